"""Moments of a vertex by its boundary: what the ball of a vertex has of the body ends at the facets that it sees.

With ``H(rho) = int_rho^eps J (r / eps)^p r^(d - 1) dr``, p = 0 for order three and 1 for order four,

    int_{ball in D} J (r / eps)^p e^alpha dy  =  H(0) int_cone e^alpha dOmega - sum_facets int_facet e^alpha H dOmega.

The cone is all directions into the body. Facets count that the vertex sees from within; those behind a slit, a notch
or a hole do not, and shadows are radial.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from .._compile import available
from .._scaling import whole_power
from .._threads import all_threads
from .._types import Bools, Floats, Ints, Longs, Mesh
from ..geometry.simplices import outward_normals, vertex_sizes, vertex_volumes
from ..geometry.tensors import monomials, powers
from ..geometry.visibility import INSET, Sight, sight
from ..material.influence import Influence, as_influence
from .bond_list import BondList
from .moment_targets import Targets
from .quadrature import FINE, FINER, Cumulative, sphere_mean

_FLAT = 1e-9  # of the horizon: a plane this close to a vertex goes through it, and is seen from no side
_PAIRS = 1 << 15  # vertices and facets looked at together
_TASKS = 8  # of compiled sums
_CONE = 1e9  # all triangles around a vertex are seen from as close as can be
_SPHERE = {2: 2.0 * np.pi, 3: 4.0 * np.pi}
_GAUSS = np.polynomial.legendre.leggauss(4)  # of the angle in which an edge is seen


def facet_targets(bonds: BondList, with_four: bool = True) -> Targets:
    """Return moments of order three and four, ``2 V_i`` times those of the ball around the vertex.

    For bodies in two or three dimensions with w = 1. Where the whole ball lies inside they are 0, and ``H(0)`` times
    the mean over the sphere. Without ``with_four``, and in three dimensions, those of order four are 0.
    """
    mesh, dim, eps = bonds.mesh, bonds.dim, bonds.horizon
    with_four = with_four and dim == 2
    influence = as_influence(bonds.influence)
    assert isinstance(influence, Influence)
    n3, n4 = (len(monomials(dim, order)) for order in (3, 4))
    radial = [Cumulative(influence, dim - 1 + p) for p in (0, 1)]
    whole = [float(table(np.ones(1))[0]) * whole_power(eps, dim) for table in radial]
    values = np.zeros((mesh.nvertices, n3 + n4))
    if with_four:
        values[:, n3:] = whole[1] * _SPHERE[dim] * sphere_mean(dim, 4)

    def add(vertex: Longs, e: Floats, three: Floats, four: Floats) -> None:
        n = len(vertex)
        into = sparse.csr_matrix((np.ones(n), (vertex, np.arange(n))), (mesh.nvertices, n))
        values[:, :n3] += into @ (powers(e, 3) * three[:, None])
        if with_four:
            values[:, n3:] += into @ (powers(e, 4) * four[:, None])

    facets: Ints = mesh.boundary_facets()
    near = np.zeros(mesh.nvertices, dtype=bool)
    near[mesh.facets[:, facets]] = True
    values[near] = 0.0
    for vertex, corners in _cones(mesh, near):
        if available():
            # a table that is whole everywhere, and no end
            constant, cone = 2.0 * np.array(whole), _Pairs(vertex, np.arange(len(vertex)), corners)
            _add_compiled(
                mesh, cone, _CONE * eps, constant[:, None].repeat(2, axis=1), np.array(whole), with_four, values
            )
            continue
        pair, e, omega, _ = seen(corners - mesh.p[:, vertex][:, None], _CONE)
        add(vertex[pair], e, omega * whole[0], omega * whole[1])
    pairs = _Pairs.of(mesh, facets, eps)
    near[pairs.vertex] = True
    view = sight(mesh, eps)
    plain = pairs.take(~view.near[pairs.vertex])
    if available():
        tables = np.stack([radial[p].table for p in (0, 1)]) * whole_power(eps, dim)
        _add_compiled(mesh, plain, eps, tables, np.array(whole), with_four, values)
    else:
        for vertex, e, omega, rho in plain.parts(mesh, eps, None):
            add(vertex, e, *(omega * (radial[p](rho / eps) * whole_power(eps, dim) - whole[p]) for p in (0, 1)))
    for vertex, e, omega, rho in pairs.take(view.near[pairs.vertex]).parts(mesh, eps, view):
        add(vertex, e, *(omega * (radial[p](rho / eps) * whole_power(eps, dim) - whole[p]) for p in (0, 1)))
    values *= 2.0 * vertex_volumes(mesh)[:, None]
    return Targets(values, ~near, near, four_everywhere=with_four)


def _add_compiled(
    mesh: Mesh, pairs: _Pairs, eps: float, tables: Floats, whole: Floats, four: bool, values: Floats
) -> None:
    """Add what facets take off, in threads: each has vertices of its own."""
    from .facet_loops import add_edges, add_triangles

    if not len(pairs.vertex):  # all of them may have to look around corners
        return
    x, corners = np.ascontiguousarray(mesh.p.T), np.ascontiguousarray(np.moveaxis(pairs.corners, (0, 1, 2), (2, 1, 0)))
    flat, least = mesh.dim() == 2, 4 if tables.shape[1] == 2 else 1
    cuts = np.searchsorted(pairs.vertex, pairs.vertex[np.linspace(0, len(pairs.vertex), _TASKS + 1)[1:-1].astype(int)])
    edges = np.unique([0, *cuts, len(pairs.vertex)])

    def act(k: int) -> None:
        part = slice(int(edges[k]), int(edges[k + 1]))
        (add_edges if flat else add_triangles)(
            x, corners, pairs.vertex[part], pairs.facet[part], least, eps, tables, whole, four, values
        )

    list(all_threads().map(act, range(len(edges) - 1)))


def _cones(mesh: Mesh, marked: Bools) -> Iterator[tuple[Longs, Floats]]:
    """Yield marked vertices, in order, with the facet opposite to them of one of their elements, (dim, dim, n)."""
    for local in range(mesh.t.shape[0]):
        vertex = mesh.t[local].astype(np.int64)
        element = np.flatnonzero(marked[vertex])
        element = element[np.argsort(vertex[element], kind="stable")]
        yield vertex[element], mesh.p[:, np.delete(mesh.t, local, axis=0)[:, element]]


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Vertices, in order, and the facets within the horizon that face them, with all corners (dim, dim, nfacets)."""

    vertex: Longs
    facet: Longs
    corners: Floats

    @classmethod
    def of(cls, mesh: Mesh, facets: Ints, eps: float) -> _Pairs:
        """Return those of a mesh; the normal out of the body points away from the vertex."""
        corners = mesh.p[:, mesh.facets[:, facets]]
        normal, _ = outward_normals(mesh, facets)
        middle = corners.mean(axis=1)
        radius = np.linalg.norm(corners - middle[:, None], axis=0).max(axis=0)
        search = _facing if available() else _facing_by_trees
        vertex, facet = search(mesh.p, middle, normal, radius, eps)
        return cls(vertex, facet, corners)

    def take(self, which: Bools) -> _Pairs:
        return _Pairs(self.vertex[which], self.facet[which], self.corners)

    def parts(self, mesh: Mesh, eps: float, view: Sight | None) -> Iterator[tuple[Longs, Floats, Floats, Floats]]:
        """Yield vertices, directions, solid angles and distances of parts of the facets that they see."""
        size = None if view is None else vertex_sizes(mesh)
        for low in range(0, len(self.vertex), _PAIRS):
            v, f = self.vertex[low : low + _PAIRS], self.facet[low : low + _PAIRS]
            pair, e, omega, rho = seen(self.corners[:, :, f] - mesh.p[:, v][:, None], 1.0)
            use, v = rho < eps, v[pair]
            if view is not None and size is not None:
                asked = np.flatnonzero(use)
                inset = 2.0 * INSET * size[v[asked]]  # up to a little before the facet, which hides not itself
                end = mesh.p[:, v[asked]] + (rho[asked] - inset) * e[asked].T
                use[asked] = ~view.hidden(view.points[:, v[asked]], end, size[v[asked]])
            yield v[use], e[use], omega[use], rho[use]


def _facing(x: Floats, middle: Floats, normal: Floats, radius: Floats, eps: float) -> tuple[Longs, Longs]:
    """Vertices and facets that face each other within the horizon, in order, by compiled loops."""
    from ..geometry.neighbour_loops import Cells
    from .facet_loops import facing

    dim = len(x)
    points, circles = np.zeros((x.shape[1], 3)), np.zeros((len(radius), 7))
    points[:, :dim], circles[:, :dim], circles[:, 3 : 3 + dim], circles[:, 6] = x.T, middle.T, normal.T, radius
    cells = Cells.of(circles[:, :3], eps + float(radius.max()))
    chunks = np.array_split(np.arange(len(points)), _TASKS)
    place, close = cells.cell_of(points), eps * (1.0 - _FLAT)

    def act(rows: Longs) -> tuple[Longs, Longs]:
        count, room = np.empty(len(rows), dtype=np.int64), 32 * len(rows)
        while True:
            found = np.empty(room, dtype=np.int64)
            arrays = cells.shape, cells.order, cells.start, circles
            total = facing(points[rows], place[rows], *arrays, close, _FLAT * eps, found, count)
            if total <= room:
                return np.repeat(rows, count), found[:total]
            room = total

    vertex, facet = zip(*all_threads().map(act, chunks), strict=True)
    return np.concatenate(vertex), np.concatenate(facet)


def _facing_by_trees(x: Floats, middle: Floats, normal: Floats, radius: Floats, eps: float) -> tuple[Longs, Longs]:
    """The same by search trees."""
    from scipy.spatial import cKDTree

    tree, far = cKDTree(middle.T), (eps + float(radius.max())) * (1.0 + 1e-9)
    close = np.flatnonzero(np.isfinite(tree.query(x.T, distance_upper_bound=far)[0]))
    found = cKDTree(x[:, close].T).sparse_distance_matrix(tree, far, output_type="ndarray")
    vertex, facet = close[found["i"]].astype(np.int64), found["j"].astype(np.int64)
    height = np.einsum("dn,dn->n", normal[:, facet], middle[:, facet] - x[:, vertex])
    # no closer than this: the height over the plane, and the way in the plane to a circle around the facet
    aside = np.sqrt(np.maximum(found["v"] ** 2 - height**2, 0.0)) - radius[facet]
    closest = np.hypot(height, np.maximum(aside, 0.0))
    keep = np.flatnonzero((height > _FLAT * eps) & (closest < eps * (1.0 - _FLAT)))
    keep = keep[np.lexsort((facet[keep], vertex[keep]))]
    return vertex[keep], facet[keep]


def seen(corners: Floats, nearest: float) -> tuple[Longs, Floats, Floats, Floats]:
    """Return parts of facets as they are seen from the origin: which facet, direction, solid angle and distance.

    ``corners`` (dim, dim, n). Of a triangle the parts are more the closer it is; ``nearest`` scales that.

    >>> pair, e, omega, rho = seen(np.array([[[1.0], [1.0]], [[-1.0], [1.0]]]), 1.0)    # an edge at distance 1
    >>> float(omega.sum() / np.pi), float((omega / rho**0 * e[:, 0]).sum().round(6))      # a right angle
    (0.5, 1.414214)
    """
    return _seen_edge(corners) if len(corners) == 2 else _seen_triangle(corners, nearest)


def _seen_edge(corners: Floats) -> tuple[Longs, Floats, Floats, Floats]:
    (ax, bx), (ay, by) = corners
    first, turn = np.arctan2(ay, ax), np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
    x, w = _GAUSS
    angle = first + 0.5 * turn * (1.0 + x[:, None])
    e = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    nx, ny = by - ay, ax - bx
    with np.errstate(divide="ignore", invalid="ignore"):
        rho = (ax * nx + ay * ny) / (e[..., 0] * nx + e[..., 1] * ny)
    omega = 0.5 * np.abs(turn) * w[:, None]
    pair = np.tile(np.arange(len(ax)), len(x))
    rho = np.where(np.isfinite(rho), rho, np.inf)
    return pair, e.reshape(-1, 2), omega.ravel(), rho.ravel()


def _seen_triangle(corners: Floats, nearest: float) -> tuple[Longs, Floats, Floats, Floats]:
    level, out = _level(corners, nearest), []
    for depth in range(3):
        which = np.flatnonzero(level == depth)
        if not len(which):
            continue
        parts = _subdivided(corners[:, :, which], depth)  # (dim, 3, n, k)
        a, b, c = (parts[:, k] for k in range(3))
        la, lb, lc = (np.sqrt((x * x).sum(axis=0)) for x in (a, b, c))
        normal = np.cross(b - a, c - a, axis=0)
        det = (a * normal).sum(axis=0)  # a . (b x c)
        ab, ac, bc = (a * b).sum(axis=0), (a * c).sum(axis=0), (b * c).sum(axis=0)
        omega = 2.0 * np.arctan2(np.abs(det), la * lb * lc + ab * lc + ac * lb + bc * la)
        e = a / la + b / lb + c / lc
        e /= np.sqrt((e * e).sum(axis=0))
        with np.errstate(divide="ignore", invalid="ignore"):
            rho = np.abs(det / (e * normal).sum(axis=0))
        pair = np.repeat(which, parts.shape[3])
        out.append((pair, e.reshape(3, -1).T, omega.ravel(), np.where(np.isfinite(rho), rho, np.inf).ravel()))
    pair, e, omega, rho = (np.concatenate(x) for x in zip(*out, strict=True))
    return pair, e, omega, rho


def _level(corners: Floats, nearest: float) -> Longs:
    """How often each triangle is halved: the closer, the more."""
    middle = corners.mean(axis=1)
    edges = corners - np.roll(corners, 1, axis=1)
    ratio = (edges**2).sum(axis=0).max(axis=0) / np.maximum((middle**2).sum(axis=0), np.finfo(float).tiny) * nearest
    level: Longs = (ratio > FINE).astype(np.int64) + (ratio > FINER)
    return level


def _subdivided(corners: Floats, depth: int) -> Floats:
    """Triangles (3, 3, n) in 4^depth parts, (3, 3, n, k)."""
    parts = corners[..., None]
    for _ in range(depth):
        a, b, c = parts[:, 0], parts[:, 1], parts[:, 2]
        ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
        four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        parts = np.concatenate([np.stack(part, axis=1) for part in four], axis=-1)
    return parts
