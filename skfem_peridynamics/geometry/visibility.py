"""Which vertices see each other: bonds do not cross slits, notches or holes.

A bond is blocked when its segment crosses a boundary facet. Three details make that exact on meshes whose lattice
lines meet cracks:

* the two copies of a slit vertex coincide, so every boundary vertex is first moved by 1e-6 of its size into its own
  side, a direction inward of all its facets; at a crack tip there is none and the tip stays where it is;
* a bond that only touches the rim of a facet (a crack tip, a notch corner, an edge two facets share) is tried again
  along paths bowed a little to each side, and is blocked when every one of them leaves the body: it sees past a tip,
  and does not slip through the seam of two facets or around the mouth of a crack;
* only facets with a vertex of the body on their outer side can block anything: a convex body has none. And nothing
  blocks the edge of an element.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Bools, Floats, Longs, Mesh
from .simplices import outward_normals, vertex_sizes
from .vertex_sectors import vertex_sectors

INSET = 1e-6  # of the vertex size
_SEAM = 1e-5  # barycentric: more than an inset can shift a crossing
_BOW = 1e-3  # of the vertex size, more than the seam
_PART = 0.3819660112501051  # where a path bends: irrational, so that lattice planes do not hold the bend
_EDGE = 1e-9  # barycentric, round-off of a closed facet
_FLUSH = 1e-13  # of the body: closer to a plane than this is on it, far less than an inset
_GILBERT = 60  # rounds: wedges of 5 degrees need about 20
_BONDS = 4096  # looked at together: bounds the bond-facet pairs held in memory


@dataclass(frozen=True)
class Facets:
    """Facets as planes: a corner and a unit normal (dim, n), and gradients of dim - 1 barycentric coordinates."""

    corner: Floats
    normal: Floats
    gradient: Floats  # (dim - 1, dim, n)
    middle: Floats
    radius: float
    flush: float

    @classmethod
    def from_corners(cls, corners: Floats, normal: Floats, extent: float) -> Facets:
        edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
        middle = corners.mean(axis=1)
        radius = float(np.linalg.norm(corners - middle[:, None], axis=0).max(initial=0.0))
        gradient = np.moveaxis(np.asarray(np.linalg.pinv(edges), dtype=float), 0, 2)
        return cls(corners[:, 0], normal, gradient, middle, radius, _FLUSH * extent)

    def pairs(self, p: Floats, q: Floats) -> tuple[Longs, Longs]:
        """Return the segments and the facets that are close enough to meet."""
        from scipy.spatial import cKDTree

        half = 0.5 * float(np.linalg.norm(q - p, axis=0).max())
        tree, middles = cKDTree(self.middle.T), cKDTree((0.5 * (p + q)).T)
        distances = middles.sparse_distance_matrix(tree, (half + self.radius) * (1.0 + 1e-9), output_type="ndarray")
        return distances["i"], distances["j"]

    def margin(self, p: Floats, q: Floats, which: Longs) -> Floats:
        """Least barycentric coordinate at which the segment p q crosses facet ``which``; -inf where it does not."""
        corner, normal = self.corner[:, which], self.normal[:, which]
        above, below = ((normal * (end - corner)).sum(axis=0) for end in (p, q))
        margin = np.full(len(which), -np.inf)
        cross = np.flatnonzero((above * below < 0.0) & (np.minimum(np.abs(above), np.abs(below)) > self.flush))
        if len(cross):
            above, below, which = above[cross], below[cross], which[cross]
            p, q = p[:, cross], q[:, cross]
            foot = p + (q - p) * (above / (above - below)) - corner[:, cross]
            least, rest = np.full(len(cross), np.inf), np.ones(len(cross))
            for row in self.gradient:
                coordinate = (row[:, which] * foot).sum(axis=0)
                least = np.minimum(least, coordinate)
                rest -= coordinate
            margin[cross] = np.minimum(least, rest)
        return margin


@dataclass(frozen=True)
class Sight:
    """Decide visibility on one mesh; build it with :func:`sight`.

    ``points`` are the inset vertices (dim, n), or points inside elements as they are, and ``size`` their sizes;
    ``blocking`` the facets that can block, ``boundary`` all facets near those; ``near`` marks the points that have a
    blocking facet within reach; ``edges`` are the mesh edges there, as sorted numbers ``low * nvertices + high``.
    """

    points: Floats
    size: Floats
    blocking: Facets
    boundary: Facets
    near: Bools
    edges: Longs

    def blocked(self, i: Longs, j: Longs) -> Bools:
        """Return for each bond (i, j) whether a facet stands between its ends, shape (nbonds,)."""
        out = np.zeros(len(i), dtype=bool)
        suspect = np.flatnonzero(self.near[i] & self.near[j])
        if not len(suspect):
            return out
        a, b = i[suspect], j[suspect]
        suspect = suspect[~np.isin(np.minimum(a, b) * len(self.near) + np.maximum(a, b), self.edges)]
        a, b = i[suspect], j[suspect]
        out[suspect] = self.hidden(self.points[:, a], self.points[:, b], np.minimum(self.size[a], self.size[b]))
        return out

    def hidden(self, p: Floats, q: Floats, size: Floats) -> Bools:
        """Return for each segment p q whether a facet stands between its ends; ``size`` of the elements around."""
        out = np.zeros(p.shape[1], dtype=bool)
        for start in range(0, p.shape[1], _BONDS):
            part = slice(start, start + _BONDS)
            crossed, touches = self._crossed(p[:, part], q[:, part])
            touch = np.flatnonzero(touches & ~crossed)
            if len(touch):
                here = start + touch
                crossed[touch] = self._enclosed(p[:, here], q[:, here], _BOW * size[here])
            out[part] = crossed
        return out

    def _crossed(self, p: Floats, q: Floats) -> tuple[Bools, Bools]:
        """Which segments cross a blocking facet well inside it, and which touch the rim of one."""
        bond, facet = self.blocking.pairs(p, q)
        margin = self.blocking.margin(p[:, bond], q[:, bond], facet)
        n = p.shape[1]
        crossed = np.bincount(bond, margin > _SEAM, n) > 0
        return crossed, np.bincount(bond, np.abs(margin) <= _SEAM, n) > 0

    def _enclosed(self, p: Floats, q: Floats, bow: Floats) -> Bools:
        """Which segments leave the body along every path bowed by ``bow``."""
        n = p.shape[1]
        enclosed = np.ones(n, dtype=bool)
        for across in _sideways(q - p):
            middle = p + _PART * (q - p) + bow * across
            leaves = np.zeros(n, dtype=bool)
            for start, end in ((p, middle), (middle, q)):
                bond, facet = self.boundary.pairs(start, end)
                margin = self.boundary.margin(start[:, bond], end[:, bond], facet)
                leaves |= np.bincount(bond, margin >= -_EDGE, n) > 0
            enclosed &= leaves
        return enclosed


def _sideways(direction: Floats) -> list[Floats]:
    """Unit vectors across each direction (dim, n): both ways along dim - 1 axes; the zero vector in 1D."""
    dim, n = direction.shape
    if dim == 1:
        return [np.zeros((1, n))]
    # the last dim - 1 columns of the Householder reflection that takes the first axis to the direction
    unit = direction / np.linalg.norm(direction, axis=0)
    v = unit.copy()
    v[0] += np.where(unit[0] < 0.0, -1.0, 1.0)
    out = []
    for axis in range(1, dim):
        across = -v * (v[axis] / (0.5 * (v * v).sum(axis=0)))
        across[axis] += 1.0
        out += [across, -across]
    return out


def sight(mesh: Mesh, reach: float, points: Floats | None = None, size: Floats | None = None) -> Sight:
    """Prepare the visibility test for bonds no longer than ``reach`` between the vertices.

    Or between ``points`` (dim, n) strictly inside elements, with the ``size`` (n,) of what each stands for.

    >>> import skfem
    >>> m = skfem.MeshTri.init_lshaped().refined(2)           # the quarter x > 0, y > 0 is cut out
    >>> tip = np.flatnonzero((m.p == np.array([[0.5], [0.0]])).all(axis=0))
    >>> low = np.flatnonzero((m.p == np.array([[0.0], [0.5]])).all(axis=0))
    >>> sight(m, 1.0).blocked(tip, low).tolist()
    [True]
    """
    from scipy.spatial import cKDTree

    facets = mesh.boundary_facets()
    normal, _ = outward_normals(mesh, facets)
    corners = mesh.p[:, mesh.facets[:, facets]]
    inside = points is not None
    points, size = (mesh.p, vertex_sizes(mesh)) if points is None or size is None else (points, size)
    # a facet can block only when the body reaches beyond its plane
    hull = _extreme(mesh.p)
    extent = float(np.ptp(hull, axis=1).max())
    height = np.einsum("df,df->f", normal, corners[:, 0])
    blocking = np.zeros(len(facets), dtype=bool)
    step = max(1, (1 << 20) // hull.shape[1])
    for start in range(0, len(facets), step):
        part = slice(start, start + step)
        blocking[part] = (normal[:, part].T @ hull).max(axis=1) - height[part] > 1e-9 * extent
    # the two faces of a slit coincide: one of them does for both
    middle = corners.mean(axis=1)
    _, first = np.unique(np.round((middle - middle.min(axis=1, keepdims=True)) / extent, 12), axis=1, return_index=True)
    standing = np.intersect1d(np.flatnonzero(blocking), first)
    near, around = np.zeros(points.shape[1], dtype=bool), np.zeros(len(facets), dtype=bool)
    block = Facets.from_corners(corners[:, :, standing], normal[:, standing], extent)
    if len(standing):
        tree = cKDTree(block.middle.T)
        far = (reach + block.radius) * (1.0 + 1e-9)
        near = np.isfinite(tree.query(points.T, distance_upper_bound=far)[0])
        close = np.isfinite(tree.query(mesh.p.T, distance_upper_bound=far)[0]) if inside else near
        around[first] = close[mesh.facets[:, facets[first]]].any(axis=0)
    boundary = Facets.from_corners(corners[:, :, around], normal[:, around], extent)
    if inside or not len(standing):
        return Sight(points, size, block, boundary, near, np.empty(0, dtype=np.int64))
    inward = _inward(mesh, facets, normal)
    return Sight(mesh.p + INSET * size * inward, size, block, boundary, near, _edges(mesh, near))


def _edges(mesh: Mesh, near: Bools) -> Longs:
    """The edges of elements between ``near`` vertices, as sorted numbers."""
    t = np.sort(mesh.t[:, near[mesh.t].any(axis=0)].astype(np.int64), axis=0)
    low, high = np.triu_indices(len(t), 1)
    edges: Longs = np.unique(t[low] * mesh.nvertices + t[high])
    return edges


def _inward(mesh: Mesh, facets: Longs, normal: Floats) -> Floats:
    """Unit vectors (dim, nvertices) inward of all facets at a boundary vertex; 0 inside and where there is none.

    Minus the point of the convex hull of the outward normals that is closest to the origin is such a direction
    whenever one exists; Gilbert's algorithm finds it, for all vertices together. Where several fans of elements
    meet in one vertex it is left alone.
    """
    vertex = mesh.facets[:, facets].ravel()
    n = np.tile(normal, mesh.facets.shape[0])
    on_boundary = np.zeros(mesh.nvertices, dtype=bool)
    on_boundary[vertex] = True
    _, _, of_fan = vertex_sectors(mesh, on_boundary, np.empty(0, dtype=np.int64))
    single = np.bincount(of_fan, minlength=mesh.nvertices) == 1
    n, vertex = n[:, single[vertex]], vertex[single[vertex]]
    point = np.zeros_like(mesh.p)
    order = np.argsort(vertex, kind="stable")
    n, vertex = n[:, order], vertex[order]
    present, first = np.unique(vertex, return_index=True)
    point[:, present] = n[:, first]
    for _ in range(_GILBERT):
        height = (n * point[:, vertex]).sum(axis=0)
        lowest = np.minimum.reduceat(height, first)
        wanting = lowest < 0.5 * (point[:, present] ** 2).sum(axis=0)
        if not wanting.any():
            break
        # the segment from the point to the lowest normal comes closer to the origin
        place = first[wanting]
        is_lowest = height == np.repeat(lowest, np.diff(np.append(first, len(vertex))))
        hit = np.flatnonzero(is_lowest)
        pick = hit[np.searchsorted(hit, place)]
        here = present[wanting]
        step = n[:, pick] - point[:, here]
        part = -(point[:, here] * step).sum(axis=0) / np.maximum((step**2).sum(axis=0), np.finfo(float).tiny)
        point[:, here] += np.clip(part, 0.0, 1.0) * step
    length = np.linalg.norm(point, axis=0)
    lowest = np.full(mesh.nvertices, np.inf)
    lowest[present] = np.minimum.reduceat((n * point[:, vertex]).sum(axis=0), first)
    exists = (length > 1e-3) & (lowest > 1e-2 * length)
    return np.where(exists, -point / np.maximum(length, np.finfo(float).tiny), 0.0)


def _extreme(p: Floats) -> Floats:
    """Points (dim, n) whose convex hull is that of the body, or the corners of its box where it is too flat to tell."""
    from scipy.spatial import ConvexHull, QhullError

    low, high = p.min(axis=1), p.max(axis=1)
    if len(p) > 1:
        try:
            hull: Floats = p[:, ConvexHull(p.T).vertices]
            return hull
        except QhullError:
            pass
    return np.stack([np.where(corner, high, low) for corner in np.ndindex((2,) * len(p))], axis=1)
