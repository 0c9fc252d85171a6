"""Sets and surfaces of Abaqus and CalculiX input files, as one scope of names and numbers has them.

A scope is a part in one of its places, or the assembly, which reaches into the others by ``INSTANCE=`` and by names
like ``Plate-1.Edge``.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from .._memory import free_memory
from .._types import Longs
from .abaqus_text import Section, rows_of
from .entries import whole

_LARGEST_RANGES = 100  # numbers that a set generates, for each that there is
# corners of the faces S1, S2, ... of an element, by its shape
_FACES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 2), (0, 3, 1), (1, 3, 2), (2, 3, 0)),
    "wedge": ((0, 1, 2), (3, 5, 4), (0, 3, 4, 1), (1, 4, 5, 2), (2, 5, 3, 0)),
    "hexahedron": ((0, 1, 2, 3), (4, 7, 6, 5), (0, 4, 5, 1), (1, 5, 6, 2), (2, 6, 7, 3), (3, 7, 4, 0)),
}


class Unread(ValueError):
    """A surface that is left out, with the reason."""


@dataclass
class Numbered:
    """Numbers of a file, sorted, and the place of each in the body that is put together."""

    numbers: Longs = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    places: Longs = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def find(self, wanted: Longs) -> tuple[Longs, Longs]:
        """Return the places of numbers, and those that are not there."""
        if not len(self.numbers):
            return self.places, wanted
        at = np.minimum(np.searchsorted(self.numbers, wanted), len(self.numbers) - 1)
        found = self.numbers[at] == wanted
        return self.places[at[found]], wanted[~found]


@dataclass
class Listed:
    """Nodes or elements that name their set where they are listed."""

    kind: str  # NSET or ELSET
    name: str
    numbers: Longs


@dataclass
class Scope:
    """Nodes, elements, sets and surfaces by number and by name (in capitals), their members by place in the body."""

    nodes: Numbered = field(default_factory=Numbered)
    elements: Numbered = field(default_factory=Numbered)
    node_sets: dict[str, Longs] = field(default_factory=dict)
    element_sets: dict[str, Longs] = field(default_factory=dict)
    surfaces: dict[str, Longs] = field(default_factory=dict)  # (n, 2): element, face
    hidden: set[tuple[str, str]] = field(default_factory=set)  # keyword and name

    def sets(self, kind: str) -> dict[str, Longs]:
        """Return the sets of nodes, or those of elements."""
        return self.node_sets if kind == "NSET" else self.element_sets

    def numbered(self, kind: str) -> Numbered:
        """Return the nodes, or the elements."""
        return self.nodes if kind == "NSET" else self.elements


@dataclass(frozen=True, eq=False)
class Cells:
    """All elements of the body: blocks (type, kind as meshio names it, nodes by place), and where each element is."""

    blocks: list[tuple[str, str, Longs]]
    block: Longs
    row: Longs

    def by_block(self, places: Longs) -> Iterator[tuple[int, Longs]]:
        """Yield the blocks of elements, with their rows there."""
        blocks = self.block[places]
        for block in np.unique(blocks).tolist():
            yield block, self.row[places[blocks == block]]


def add_set(section: Section | Listed, scope: Scope, others: Mapping[str, Scope], cells: Cells) -> None:
    """Add the set or surface of a section to its scope. Raises ``ValueError``, :class:`Unread` for surfaces."""
    if isinstance(section, Listed):
        places, _ = scope.numbered(section.kind).find(section.numbers)
        _join(scope.sets(section.kind), section.name, places)
        return
    if section.keyword == "SURFACE":
        _add_surface(section, scope, others, cells)
        return
    kind = section.keyword
    section.only("NSET", "ELSET", "INSTANCE", "GENERATE", "INTERNAL", "UNSORTED")
    name = section[kind].upper()
    of = _scope_of(section, scope, others)
    if "GENERATE" in section.parameters:
        members = _generated(section, of.numbered(kind))
    else:
        members = _members(section, kind, section.fields(), of, scope, others)
    if kind == "NSET" and "ELSET" in section.parameters:
        chosen = _members(section, "ELSET", [section["ELSET"]], of, scope, others)
        nodes = [cells.blocks[block][2][rows].ravel() for block, rows in cells.by_block(chosen)]
        members = np.concatenate([members, *nodes])
    _join(scope.sets(kind), name, members)
    if "INTERNAL" in section.parameters:
        scope.hidden.add((kind, name))


def _join(sets: dict[str, Longs], name: str, members: Longs) -> None:
    """Add members to a set, which has each of them once. Raises ``ValueError`` where the memory is too small for it."""
    if 16 * len(members) > free_memory():
        raise ValueError(f"its set {name[:60]} of {len(members)} members needs more memory than is free")
    sets[name] = np.union1d(sets.get(name, np.zeros(0, dtype=np.int64)), members)


def _scope_of(section: Section, scope: Scope, others: Mapping[str, Scope]) -> Scope:
    """The scope whose numbers a section lists."""
    if "INSTANCE" not in section.parameters:
        return scope
    name = section["INSTANCE"].upper()
    if name not in others:
        raise ValueError(
            f"line {section.line}: *{section.keyword} is of the instance {section['INSTANCE'][:60]}, "
            "which the file does not have"
        )
    return others[name]


def _members(
    section: Section, kind: str, entries: list[str], of: Scope, scope: Scope, others: Mapping[str, Scope]
) -> Longs:
    """The places of the numbers and sets that a section lists."""
    numbers = [int(entry) for entry in entries if re.fullmatch(r"[+-]?\d{1,18}", entry)]
    parts = [_found(section, of.numbered(kind), numbers)]
    for entry in entries:
        if re.fullmatch(r"[+-]?\d{1,18}", entry):
            continue
        key = entry.upper()
        within, _, rest = key.partition(".")
        if key in of.sets(kind):
            parts.append(of.sets(kind)[key])
        elif key in scope.sets(kind):
            parts.append(scope.sets(kind)[key])
        elif within in others and rest.isdigit():
            parts.append(_found(section, others[within].numbered(kind), [int(rest)]))
        elif within in others and rest in others[within].sets(kind):
            parts.append(others[within].sets(kind)[rest])
        else:
            raise ValueError(
                f"line {section.line}: *{section.keyword} lists {entry[:60]!r}, which is neither a number nor a "
                "set that stands before it"
            )
    return np.unique(np.concatenate(parts))


def _found(section: Section, numbered: Numbered, numbers: list[int]) -> Longs:
    places, missing = numbered.find(np.array(numbers, dtype=np.int64))
    if len(missing):
        raise ValueError(
            f"line {section.line}: *{section.keyword} lists {missing[0]}, and the file has none of that number"
        )
    return places


def _generated(section: Section, numbered: Numbered) -> Longs:
    """The places of ranges of numbers."""
    parts, total = [np.zeros(0, dtype=np.int64)], 0
    for row, text in zip(rows_of(section), section.data, strict=True):
        if not 2 <= len(row) <= 3:
            raise ValueError(
                f"below line {section.line}: {text[:60]!r} has {len(row)} numbers; GENERATE takes a first, a last "
                "and a step"
            )
        first, last, step = whole([*row, 1.0][:3], f"below line {section.line}: ").tolist()
        count = (last - first) // max(step, 1) + 1
        total += max(count, 0)
        if step < 1 or count > len(numbered.numbers) or total > _LARGEST_RANGES * len(numbered.numbers):
            raise ValueError(f"below line {section.line}: {text[:60]!r} generates numbers that the file does not have")
        places, missing = numbered.find(np.arange(first, last + 1, step, dtype=np.int64))
        if len(missing):
            raise ValueError(
                f"below line {section.line}: {text[:60]!r} generates {missing[0]}, and the file has none of that number"
            )
        parts.append(places)
    return np.unique(np.concatenate(parts))


def _add_surface(section: Section, scope: Scope, others: Mapping[str, Scope], cells: Cells) -> None:
    name = section["NAME"].upper()
    if "INTERNAL" in section.parameters:
        scope.hidden.add(("SURFACE", name))
    if not set(section.parameters) <= {"NAME", "TYPE", "INTERNAL", "INSTANCE"}:
        raise Unread(f"has parameters that are not read: {', '.join(section.parameters)[:60]}")
    of = _scope_of(section, scope, others)
    kind = section.parameters.get("TYPE", "ELEMENT").upper()
    rows = [[entry.strip().strip('"') for entry in row.split(",")] for row in section.data]
    if kind == "NODE":
        members = _members(section, "NSET", [row[0] for row in rows], of, scope, others)
        _join(scope.node_sets, name, members)
        return
    if kind != "ELEMENT":
        raise Unread(f"has the type {kind[:60]}, which is not read: ELEMENT and NODE are")
    parts = [scope.surfaces.get(name, np.zeros((0, 2), dtype=np.int64))]
    for row in rows:
        chosen = _members(section, "ELSET", row[:1], of, scope, others)
        face = row[1].upper() if len(row) > 1 else ""
        for block in np.unique(cells.block[chosen]).tolist():
            number = _face(face, *cells.blocks[block][:2])
            parts.append(np.array([(cell, number) for cell in chosen[cells.block[chosen] == block].tolist()]))
    scope.surfaces[name] = np.unique(np.concatenate(parts), axis=0)


def _face(name: str, of_type: str, kind: str) -> int:
    """The number of a face by its name: of a shell, S1 and S2 are its sides, E1 (in CalculiX S3) its first edge."""
    shape = kind.rstrip("0123456789")
    is_shell = re.match(r"D?S\d|STRI|M3D|SFM3D|R3D", of_type) is not None
    found = re.fullmatch(r"([SE])(\d)", name)
    number = -1
    if found and found[1] == "S":
        number = int(found[2]) - (3 if is_shell else 1)
    elif found and is_shell:
        number = int(found[2]) - 1
    if shape not in _FACES or not 0 <= number < len(_FACES[shape]):
        raise Unread(
            f"has the face {name[:60]!r} of an element {of_type}: the faces S1 to S6 of solids and plane elements and "
            "the edges E1 to E4 of shells are read"
        )
    return number


def corners_of(kind: str, face: int) -> tuple[int, ...]:
    """Return the corners of a face, by their place among the nodes of an element.

    >>> corners_of("quad8", 3)
    (3, 0)
    """
    return _FACES[kind.rstrip("0123456789")][face]
