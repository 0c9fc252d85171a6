"""Meshes of scenes: boxes with named sides, and whatever meshio reads."""

from __future__ import annotations

import contextlib
import io
import logging
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..._memory import free_memory
from ..._types import Mesh
from ...geometry.simplices import describe_point
from ...meshes.mend import mend
from ..scene.body_tables import MeshTable
from ..scene.reading import LARGEST, SceneError

_log = logging.getLogger("skfem_peridynamics")
_PRINTING = threading.Lock()
_READING = 8  # bytes of memory a byte of a mesh file


@contextlib.contextmanager
def blame(path: str) -> Iterator[None]:
    """Turn a ValueError of the library into a SceneError that starts with the path of the key."""
    try:
        yield
    except SceneError:  # it names its key already
        raise
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None


@contextlib.contextmanager
def quietly(said: io.StringIO | None = None) -> Iterator[None]:
    """Keep what is printed, for one thread at a time: two that take the output at once would not give it back."""
    said = io.StringIO() if said is None else said
    with _PRINTING, contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        yield


def read_mesh(path: Path, scale: float = 1.0, join: bool = False) -> Mesh:
    """Return the simplicial mesh in a file that meshio reads; its groups become boundaries and subdomains.

    Lengths are taken ``scale`` times; ``join`` makes one vertex of those that coincide. What had to be mended is
    said in the log. Raises :class:`SceneError` for what is no mesh of a body.
    """
    from ...meshes.groups import raw_mesh
    from ...meshes.guarded_reader import read

    name = f"mesh.file = {str(path)!r}"
    if not path.is_file():
        raise SceneError(f"{name} is not a file")
    if path.stat().st_size * _READING > free_memory():
        raise SceneError(
            f"{name} has {path.stat().st_size / 1e6:.3g} MB; reading it takes about "
            f"{_READING} times as much memory, and {free_memory() / 1e6:.3g} MB are free: take a coarser mesh"
        )
    said = io.StringIO()  # meshio prints its reasons
    try:
        with quietly(said):
            content = read(path)
            check_cells(content)
            raw = raw_mesh(content, scale)
    except ModuleNotFoundError as error:
        raise SceneError(
            f'{name} keeps its numbers in HDF, which needs {error.name}: install the extra "xdmf", or write the file '
            "with its numbers inline"
        ) from None
    except (SystemExit, Exception) as error:  # whatever a reader of a foreign format may raise
        reason = " ".join((said.getvalue() or str(error)).split())
        raise SceneError(f"{name} cannot be read as a mesh: {reason}") from None
    with blame(name):
        found = mend(raw, join)
    for note in found.notes:
        _log.warning("%s: %s", name, note)
    return found.mesh


def check_cells(content: Any) -> None:
    """Raise ``ValueError`` for elements of vertices that are not there, and vertices that are nowhere."""
    if np.ndim(content.points) != 2 or any(
        np.ndim(b.data) != 2 or b.data.dtype.kind not in "iu" for b in content.cells
    ):
        raise ValueError("its elements are not all of as many vertices")
    count = len(content.points)
    far = np.flatnonzero(~(np.abs(content.points) <= LARGEST).all(axis=1))
    if len(far):
        raise ValueError(f"its vertex {far[0]} is at {describe_point(content.points[far[0]])}")
    for block in content.cells:
        if block.data.size and not 0 <= block.data.min() <= block.data.max() < count:
            raise ValueError(f"a {block.type} has vertex {block.data.max()}; the file has {count} vertices")


def make_mesh(spec: MeshTable, folder: Path) -> Mesh:
    """Return the mesh of a ``[mesh]`` table; a box has the boundaries left, right, bottom, top, front, back."""
    if spec.file is not None:
        mesh = read_mesh(folder / spec.file, spec.scale or 1.0, bool(spec.join))
        return mesh if mesh.boundaries else _with_sides(mesh)
    assert spec.box is not None
    assert spec.divisions is not None
    import skfem

    nodes = np.prod([n + 1.0 for n in spec.divisions])
    if nodes * 400.0 > free_memory():
        raise SceneError(f"mesh.divisions = {list(spec.divisions)} makes {nodes:.3g} vertices, more than memory holds")
    grid = [np.linspace(low, high, n + 1) for (low, high), n in zip(spec.box, spec.divisions, strict=True)]
    kind = (skfem.MeshLine, skfem.MeshTri, skfem.MeshTet)[len(grid) - 1]
    return _with_sides(kind(grid[0]) if len(grid) == 1 else kind.init_tensor(*grid))


def _with_sides(mesh: Mesh) -> Mesh:
    """Name the facets on the sides of the bounding box."""
    names = (("left", "right"), ("bottom", "top"), ("front", "back"))
    facets = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, facets]]
    sides = {}
    for axis, pair in enumerate(names[: mesh.dim()]):
        low, high = mesh.p[axis].min(), mesh.p[axis].max()
        for name, at in zip(pair, (low, high), strict=True):
            on = facets[(np.abs(middle[axis] - at) <= 1e-9 * (high - low)).all(axis=0)]
            if len(on):
                sides[name] = on
    return mesh.with_boundaries(sides)
