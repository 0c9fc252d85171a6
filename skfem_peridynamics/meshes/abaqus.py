"""Abaqus and CalculiX input files: nodes, elements, sets, surfaces, parts and their instances.

meshio reads one list of nodes and one of elements, and numbers sets by blocks; input files have several of each, sets
of sets, and parts that are placed more than once. What is not understood of a mesh is refused by its keyword.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._types import Floats, Longs
from .mend import Raw

# keywords that make nodes or elements which do not stand in the file, or that move those that do
_GENERATED = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM", "TRANSFORM", "SUBMODEL", "MATRIX ASSEMBLE")
_DEEPEST = 8  # of files that include each other
# corners of the faces S1, S2, ... of an element, by its shape
_FACES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}
_FACET = {2: "line", 3: "triangle", 4: "quad"}


@dataclass
class Section:
    """A keyword with its parameters, its data lines and where it stands."""

    keyword: str
    parameters: dict[str, str]
    line: int
    data: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> str:
        """Return a parameter that must be there."""
        if not self.parameters.get(name):
            raise ValueError(f"line {self.line}: *{self.keyword} has no {name}=")
        return self.parameters[name]

    def fields(self) -> list[str]:
        """Return the entries of all data lines, without quotes and without empty ones at the ends of lines."""
        entries = (entry.strip().strip('"') for line in self.data for entry in line.split(","))
        return [entry for entry in entries if entry]


@dataclass
class Part:
    """Nodes and elements by their numbers, sets by their names (in capitals), as one part of a file has them."""

    nodes: dict[int, list[float]] = field(default_factory=dict)
    elements: dict[int, tuple[str, list[int]]] = field(default_factory=dict)
    node_sets: dict[str, list[int]] = field(default_factory=dict)
    element_sets: dict[str, list[int]] = field(default_factory=dict)
    surfaces: dict[str, list[tuple[int, int]]] = field(default_factory=dict)  # element, face
    hidden: set[str] = field(default_factory=set)


def read_abaqus(path: Path) -> Raw:
    """Return the mesh of an input file with all its instances in place. Raises ``ValueError`` with line and keyword."""
    names: dict[str, str] = {}  # as the file spells them first
    parts: dict[str, Part] = {}
    assembly, free = Part(), Part()
    here, instance, placed = free, None, list[tuple[str, str, list[str], int]]()
    scoped: list[tuple[Section, Part]] = []
    for section in _sections(path):
        word = section.keyword
        if word == "PART":
            here = parts.setdefault(_key(section["NAME"], names), Part())
        elif word in ("END PART", "END ASSEMBLY"):
            here = free
        elif word == "ASSEMBLY":
            here = assembly
        elif word == "INSTANCE":
            instance = section
            placed.append((section["NAME"], _key(section["PART"], names), section.data, section.line))
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
            _read_elements(section, here, names)
        elif word in ("NSET", "ELSET", "SURFACE"):
            scoped.append((section, here))
    if parts and free.nodes:
        raise ValueError("it has nodes outside its parts as well: give all of them a part, or none")
    if not parts:
        parts, placed = {"": free}, [("", "", [], 0)]
    elif not placed:
        placed = [(name, name, [], 0) for name in parts]
    for section, part in scoped:  # a set may name sets that come later
        if "INSTANCE" not in section.parameters and part is not assembly:
            _read_set(section, part, part, names)
    return _assembled(parts, placed, assembly, scoped, names)


def _key(name: str, names: dict[str, str]) -> str:
    """A name as it is looked up: Abaqus does not tell capitals apart."""
    names.setdefault(name.upper(), name)
    return name.upper()


def _sections(path: Path, depth: int = 0) -> Iterator[Section]:
    """Yield the keywords of a file and of those it includes."""
    if not path.is_file():
        raise ValueError(f"it includes {str(path)!r}, which is not a file")
    if depth > _DEEPEST:
        raise ValueError(f"it includes files more than {_DEEPEST} deep, the last is {str(path)!r}")
    current: Section | None = None
    lines = iter(enumerate(path.read_text(errors="replace").splitlines(), 1))
    for number, line in lines:
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        if not text.startswith("*"):
            if current is None:
                raise ValueError(f"line {number} stands before the first keyword")
            current.data.append(text)
            continue
        if current is not None:
            yield current
        while text.endswith(","):  # a keyword line that goes on
            more = next(lines, None)
            if more is None:
                raise ValueError(f"line {number}: the file ends in a keyword line that goes on")
            text += more[1].strip()
        word, *options = (entry.strip() for entry in text[1:].split(","))
        parameters = {}
        for option in options:
            name, _, value = option.partition("=")
            if name.strip().isdigit():
                raise ValueError(f"line {number}: *{word} goes on into a row of numbers: its line ends in a comma")
            parameters[name.strip().upper()] = value.strip().strip('"')
        current = Section(" ".join(word.upper().split()), parameters, number)
        if current.keyword == "INCLUDE":
            yield from _sections(path.parent / current["INPUT"], depth + 1)
            current = None
    if current is not None:
        yield current


def _numbers(text: str, line: int) -> list[float]:
    try:
        # an empty entry is 0, but for the comma that ends a line
        entries = text.rstrip(", \t").split(",")
        return [float(entry.replace("D", "E").replace("d", "e")) if entry.strip() else 0.0 for entry in entries]
    except ValueError as error:
        raise ValueError(f"below line {line}: {text[:60]!r} is not a row of numbers ({error})") from None


def _read_nodes(section: Section, part: Part, names: dict[str, str]) -> None:
    listed = []
    for text in section.data:
        number, *x = _numbers(text, section.line)
        if not 1 <= len(x) <= 6:
            raise ValueError(f"below line {section.line}: node {number:g} has {len(x)} coordinates")
        part.nodes[int(number)] = [*x[:3], 0.0, 0.0][:3]
        listed.append(int(number))
    if section.parameters.get("NSET"):
        part.node_sets.setdefault(_key(section.parameters["NSET"], names), []).extend(listed)


def _read_elements(section: Section, part: Part, names: dict[str, str]) -> None:
    from meshio._mesh import num_nodes_per_cell
    from meshio.abaqus._abaqus import abaqus_to_meshio_type

    kind = abaqus_to_meshio_type.get(section["TYPE"].upper())
    if kind is None:
        raise ValueError(
            f"line {section.line}: elements of type {section['TYPE']} are not known: lines, triangles, quadrilaterals, "
            "tetrahedra, wedges and hexahedra are"
        )
    size = 1 + num_nodes_per_cell[kind]
    entries = [int(number) for text in section.data for number in _numbers(text, section.line)]
    if len(entries) % size:
        raise ValueError(f"below line {section.line}: elements of type {section['TYPE']} have {size - 1} nodes each")
    listed = []
    for k in range(0, len(entries), size):
        part.elements[entries[k]] = kind, entries[k + 1 : k + size]
        listed.append(entries[k])
    if section.parameters.get("ELSET"):
        part.element_sets.setdefault(_key(section.parameters["ELSET"], names), []).extend(listed)


def _read_set(section: Section, into: Part, of: Part, names: dict[str, str]) -> None:
    """Put a set or a surface of the nodes and elements ``of`` a part into it (or into the assembly)."""
    if section.keyword == "SURFACE":
        _read_surface(section, into, of, names)
        return
    of_nodes = section.keyword == "NSET"
    name = _key(section["NSET" if of_nodes else "ELSET"], names)
    known, sets = (of.nodes, of.node_sets) if of_nodes else (of.elements, of.element_sets)
    members = _members(section, known, sets)
    if of_nodes and section.parameters.get("ELSET"):
        chosen = of.element_sets.get(section.parameters["ELSET"].upper(), [])
        members += [node for number in chosen for node in of.elements[number][1]]
    (into.node_sets if of_nodes else into.element_sets).setdefault(name, []).extend(members)
    if "INTERNAL" in section.parameters:
        into.hidden.add(name)


def _members(section: Section, known: Mapping[int, object], sets: Mapping[str, list[int]]) -> list[int]:
    """The numbers that a set lists, generates or takes from other sets."""
    fields = section.fields()
    if "GENERATE" in section.parameters:
        out: list[int] = []
        for text in section.data:
            first, last, step = (int(x) for x in (*_numbers(text, section.line), 1.0)[:3])
            if step < 1 or (last - first) // step >= len(known):
                raise ValueError(
                    f"below line {section.line}: {text[:60]!r} generates numbers that the file does not have"
                )
            out += range(first, last + 1, step)
    else:
        out = []
        for entry in fields:
            if entry.lstrip("+-").isdigit():
                out.append(int(entry))
            elif entry.upper() in sets:
                out += sets[entry.upper()]
            else:
                raise ValueError(
                    f"line {section.line}: *{section.keyword} lists {entry[:60]!r}, which is neither a number nor a "
                    "set that stands before it"
                )
    missing = [number for number in out if number not in known]
    if missing:
        raise ValueError(
            f"line {section.line}: *{section.keyword} lists {missing[0]}, and the file has none of that number"
        )
    return out


def _read_surface(section: Section, into: Part, of: Part, names: dict[str, str]) -> None:
    name = _key(section["NAME"], names)
    if section.parameters.get("TYPE", "ELEMENT").upper() == "NODE":
        members = _members(
            Section("NSET", {}, section.line, [row.split(",")[0] for row in section.data]), of.nodes, of.node_sets
        )
        into.node_sets.setdefault(name, []).extend(members)
        return
    faces = into.surfaces.setdefault(name, [])
    for row in section.data:
        entry, _, face = (part.strip() for part in row.partition(","))
        if face.upper() not in {f"S{k}" for k in range(1, 7)}:
            raise ValueError(
                f"below line {section.line}: *SURFACE {section['NAME']} has the face {face[:60]!r}: faces S1 to S6 of "
                "elements are read"
            )
        members = _members(Section("ELSET", {}, section.line, [entry]), of.elements, of.element_sets)
        faces += [(number, int(face[1:]) - 1) for number in members]


def _place(data: Sequence[str], points: Floats, line: int) -> Floats:
    """Points where an instance puts them: a translation, then a rotation about an axis through two points."""
    rows = [_numbers(text, line) for text in data]
    if rows:
        points = points + np.array([*rows[0][:3], 0.0, 0.0, 0.0][:3])
    if len(rows) > 1:
        if len(rows[1]) != 7:
            raise ValueError(f"below line {line}: a rotation has two points and an angle, seven numbers")
        a, b = np.array(rows[1][:3]), np.array(rows[1][3:6])
        angle, axis = np.radians(rows[1][6]), (b - a) / np.linalg.norm(b - a)
        x = points - a
        # Rodrigues: x cos + (axis x x) sin + axis (axis.x) (1 - cos)
        turned = x * np.cos(angle) + np.cross(axis, x) * np.sin(angle)
        points = a + turned + np.outer(x @ axis, axis) * (1.0 - np.cos(angle))
    return points


def _assembled(
    parts: Mapping[str, Part],
    placed: Sequence[tuple[str, str, list[str], int]],
    assembly: Part,
    scoped: Sequence[tuple[Section, Part]],
    names: dict[str, str],
) -> Raw:
    """Put all instances together: one list of points, blocks by kind of element, groups by name."""
    points: list[Floats] = []
    blocks: dict[str, list[list[int]]] = {}
    tags: dict[str, dict[str, list[int]]] = {}
    points_of: dict[str, list[int]] = {}
    by_instance: dict[str, tuple[Part, dict[int, int], dict[int, tuple[str, int]]]] = {}
    first = 0
    for name, part_name, data, line in placed:
        if part_name not in parts:
            raise ValueError(
                f"line {line}: *INSTANCE {name} is of the part {part_name!r}, which the file does not have"
            )
        part = parts[part_name]
        numbers = {node: first + k for k, node in enumerate(part.nodes)}
        points.append(_place(data, np.array(list(part.nodes.values())).reshape(-1, 3), line))
        first += len(numbers)
        cells: dict[int, tuple[str, int]] = {}
        for number, (kind, nodes) in part.elements.items():
            if any(node not in numbers for node in nodes):
                raise ValueError(f"element {number} has a node that the file does not have")
            block = blocks.setdefault(kind, [])
            cells[number] = kind, len(block)
            block.append([numbers[node] for node in nodes])
        by_instance[name.upper()] = part, numbers, cells
        _collect(part, numbers, cells, blocks, tags, points_of)
    for section, part in scoped:
        if part is not assembly:
            continue
        # sets of the assembly: of one instance, or made of other sets of the assembly
        of, numbers, cells = by_instance.get(section.parameters.get("INSTANCE", "").upper(), (assembly, {}, {}))
        into = Part()
        _read_set(section, into, of, names)
        assembly.hidden |= into.hidden
        _collect(into, numbers, cells, blocks, tags, points_of, of)
        for sets, own in ((assembly.node_sets, into.node_sets), (assembly.element_sets, into.element_sets)):
            for key, members in own.items():
                sets.setdefault(key, []).extend(members)
    hidden = assembly.hidden.union(*(part.hidden for part in parts.values()))
    order = list(blocks)
    return Raw(
        np.concatenate(points) if points else np.zeros((0, 3)),
        [(kind.partition(" ")[0], np.array(blocks[kind], dtype=np.int64)) for kind in order],
        {
            names.get(key, key): [_unique(of_kind.get(kind)) for kind in order]
            for key, of_kind in tags.items()
            if key not in hidden
        },
        {
            names.get(key, key): np.unique(np.array(members, dtype=np.int64))
            for key, members in points_of.items()
            if key not in hidden
        },
    )


def _unique(cells: list[int] | None) -> Longs | None:
    return None if cells is None else np.unique(np.array(cells, dtype=np.int64))


def _collect(
    part: Part,
    numbers: Mapping[int, int],
    cells: Mapping[int, tuple[str, int]],
    blocks: dict[str, list[list[int]]],
    tags: dict[str, dict[str, list[int]]],
    points_of: dict[str, list[int]],
    of: Part | None = None,
) -> None:
    """Add the sets and surfaces of a part, as one instance numbers its nodes and elements."""
    for key, members in part.node_sets.items():
        points_of.setdefault(key, []).extend(numbers[node] for node in members)
    for key, members in part.element_sets.items():
        for number in members:
            kind, cell = cells[number]
            tags.setdefault(key, {}).setdefault(kind, []).append(cell)
    for key, faces in part.surfaces.items():
        for number, face in faces:
            kind, nodes = (of or part).elements[number]
            shape = kind.rstrip("0123456789")
            if shape not in _FACES or face >= len(_FACES[shape]):
                raise ValueError(f"surface {key}: an element {kind} has no face S{face + 1}")
            corners = [numbers[nodes[k]] for k in _FACES[shape][face]]
            facet = f"{_FACET[len(corners)]} of surfaces"
            block = blocks.setdefault(facet, [])
            tags.setdefault(key, {}).setdefault(facet, []).append(len(block))
            block.append(corners)
