"""Gmsh's own files, versions 2.2 and 4.1, text and binary: what they declare of groups, and the elements of each.

meshio loses groups here: of entities that were taken reversed (their tags have a sign), of several groups on one
entity, of elements that are saved without one (Mesh.SaveAll), of names that stand for a boundary and a region.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .._files import open_regular
from .._types import Floats, Longs
from .entries import content_of, decoded, once, whole
from .mend import Raw

VERSIONS = ("2.2", "4.1")
_MOST_GROUPS = 100  # that an entity is in
_MOST_MEMBERS = 10_000_000  # of all groups, where that is more than four an element
_SECTION = re.compile(rb"\$(\w+)[ \t\r]*\n")
_CURE = "with Mesh.SaveAll version 2.2 writes elements without their groups; save with Mesh.SaveAll = 0, or version 4.1"


class Cursor:
    """Numbers of a section one after the other: of text, or of bytes in the order of the machine that wrote them."""

    def __init__(self, content: bytes, at: int, binary: bool, order: str = "<") -> None:
        self.content, self.at, self.binary, self.order = content, at, binary, order
        self._numbers: Floats | None = None
        self._next = 0
        if not binary:
            end = content.find(b"$End", at)
            self._numbers = _numbers(content[at : end if end >= 0 else None].split())

    def _take(self, count: int, kind: str) -> np.ndarray[tuple[int, ...], np.dtype[np.generic]]:
        if count < 0:
            raise ValueError(f"a count of {count} is none")
        if self._numbers is not None:
            taken = self._numbers[self._next : self._next + count]
            self._next += count
        else:
            dtype = np.dtype(self.order + kind)
            section = self.content[self.at : self.at + count * dtype.itemsize]
            taken = np.frombuffer(section[: len(section) // dtype.itemsize * dtype.itemsize], dtype=dtype)
            self.at += count * dtype.itemsize
        if len(taken) < count:
            raise ValueError("it ends in the middle of a section")
        return taken

    def ints(self, count: int) -> Longs:
        """Return whole numbers of four bytes."""
        return whole(self._take(count, "i4"), "", "a whole number")

    def sizes(self, count: int) -> Longs:
        """Return whole numbers of eight bytes."""
        return whole(self._take(count, "u8"), "", "a whole number")

    def count(self) -> int:
        """Return how many of something follow."""
        number = int(self.sizes(1)[0])
        if number < 0:
            raise ValueError(f"a count of {number} is none")
        return number

    def doubles(self, count: int) -> Floats:
        """Return doubles."""
        return self._take(count, "f8").astype(float)

    def finish(self, section: str) -> int:
        """Return where the section ends. Raises ``ValueError`` where it goes on."""
        if self._numbers is not None:
            left = len(self._numbers) - self._next
        else:
            end = self.content.find(b"$End", self.at)
            left = len(self.content[self.at : end if end >= 0 else None].strip())
        if left:
            unit = "bytes" if self.binary else "numbers"
            raise ValueError(f"its section {section} goes on beyond what it declares, by {left} {unit}")
        return self.at


def _numbers(entries: list[bytes]) -> Floats:
    try:
        return np.array(entries, dtype=float)
    except ValueError as error:
        raise ValueError(f"it has a word where a number belongs ({error})") from None


@dataclass
class File:
    """What the sections of a file hold: nodes by number, elements by kind with the groups of each run of them."""

    names: dict[tuple[int, int], str] = field(default_factory=dict)  # of a dimension and a number
    groups: dict[tuple[int, int], Longs] = field(default_factory=dict)  # of an entity, by dimension and tag
    numbers: list[Longs] = field(default_factory=list)
    points: list[Floats] = field(default_factory=list)
    # kind, nodes (n, k), groups of all of them (m,) or of each (n, m)
    elements: list[tuple[int, Longs, Longs]] = field(default_factory=list)


def version_of(path: Path) -> str | None:
    """Return the version of a file of Gmsh's, None of any other.

    >>> version_of(Path("nothing.geo")) is None
    True
    """
    if path.suffix.lower() != ".msh" or not path.is_file():
        return None
    with open_regular(path) as file:
        found = re.match(
            rb"(?:\xef\xbb\xbf)?\s*(?:\$Comments.*?\$EndComments\s*)?\$MeshFormat\s+(\d+(?:\.\d+)?)",
            file.read(4096),
            re.S,
        )
    return found[1].decode() if found else None


def read_gmsh(path: Path) -> Raw:
    """Return nodes, elements and groups of a file of version 2.2 or 4.1. Raises ``ValueError``."""
    content = content_of(path)
    header = re.search(rb"\$MeshFormat\s+(\S+)[ \t]+([01])[ \t]+8[ \t\r]*\n", content)
    if header is None:
        raise ValueError("its $MeshFormat is not a version, 0 or 1 for text or binary, and the size 8 of its numbers")
    version, binary = header.groups()
    old, is_binary, order = version.startswith(b"2"), binary == b"1", "<"
    at = header.end()
    if is_binary:
        order = "<" if content[at : at + 4] == b"\x01\x00\x00\x00" else ">"
        at += 4
    file = File()
    while match := _SECTION.search(content, at):
        section, at = match[1].decode(), match.end()
        if section.startswith("End"):
            continue
        if section == "PhysicalNames":
            _read_names(content[at : content.find(b"$End", at)], file)
        elif section in ("Entities", "PartitionedEntities"):
            cursor = Cursor(content, at, is_binary, order)
            _read_entities(cursor, section == "PartitionedEntities", file)
            at = cursor.finish(section)
        elif section == "Nodes":
            at = (_read_nodes_2 if old else _read_nodes_4)(content, at, is_binary, order, file)
        elif section == "Elements":
            at = (_read_elements_2 if old else _read_elements_4)(content, at, is_binary, order, file)
        end = content.find(b"$End" + match[1], at)
        at = end if end >= 0 else len(content)
    return _raw(file)


def _read_names(text: bytes, file: File) -> None:
    found = re.findall(rb'^[ \t]*(\d)[ \t]+(-?\d{1,18})[ \t]+"(.*)"[ \t\r]*$', text, re.M)
    for dim, number, name in found:
        file.names[int(dim), abs(int(number))] = decoded(name)
    declared = text.split(None, 1)[:1]
    if declared != [b"%d" % len(found)]:
        raise ValueError(f"it declares {decoded(b''.join(declared))[:20]} names of groups and lists {len(found)}")


def _read_entities(cursor: Cursor, partitioned: bool, file: File) -> None:
    if partitioned:
        cursor.sizes(1)  # partitions
        for _ in range(cursor.count()):  # ghost entities
            cursor.ints(2)
    counts = cursor.sizes(4).tolist()
    for dim, count in enumerate(counts):
        for _ in range(count):
            tag = int(cursor.ints(1)[0])
            if partitioned:
                cursor.ints(2)  # the entity it was cut from
                cursor.ints(cursor.count())
            cursor.doubles(3 if dim == 0 else 6)
            # a group that was taken reversed has a negative number: the same group
            file.groups[dim, tag] = np.unique(np.abs(cursor.ints(cursor.count())))
            if len(file.groups[dim, tag]) > _MOST_GROUPS:
                raise ValueError(
                    f"its entity {tag} of dimension {dim} is in {len(file.groups[dim, tag])} groups; at most "
                    f"{_MOST_GROUPS} are read"
                )
            if dim:
                cursor.ints(cursor.count())  # what bounds it


def _read_nodes_4(content: bytes, at: int, binary: bool, order: str, file: File) -> int:
    cursor = Cursor(content, at, binary, order)
    blocks, count, _, _ = cursor.sizes(4).tolist()
    for _ in range(blocks):
        dim, _, parametric = cursor.ints(3).tolist()
        size = cursor.count()
        file.numbers.append(cursor.sizes(size))
        columns = 3 + (dim if parametric else 0)
        file.points.append(cursor.doubles(size * columns).reshape(size, columns)[:, :3])
    _check_count("nodes", sum(map(len, file.numbers)), count)
    return cursor.finish("Nodes")


def _read_elements_4(content: bytes, at: int, binary: bool, order: str, file: File) -> int:
    cursor = Cursor(content, at, binary, order)
    blocks, count, _, _ = cursor.sizes(4).tolist()
    total = members = 0
    for _ in range(blocks):
        dim, entity, kind = cursor.ints(3).tolist()
        size, columns = cursor.count(), _nodes_of(kind) + 1
        nodes = cursor.sizes(size * columns).reshape(size, columns)[:, 1:]
        groups = file.groups.get((dim, entity), np.zeros(0, dtype=np.int64))
        members += len(nodes) * len(groups)
        if members > max(_MOST_MEMBERS, 4 * (total + size)):
            raise ValueError(f"its groups have more than {_MOST_MEMBERS} members, counted as often as they are in one")
        file.elements.append((kind, nodes, groups))
        total += size
    _check_count("elements", total, count)
    return cursor.finish("Elements")


def _read_nodes_2(content: bytes, at: int, binary: bool, order: str, file: File) -> int:
    count, at = _count_line(content, at, "Nodes")
    if binary:
        row = np.dtype([("number", order + "i4"), ("x", order + "f8", 3)])
        _check_count("nodes", min(count, (len(content) - at) // row.itemsize), count)
        table = np.frombuffer(content[at : at + count * row.itemsize], dtype=row)
        file.numbers.append(table["number"].astype(np.int64))
        file.points.append(table["x"].astype(float))
        return Cursor(content, at + count * row.itemsize, binary).finish("Nodes")
    cursor = Cursor(content, at, binary)
    rows = cursor.doubles(4 * count).reshape(count, 4)
    file.numbers.append(whole(rows[:, 0], ""))
    file.points.append(rows[:, 1:])
    return cursor.finish("Nodes")


def _count_line(content: bytes, at: int, section: str) -> tuple[int, int]:
    """The count that a section of version 2.2 begins with, and where its rows begin."""
    found = re.compile(rb"[ \t]*(\d{1,18})[ \t\r]*\n").match(content, at)
    if found is None:
        raise ValueError(f"its section {section} does not begin with a count")
    return int(found[1]), found.end()


def _read_elements_2(content: bytes, at: int, binary: bool, order: str, file: File) -> int:
    count, at = _count_line(content, at, "Elements")
    cursor = Cursor(content, at, binary, order)
    done = 0
    while done < count:
        if binary:
            kind, size, ntags = cursor.ints(3).tolist()
            columns = 1 + _tags(ntags) + _nodes_of(kind)
            rows = cursor.ints(size * columns).reshape(size, columns)
            groups, nodes = rows[:, 1 : 1 + min(ntags, 1)], rows[:, 1 + ntags :]
        else:
            size = 1
            _, kind, ntags = cursor.ints(3).tolist()
            rows = cursor.ints(_tags(ntags) + _nodes_of(kind))[None]
            groups, nodes = rows[:, : min(ntags, 1)], rows[:, ntags:]
        file.elements.append((kind, nodes, np.abs(groups)))
        done += size
    _check_count("elements", done, count)
    return cursor.finish("Elements")


def _tags(count: int) -> int:
    if count < 0:
        raise ValueError(f"it has an element of {count} tags")
    return count


def _nodes_of(kind: int) -> int:
    from meshio._mesh import num_nodes_per_cell
    from meshio.gmsh.common import _gmsh_to_meshio_type

    if kind not in _gmsh_to_meshio_type:
        raise ValueError(f"it has elements of Gmsh's type {kind}, which is not known: take first or second order")
    return int(num_nodes_per_cell[_gmsh_to_meshio_type[kind]])


def _check_count(what: str, found: int, declared: int) -> None:
    if found != declared:
        raise ValueError(f"it declares {declared} {what} and lists {found}")


def _raw(file: File) -> Raw:
    """Blocks by kind of element, vertices numbered from 0, groups by name."""
    from meshio.gmsh.common import _gmsh_to_meshio_order, _gmsh_to_meshio_type

    numbers = np.concatenate(file.numbers) if file.numbers else np.zeros(0, dtype=np.int64)
    points = np.concatenate(file.points) if file.points else np.zeros((0, 3))
    if not np.isfinite(points).all():
        raise ValueError("it has nodes whose coordinates are no numbers")
    order = once(numbers, points, "node")
    by_kind: dict[int, list[tuple[Longs, Longs]]] = {}
    for kind, nodes, groups in file.elements:
        by_kind.setdefault(kind, []).append((nodes, groups))
    blocks: list[tuple[str, Longs]] = []
    tags: dict[str, list[Longs | None]] = {}
    for place, (kind, runs) in enumerate(by_kind.items()):
        nodes = np.concatenate([nodes for nodes, _ in runs])
        at = np.searchsorted(numbers[order], nodes)
        at = np.minimum(at, len(order) - 1)
        if not len(numbers) or (numbers[order][at] != nodes).any():
            raise ValueError("it has elements of nodes that it does not list")
        name = _gmsh_to_meshio_type[kind]
        blocks.append((name, _gmsh_to_meshio_order(name, order[at])))
        for key, cells in _members(runs).items():
            group = file.names.get((_dimension(name), key), str(key))
            parts: list[Longs | None] = tags.setdefault(group, [None] * len(by_kind))
            before = parts[place]  # two groups may bear one name
            parts[place] = cells if before is None else np.union1d(before, cells)
    declared = [(name, dim) for (dim, _), name in file.names.items()]
    return Raw(points, blocks, tags, {}, declared, _CURE)


def _members(runs: list[tuple[Longs, Longs]]) -> Mapping[int, Longs]:
    """The elements of each group, by its number; 0 is no group."""
    members: dict[int, list[Longs]] = {}
    first = 0
    for nodes, groups in runs:
        if groups.ndim == 1:
            for key in groups[groups != 0].tolist():
                members.setdefault(key, []).append(np.arange(first, first + len(nodes)))
        for column in groups.T if groups.ndim == 2 else ():
            for key in np.unique(column[column != 0]).tolist():
                members.setdefault(key, []).append(first + np.flatnonzero(column == key))
        first += len(nodes)
    return {key: np.unique(np.concatenate(cells)) for key, cells in members.items()}


def _dimension(name: str) -> int:
    from meshio._mesh import topological_dimension

    return int(topological_dimension[name])
