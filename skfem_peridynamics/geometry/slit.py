"""Pre-cracks: open a mesh along facets, so that a crack is a boundary and its two faces are not glued by P1."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from .._types import Bools, Floats, Ints, Longs, Mesh
from .layers import named_facets
from .simplices import check_simplices, describe_point, distance_to_simplices
from .vertex_sectors import vertex_sectors


@dataclass(frozen=True)
class Crack:
    """A crack as geometry: a point (1D), a polyline (2D) or a convex planar polygon (3D).

    Facets of the mesh must follow it.

    Parameters
    ----------
    points : array_like, (ncorners, dim)
        Its corners, in the units of the mesh.

    Raises
    ------
    ValueError
        For too few points, coordinates that are not finite, or a polygon that is not planar.

    Examples
    --------
    >>> Crack([[0.0, 0.5], [0.5, 0.5]]).corners.shape        # (dim, corners of a piece, pieces)
    (2, 2, 1)
    """

    points: npt.ArrayLike

    def __post_init__(self) -> None:
        points = self._points
        if points.ndim != 2 or not 1 <= points.shape[1] <= 3:
            raise ValueError(f"crack points must be rows of 1 to 3 coordinates, not an array of shape {points.shape}")
        if not np.isfinite(points).all():
            raise ValueError(f"crack points {points.tolist()} must be finite numbers")
        dim = points.shape[1]
        if len(points) < dim:
            raise ValueError(f"a crack in {dim}D needs at least {dim} points, not {len(points)}")
        if dim == 3:
            flatness = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
            if flatness[1] <= 1e-9 * flatness[0] or (len(flatness) > 2 and flatness[2] > 1e-6 * flatness[0]):
                raise ValueError(f"crack points {points.tolist()} must span one plane")
        elif dim == 2 and (np.linalg.norm(np.diff(points, axis=0), axis=1) == 0.0).any():
            raise ValueError(f"crack points {points.tolist()} repeat a point")

    @property
    def _points(self) -> Floats:
        return np.asarray(self.points, dtype=float)

    @property
    def corners(self) -> Floats:
        """The crack as simplices, shape (dim, corners of a piece, pieces)."""
        points = self._points
        if points.shape[1] == 1:
            pieces = points[:, None, :]
        elif points.shape[1] == 2:
            pieces = np.stack([points[:-1], points[1:]], axis=1)
        else:  # a fan of triangles fills a convex polygon
            n = len(points) - 2
            pieces = np.stack([np.repeat(points[:1], n, axis=0), points[1:-1], points[2:]], axis=1)
        return np.moveaxis(pieces, (0, 1, 2), (2, 1, 0))


def facets_on(mesh: Mesh, crack: Crack, tolerance: float = 1e-6) -> Longs:
    """Return the interior facets that lie on a crack, to ``tolerance`` times the facet's own size.

    Raises ``ValueError`` when none does, or when they cover less than the crack that lies in the body.

    >>> import skfem
    >>> m = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> len(facets_on(m, Crack([[0, 0.5], [0.5, 0.5]])))
    2
    """
    corners = crack.corners
    if corners.shape[0] != mesh.dim():
        raise ValueError(f"crack points have {corners.shape[0]} coordinates, the mesh has {mesh.dim()}")
    inner = np.setdiff1d(np.arange(mesh.facets.shape[1]), mesh.boundary_facets())
    vertices = mesh.p[:, mesh.facets[:, inner]]
    middle = vertices.mean(axis=1)
    size = np.linalg.norm(vertices - middle[:, None], axis=0).max(axis=0)
    size = np.where(size > 0.0, size, np.ptp(mesh.p[0]) / mesh.nelements)
    low, high = corners.min(axis=(1, 2)), corners.max(axis=(1, 2))
    near = np.flatnonzero(((middle >= (low[:, None] - size)) & (middle <= high[:, None] + size)).all(axis=0))
    on: Bools = np.ones(len(near), dtype=bool)
    for k in range(vertices.shape[1] + 1):  # each vertex, and the midpoint: a facet may not bridge a kink
        point = middle[:, near] if k == vertices.shape[1] else vertices[:, k, near]
        gap = np.full(len(near), np.inf)
        for piece in range(corners.shape[2]):
            gap = np.minimum(gap, distance_to_simplices(point, corners, np.full(len(near), piece)))
        on &= gap <= tolerance * size[near]
    chosen = inner[near[on]]
    start, end = (describe_point(p) for p in (crack._points[0], crack._points[-1]))
    if not len(chosen):
        body_low, body_high = mesh.p.min(axis=1), mesh.p.max(axis=1)
        if (high < body_low).any() or (low > body_high).any():
            raise ValueError(
                f"crack from {start} to {end} lies outside the body, which reaches from {describe_point(body_low)} "
                f"to {describe_point(body_high)}"
            )
        ends = (mesh.p[:, np.linalg.norm(mesh.p.T - x, axis=1).argmin()] for x in (crack._points[0], crack._points[-1]))
        raise ValueError(
            f"crack from {start} to {end}: no interior facet of the mesh lies on it; facets must follow it "
            f"(the vertices nearest to its ends are at {' and '.join(map(describe_point, ends))})"
        )
    if mesh.dim() > 1:
        covered = _measure(mesh.p[:, mesh.facets[:, chosen]])
        wanted = _measure(corners)
        if covered < wanted * (1.0 - 1e-4):
            raise ValueError(
                f"crack from {start} to {end}: facets of the mesh follow only {covered:.6g} of its {wanted:.6g}; "
                "let the mesh follow all of it, and let it lie inside the body"
            )
    return chosen


def _measure(corners: Floats) -> float:
    """Total length or area of simplices (dim, k, n) of order k - 1, by their Gram determinants."""
    edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
    gram = np.einsum("ndi,ndj->nij", edges, edges)
    return float(np.sqrt(np.maximum(np.linalg.det(gram), 0.0)).sum() / (edges.shape[2] if edges.shape[2] > 1 else 1))


def slit(mesh: Mesh, *cracks: Crack, facets: Any = None, name: str = "slit") -> Mesh:
    """Open the mesh along cracks or tagged facets: vertices there are doubled, except at tips.

    Named boundaries and subdomains are kept; the two faces become the boundary ``name``. Faces that meet (T or X
    junctions) get as many copies of a vertex as there are sides. ``mesh.is_valid()`` is False on the result, by design.

    Parameters
    ----------
    mesh : skfem.Mesh
        Lines, triangles or tetrahedra.
    *cracks
        Where to cut, as geometry.
    facets : optional
        Where to cut, as scikit-fem names facets: a name, indices, a callable of midpoints, or a list of these.
    name : str, optional
        Name of the boundary that the two faces become.

    Returns
    -------
    skfem.Mesh
        A mesh with more vertices and the same elements.

    Raises
    ------
    ValueError
        When no facet lies on a crack or the set is empty.

    Examples
    --------
    >>> import skfem
    >>> m = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> opened = slit(m, Crack([[0, 0.5], [0.5, 0.5]]))
    >>> int(opened.nvertices - m.nvertices), len(opened.boundaries["slit"])    # mouth and one more; two faces of 2
    (2, 4)
    """
    check_simplices(mesh)
    on = [facets_on(mesh, crack) for crack in cracks]
    if facets is not None:
        tagged = named_facets(mesh, facets)
        on.append(np.setdiff1d(tagged, mesh.boundary_facets()))
        if not len(on[-1]):
            raise ValueError(f"facets = {facets!r} lie on the boundary already; a slit opens interior facets")
    if not on:
        raise ValueError("slit needs a Crack or facets=")
    cut = np.unique(np.concatenate(on)).astype(np.int64)
    t, origin = _split(mesh, cut)
    opened = dataclasses.replace(
        mesh,
        doflocs=np.ascontiguousarray(mesh.p[:, origin]),
        t=np.ascontiguousarray(t),
        _boundaries=None,
        _subdomains=mesh.subdomains,
    )
    # facets keep their identity as sets of original vertices
    old, new = _label(mesh.facets, mesh.nvertices), _label(origin[opened.facets], mesh.nvertices)
    named = dict(mesh.boundaries or {})
    boundaries = {key: np.flatnonzero(np.isin(new, old[value])).astype(np.int32) for key, value in named.items()}
    faces = np.flatnonzero(np.isin(new, old[cut])).astype(np.int32)
    boundaries[name] = np.union1d(boundaries.get(name, faces), faces)  # slitting again adds to the first slit
    return dataclasses.replace(opened, _boundaries=boundaries)


def _label(facets: Longs, nvertices: int) -> Longs:
    """One number per facet from its vertices, whatever their order (exact up to two million vertices in 3D)."""
    label = np.zeros(facets.shape[1], dtype=np.int64)
    for vertex in np.sort(facets, axis=0).astype(np.int64):
        label = label * nvertices + vertex
    return label


def _split(mesh: Mesh, cut: Longs) -> tuple[Ints, Longs]:
    """Return connectivity with doubled vertices, and the original vertex of each new one.

    Around a vertex on the crack two elements stay together when a chain of uncut facets at that vertex joins them.
    """
    on_crack = np.zeros(mesh.nvertices, dtype=bool)
    on_crack[mesh.facets[:, cut]] = True
    corners, fan, vertex = vertex_sectors(mesh, on_crack, cut)
    # the first fan of a vertex keeps its number, the others get copies
    first = np.ones(len(vertex), dtype=bool)
    first[1:] = vertex[1:] != vertex[:-1]
    number = vertex.copy()
    number[~first] = mesh.nvertices + np.arange((~first).sum())
    new = mesh.t.reshape(-1).astype(np.int64)
    new[corners] = number[fan]
    origin = np.concatenate([np.arange(mesh.nvertices), vertex[~first]])
    return new.reshape(mesh.t.shape).astype(mesh.t.dtype), origin
