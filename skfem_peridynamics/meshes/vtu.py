"""VTU files, beyond what meshio reads of them: several pieces, and the true reason where it cannot read one."""

from __future__ import annotations

import copy
import re
import tempfile
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

_COMPRESSORS = ("vtkZLibDataCompressor", "vtkLZMADataCompressor")
_AGAIN = "save it again, from ParaView by Save Data with Data Mode ASCII, or Binary and Compressor Type ZLib"


def read_vtu(path: Path) -> Any:
    """Return what meshio reads of a file, all its pieces together.

    Raises ``ValueError`` for what meshio does not know, and where it delivers another number of points or cells than
    the file declares.
    """
    import meshio

    head = path.read_bytes()
    raw = b'encoding="raw"' in head
    named = re.search(rb'<VTKFile[^>]*compressor="([^"]*)"', head)  # also where raw bytes make it no XML
    if named and named[1].decode(errors="replace") not in _COMPRESSORS:
        compressor = named[1][:60].decode(errors="replace")
        raise ValueError(f"its data are compressed by {compressor}, which is not read: {_AGAIN}")
    try:
        tree = ElementTree.fromstring(head)
    except ElementTree.ParseError as error:
        if not raw:
            raise ValueError(f"it is not XML: {error}") from None
        return _read_raw(path)  # bytes that are no XML
    grid = tree.find("UnstructuredGrid")
    pieces = [] if grid is None else grid.findall("Piece")
    if not pieces:
        raise ValueError("it holds no piece of an unstructured grid")
    if len(pieces) == 1:
        content = _read_raw(path) if raw else meshio.read(path)
        return _checked(content, pieces[0], 1)
    parts = []
    with tempfile.TemporaryDirectory() as folder:
        for k in range(len(pieces)):
            single = copy.deepcopy(tree)
            own = single.find("UnstructuredGrid")
            assert own is not None
            for j, piece in enumerate(own.findall("Piece")):
                if j != k:
                    own.remove(piece)
            place = Path(folder) / f"{k}.vtu"
            ElementTree.ElementTree(single).write(place)
            parts.append(_checked(meshio.read(place), pieces[k], k + 1))
    return _joined(parts)


def _read_raw(path: Path) -> Any:
    import meshio

    try:
        return meshio.read(path)
    except (SystemExit, Exception):
        raise ValueError(f"its data are appended as raw bytes, which cannot be read: {_AGAIN}") from None


def _checked(content: Any, piece: ElementTree.Element, number: int) -> Any:
    """The content of a piece, which must be what the piece declares."""
    found = {"NumberOfPoints": len(content.points), "NumberOfCells": sum(len(block.data) for block in content.cells)}
    for name, count in found.items():
        declared = piece.get(name)
        if declared is not None and declared.strip().isdigit() and int(declared) != count:
            raise ValueError(f"its piece {number} declares {name}={declared}, and {count} were read: {_AGAIN}")
    return content


def _joined(parts: list[Any]) -> Any:
    """One mesh of several, their points and cells one after the other."""
    import meshio

    first = np.cumsum([0, *(len(part.points) for part in parts)])
    cells = [(block.type, block.data + at) for part, at in zip(parts, first, strict=False) for block in part.cells]
    names = {name for part in parts for name in part.cell_data}
    data = {}
    for name in names:
        columns = []
        for part in parts:
            given = part.cell_data.get(name)
            columns += [np.zeros(len(block.data), dtype=int) for block in part.cells] if given is None else list(given)
        data[name] = columns
    return meshio.Mesh(np.concatenate([part.points for part in parts]), cells, cell_data=data)
