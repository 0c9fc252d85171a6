"""Frames as VTK writes them: XML with packed numbers. meshio writes the same, but by name only, not into a file."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any
from xml.sax.saxutils import escape, quoteattr

import numpy as np
import numpy.typing as npt

from ..._types import Mesh

_KINDS = {"float32": "Float32", "float64": "Float64", "int32": "Int32", "uint8": "UInt8"}
_CELLS = {1: 3, 2: 5, 3: 10}  # VTK's numbers of a line, a triangle and a tetrahedron
_COMPONENTS = {3: ("x", "y", "z"), 6: ("xx", "yy", "zz", "xy", "yz", "xz")}
_BLOCK = 1 << 16  # bytes that are packed together
_LEVEL = 1  # of zlib: its fastest


class VtuWriter:
    """The frames of one mesh; what all of them share is packed once.

    >>> import skfem
    >>> content = VtuWriter(skfem.MeshTri()).frame({"Z": np.zeros(4, dtype=np.float32)}, {"Z": "1"})
    >>> content.count(b"<DataArray"), b'NumberOfPoints="4"' in content
    (5, True)
    """

    def __init__(self, mesh: Mesh, cells: Mapping[str, npt.NDArray[Any]] | None = None) -> None:
        self.mesh = mesh
        self.cells = {} if cells is None else cells  # fields (nelements,) that all frames share

    @cached_property
    def _head(self) -> str:
        mesh, dim = self.mesh, int(self.mesh.dim())
        points = np.pad(mesh.p.T, ((0, 0), (0, 3 - dim)))
        count = mesh.t.shape[1]
        offsets = np.arange(1, count + 1, dtype=np.int32) * np.int32(dim + 1)
        return (
            '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            'header_type="UInt32" compressor="vtkZLibDataCompressor">\n<UnstructuredGrid>\n'
            f'<Piece NumberOfPoints="{points.shape[0]}" NumberOfCells="{count}">\n<Points>\n'
            f"{_array('Points', points)}</Points>\n<Cells>\n"
            f"{_array('connectivity', mesh.t.T.astype(np.int32).ravel())}{_array('offsets', offsets)}"
            f"{_array('types', np.full(count, _CELLS[dim], dtype=np.uint8))}</Cells>\n<PointData>\n"
        )

    def frame(self, fields: Mapping[str, npt.NDArray[Any]], units: Mapping[str, str]) -> bytes:
        """Return the file of a frame: fields (nvertices,) or (nvertices, k), and the units of some."""
        arrays = (_array(name, values, units.get(name)) for name, values in fields.items())
        return (self._head + "".join(arrays) + self._tail).encode()

    @cached_property
    def _tail(self) -> str:
        cells = "".join(_array(name, values) for name, values in self.cells.items())
        cells = f"<CellData>\n{cells}</CellData>\n" if cells else ""
        return f"</PointData>\n{cells}</Piece>\n</UnstructuredGrid>\n</VTKFile>\n"


def _array(name: str, values: npt.NDArray[Any], unit: str | None = None) -> str:
    """An array of numbers, packed, with its unit as the information key that VTK has for it."""
    width = f' NumberOfComponents="{values.shape[1]}"' if values.ndim > 1 else ""
    if values.ndim > 1 and name != "connectivity":  # coordinates, and symmetric tensors
        names = _COMPONENTS.get(values.shape[1], ())
        width += "".join(f' ComponentName{k}="{one}"' for k, one in enumerate(names))
    key = '<InformationKey name="UNITS_LABEL" location="vtkDataArray">'
    note = "" if unit is None else f"{key}{escape(unit)}</InformationKey>\n"
    kind = _KINDS[values.dtype.name]
    start = f'<DataArray type="{kind}" Name={quoteattr(name)}{width} format="binary">'
    return f"{start}\n{_packed(values)}\n{note}</DataArray>\n"


def _packed(values: npt.NDArray[Any]) -> str:
    """Blocks by zlib after a header of their sizes, both in base 64."""
    content = np.ascontiguousarray(values).astype(values.dtype.newbyteorder("<"), copy=False).tobytes()
    parts: Sequence[bytes] = [zlib.compress(content[k : k + _BLOCK], _LEVEL) for k in range(0, len(content), _BLOCK)]
    header = struct.pack(f"<{3 + len(parts)}I", len(parts), _BLOCK, len(content) % _BLOCK, *map(len, parts))
    return (base64.b64encode(header) + base64.b64encode(b"".join(parts))).decode()
