"""Corner pairs: the accuracy of a ball for few bonds that break as vertex pairs do.

A ball rule reads the displacement at points inside elements; a crack that opens a row of elements then breaks more
bonds than it should. Here the law is interpolated in place of the displacement: the bond from a vertex to a point of
its ball is shared among the corners of the element that holds the point, by barycentric coordinates. What comes out is
a list of vertex pairs with weights of its own.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from .._scaling import whole_power
from .._types import Floats, Longs, Mesh
from ..geometry.neighbours import estimate_pairs
from ..geometry.rays import Tracer
from ..geometry.simplices import vertex_sizes
from ..geometry.visibility import sight
from ..material.influence import Influence, constant
from . import rule as bond_parts
from .bond_list import Balance
from .pair_bonds import PairBonds
from .quadrature import radial_rule
from .rule import Part, rows_of
from .samples import Samples, vertex_samples

_GOLDEN = 0.6180339887498949  # turns from vertex to vertex: no two near ones have directions in common
_FEWEST = 3, 5  # nodes along a direction, directions of half a ball
_PER_POINT = 3.7  # bonds of a point of half a ball: of its six corners many are those of others, too
# what may be left of the largest moment inside and near the boundary, and the least factor of a weight: 0.011, 0.042
# and 0.14 were the worst in bodies where the errors are those of all pairs or less
_LEFT, _LEAST = (0.03, 0.1), 0.05
_NOTHING = 1e-12  # of the largest weight: a corner that has no share


@dataclass(frozen=True)
class CornerRule:
    """Vertex pairs that stand for balls, in two dimensions; to be balanced.

    Around each vertex a ball of ``radial`` Gauss nodes along ``2 angular`` directions, turned by another angle at each
    vertex; each of its points is shared among the corners of its element. Without counts they follow the mesh: at m
    vertices per horizon max(3, m / 5) nodes and max(5, m - 3) directions.

    Parameters
    ----------
    radial : int, optional
        Nodes along a direction.
    angular : int, optional
        Directions of half the ball.

    Raises
    ------
    ValueError
        For counts below 1.

    References
    ----------
    Paper, eq. 2.4, with the integral over the ball as a sum over corners.

    Examples
    --------
    >>> import skfem
    >>> CornerRule().fitted(skfem.MeshTri().refined(5), horizon=0.25)                  # m = 8
    CornerRule(radial=3, angular=5)
    """

    radial: int | None = None
    angular: int | None = None

    def __post_init__(self) -> None:
        for name in ("radial", "angular"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1):
                raise ValueError(f"{name} = {value!r} must be a whole number, at least 1")

    @property
    def name(self) -> str:
        counts = [str(count) for count in (self.radial, self.angular) if count is not None]
        return f"corner pairs {' x '.join(counts) if len(counts) == 2 else 'of the mesh'}"

    @property
    def symmetric(self) -> bool:
        return True

    @property
    def rounds(self) -> int:
        """Rounds of balancing, one more than pairs of all vertices need."""
        return 2

    def suffices(self, balance: Balance) -> bool:
        """Return whether balanced weights are good enough to be used.

        Parameters
        ----------
        balance : Balance
            How balancing went.

        Returns
        -------
        bool
            Whether moments are met and no bond has all but vanished.
        """
        left = max(balance.residual / _LEFT[0], balance.residual_near / _LEFT[1])
        return left < 1.0 and balance.smallest > _LEAST

    def fitted(self, mesh: Mesh, horizon: float) -> CornerRule:
        """Return the rule with the counts that a mesh asks for.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles.
        horizon : float
            A length.

        Returns
        -------
        CornerRule
            The rule, both counts given.
        """
        m = horizon / float(np.quantile(vertex_sizes(mesh), 0.25))
        radial, angular = max(_FEWEST[0], round(0.2 * m)), max(_FEWEST[1], round(m - 3.0))
        return dataclasses.replace(self, radial=self.radial or radial, angular=self.angular or angular)

    def samples(self, mesh: Mesh) -> Samples:
        """Return the vertices.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles.

        Returns
        -------
        Samples
            The points where the rule reads the displacement.
        """
        return vertex_samples(mesh)

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        """Return about how many bonds there will be, before they are made.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles.
        horizon : float
            A length.

        Returns
        -------
        int
            Number of bonds.
        """
        rule = self.fitted(mesh, horizon)
        assert rule.radial is not None
        assert rule.angular is not None
        # merged they are no more than all pairs of vertices that near
        pairs = estimate_pairs(np.ascontiguousarray(mesh.p), horizon + 0.5 * float(vertex_sizes(mesh).max()))
        return min(pairs, int(_PER_POINT * mesh.nvertices * rule.radial * rule.angular))

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds, ends sorted, with their weights.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles.
        samples : Samples
            The vertices.
        horizon : float
            A length.
        influence : Influence
            The constant influence function.

        Returns
        -------
        list of PairBonds
            The bonds, a part of them at a time.

        Raises
        ------
        ValueError
            In one or three dimensions, and for another influence function.
        """
        if mesh.dim() != 2:
            raise ValueError(f"rule = {self.name}: corner pairs are for bodies in 2D, and this is one in {mesh.dim()}D")
        if influence is not constant:
            raise ValueError(
                f"rule = {self.name}: corner pairs go with the constant influence function; their far ends lie beyond "
                "the points that they stand for, where another has another value"
            )
        if self.radial is None or self.angular is None:
            return self.fitted(mesh, horizon).parts(mesh, samples, horizon, influence)
        near, far, weight = self._shared(mesh, samples, horizon)
        keep = (near != far) & (weight > _NOTHING * weight.max(initial=0.0))
        near, far, weight = near[keep], far[keep], weight[keep]
        # a pair stands for both orders of its ends: what both have given is added
        key, place = np.unique(np.minimum(near, far) * samples.nsamples + np.maximum(near, far), return_inverse=True)
        weight = np.bincount(place, weight).astype(float)
        near, far = key // samples.nsamples, key % samples.nsamples
        number = samples.vertices[:, 0].astype(np.int64)
        seen = ~sight(mesh, 1.5 * horizon).blocked(number[near], number[far])
        near, far, weight = near[seen], far[seen], weight[seen]
        start = np.searchsorted(near, np.arange(samples.nsamples + 1))
        out: list[Part] = []
        for run in rows_of(start, bond_parts.BLOCK):
            low, high = int(start[run.start]), int(start[run.stop])
            if low < high:
                ends = far[low:high]
                first = min(run.start, int(ends.min()))
                last = max(run.stop - 1, int(ends.max()))
                rows, partner = start[run.start : run.stop + 1] - low, (ends - first).astype(np.int32)
                out.append(
                    PairBonds(samples, first, last + 1 - first, run.start - first, rows, partner, 0.0, weight[low:high])
                )
        return out

    def _shared(self, mesh: Mesh, samples: Samples, horizon: float) -> tuple[Longs, Longs, Floats]:
        """Near and far ends, sample numbers, and what each point of each ball gives to each corner."""
        assert self.radial is not None
        assert self.angular is not None
        n, count = samples.nsamples, 2 * self.angular
        nodes, W = radial_rule(np.ones_like, 2, self.radial)  # of s^2, s of it from the bond force
        turn = (np.arange(n) * _GOLDEN) % 1.0 * (2.0 * np.pi / count)
        angle = (turn[:, None] + 2.0 * np.pi * (np.arange(count) + 0.5) / count).ravel()
        way = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        x, vertex = np.repeat(samples.points, count, axis=0), np.repeat(samples.vertices[:, 0].astype(np.int64), count)
        tracer = Tracer(mesh)
        begin = tracer.first_elements(vertex, way)
        inside = np.flatnonzero(begin >= 0)
        x, way = x[inside], way[inside]
        rays = tracer.march(x, begin[inside], way, horizon, nodes)
        site = np.repeat(np.arange(n), count)[inside]
        full = samples.volume[site] * (2.0 * np.pi / count) * whole_power(rays.reach, 2)
        near, far, weight = [], [], []
        for k, (s, w) in enumerate(zip(nodes, W, strict=True)):
            element = rays.element[:, k]
            share = np.clip(tracer.barycentric(element, x + (rays.reach * s)[:, None] * way), 0.0, 1.0)
            near.append(np.repeat(site, 3))
            far.append(samples.place[mesh.t[:, element].T].ravel())
            weight.append((share * (full * w / s)[:, None]).ravel())
        return np.concatenate(near).astype(np.int64), np.concatenate(far).astype(np.int64), np.concatenate(weight)
