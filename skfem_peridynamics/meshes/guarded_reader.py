"""Mesh files in formats whose readers may never end: read in a process of its own, which can be stopped.

Measured by feeding damaged files to meshio: its readers of Ansys, MDPA, Nastran, OFF, PLY, Tecplot,
TetGen and WKT loop at an unexpected end. What the process gives back are plain arrays.
"""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from .._files import open_regular
from .entries import READING, content_of
from .exodus import numbers_of
from .vtu import read_vtu

# formats whose readers end on whatever they are given; the first bytes tell Gmsh's files from Ansys's of the same name
_SAFE = {".vtk", ".mesh", ".meshb", ".vol", ".obj", ".stl"}
_LINES = re.MULTILINE | re.IGNORECASE
_CHILD_MEMORY = 1.5e9  # bytes of address space, most of it that of libraries
_SECONDS, _RATE = 5.0, 1e6  # patience, and bytes a second on top

_CHILD = """
import json
import os
import sys
import threading
def watch():  # the other end is closed when the parent ends, however that happens
    os.read(0, 1)
    os._exit(1)
threading.Thread(target=watch, daemon=True).start()
try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[2]), int(sys.argv[2])))
except (ImportError, ValueError):
    pass
import numpy as np
import meshio
out = sys.stdout
sys.stdout = sys.stderr
mesh = meshio.read(sys.argv[1])
content = {"points": mesh.points}
for k, block in enumerate(mesh.cells):
    content[f"cells {k} {block.type}"] = block.data
for what in ("cell_data", "cell_sets"):
    for name, parts in getattr(mesh, what).items():
        for k, part in enumerate(parts):
            if part is not None and np.asarray(part).dtype.kind in "iu":
                content[f"{what} {k} {name}"] = part
for what in ("field_data", "point_sets"):
    for name, part in getattr(mesh, what).items():
        if np.asarray(part).dtype.kind in "iu":
            content[f"{what} 0 {name}"] = part
names = {str(tag): list(map(str, found)) for tag, found in getattr(mesh, "cell_tags", {}).items()}
content["tag_names"] = np.array(json.dumps(names))
np.savez(out.buffer, **content)
"""


class ReaderError(Exception):
    """What a reader in a process of its own has ended with."""


def read(path: Path) -> Any:
    """Return what meshio reads; raises whatever it raises, and ``TimeoutError`` where it does not come to an end."""
    import meshio

    if _is_gmsh(path):
        return meshio.read(path, file_format="gmsh")
    if path.suffix.lower() in (".xdmf", ".xmf"):
        return _read_xdmf(path)
    if path.suffix.lower() == ".vtu":
        return read_vtu(path)
    if path.suffix.lower() in _SAFE:
        _check_listed(path)
        return meshio.read(path)
    # isolated: with the working folder on its path a numpy.py beside the scene would be run
    patience = _SECONDS + path.stat().st_size / _RATE
    try:
        output, errors, code = _run(path, patience)
    except subprocess.TimeoutExpired:
        raise TimeoutError(f"its reader has not come to an end in {patience:.0f} s") from None
    if code:
        said = errors.decode(errors="replace").strip().splitlines()
        missing = re.fullmatch(r"ModuleNotFoundError: No module named '(\w+)[\w.]*'", said[-1] if said else "")
        if missing:
            raise ModuleNotFoundError(said[-1], name=missing[1])
        raise ReaderError(said[-1] if said else "")
    cells: list[tuple[str, Any]] = []
    arrays_by_name: dict[str, Any] = {"points": np.zeros((0, 3)), "cell_data": {}, "cell_sets": {}, "field_data": {}}
    arrays_by_name["point_sets"] = {}
    tag_names: dict[str, list[str]] = {}
    with np.load(io.BytesIO(output), allow_pickle=False) as content:
        for key in content:
            key_kind, number, name = (*key.split(" ", 2), "", "")[:3]
            if key == "tag_names":
                tag_names = json.loads(str(content[key]))
            elif key_kind == "points":
                arrays_by_name["points"] = content[key]
            elif key_kind == "cells":
                cells.append((name, content[key]))
            elif key_kind in ("cell_data", "cell_sets"):
                arrays_by_name[key_kind].setdefault(name, {})[int(number)] = content[key]
            else:
                arrays_by_name[key_kind][name] = content[key]
    none = np.zeros(0, dtype=np.int64)
    for name, parts in arrays_by_name["cell_sets"].items():
        arrays_by_name["cell_sets"][name] = [parts.get(k, none) for k in range(len(cells))]
    for name, parts in arrays_by_name["cell_data"].items():
        arrays_by_name["cell_data"][name] = [
            parts.get(k, np.zeros(len(block), dtype=np.int64)) for k, (_, block) in enumerate(cells)
        ]
    mesh = meshio.Mesh(arrays_by_name.pop("points"), cells, **arrays_by_name)
    mesh.cell_tags = {int(tag): names for tag, names in tag_names.items()}
    return mesh


def _run(path: Path, patience: float) -> tuple[bytes, bytes, int]:
    """Read in a process of its own, which ends when this one does, and has a bound of memory."""
    most = _CHILD_MEMORY + READING * path.stat().st_size
    command = [sys.executable, "-I", "-c", _CHILD, str(path.absolute()), str(int(most))]
    read_end, write_end = os.pipe()
    try:
        with subprocess.Popen(command, stdin=read_end, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
            try:
                output, errors = child.communicate(timeout=patience)
            except BaseException:
                child.kill()
                raise
            return output, errors, child.returncode
    finally:
        os.close(read_end)
        os.close(write_end)


def _check_listed(path: Path) -> None:
    """Raise ``ValueError`` where a VTK file has a grid that it does not list: a few bytes make any number of cells."""
    grid = re.search(
        rb"^[ \t]*DATASET[ \t]+(STRUCTURED_POINTS|STRUCTURED_GRID|RECTILINEAR_GRID)", content_of(path), _LINES
    )
    if path.suffix.lower() == ".vtk" and grid:
        raise ValueError(f"{grid[1].decode()} has quadrilaterals or bricks; write triangles or tetrahedra")


def _is_gmsh(path: Path) -> bool:
    if path.suffix.lower() != ".msh":
        return False
    with open_regular(path) as file:
        return file.read(64).lstrip().startswith((b"$MeshFormat", b"$Comments"))


def _read_xdmf(path: Path) -> Any:
    """Read XDMF; numbers that stand in the file itself are read without h5py, which meshio asks for before it looks."""
    from meshio.xdmf.main import XdmfReader, xdmf_to_numpy_type

    class Bounded(XdmfReader):  # type: ignore[misc]
        def _read_data_item(self, item: Any, root: Any = None) -> Any:
            if "Reference" in item.attrib:
                return super()._read_data_item(item, root)
            if item.get("Dimensions") is None:
                raise ValueError("it has data without Dimensions")
            kind, text = item.get("DataType", item.get("NumberType", "Float")), item.text or ""
            dtype = np.dtype(xdmf_to_numpy_type[kind, item.get("Precision", "4")])
            sizes = [int(n) for n in item.get("Dimensions").split()]
            form = item.get("Format", "XML")
            if form == "XML":
                return np.array(text.split(), dtype=dtype).reshape(sizes)
            if form == "Binary":
                return np.frombuffer(content_of(path.parent / text.strip()), dtype=dtype).reshape(sizes)
            if form != "HDF":
                raise ValueError(f"data in the format {form[:40]!r} is not read: write it as XML, Binary or HDF")
            return _read_hdf(path.parent, text.strip())

    return Bounded(path).read()


def _read_hdf(folder: Path, place: str) -> Any:
    """Read ``file:path`` of an HDF5 file; what is packed there may be far more than the file."""
    import h5py

    name, _, inside = place.partition(":")
    with open_regular(folder / name) as raw, h5py.File(raw, "r") as file:
        return numbers_of(file, inside.strip("/"))
