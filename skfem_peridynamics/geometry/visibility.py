"""Which vertices see each other: bonds do not cross slits, notches or holes.

A bond is blocked when its segment crosses a boundary facet. Three details make that exact on meshes whose
lattice lines meet cracks:

* the two copies of a slit vertex coincide, so every boundary vertex is first moved by 1e-6 of its size against its
  outward normals, into its own side; at a crack tip the normals cancel and the tip stays where it is;
* a bond that touches only the rim of a facet (a crack tip, a notch corner, an edge two facets share) is looked at
  again a hair to each side, and is blocked only when it is blocked on all of them: it sees past a tip, and does
  not slip through the seam of two facets;
* only facets with a vertex of the body on their outer side can block anything: a convex body has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from .._types import Bools, Floats, Longs, Mesh
from .simplices import outward_normals, vertex_sizes

_INSET = 1e-6  # of the vertex size
_ASIDE = 1e-8  # of the vertex size, much less than the inset
_SEAM = 1e-11  # barycentric, much less than a step aside, much more than round-off
_CHUNK = 1 << 17  # bond-facet pairs at a time


@dataclass(frozen=True)
class Sight:
    """Decide visibility on one mesh; build it with :func:`sight`.

    ``points`` are the inset vertices (dim, n) and ``size`` their sizes; ``facets`` those that can block, with their
    ``middle`` (dim, nf) and largest ``radius``; ``near`` marks the vertices that have one within reach.
    """

    points: Floats
    size: Floats
    facets: Facets
    middle: Floats
    radius: float
    near: Bools

    def blocked(self, i: Longs, j: Longs) -> Bools:
        """Return for each bond (i, j) whether a facet stands between its ends, shape (nbonds,)."""
        out = np.zeros(len(i), dtype=bool)
        if not self.middle.shape[1]:
            return out
        suspect = np.flatnonzero(self.near[i] & self.near[j])
        tree = cKDTree(self.middle.T)
        step = max(1, _CHUNK // 32)
        for start in range(0, len(suspect), step):
            bonds = suspect[start : start + step]
            p, q = self.points[:, i[bonds]], self.points[:, j[bonds]]
            half = 0.5 * np.linalg.norm(q - p, axis=0).max()
            pairs = cKDTree((0.5 * (p + q)).T).sparse_distance_matrix(tree, half + self.radius, output_type="ndarray")
            aside = _ASIDE * np.minimum(self.size[i[bonds]], self.size[j[bonds]])
            out[bonds] = self._blocked(p, q, aside, pairs["i"], pairs["j"])
        return out

    def _blocked(self, p: Floats, q: Floats, aside: Floats, bond: Longs, facet: Longs) -> Bools:
        n = p.shape[1]
        inner = np.empty(len(bond))
        for start in range(0, len(bond), _CHUNK):
            part = slice(start, start + _CHUNK)
            inner[part] = self.facets.margin(p[:, bond[part]], q[:, bond[part]], facet[part])
        blocked: Bools = np.bincount(bond, inner > _SEAM, n) > 0
        # what only touched: look again from a hair to each side
        seam = np.bincount(bond, inner >= -_SEAM, n).astype(bool) & ~blocked
        again = np.flatnonzero(seam[bond])
        if len(again):
            every = seam.copy()
            for across in _sideways(q - p):
                shift = aside * across
                margin = self.facets.margin((p + shift)[:, bond[again]], (q + shift)[:, bond[again]], facet[again])
                every &= np.bincount(bond[again], margin >= -_SEAM, n) > 0
            blocked |= every
        return blocked


@dataclass(frozen=True)
class Facets:
    """Facets as planes: a corner (dim, n), a unit normal (dim, n) and the gradients of dim - 1 barycentric coordinates."""

    corner: Floats
    normal: Floats
    gradient: Floats  # (dim - 1, dim, n)

    @classmethod
    def of(cls, corners: Floats, normal: Floats) -> Facets:
        edges = np.moveaxis(corners[:, 1:] - corners[:, :1], 2, 0)
        return cls(corners[:, 0], normal, np.moveaxis(np.linalg.pinv(edges), 0, 2))

    def margin(self, p: Floats, q: Floats, which: Longs) -> Floats:
        """Least barycentric coordinate at which the open segment p q meets facet ``which``; -inf where it does not."""
        corner, normal = self.corner[:, which], self.normal[:, which]
        above, below = ((normal * (end - corner)).sum(axis=0) for end in (p, q))
        margin = np.full(len(which), -np.inf)
        cross = np.flatnonzero(above * below < 0.0)
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


def _sideways(direction: Floats) -> list[Floats]:
    """Unit vectors across each direction (dim, n): both ways along dim - 1 axes; the zero shift in 1D."""
    dim, n = direction.shape
    if dim == 1:
        return [np.zeros((1, n))]
    # the last dim - 1 columns of the Householder reflection that takes the first axis to the direction
    unit = direction / np.linalg.norm(direction, axis=0)
    sign = np.where(unit[0] < 0.0, -1.0, 1.0)
    v = unit.copy()
    v[0] += sign
    out = []
    for axis in range(1, dim):
        across = -v * (v[axis] / (0.5 * (v * v).sum(axis=0)))
        across[axis] += 1.0
        out += [across, -across]
    return out


def sight(mesh: Mesh, reach: float) -> Sight:
    """Prepare the visibility test for bonds no longer than ``reach``.

    >>> import skfem
    >>> m = skfem.MeshTri.init_lshaped().refined(2)           # the quarter x > 0, y > 0 is cut out
    >>> tip = np.flatnonzero((m.p == np.array([[0.5], [0.0]])).all(axis=0))
    >>> low = np.flatnonzero((m.p == np.array([[0.0], [0.5]])).all(axis=0))
    >>> sight(m, 1.0).blocked(tip, low).tolist()
    [True]
    """
    facets = mesh.boundary_facets()
    normal, measure = outward_normals(mesh, facets)
    corners = mesh.p[:, mesh.facets[:, facets]]
    # against the sum of the unit normals at each vertex
    lean = np.zeros_like(mesh.p)
    for vertex in mesh.facets[:, facets]:
        for axis in range(mesh.dim()):
            lean[axis] += np.bincount(vertex, normal[axis] * measure, mesh.nvertices)
    length = np.linalg.norm(lean, axis=0)
    weight = np.zeros(mesh.nvertices)
    for vertex in mesh.facets[:, facets]:
        weight += np.bincount(vertex, measure, mesh.nvertices)
    lean /= np.where(length > 1e-6 * weight, length, np.inf)
    size = vertex_sizes(mesh)
    points = mesh.p - _INSET * size * lean
    # a facet can block only when the body reaches beyond its plane
    hull = mesh.p[:, _extreme(mesh.p)]
    height = np.einsum("df,df->f", normal, corners[:, 0])
    extent = np.ptp(hull, axis=1).max()
    blocking = np.zeros(len(facets), dtype=bool)
    step = max(1, (1 << 20) // hull.shape[1])
    for start in range(0, len(facets), step):
        part = slice(start, start + step)
        beyond = (normal[:, part].T @ hull).max(axis=1) - height[part]
        blocking[part] = beyond > 1e-9 * extent
    # the two faces of a slit coincide: one of them does for both
    middle = corners.mean(axis=1)
    _, first = np.unique(np.round((middle - middle.min(axis=1, keepdims=True)) / extent, 12), axis=1, return_index=True)
    standing = np.intersect1d(np.flatnonzero(blocking), first)
    corners, normal, middle = corners[:, :, standing], normal[:, standing], middle[:, standing]
    near, radius = np.zeros(mesh.nvertices, dtype=bool), 0.0
    if len(standing):
        radius = float(np.linalg.norm(corners - middle[:, None], axis=0).max())
        gap, _ = cKDTree(middle.T).query(points.T, distance_upper_bound=reach + radius)
        near = np.isfinite(gap)
    return Sight(points, size, Facets.of(corners, normal), middle, radius, near)


def _extreme(p: Floats) -> Longs:
    """Vertices that span the convex hull."""
    if p.shape[0] == 1:
        return np.array([p[0].argmin(), p[0].argmax()])
    return np.asarray(ConvexHull(p.T).vertices, dtype=np.int64)
