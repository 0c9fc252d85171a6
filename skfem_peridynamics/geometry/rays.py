"""Rays through a simplicial mesh: how far each sees, and in which elements given points of it lie.

All rays of a chunk advance together, one element a round, from neighbour to neighbour. A ray ends at its length or at
the boundary, whichever comes first; the faces of a slit are boundary. In one element the barycentric coordinates are
linear along the ray, so the facet it leaves by is the one whose coordinate falls and vanishes first; that of the facet
it came in by rises. A ray that meets a vertex or an edge turns around it element by element without advancing; one
that keeps turning (round-off on needles) is moved a hair to the side. A ray that comes from afar and exactly touches
the tip of a slit or a re-entrant corner may end there: it turns to one side, and that may be the closed one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._compile import available
from .._types import Floats, Ints, Longs, Mesh

_CHUNK = 1 << 15  # rays that advance together: bounds the memory
_PARALLEL = 1e-12  # a facet steeper than this against the ray is crossed, others are run along
_STILL = 1e-12  # of the length, or of the mesh where that is shorter: less is no advance
_TURNS = (
    40  # rounds without advancing after which a ray is moved; a vertex of a good mesh has at most about 30 elements
)
_NUDGE = 1e-10  # of the same
_MANY = 20_000  # elements from which compiled loops march; below that they take longer to load


def opposite_neighbours(mesh: Mesh) -> Ints:
    """Return the element across from each corner of each element, (nelements, dim + 1); -1 at the boundary.

    >>> import skfem
    >>> opposite_neighbours(skfem.MeshLine(np.array([0.0, 1.0, 2.0]))).tolist()
    [[1, -1], [-1, 0]]
    """
    out = np.full((mesh.nelements, mesh.t.shape[0]), -1, dtype=np.int32)
    for side in (0, 1):
        facet = np.flatnonzero(mesh.f2t[side] >= 0)
        element = mesh.f2t[side, facet]
        corner = mesh.t[:, element].sum(axis=0) - mesh.facets[:, facet].sum(axis=0)
        local = (mesh.t[:, element] == corner).argmax(axis=0)
        out[element, local] = mesh.f2t[1 - side, facet]
    return out


@dataclass(frozen=True)
class Rays:
    """Where rays ended: ``reach`` (nrays,), and the element of each node on them, ``element`` (nrays, nnodes)."""

    reach: Floats
    element: Ints


@dataclass(frozen=True, eq=False)
class Tracer:
    """Marches rays through one mesh.

    >>> import skfem
    >>> tracer = Tracer(skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5)))
    >>> x, e = np.array([[0.1, 0.1]]), np.array([[1.0, 0.0]])
    >>> start = tracer.elements_at(x)
    >>> rays = tracer.march(x, start, e, length=2.0, nodes=np.array([0.5]))
    >>> corners = tracer.mesh.p[:, tracer.mesh.t[:, rays.element[0, 0]]]
    >>> rays.reach.tolist(), corners.tolist()                             # half way is (0.55, 0.1)
    ([0.9], [[0.5, 0.5, 0.75], [0.0, 0.25, 0.25]])
    """

    mesh: Mesh

    @cached_property
    def base(self) -> Floats:
        """The first corner of each element, (nelements, dim)."""
        return np.ascontiguousarray(self.mesh.p[:, self.mesh.t[0]].T)

    @cached_property
    def gradient(self) -> Floats:
        """Gradients of the barycentric coordinates, (nelements, dim + 1, dim)."""
        edges = np.moveaxis(self.mesh.p[:, self.mesh.t[1:]] - self.mesh.p[:, self.mesh.t[:1]], 2, 0)
        inverse = np.linalg.inv(edges)
        return np.concatenate([-inverse.sum(axis=1, keepdims=True), inverse], axis=1)

    @cached_property
    def extent(self) -> float:
        """The largest side of the mesh's box."""
        return float(np.ptp(self.mesh.p, axis=1).max())

    @cached_property
    def neighbour(self) -> Ints:
        return opposite_neighbours(self.mesh)

    def barycentric(self, element: Longs | Ints, x: Floats) -> Floats:
        """Return the barycentric coordinates of points x (n, dim) in given elements, (n, dim + 1)."""
        # written out: a product of many small matrices is slower
        gradient, away = self.gradient[element], x - self.base[element]
        rest = sum(gradient[:, 1:, a] * away[:, a, None] for a in range(x.shape[1]))
        out = np.empty((len(x), x.shape[1] + 1))
        out[:, 1:] = rest
        out[:, 0] = 1.0 - out[:, 1:].sum(axis=1)
        return out

    def elements_at(self, x: Floats) -> Longs:
        """Return an element that holds each point x (n, dim), by marching there from the nearest vertex.

        Raises ``ValueError`` for a point that the straight way from its nearest vertex does not reach.
        """
        from scipy.spatial import cKDTree

        distance, vertex = cKDTree(self.mesh.p.T).query(x)
        origin = self.mesh.p.T[vertex]
        direction = np.where(distance[:, None] > 0.0, x - origin, np.eye(x.shape[1])[0])
        direction = direction / np.linalg.norm(direction, axis=1, keepdims=True)
        start = self.first_elements(vertex, direction)
        at_vertex = distance <= 1e-12 * np.ptp(self.mesh.p)
        start[at_vertex] = self.any_element(vertex[at_vertex])
        lost = start < 0
        element_of_point = start.copy()
        go = np.flatnonzero(~lost & ~at_vertex)
        if len(go):
            reach, element = self._walk(origin[go], start[go], direction[go], distance[go], distance[go, None])
            element_of_point[go] = element[:, 0]
            lost[go] = reach < distance[go] * (1.0 - 1e-9)
        if lost.any():
            raise ValueError(f"point {x[lost][0].tolist()} is not seen from its nearest vertex: is it inside the mesh?")
        return element_of_point

    def first_elements(self, vertex: Longs, direction: Floats) -> Longs:
        """Return the element at each vertex that a ray in a direction (n, dim) enters; -1 where it leaves the body.

        The choice is the element in whose cone the direction lies deepest; a direction that runs along the boundary
        is taken in.
        """
        corner, element, start = self._stars
        if self.mesh.nelements >= _MANY and available():
            from .ray_loops import first_elements

            entered = np.empty(len(vertex), dtype=np.int64)
            first_elements(vertex, direction, corner, element, start, self.gradient, -_PARALLEL, entered)
            return entered
        count = start[vertex + 1] - start[vertex]
        out = np.full(len(vertex), -1, dtype=np.int64)
        step = max(1, (1 << 18) // max(1, int(count.max(initial=1))))
        for low in range(0, len(vertex), step):
            part = slice(low, low + step)
            n = count[part]
            ray = np.repeat(np.arange(len(n)), n)
            first = np.cumsum(n) - n
            place = np.arange(len(ray)) - np.repeat(first, n) + np.repeat(start[vertex[part]], n)
            here, local = element[place], corner[place]
            gradient = self.gradient[here]
            slope = np.einsum("nkd,nd->nk", gradient, direction[part][ray])
            slope /= np.linalg.norm(gradient, axis=2)  # so that depth means an angle
            slope[np.arange(len(ray)), local] = np.inf
            depth = slope.min(axis=1)
            best = np.maximum.reduceat(depth, first)
            is_best = np.flatnonzero(depth == best[ray])
            pick = is_best[np.searchsorted(ray[is_best], np.arange(len(n)))]
            out[part] = np.where(best >= -_PARALLEL, here[pick], -1)
        return out

    def any_element(self, vertex: Longs) -> Longs:
        """Return one of the elements at each vertex."""
        _, element, start = self._stars
        return element[start[vertex]]

    @cached_property
    def _stars(self) -> tuple[Longs, Longs, Longs]:
        """Corners sorted by vertex: local number and element of each, and where each vertex starts."""
        order = np.argsort(self.mesh.t.ravel(), kind="stable")
        local, element = np.divmod(order, self.mesh.nelements)
        start = np.searchsorted(self.mesh.t.ravel()[order], np.arange(self.mesh.nvertices + 1))
        return local, element, start

    def march(
        self,
        x: Floats,
        element: Longs,
        direction: Floats,
        length: float,
        nodes: Floats,
        nodes_cut: Floats | None = None,
    ) -> Rays:
        """March rays from points x (n, dim) in given elements along unit directions (n, dim).

        ``nodes`` are increasing fractions of the way, one set for all rays; where a ray is cut short ``nodes_cut`` (or
        the same) are placed on what is left of it. An element of -1 is a ray that leaves at once: its reach is 0.
        """
        nodes_cut = nodes if nodes_cut is None else nodes_cut
        reach = np.zeros(len(x))
        crossed = np.zeros((len(x), len(nodes)), dtype=np.int32)
        for low in range(0, len(x), _CHUNK):
            part = low + np.flatnonzero(element[low : low + _CHUNK] >= 0)
            if not len(part):
                continue
            ends = np.full(len(part), length)
            begin = x[part], element[part], direction[part]
            reach[part], crossed[part] = self._walk(*begin, ends, ends[:, None] * nodes)
            cut = np.flatnonzero(reach[part] < length)
            if len(cut) and len(nodes):
                begin = x[part[cut]], element[part[cut]], direction[part[cut]]
                ends = reach[part[cut]]
                crossed[part[cut]] = self._walk(*begin, ends, ends[:, None] * nodes_cut)[1]
        return Rays(reach, crossed)

    def _walk(self, x: Floats, element: Longs, way: Floats, length: Floats, at: Floats) -> tuple[Floats, Ints]:
        """Reach of each ray, and the elements at distances ``at`` (n, nnodes)."""
        if self.mesh.nelements < _MANY or not available():
            return self._walk_together(x, element, way, length, at)
        from .ray_loops import walk

        reach, crossed, stuck = length.copy(), np.zeros(at.shape, dtype=np.int32), np.zeros(len(x), dtype=bool)
        mesh = self.gradient, self.base, self.neighbour, self.extent
        walk(x, element, way, length, at, *mesh, _PARALLEL, _STILL, _TURNS, reach, crossed, stuck)
        if stuck.any():
            rest = x[stuck], element[stuck], way[stuck], length[stuck], at[stuck]
            reach[stuck], crossed[stuck] = self._walk_together(*rest)
        return reach, crossed

    def _walk_together(self, x: Floats, element: Longs, way: Floats, length: Floats, at: Floats) -> tuple[Floats, Ints]:
        """The same, all rays an element a round."""
        n, nnodes = at.shape
        reach, crossed = length.copy(), np.zeros((n, nnodes), dtype=np.int32)
        scale = np.minimum(length, self.extent)  # what round-off is measured by
        at = np.concatenate([at, np.full((n, 1), np.inf)], axis=1)
        ray = np.arange(n)
        here = np.asarray(element, dtype=np.int64)
        next_node, turns = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        s = np.zeros(n)
        while len(ray):
            gradient, neighbour = self.gradient[here], self.neighbour[here]
            slope = sum(gradient[:, :, a] * way[:, a, None] for a in range(x.shape[1]))
            value = self.barycentric(here, x)
            steep = sum(gradient[:, :, a] ** 2 for a in range(x.shape[1]))
            leaving = (slope < 0.0) & (slope * slope > _PARALLEL**2 * steep)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                exits = np.where(leaving, np.maximum(-value / slope, s[:, None]), np.inf)
            facet = exits.argmin(axis=1)
            rows = np.arange(len(ray))
            out, follow = exits[rows, facet], neighbour[rows, facet].astype(np.int64)
            over = (follow < 0) | (out >= length)
            end = np.where(over, np.inf, out)  # round-off must not lose the last node of a ray
            while True:
                passed = np.flatnonzero(at[ray, next_node] <= end)
                passed = passed[next_node[passed] < nnodes]
                if not len(passed):
                    break
                crossed[ray[passed], next_node[passed]] = here[passed]
                next_node[passed] += 1
            reach[ray[over]] = np.minimum(out[over], length[over])
            go = ~over
            turns = np.where(out > s + _STILL * scale, 0, turns + 1)
            ray, here, s = ray[go], follow[go], out[go]
            x, way, length, scale = x[go], way[go], length[go], scale[go]
            next_node, turns = next_node[go], turns[go]
            stuck = np.flatnonzero(turns > _TURNS)
            if len(stuck):
                turns[stuck] = 0
                side = np.random.default_rng(len(stuck)).standard_normal((len(stuck), x.shape[1]))
                x = x.copy()
                x[stuck] += _NUDGE * scale[stuck, None] * side
        return reach, crossed
