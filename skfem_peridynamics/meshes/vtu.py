"""VTU files: pieces of an unstructured grid, their numbers as text, in base 64 or as raw bytes, compressed or not.

meshio reads the first piece alone, skips cells that it does not know, and unpacks whatever a file says it has packed.
"""

from __future__ import annotations

import base64
import binascii
import lzma
import re
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from .._types import Longs
from .entries import content_of, decoded, whole

Array = np.ndarray[Any, np.dtype[Any]]
_AGAIN = "save it again, from ParaView by Save Data with Data Mode ASCII, or Binary and Compressor Type ZLib"
_UNPACKERS: Mapping[str, Callable[[], Any]] = {
    "vtkZLibDataCompressor": zlib.decompressobj,
    "vtkLZMADataCompressor": lzma.LZMADecompressor,
}
_TYPES = {"Float32": "f4", "Float64": "f8"} | {
    f"{sign}Int{8 * size}": f"{letter}{size}" for sign, letter in (("", "i"), ("U", "u")) for size in (1, 2, 4, 8)
}
_GHOST = 1 | 32  # bits of vtkGhostType: a copy of another piece's element, a hidden one
_TAGS = 100_000  # of its XML: a few for each piece and array
_LARGEST_CELL = 64  # vertices of a cell, and numbers of the faces of one
# cells that VTK numbers by rows: their kind, and their vertices in its order
_BY_ROWS = {8: ("quad", (0, 1, 3, 2)), 11: ("hexahedron", (0, 1, 3, 2, 4, 5, 7, 6))}


@dataclass(frozen=True, eq=False)
class _Coding:
    """How a file writes its numbers."""

    order: str
    header: str
    compressor: str | None
    appended: bytes
    raw: bool


def read_vtu(path: Path) -> Any:
    """Return points, cells and their numbers in all pieces, as a mesh of meshio's.

    Raises ``ValueError`` for what is not known, and where arrays are not as long as the file declares.
    """
    content = content_of(path)
    named = re.search(rb'<VTKFile[^>]{0,1000}compressor="([^"]*)"', content)
    if named and decoded(named[1]) not in _UNPACKERS:
        raise ValueError(f"its data are compressed by {decoded(named[1])[:60]}, which is not read: {_AGAIN}")
    appended = b""
    start = re.search(rb"<AppendedData[^>]{0,200}>\s{0,200}_", content)
    if start is not None:  # bytes that may be no XML
        end = content.rfind(b"</AppendedData>")
        appended, content = content[start.end() : end], content[: start.end()] + content[end:]
    if content.count(b"<") > _TAGS:
        raise ValueError(f"it has more than {_TAGS} tags: no grid has")
    try:
        tree = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise ValueError(f"it is not XML: {error}") from None
    order = "<" if tree.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
    is_raw = start is not None and b'encoding="raw"' in start[0]
    header = _TYPES.get(tree.get("header_type", "UInt32"), "")
    if header not in ("u4", "u8"):
        raise ValueError(f"its header_type is {tree.get('header_type', '')[:40]!r}: UInt32 and UInt64 are read")
    coding = _Coding(order, header, tree.get("compressor"), appended, is_raw)
    pieces = tree.findall("UnstructuredGrid/Piece")
    if not pieces:
        raise ValueError("it holds no piece of an unstructured grid")
    return _joined([_read_piece(piece, f"its piece {k}", coding) for k, piece in enumerate(pieces, 1)])


@dataclass(frozen=True, eq=False)
class _Piece:
    points: Array
    cells: list[tuple[str, Longs, Longs]]  # kind, vertices, places among the cells of the piece
    data: dict[str, Array]  # of the cells
    fields: dict[str, Array]  # of the points
    ghosts: int


def _read_piece(piece: ElementTree.Element, which: str, coding: _Coding) -> _Piece:
    counts = []
    for name in ("NumberOfPoints", "NumberOfCells"):
        if not piece.get(name, "").strip().isdigit():
            raise ValueError(f"{which} has {name}={piece.get(name, '')[:40]!r}, which is not a count")
        counts.append(int(piece.get(name, "")))
    points, cells = counts
    p = [_values(array, coding, 3 * points) for array in piece.findall("Points/DataArray")]
    if len(p) != 1 or p[0].size != 3 * points:
        raise ValueError(f"{which} declares {points} points and lists {sum(x.size for x in p) / 3:g}")
    most = _LARGEST_CELL * cells
    arrays = {array.get("Name"): _values(array, coding, most) for array in piece.findall("Cells/DataArray")}
    missing = [name for name in ("connectivity", "offsets", "types") if name not in arrays]
    if missing:
        raise ValueError(f"{which} has no {missing[0]} of its cells")
    connectivity, offsets, types = (
        whole(arrays[name].ravel(), f"{which}: ", f"a number of {name}")
        for name in ("connectivity", "offsets", "types")
    )
    if len(offsets) != cells or len(types) != cells:
        raise ValueError(f"{which} declares {cells} cells and lists {len(offsets)} offsets and {len(types)} types")
    sizes = np.diff(offsets, prepend=0)
    if (sizes < 0).any() or (offsets[-1] if cells else 0) != len(connectivity):
        raise ValueError(f"{which} has offsets that do not cut its {len(connectivity)} connectivity entries into cells")
    data = _columns(piece, "CellData", cells, which, coding)
    ghost = data["vtkGhostType"].astype(np.int64) & _GHOST != 0 if "vtkGhostType" in data else np.zeros(cells, bool)
    blocks = []
    change = np.flatnonzero((np.diff(types) != 0) | (np.diff(sizes) != 0)) + 1
    for run in np.split(np.arange(cells), change):
        run = run[~ghost[run]]
        if len(run):
            corners = connectivity[offsets[run][:, None] - sizes[run[0]] + np.arange(sizes[run[0]])]
            blocks.append((*_kind(int(types[run[0]]), corners, which), run))
    fields = _columns(piece, "PointData", points, which, coding)
    return _Piece(p[0].reshape(-1, 3), blocks, data, fields, int(ghost.sum()))


def _columns(piece: ElementTree.Element, of: str, count: int, which: str, coding: _Coding) -> dict[str, Array]:
    """The numbers of cells or points by name, (count,) or (count, components)."""
    found = {}
    for array in piece.findall(f"{of}/DataArray"):
        if array.get("type") == "String":
            continue
        columns = array.get("NumberOfComponents", "1").strip()
        components = int(columns) if re.fullmatch("[1-9][0-9]{0,2}", columns) else 1
        values = _values(array, coding, count * components)
        if values.size != count * components:
            what = "cells" if of == "CellData" else "points"
            raise ValueError(f"{which} has {values.size} numbers of {array.get('Name', '')[:60]!r} for {count} {what}")
        found[str(array.get("Name"))] = values.reshape(count, components) if components > 1 else values.ravel()
    return found


def _kind(number: int, corners: Longs, which: str) -> tuple[str, Longs]:
    """The name of a kind of cells in meshio, and their vertices in its order."""
    from meshio._mesh import num_nodes_per_cell
    from meshio._vtk_common import vtk_to_meshio_order, vtk_to_meshio_type

    kind, order = _BY_ROWS.get(number, (vtk_to_meshio_type.get(number), vtk_to_meshio_order(number)))
    size = corners.shape[1]
    if kind == "polygon" and size in (3, 4):
        kind = ("triangle", "quad")[size - 3]
    if kind not in num_nodes_per_cell:
        raise ValueError(
            f"{which} has cells of VTK's type {number}{f' ({kind})' if kind else ''} with {size} vertices, which are "
            "not read: save lines, triangles, quadrilaterals, tetrahedra, pyramids, wedges or hexahedra"
        )
    if size != num_nodes_per_cell[kind]:
        raise ValueError(f"{which} has a {kind} of {size} vertices")
    return kind, corners if order is None else corners[:, list(order)]


def _values(array: ElementTree.Element, coding: _Coding, most: int) -> Array:
    """The numbers of an array, of which there are to be no more than so many."""
    name, of_type = array.get("Name"), array.get("type", "")
    if of_type not in _TYPES:
        raise ValueError(f"its array {name!r} is of the type {of_type[:60]!r}, which is not read: {_AGAIN}")
    dtype = np.dtype(coding.order + _TYPES[of_type])
    form = array.get("format", "ascii")
    if form == "ascii":
        try:
            return np.array((array.text or "").split(), dtype=dtype)
        except (ValueError, OverflowError) as error:
            raise ValueError(f"its array {name!r} has a word where a number belongs ({error})") from None
    if form == "binary":
        text, at = (array.text or "").strip().encode(), 0
    elif form == "appended" and array.get("offset", "").strip().isdigit():
        text, at = coding.appended, int(array.get("offset", ""))
    else:
        raise ValueError(f"its array {name!r} has the format {form[:60]!r}, which is not read: {_AGAIN}")
    try:
        content = _content(text[at:], coding, coding.raw and form == "appended", most * dtype.itemsize)
        return np.frombuffer(content, dtype=dtype)
    except (binascii.Error, zlib.error, lzma.LZMAError, EOFError, ValueError) as error:
        raise ValueError(f"its array {name!r} is damaged ({error}): {_AGAIN}") from None


def _content(text: bytes, coding: _Coding, raw: bool, most: int) -> bytes:
    """The bytes of an array: behind their number, or unpacked from blocks that are behind their numbers."""
    size = np.dtype(coding.header).itemsize

    def take(start: int, count: int) -> bytes:
        """Bytes of one run of base 64, or of the raw ones."""
        coded = text[start : start + (count if raw else -(-count // 3) * 4)]
        found = coded if raw else base64.b64decode(coded, validate=True)
        if len(found) < count:
            raise ValueError("it ends too early")
        return found[:count]

    def header(count: int) -> list[int]:
        return [int(x) for x in np.frombuffer(take(0, count * size), coding.order + coding.header)]

    if coding.compressor is None:
        return take(0, size + header(1)[0])[size:]
    blocks = header(1)[0]
    if not blocks:
        return b""
    if blocks * size > len(text):
        raise ValueError(f"it has {blocks} blocks")
    _, block, last, *packed = header(3 + blocks)
    unpacked = [block] * (blocks - 1) + [last or block]
    if sum(unpacked) > most:
        raise ValueError(f"it has {sum(unpacked):.3g} bytes when unpacked, and {most:.3g} belong there")
    first = (3 + blocks) * size
    text = text[first if raw else -(-first // 3) * 4 :]
    everything = take(0, sum(packed))
    parts, at = [], 0
    for count, length in zip(unpacked, packed, strict=True):
        # no more than it says: a few bytes can unpack to any number of them
        part = _UNPACKERS[coding.compressor]().decompress(everything[at : at + length], count + 1)
        if len(part) != count:
            raise ValueError("a block of it is not as long as declared")
        parts.append(part)
        at += length
    return b"".join(parts)


def _joined(pieces: list[_Piece]) -> Any:
    """One mesh of several pieces, their points and cells one after the other."""
    import meshio

    first = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    names = list(pieces[0].data)
    for k, piece in enumerate(pieces[1:], 2):
        other = sorted(set(names) ^ set(piece.data))
        if other:
            raise ValueError(f"its pieces 1 and {k} do not both have the cell data {other[0]!r}")
    cells, data = [], {name: list[Array]() for name in names}
    for at, piece in zip(first, pieces, strict=False):
        for kind, corners, places in piece.cells:
            wrong = corners[(corners < 0) | (corners >= len(piece.points))]
            if len(wrong):
                raise ValueError(f"a {kind} has vertex {wrong[0]}; there are {len(piece.points)}, counted from 0")
            cells.append((kind, corners + at))
            for name in names:
                data[name].append(piece.data[name][places])
    common = [name for name in pieces[0].fields if all(name in piece.fields for piece in pieces)]
    mesh = meshio.Mesh(
        np.concatenate([piece.points for piece in pieces]),
        cells,
        cell_data=data,
        point_data={name: np.concatenate([piece.fields[name] for piece in pieces]) for name in common},
    )
    ghosts = sum(piece.ghosts for piece in pieces)
    mesh.notes = [f"{ghosts} ghost elements, copies for other pieces, were left out"] if ghosts else []
    return mesh
