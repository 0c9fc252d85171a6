"""Meshes of scenes: boxes with named sides, and whatever meshio reads."""

from __future__ import annotations

import contextlib
import io
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .._types import Mesh
from ..geometry.simplices import check_simplices, describe_point
from .memory import free_memory
from .reading import LARGEST, SceneError
from .tables import MeshTable

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


def read_mesh(path: Path) -> Mesh:
    """Return the simplicial mesh in a file that meshio reads; physical groups become boundaries and subdomains."""
    from skfem.io.meshio import from_meshio

    from .foreign import read

    if not path.is_file():
        raise SceneError(f"mesh.file = {str(path)!r} is not a file")
    if path.stat().st_size * _READING > free_memory():
        raise SceneError(
            f"mesh.file = {str(path)!r} has {path.stat().st_size / 1e6:.3g} MB; reading it takes about "
            f"{_READING} times as much memory, and {free_memory() / 1e6:.3g} MB are free: take a coarser mesh"
        )
    said = io.StringIO()  # meshio prints its reasons
    try:
        # the output is one for all threads: two that take it at once would not give it back
        with _PRINTING, contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            content = read(path)
            _check_cells(content)
            mesh = from_meshio(content, ignore_orientation=True)
    except (SystemExit, Exception) as error:  # whatever a reader of a foreign format may raise
        reason = " ".join((said.getvalue() or str(error)).split())
        raise SceneError(f"mesh.file = {str(path)!r} cannot be read as a mesh: {reason}") from None
    with blame(f"mesh.file = {str(path)!r}"):
        check_simplices(mesh)
        spread = np.ptp(content.points[np.unique(np.concatenate([c.data.ravel() for c in content.cells]))], axis=0)
        if (spread[mesh.dim() :] > 1e-9 * spread.max()).any():
            raise ValueError(
                f"its {type(mesh).__name__} elements have {mesh.dim()} dimensions, its points spread over "
                f"{describe_point(spread)}; a surface or a curve in space is not a body"
            )
    return mesh


def _check_cells(content: Any) -> None:
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
        mesh = read_mesh(folder / spec.file)
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
