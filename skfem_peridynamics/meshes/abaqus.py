"""Abaqus and CalculiX input files: nodes, elements, sets, surfaces, parts and their instances.

meshio reads one list of nodes and one of elements, and numbers sets by blocks; input files have several of each, sets
of sets, and parts that are placed more than once. What is not understood of a mesh is refused by its keyword.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._types import Floats, Longs
from .abaqus_sets import Cells, Listed, Numbered, Scope, Unread, add_set, corners_of
from .abaqus_text import Section, numbers_of, rows_of, sections
from .entries import once, whole
from .mend import Raw

# keywords that make nodes or elements which do not stand in the file, or that move those that do
_GENERATED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "TRANSFORM", "SUBMODEL", "MATRIX ASSEMBLE")
# elements by the family of their type and its first number: how many nodes, and the kind
_PLANE = {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8", 9: "quad9"}
_SOLID = {4: "tetra", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20", 27: "hexahedron27"}
_FAMILIES: Sequence[tuple[str, Mapping[int, str]]] = (
    (r"(?:CPS|CPEG?|CAX|CGAX|DC2D|AC2D|DCAX|D?S|STRI|M3D|SFM3D|R3D)(\d)", _PLANE),
    (r"(?:C3D|DC3D|AC3D|SC|CSS)(\d+)", _SOLID),
    (r"(?:T[23]D|R2D)([23])", {2: "line", 3: "line3"}),
    (r"B[23](\d)", {1: "line", 2: "line3", 3: "line"}),
)
_FACET = {2: "line", 3: "triangle", 4: "quad"}


@dataclass
class Part:
    """What stands in a part: nodes (numbers, coordinates), elements (type, numbers, nodes), sets in their order."""

    name: str = ""
    nodes: list[tuple[Longs, Floats]] = field(default_factory=list)
    elements: list[tuple[str, Longs, Longs]] = field(default_factory=list)
    sets: list[Section | Listed] = field(default_factory=list)


@dataclass(frozen=True)
class Instance:
    """A part in one of its places."""

    name: str
    part: str
    place: Section | None = None


_MOST_PLACED = 5_000_000  # nodes of all instances: a part may be placed again and again


def read_abaqus(path: Path) -> Raw:
    """Return the mesh of an input file with all its instances in place. Raises ``ValueError`` with line and keyword."""
    names: dict[str, str] = {}  # as the file spells them first
    parts: dict[str, Part] = {}
    assembly, free = Part(), Part()
    here, instance, placed = free, None, list[Instance]()
    for section in sections(path):
        word = section.keyword
        if word == "PART":
            key = _key(section["NAME"], names)
            if key in parts:
                raise ValueError(f"line {section.line}: there are two parts of the name {section['NAME'][:60]}")
            here = parts[key] = Part(key)
        elif word in ("END PART", "END ASSEMBLY"):
            here = free
        elif word == "ASSEMBLY":
            here = assembly
        elif word == "INSTANCE":
            instance = section
            placed.append(Instance(_key(section["NAME"], names), _key(section["PART"], names), section))
        elif word == "END INSTANCE":
            instance = None
        elif word in _GENERATED or (word == "NODE" and "SYSTEM" in section.parameters):
            raise ValueError(
                f"line {section.line}: *{word} makes or moves nodes and elements that the file does not list: write "
                "the mesh out in full (from Abaqus/CAE: write the input of a job), or export it in another format"
            )
        elif instance is not None and word in ("NODE", "ELEMENT", "NSET", "ELSET"):
            raise ValueError(f"line {section.line}: *{word} inside *INSTANCE is not read: put it into the part")
        elif word == "NODE":
            _read_nodes(section, here, names)
        elif word == "ELEMENT":
            if here is assembly:
                raise ValueError(
                    f"line {section.line}: *ELEMENT in the assembly is not read: elements belong into parts"
                )
            _read_elements(section, here, names)
        elif word in ("NSET", "ELSET", "SURFACE"):
            _key(section["NAME" if word == "SURFACE" else word], names)
            here.sets.append(section)
    if parts and (free.nodes or free.elements or free.sets):
        raise ValueError("it has nodes, elements or sets outside its parts as well: give all of them a part, or none")
    if not parts:
        parts, placed = {"": free}, [Instance("", "")]
    elif not placed:
        placed = [Instance(name, name) for name in parts]
    return _assembled(parts, placed, assembly, names)


def _key(name: str, names: dict[str, str]) -> str:
    """A name as it is looked up: Abaqus does not tell capitals apart."""
    names.setdefault(name.upper(), name)
    return name.upper()


def _read_nodes(section: Section, part: Part, names: dict[str, str]) -> None:
    section.only("NSET", "INPUT")
    rows = rows_of(section)
    for row in rows:
        if not 2 <= len(row) <= 7:
            raise ValueError(f"below line {section.line}: node {row[0]:g} has {len(row) - 1} coordinates")
    numbers = whole([row[0] for row in rows], f"below line {section.line}: ")
    x = np.array([[*row[1:4], 0.0, 0.0][:3] for row in rows]).reshape(-1, 3)
    part.nodes.append((numbers, x))
    if section.parameters.get("NSET"):
        part.sets.append(Listed("NSET", _key(section.parameters["NSET"], names), numbers))


def kind_of_type(name: str) -> str | None:
    """Return the kind of a type of element by its name in meshio; None of one that is not known.

    >>> kind_of_type("CPE4R"), kind_of_type("C3D10M"), kind_of_type("STRI65"), kind_of_type("SPRINGA")
    ('quad', 'tetra10', 'triangle6', None)
    """
    for pattern, kinds in _FAMILIES:
        found = re.match(pattern, name.upper())
        if found:
            return kinds.get(int(found[1]))
    return None


def _read_elements(section: Section, part: Part, names: dict[str, str]) -> None:
    from meshio._mesh import num_nodes_per_cell

    section.only("TYPE", "ELSET", "INPUT")
    kind = kind_of_type(section["TYPE"])
    if kind is None:
        raise ValueError(
            f"line {section.line}: elements of type {section['TYPE']} are not known: lines, triangles, quadrilaterals, "
            "tetrahedra, wedges and hexahedra are"
        )
    size = 1 + int(num_nodes_per_cell[kind])
    rows: list[list[float]] = []
    open_row: list[float] = []
    for row in rows_of(section):  # an element may take several lines, and the next one starts on its own
        open_row += row
        if len(open_row) == size:
            rows.append(open_row)
            open_row = []
        elif len(open_row) > size:
            break
    if open_row:
        raise ValueError(
            f"below line {section.line}: elements of type {section['TYPE']} have {size - 1} nodes each, and element "
            f"{open_row[0]:g} has {len(open_row) - 1}"
        )
    table = whole(np.array(rows).reshape(-1, size), f"below line {section.line}: ")
    part.elements.append((section["TYPE"].upper(), table[:, 0], table[:, 1:]))
    if section.parameters.get("ELSET"):
        part.sets.append(Listed("ELSET", _key(section.parameters["ELSET"], names), table[:, 0]))


def _place(instance: Instance, points: Floats) -> Floats:
    """Points where an instance puts them: a translation, then a rotation about an axis through two points."""
    if instance.place is None:
        return points
    line = instance.place.line
    rows = [numbers_of(text, line) for text in instance.place.data]
    if len(rows) > 2:
        raise ValueError(f"below line {line}: an instance has a translation and a rotation, two rows of numbers")
    if rows:
        points = points + np.array([*rows[0][:3], 0.0, 0.0, 0.0][:3])
    if len(rows) > 1:
        if len(rows[1]) != 7:
            raise ValueError(f"below line {line}: a rotation has two points and an angle, seven numbers")
        a, b = np.array(rows[1][:3]), np.array(rows[1][3:6])
        length = float(np.linalg.norm(b - a))
        if not 0.0 < length < np.inf:
            raise ValueError(f"below line {line}: a rotation has two different points on its axis, not {rows[1][:6]}")
        angle, axis = np.radians(rows[1][6]), (b - a) / length
        x = points - a
        # Rodrigues: x cos + (axis x x) sin + axis (axis.x) (1 - cos)
        turned = x * np.cos(angle) + np.cross(axis, x) * np.sin(angle)
        points = a + turned + np.outer(x @ axis, axis) * (1.0 - np.cos(angle))
    return points


def _assembled(parts: Mapping[str, Part], placed: Sequence[Instance], assembly: Part, names: Mapping[str, str]) -> Raw:
    """Put all instances together: one list of points, blocks of elements, groups by name."""
    points: list[Floats] = []
    scopes: dict[str, Scope] = {}
    blocks: list[tuple[str, str, Longs]] = []
    count = placed_nodes = 0
    for instance in placed:
        if instance.part not in parts:
            line = f"line {instance.place.line}: " if instance.place else ""
            raise ValueError(
                f"{line}*INSTANCE {names[instance.name]} is of the part {names[instance.part]!r}, "
                "which the file does not have"
            )
        if instance.name in scopes:
            raise ValueError(f"there are two instances of the name {names[instance.name]}")
        nodes, x = _nodes_of(parts[instance.part], len(points) and sum(map(len, points)))
        placed_nodes += len(x)
        if placed_nodes > _MOST_PLACED:
            raise ValueError(
                f"its instances place more than {_MOST_PLACED} nodes, the last of them {instance.name[:60]}"
            )
        points.append(_place(instance, x))
        elements = _elements_of(parts[instance.part], nodes, blocks, count)
        count += len(elements.numbers)
        scopes[instance.name] = Scope(nodes, elements)
    nodes, x = _nodes_of(assembly, sum(map(len, points)))
    points.append(x)
    whole_body = Scope(nodes)
    sizes = [len(rows) for _, _, rows in blocks]
    cells = Cells(
        blocks,
        np.repeat(np.arange(len(blocks)), sizes),
        np.concatenate([np.zeros(0, dtype=np.int64), *(np.arange(size) for size in sizes)]),
    )
    notes: list[str] = []
    unread: list[str] = []
    sources = [(instance.name, instance.part, scopes[instance.name], parts[instance.part].sets) for instance in placed]
    for _, _, scope, listed in [*sources, ("", "", whole_body, assembly.sets)]:
        for section in sorted(listed, key=lambda one: isinstance(one, Section)):  # names in passing come first
            try:
                add_set(section, scope, scopes, cells)
            except Unread as reason:
                assert isinstance(section, Section)
                unread.append(section["NAME"])
                notes.append(f"line {section.line}: *SURFACE {section['NAME']} {reason}; it was left out")
    left = [name for name in parts if name not in {instance.part for instance in placed}]
    if left:
        notes.append(f"parts that no instance places were left out: {', '.join(names[name] for name in left)}")
    if any(block[0].startswith(("CAX", "CGAX", "DCAX")) for block in blocks):
        notes.append("its elements are axisymmetric there, and plane here")
    return _groups(cells, np.concatenate(points), sources, whole_body, names, notes, unread)


def _nodes_of(part: Part, first: int) -> tuple[Numbered, Floats]:
    """The nodes of a part, numbered in the body from a first place on."""
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *(numbers for numbers, _ in part.nodes)])
    x = np.concatenate([np.zeros((0, 3)), *(x for _, x in part.nodes)])
    chosen = once(numbers, x, "node")
    # in the order of the file
    places = np.empty(len(chosen), dtype=np.int64)
    places[np.argsort(chosen)] = first + np.arange(len(chosen))
    return Numbered(numbers[chosen], places), x[np.sort(chosen)]


def _elements_of(part: Part, nodes: Numbered, blocks: list[tuple[str, str, Longs]], first: int) -> Numbered:
    """Add the elements of a part to the blocks of the body, and return their numbers."""
    numbers = np.concatenate([np.zeros(0, dtype=np.int64), *(numbers for _, numbers, _ in part.elements)])
    width = max((rows.shape[1] for *_, rows in part.elements), default=0)
    padded = [np.pad(rows, ((0, 0), (0, width - rows.shape[1]))) for *_, rows in part.elements]
    chosen = np.sort(once(numbers, np.concatenate([np.zeros((0, width), dtype=np.int64), *padded]), "element"))
    start = 0
    for name, own, rows in part.elements:
        mine = chosen[(chosen >= start) & (chosen < start + len(own))] - start
        start += len(own)
        places, missing = nodes.find(rows[mine].ravel())
        if len(missing):
            bad = own[mine][np.isin(rows[mine], missing).any(axis=1)][0]
            raise ValueError(f"element {bad} has a node that the file does not have: {missing[0]}")
        kind = kind_of_type(name)
        assert kind is not None  # as it was read
        blocks.append((name, kind, places.reshape(rows[mine].shape)))
    order = np.argsort(numbers[chosen], kind="stable")
    return Numbered(numbers[chosen][order], first + order)


def _groups(
    cells: Cells,
    points: Floats,
    sources: Sequence[tuple[str, str, Scope, object]],
    assembly: Scope,
    names: Mapping[str, str],
    notes: list[str],
    unread: Sequence[str],
) -> Raw:
    """The body with its groups by name; sets of one name in several parts have the name of their instance before it."""
    blocks = [(kind, rows) for _, kind, rows in cells.blocks]
    tags: dict[str, list[Longs | None]] = {name: [] for name in unread}
    points_of: dict[str, Longs] = {}
    for kind in ("ELSET", "NSET", "SURFACE"):
        found: dict[str, list[tuple[str, str, Longs]]] = {}  # owner, instance, members
        for instance, part, scope, _ in [*sources, ("", "the assembly", assembly, None)]:
            sets = scope.surfaces if kind == "SURFACE" else scope.sets(kind)
            for key, members in sets.items():
                if (kind, key) not in scope.hidden:
                    found.setdefault(key, []).append((part, instance, members))
        for key, listed in found.items():
            own = names.get(key, key)
            apart = len({part for part, _, _ in listed}) > 1
            if apart:
                notes.append(
                    f"{own!r} is a *{kind} of several parts: it is called "
                    + ", ".join(repr(f"{names[i]}.{own}" if i else own) for _, i, _ in listed)
                )
            for _, instance, members in listed:
                name = f"{names[instance]}.{own}" if apart and instance else own
                if kind == "NSET":
                    points_of[name] = np.union1d(points_of.get(name, members), members)
                elif kind == "ELSET":
                    _tag(tags.setdefault(name, []), cells, members)
                else:
                    _add_facets(tags.setdefault(name, []), blocks, cells, members)
    return Raw(points, blocks, tags, points_of, notes=notes)


def _tag(of_blocks: list[Longs | None], cells: Cells, members: Longs) -> None:
    """Add elements to a group."""
    for block, rows in cells.by_block(members):
        of_blocks += [None] * (block + 1 - len(of_blocks))
        before = of_blocks[block]
        of_blocks[block] = rows if before is None else np.union1d(before, rows)


def _add_facets(of_blocks: list[Longs | None], blocks: list[tuple[str, Longs]], cells: Cells, members: Longs) -> None:
    """Add faces of elements to the blocks, and to a group."""
    for face in np.unique(members[:, 1]).tolist():
        for block, rows in cells.by_block(members[members[:, 1] == face, 0]):
            _, kind, nodes = cells.blocks[block]
            corners = corners_of(kind, face)
            blocks.append((_FACET[len(corners)], nodes[rows][:, corners]))
            of_blocks += [None] * (len(blocks) - 1 - len(of_blocks))
            of_blocks.append(np.arange(len(rows)))
