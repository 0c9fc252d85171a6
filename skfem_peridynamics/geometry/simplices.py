"""Volumes, sizes, normals and distances of simplices: one formula for lines, triangles and tetrahedra."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import factorial

import numpy as np

from .._scaling import cube_root
from .._types import Floats, Ints, Longs, Mesh

_CHUNK = 1 << 16  # elements looked at together


def check_simplices(mesh: Mesh) -> None:
    """Raise ``ValueError`` unless the mesh is of first-order lines, triangles or tetrahedra of positive volume."""
    if mesh.t.shape[0] != mesh.p.shape[0] + 1 or mesh.elem.maxdeg > 1:
        raise ValueError(
            f"mesh is a {type(mesh).__name__}; the elements must be first-order simplices: lines (1D), triangles (2D) "
            "or tetrahedra (3D); quadrilaterals and hexahedra become these by mesh.to_meshtri() and mesh.to_meshtet()"
        )
    if not np.isfinite(mesh.p).all():
        raise ValueError("mesh has vertices with coordinates that are not finite")
    unused = np.setdiff1d(np.arange(mesh.p.shape[1]), mesh.t)
    if len(unused):
        raise ValueError(
            f"mesh has {len(unused)} vertices that belong to no element, the first is {unused[0]} at "
            f"{describe_point(mesh.p[:, unused[0]])}; remove them, for example with mesh.remove_unused_nodes()"
        )
    volume = element_volumes(mesh)
    extent = np.ptp(mesh.p[:, mesh.t], axis=1).max(axis=0)
    flat = np.flatnonzero(volume <= 1e-14 * extent ** mesh.dim())
    if len(flat):
        raise ValueError(f"mesh element {flat[0]} has volume {volume[flat[0]]:.3g}; every element must have a volume")


def describe_point(x: Floats) -> str:
    """Return ``(0.1, 0.2)``: a point as messages show it.

    >>> describe_point(np.array([0.5, 1e-3]))
    '(0.5, 0.001)'
    """
    return "(" + ", ".join(f"{c:.6g}" for c in np.atleast_1d(x)) + ")"


def element_volumes(mesh: Mesh) -> Floats:
    """Return the length, area or volume of each element, shape (nelements,).

    >>> import skfem
    >>> element_volumes(skfem.MeshTri()).tolist()
    [0.5, 0.5]
    """
    volume = np.empty(mesh.t.shape[1])
    for elements, corners in _in_chunks(mesh):
        volume[elements] = np.abs(_determinant([corner - corners[0] for corner in corners[1:]]))
    volume /= factorial(mesh.dim())
    return volume


def _in_chunks(mesh: Mesh) -> Iterator[tuple[slice, list[Floats]]]:
    """Some elements at a time, and their corners (dim, n): what is made of them takes little memory."""
    for start in range(0, mesh.t.shape[1], _CHUNK):
        elements = slice(start, start + _CHUNK)
        yield elements, [mesh.p.take(t, axis=1) for t in mesh.t[:, elements]]


def _determinant(columns: list[Floats]) -> Floats:
    """Determinants of many matrices, given as columns (dim, n): written out, a third of the time of a library's."""
    out: Floats
    if len(columns) == 1:
        out = columns[0][0]
    elif len(columns) == 2:
        (a, b), (c, d) = columns
        out = a * d - b * c
    else:
        (a, b, c), (d, e, f), (g, h, i) = columns
        out = a * (e * i - f * h) + d * (h * c - i * b) + g * (b * f - c * e)
    return out


def vertex_volumes(mesh: Mesh, density: Floats | None = None) -> Floats:
    """Return the integral of each hat function: an equal share of every element at its vertices, (nvertices,).

    With a ``density``, one for each element, it is the integral of that times each hat function.

    >>> import skfem
    >>> vertex_volumes(skfem.MeshLine(np.array([0.0, 1.0, 3.0]))).tolist()
    [0.5, 1.5, 1.0]
    """
    corners = mesh.t.shape[0]
    volume = element_volumes(mesh) if density is None else density * element_volumes(mesh)
    share = np.broadcast_to(volume / corners, mesh.t.shape)
    return np.asarray(np.bincount(mesh.t.ravel(), share.ravel(), mesh.nvertices), dtype=float)


def edge_of_volume(volume: Floats, dim: int) -> Floats:
    """Return the edges of cubes of some volumes; lengths scaled by a power of two, they have the same bits.

    >>> edge_of_volume(np.array([8.0, 27.0]), 3).round(12).tolist()
    [2.0, 3.0]
    """
    # a square root is rounded correctly on every processor; a cube root is not
    edge: Floats = volume if dim == 1 else np.sqrt(volume) if dim == 2 else cube_root(volume)
    return edge


def vertex_sizes(mesh: Mesh) -> Floats:
    """Return the edge of the cube that each vertex stands for, ``h_i = (d! mean|T|)^(1/d)``, (nvertices,).

    The mean runs over the elements at the vertex, so a vertex on the boundary or on a crack gets the same size as
    its neighbours inside, though its volume is smaller.

    >>> import skfem
    >>> vertex_sizes(skfem.MeshTri().refined(2)).round(12).tolist()[:3]
    [0.25, 0.25, 0.25]
    """
    volume = np.broadcast_to(element_volumes(mesh), mesh.t.shape)
    total = np.bincount(mesh.t.ravel(), volume.ravel(), mesh.nvertices)
    count = np.bincount(mesh.t.ravel(), minlength=mesh.nvertices)
    dim = mesh.dim()
    size = edge_of_volume(factorial(dim) * total / count, dim)
    return size


def longest_edge(mesh: Mesh) -> float:
    """Return the length of the longest edge of an element.

    >>> import skfem
    >>> round(longest_edge(skfem.MeshTri()), 12)
    1.414213562373
    """
    largest = 0.0
    for _, corners in _in_chunks(mesh):
        for a, b in combinations(corners, 2):
            edge = a - b
            largest = max(largest, float(np.einsum("dn,dn->n", edge, edge).max()))
    return float(np.sqrt(largest))


def outward_normals(mesh: Mesh, facets: Ints) -> tuple[Floats, Floats]:
    """Return unit normals (dim, nfacets) out of each facet's first element, and the facets' measures (nfacets,).

    Both come from the gradient of the barycentric coordinate of the opposite vertex, whatever the dimension.

    >>> import skfem
    >>> m = skfem.MeshTri().with_defaults()
    >>> n, area = outward_normals(m, m.boundaries["left"])
    >>> n.ravel().tolist(), area.tolist()
    ([-1.0, 0.0], [1.0])
    """
    element = mesh.f2t[0, facets]
    corners = mesh.t[:, element]
    opposite = corners.sum(axis=0) - mesh.facets[:, facets].sum(axis=0)
    base = mesh.p[:, opposite]
    # rows: the edges from the opposite vertex to the vertices of the facet; the plane through them is g.edge = 1
    edges = np.moveaxis(mesh.p[:, mesh.facets[:, facets]] - base[:, None, :], (0, 1, 2), (2, 1, 0))
    gradient = np.linalg.solve(edges, np.ones((*edges.shape[:2], 1)))[..., 0].T
    steep = np.linalg.norm(gradient, axis=0)
    volume = np.abs(_determinant(list(np.moveaxis(edges, (0, 1, 2), (2, 0, 1))))) / factorial(mesh.dim())
    measure = mesh.dim() * volume * steep
    return gradient / steep + 0.0, measure


def facet_directions(mesh: Mesh, most: int = 64) -> tuple[Floats, Floats]:
    """Return the distinct unit normals of all facets (dim, k) and their shares of the area (k,), up to sign.

    Both are empty when there are more than ``most`` of them: the mesh is irregular, and as good as isotropic.

    >>> import skfem
    >>> normals, share = facet_directions(skfem.MeshTri().refined(1))
    >>> normals.shape, share.round(4).tolist()                          # six edges of 1/2 twice, four of 1/sqrt(2)
    ((2, 3), [0.3398, 0.3204, 0.3398])
    """
    normal, area = outward_normals(mesh, np.arange(mesh.facets.shape[1]))
    lead = np.take_along_axis(normal, (np.abs(normal) > 1e-6).argmax(axis=0)[None], axis=0)
    normal = normal * np.sign(lead)
    distinct, which = np.unique(np.round(normal, 6), axis=1, return_inverse=True)
    if distinct.shape[1] > most:
        return np.empty((mesh.dim(), 0)), np.empty(0)
    share = np.bincount(which.ravel(), area)
    return distinct / np.linalg.norm(distinct, axis=0), share / share.sum()


def offset_from_simplices(x: Floats, corners: Floats, which: Longs) -> Floats:
    """Return each point x (dim, n) minus the nearest point of simplex ``which`` (n,) of ``corners``, (dim, n).

    ``corners`` is (dim, k, nsimplices). The simplices may be of any order k - 1: points, segments, triangles.

    >>> segment = np.array([[[0.0], [1.0]], [[0.0], [0.0]]])            # from (0, 0) to (1, 0)
    >>> offset_from_simplices(np.array([[0.5, 2.0], [2.0, 0.0]]), segment, np.array([0, 0])).tolist()
    [[0.0, 1.0], [2.0, 0.0]]
    """
    k = corners.shape[1]
    away: Floats = x - corners[:, 0, which]
    if k == 1:
        return away
    edges = corners[:, 1:] - corners[:, :1]
    inverse = np.moveaxis(np.linalg.pinv(np.moveaxis(edges, 2, 0)), 0, 2)  # (k - 1, dim, nsimplices)
    inner = [(inverse[row][:, which] * away).sum(axis=0) for row in range(k - 1)]
    for row, part in enumerate(inner):
        away = away - edges[:, row, which] * part
    outside = np.flatnonzero((np.min(inner, axis=0) < 0.0) | (np.sum(inner, axis=0) > 1.0))
    if len(outside):
        rims = [np.delete(corners, drop, axis=1) for drop in range(k)]
        offsets = np.array([offset_from_simplices(x[:, outside], rim, which[outside]) for rim in rims])
        nearest = np.linalg.norm(offsets, axis=1).argmin(axis=0)
        away[:, outside] = offsets[nearest, :, np.arange(len(outside))].T
    return away


def distance_to_simplices(x: Floats, corners: Floats, which: Longs) -> Floats:
    """Return the distance of each point x (dim, n) to simplex ``which`` (n,) of ``corners`` (dim, k, nsimplices).

    >>> segment = np.array([[[0.0], [1.0]], [[0.0], [0.0]]])            # from (0, 0) to (1, 0)
    >>> distance_to_simplices(np.array([[0.5, 2.0], [2.0, 0.0]]), segment, np.array([0, 0])).tolist()
    [2.0, 1.0]
    """
    distance: Floats = np.linalg.norm(offset_from_simplices(x, corners, which), axis=0)
    return distance
