"""Boxes of lines, triangles and tetrahedra: regular, random, graded, with named sides."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from .._types import Floats, Mesh


def mesh_class(dim: int) -> type[Mesh]:
    """Return scikit-fem's mesh of first-order simplices in a dimension: lines, triangles or tetrahedra.

    >>> mesh_class(2).__name__
    'MeshTri1'
    """
    import skfem

    classes: tuple[type[Mesh], ...] = (skfem.MeshLine, skfem.MeshTri, skfem.MeshTet)
    return classes[dim - 1]


def box_of_axes(*axes: Floats) -> Mesh:
    """Return the interval, rectangle or box whose vertices have every combination of some coordinates.

    >>> box_of_axes(np.linspace(0, 1, 3), np.linspace(0, 2, 5)).p.shape
    (2, 15)
    """
    kind = mesh_class(len(axes))
    return kind(axes[0]) if len(axes) == 1 else kind.init_tensor(*axes)


def unit_box(dim: int, n: int, kind: str = "regular", seed: int = 0) -> Mesh:
    """Return the unit interval, square or cube, n elements a side: ``regular``, ``random`` or ``graded``.

    ``random`` shifts inner vertices by up to 40 % of h along each axis, less where an element would fold; ``graded``
    elements grow from 0.5 h to 1.5 h along each axis. Raises ``ValueError`` for another kind.

    >>> unit_box(2, 4, "random").p.shape
    (2, 25)
    """
    if kind not in ("regular", "random", "graded"):
        raise ValueError(f"kind = {kind!r} must be regular, random or graded")
    axis = np.linspace(0.0, 1.0, n + 1)
    if kind == "graded":
        axis = 0.5 * axis + 0.5 * axis**2
    mesh = box_of_axes(*[axis] * dim)
    if kind != "random":
        return mesh
    inner = ((mesh.p > 1e-9) & (mesh.p < 1.0 - 1e-9)).all(axis=0)
    shift = np.random.default_rng(seed).uniform(-0.4, 0.4, mesh.p.shape) / n * inner

    def signed(p: Floats) -> Floats:
        return np.asarray(np.linalg.det(np.moveaxis(p[:, mesh.t[1:]] - p[:, mesh.t[:1]], 2, 0)))

    before = signed(mesh.p)
    while (wrong := np.asarray(before * signed(mesh.p + shift) < 0.05 * before**2)).any():
        shift[:, np.unique(mesh.t[:, wrong])] *= 0.7
    return type(mesh)(mesh.p + shift, mesh.t)


def axis_with_a_twin(n: int, gap: float) -> Floats:
    """Return n + 2 numbers from 0 to 1, two of them ``gap`` of their distance apart."""
    axis = np.linspace(0.0, 1.0, n + 1)
    return np.sort(np.append(axis, axis[n // 2] + gap / n))


def graded_axis(n: int, ratio: float) -> Floats:
    """Return n + 1 numbers from 0 to 1 whose distances grow from 1 to ``ratio``."""
    h = np.geomspace(1.0, ratio, n)
    return np.concatenate([[0.0], np.cumsum(h) / h.sum()])


def single_element(dim: int) -> Mesh:
    """Return one line, triangle or tetrahedron with edges of length 1 along the axes."""
    return mesh_class(dim)(np.hstack([np.zeros((dim, 1)), np.eye(dim)]), np.arange(dim + 1)[:, None])


def with_sides(mesh: Mesh, without: Collection[str] = ()) -> Mesh:
    """Name the facets on the sides of the bounding box, but for some names."""
    names = (("left", "right"), ("bottom", "top"), ("front", "back"))
    facets = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, facets]]
    sides = {}
    for axis, pair in enumerate(names[: mesh.dim()]):
        low, high = mesh.p[axis].min(), mesh.p[axis].max()
        for name, at in zip(pair, (low, high), strict=True):
            near = np.abs(middle[axis] - at) <= max(1e-9 * (high - low), 4.0 * np.spacing(abs(at)))
            on = facets[near.all(axis=0)]
            if len(on) and name not in without:
                sides[name] = on
    return mesh.with_boundaries(sides)
