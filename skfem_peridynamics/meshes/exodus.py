"""Exodus files: element blocks are regions, side sets and node sets boundaries, by name or by number.

meshio delivers neither blocks nor side sets. A file is netCDF 3, which SciPy reads, or HDF 5, which takes h5py.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from .._files import open_regular
from .._memory import free_memory
from .._types import Longs
from .entries import decoded, whole
from .mend import Raw

SUFFIXES = (".e", ".ex2", ".exo", ".exodus", ".g", ".gen")
# element types by the letters they begin with
_KINDS = {
    **{"TRI": "triangle", "QUA": "quad", "TET": "tetra", "HEX": "hexahedron", "WED": "wedge", "PYR": "pyramid"},
    **{"BAR": "line", "BEA": "line", "TRU": "line", "EDG": "line"},
}
_CORNERS = {"line": 2, "triangle": 3, "quad": 4, "tetra": 4, "pyramid": 5, "wedge": 6, "hexahedron": 8}
# corners of the sides of an element, as the format counts them
_SIDES: Mapping[str, tuple[tuple[int, ...], ...]] = {
    "line": ((0,), (1,)),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1, 3), (1, 2, 3), (0, 3, 2), (0, 2, 1)),
    "pyramid": ((0, 1, 4), (1, 2, 4), (2, 3, 4), (0, 4, 3), (0, 3, 2, 1)),
    "wedge": ((0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2), (0, 2, 1), (3, 4, 5)),
    "hexahedron": ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3), (0, 3, 2, 1), (4, 5, 6, 7)),
}
_FACET = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}

_PACKED, _SMALL = 1100, 1e6  # more than ZLib packs, and bytes that are always read


def read_exodus(path: Path) -> Raw:
    """Return the mesh of a file with blocks and sets as groups. Raises ``ValueError``."""
    variables, types = _variables(path)
    if "coord" in variables:
        points = np.atleast_2d(variables["coord"].astype(float)).T
    else:
        found = [variables[f"coord{axis}"].astype(float) for axis in "xyz" if f"coord{axis}" in variables]
        points = np.column_stack(found) if found else np.zeros((0, 3))
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    blocks: list[tuple[str, Longs]] = []
    tags: dict[str, list[Longs | None]] = {}
    owner, row = [np.zeros(0, dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    names = _names(variables, "eb", "connect")
    for number, name in names.items():
        nodes = whole(variables[f"connect{number}"], f"block {name}: ") - 1
        kind = _kind(types.get(f"connect{number}", ""), nodes, name)
        wrong = nodes[(nodes < 0) | (nodes >= len(points))]
        if len(wrong):
            raise ValueError(f"block {name} has vertex {wrong[0] + 1} of {len(points)}")
        _tag(tags, name, len(blocks), np.arange(len(nodes)))
        owner.append(np.full(len(nodes), len(blocks)))
        row.append(np.arange(len(nodes)))
        blocks.append((kind, nodes))
    owners, rows = np.concatenate(owner), np.concatenate(row)
    points_of = {}
    for number, name in _names(variables, "ns", "node_ns").items():
        points_of[name] = _within(variables[f"node_ns{number}"], len(points), f"the set of nodes {name}")
    body = list(blocks)
    for number, name in _names(variables, "ss", "elem_ss").items():
        elements = _within(variables[f"elem_ss{number}"], len(rows), f"the set of sides {name}")
        sides = whole(variables[f"side_ss{number}"], f"the set of sides {name}: ", "a side")
        if len(sides) != len(elements):
            raise ValueError(f"the set of sides {name} has {len(elements)} elements and {len(sides)} sides")
        for block, side in sorted(set(zip(owners[elements].tolist(), sides.tolist(), strict=True))):
            kind, nodes = body[block]
            of_kind = _SIDES[kind.rstrip("0123456789")]
            if not 1 <= side <= len(of_kind):
                raise ValueError(f"the set of sides {name} has side {side} of a {kind}, which has {len(of_kind)}")
            chosen = rows[elements[(owners[elements] == block) & (sides == side)]]
            blocks.append((_FACET[len(of_kind[side - 1])], nodes[chosen][:, of_kind[side - 1]]))
            _tag(tags, name, len(blocks) - 1, np.arange(len(chosen)))
    return Raw(points, blocks, tags, points_of)


def _tag(tags: dict[str, list[Longs | None]], name: str, block: int, cells: Longs) -> None:
    parts = tags.setdefault(name, [])
    parts += [None] * (block - len(parts))
    parts.append(cells)


def _kind(of_type: str, nodes: Longs, name: str) -> str:
    """The kind of the elements of a block by its name in meshio."""
    kind = _KINDS.get(of_type[:3].upper())
    if kind is None or nodes.ndim != 2 or nodes.shape[1] < _CORNERS[kind]:
        raise ValueError(
            f"block {name} has elements of type {of_type[:60]!r} with {nodes.shape[-1]} nodes, which are not read; "
            f"{', '.join(_KINDS)} are, by their first letters"
        )
    return kind + (str(nodes.shape[1]) if nodes.shape[1] > _CORNERS[kind] else "")


def _within(numbers: Any, count: int, what: str) -> Longs:
    """Numbers that count from 1, as places."""
    places = whole(numbers, f"{what}: ") - 1
    wrong = places[(places < 0) | (places >= count)]
    if len(wrong):
        raise ValueError(f"{what} lists {wrong[0] + 1} of {count}")
    return places


def _names(variables: Mapping[str, Any], kind: str, stem: str) -> dict[int, str]:
    """The blocks or sets that hold something, in their order: by name, where they have none by their identity."""
    listed = sorted(int(key[len(stem) :]) for key in variables if key.startswith(stem) and key[len(stem) :].isdigit())
    texts = [decoded(bytes(row).split(b"\0")[0]).strip() for row in np.asarray(variables.get(f"{kind}_names", ()))]
    marks = np.asarray(variables.get(f"{kind}_prop1", ())).tolist()
    names = {}
    for number in listed:
        name = texts[number - 1] if number <= len(texts) else ""
        names[number] = name or str(marks[number - 1] if number <= len(marks) else number)
    return names


def _variables(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """The arrays of a file by name, and the types of its elements."""
    with open_regular(path) as file:
        start = file.read(4)
    if start == b"\x89HDF":
        return _of_hdf(path)
    if start not in (b"CDF\x01", b"CDF\x02"):
        raise ValueError(
            "it is not netCDF of the classic form, that with offsets of 64 bits, or netCDF 4: save it again as one of "
            "them, or export it as .msh (Gmsh 4.1), .vtu or .inp"
        )
    from scipy.io import netcdf_file

    try:
        with netcdf_file(path, "r", mmap=False) as content:
            found = {name: np.array(variable.data) for name, variable in content.variables.items()}
            types = {name: variable._attributes.get("elem_type", b"") for name, variable in content.variables.items()}
    except (ValueError, TypeError, LookupError, OverflowError) as error:
        raise ValueError(f"its netCDF is damaged ({type(error).__name__}: {error})") from None
    return found, {name: _text(value) for name, value in types.items()}


def _of_hdf(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    import h5py

    try:
        with open_regular(path) as raw, h5py.File(raw, "r") as content:
            names = [name for name in content if content.get(name, getclass=True, getlink=True) is h5py.HardLink]
            names = [name for name in names if content.get(name, getclass=True) is h5py.Dataset and content[name].shape]
            found = {name: numbers_of(content, name) for name in names}
            types = {name: _text(content[name].attrs.get("elem_type", b"")) for name in found}
    except (OSError, ValueError, TypeError, LookupError) as error:
        raise ValueError(f"its netCDF 4 is damaged ({error})") from None
    return found, types


def numbers_of(content: Any, name: str) -> Any:
    """Return the numbers under a name of an HDF file; raises ``ValueError`` where they are not in it, or were no room.

    What is not stored is filled in by HDF: a file of a kilobyte may stand for gigabytes.
    """
    link = content.get(name, getlink=True)
    data = content[name] if type(link).__name__ == "HardLink" else None
    if data is None or getattr(data, "external", None) or getattr(data, "is_virtual", False):
        raise ValueError(f"{name[:80]!r} is in another file: only what is in the file itself is read")
    stored = int(data.id.get_storage_size())
    if data.nbytes > _PACKED * stored + _SMALL or data.nbytes * 2 > free_memory():
        raise ValueError(f"{name[:80]!r} unpacks {stored} bytes to {data.nbytes / 1e6:.3g} MB, which is more than fits")
    return data[()]


def _text(value: Any) -> str:
    """The text of an attribute; empty where it is none."""
    return value if isinstance(value, str) else decoded(value) if isinstance(value, bytes) else ""
