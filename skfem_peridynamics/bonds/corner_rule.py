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
from ..material.influence import Influence
from . import rule as bond_parts
from .bond_list import Balance
from .pair_bonds import PairBonds, pair_weights
from .pair_rule import PairRule
from .quadrature import half_sphere, radial_rule, turns
from .rule import Part, rows_of
from .samples import Samples, vertex_samples

_FEWEST = {2: (3, 5), 3: (1, 13)}  # nodes along a direction, directions of half a ball
_WHOLE = {2: 0.0, 3: 0.5}  # of the horizon
# bonds of a point of half a ball, merged with those of others: of its corners, six in a plane and eight in space
_PER_POINT = {2: 3.7, 3: 5.5}
# what may be left of the largest moment inside and near the boundary, and the least factor of a weight: 0.011, 0.042
# and 0.12 were the worst in bodies where the errors are those of all pairs or little more
_LEFT, _LEAST = (0.03, 0.1), 0.05
_NOTHING = 1e-12  # of the largest weight: a corner that has no share


@dataclass(frozen=True)
class CornerRule:
    """Vertex pairs that stand for balls, in two and three dimensions; to be balanced.

    Around each vertex a ball of ``radial`` Gauss nodes along ``2 angular`` directions, turned by another angle at each
    vertex; each of its points is shared among the corners of its element. In 3D pairs within half the horizon are kept
    whole, and points stand for what is beyond. Without counts they follow the mesh: at m vertices per horizon
    max(3, m / 5) nodes and max(5, m - 3) directions in 2D, max(1, m / 6) and max(13, 0.7 m^2) in 3D.

    Parameters
    ----------
    radial : int, optional
        Nodes along a direction.
    angular : int, optional
        Directions of half the ball; in 3D the smallest Lebedev rule with so many.
    whole : float, optional
        Part of the horizon, from 0 to 0.9, within which all pairs are kept; 0 where the influence function is 0 beyond.

    Raises
    ------
    ValueError
        For counts below 1, and another part.

    References
    ----------
    Paper, eq. 2.4, with the integral over the ball as a sum over corners.

    Examples
    --------
    >>> import skfem
    >>> CornerRule().fitted(skfem.MeshTri().refined(5), horizon=0.25)                  # m = 8
    CornerRule(radial=3, angular=5, whole=0.0)
    """

    radial: int | None = None
    angular: int | None = None
    whole: float | None = None

    def __post_init__(self) -> None:
        for name in ("radial", "angular"):
            value = getattr(self, name)
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1):
                raise ValueError(f"{name} = {value!r} must be a whole number, at least 1")
        if self.whole is not None and not 0.0 <= self.whole <= 0.9:
            raise ValueError(f"whole = {self.whole!r} must be a part of the horizon, from 0 to 0.9")

    @property
    def name(self) -> str:
        counts = [str(count) for count in (self.radial, self.angular) if count is not None]
        return f"corner pairs {' x '.join(counts) if len(counts) == 2 else 'of the mesh'}"

    @property
    def symmetric(self) -> bool:
        return True

    @property
    def holds_influence(self) -> bool:
        """Whether weights hold the influence function: at the points that they stand for, not at the corners."""
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
            Triangles or tetrahedra.
        horizon : float
            A length.

        Returns
        -------
        CornerRule
            The rule, all given.

        Raises
        ------
        ValueError
            In one dimension.
        """
        dim = int(mesh.dim())
        if dim == 1:
            raise ValueError(f"rule = {self.name}: corner pairs are for bodies in 2D and 3D, and this is one in 1D")
        m = horizon / float(np.quantile(vertex_sizes(mesh), 0.25))
        grown = (0.2 * m, m - 3.0) if dim == 2 else (m / 6.0, 0.7 * m * m)
        radial, angular = (max(least, round(count)) for least, count in zip(_FEWEST[dim], grown, strict=True))
        return dataclasses.replace(
            self,
            radial=self.radial or radial,
            angular=self.angular or angular,
            whole=_WHOLE[dim] if self.whole is None else self.whole,
        )

    def samples(self, mesh: Mesh) -> Samples:
        """Return the vertices.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles or tetrahedra.

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
            Triangles or tetrahedra.
        horizon : float
            A length.

        Returns
        -------
        int
            Number of bonds.
        """
        rule, dim = self.fitted(mesh, horizon), int(mesh.dim())
        assert rule.radial is not None
        assert rule.angular is not None
        assert rule.whole is not None
        x, half = np.ascontiguousarray(mesh.p), 0.5 * float(vertex_sizes(mesh).max())
        near = estimate_pairs(x, rule.whole * horizon) if rule.whole else 0
        count = rule.angular if dim == 2 else len(half_sphere(dim, rule.angular)[0])
        # merged they are no more than all pairs of vertices that near
        pairs = estimate_pairs(x, horizon + half)
        return min(pairs, near + int(_PER_POINT[dim] * mesh.nvertices * rule.radial * count))

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds, ends sorted, with their weights.

        Parameters
        ----------
        mesh : skfem.Mesh
            Triangles or tetrahedra.
        samples : Samples
            The vertices.
        horizon : float
            A length.
        influence : Influence
            The influence function.

        Returns
        -------
        list of PairBonds
            The bonds, a part of them at a time.

        Raises
        ------
        ValueError
            In one dimension.
        """
        if self.radial is None or self.angular is None or self.whole is None:
            return self.fitted(mesh, horizon).parts(mesh, samples, horizon, influence)
        near, far, weight = self._shared(mesh, samples, horizon, influence)
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

    def _shared(
        self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence
    ) -> tuple[Longs, Longs, Floats]:
        """Near and far ends, sample numbers, and what each point of each ball gives to each corner."""
        assert self.radial is not None
        assert self.angular is not None
        assert self.whole is not None
        n, dim, whole = samples.nsamples, int(mesh.dim()), self.whole
        if not (influence(np.linspace(whole, 1.0, 64)[1:-1]) > 0.0).any():
            whole = 0.0
        e, angle = half_sphere(dim, self.angular)
        e, angle = np.concatenate([e, -e]), np.concatenate([angle, angle])
        # rules of s^d beyond what is whole, with J and, for rays that end before the horizon, without; s of it is in
        # the bond force
        nodes, W = radial_rule(lambda s: influence(s) * (s >= whole), dim, self.radial)
        nodes_cut, W_cut = radial_rule(lambda s: np.where(s >= whole, 1.0, 0.0), dim, self.radial)
        along = np.arange(n) if samples.along is None else samples.along
        way = np.einsum("nij,kj->nki", turns(dim, along, len(e)), e).reshape(-1, dim)
        x = np.repeat(samples.points, len(e), axis=0)
        vertex = np.repeat(samples.vertices[:, 0].astype(np.int64), len(e))
        tracer = Tracer(mesh)
        begin = tracer.first_elements(vertex, way)
        inside = np.flatnonzero(begin >= 0)
        x, way = x[inside], way[inside]
        rays = tracer.march(x, begin[inside], way, horizon, nodes, nodes_cut)
        site, seen, cut = np.repeat(np.arange(n), len(e))[inside], rays.reach / horizon, rays.reach < horizon
        full = samples.volume[site] * np.tile(angle, n)[inside] * whole_power(rays.reach, dim)
        if whole:  # of a ray that ends early, what lies beyond the pairs that are kept
            rest = np.maximum(seen ** (dim + 1) - whole ** (dim + 1), 0.0)
            full *= np.where(cut, rest / np.maximum(seen, whole) ** (dim + 1) / (1.0 - whole ** (dim + 1)), 1.0)
        near, far, weight = [], [], []
        for k in range(self.radial):
            s = np.where(cut, nodes_cut[k], nodes[k])
            w = np.where(cut, W_cut[k] * influence(nodes_cut[k] * seen), W[k])
            element = rays.element[:, k]
            share = np.clip(tracer.barycentric(element, x + (rays.reach * s)[:, None] * way), 0.0, 1.0)
            near.append(np.repeat(site, dim + 1))
            far.append(samples.place[mesh.t[:, element].T].ravel())
            weight.append((share * (full * w / s)[:, None]).ravel())
        if whole:
            pairs = PairRule()
            for i, j in pairs.ends_within(mesh, samples, whole * horizon):
                near.append(i)
                far.append(j.astype(np.int64))
                r = np.asarray(np.linalg.norm(samples.points[j] - samples.points[i], axis=1))
                weight.append(pair_weights(samples, i, j, r, whole * horizon) * influence(r / horizon))
        return np.concatenate(near).astype(np.int64), np.concatenate(far).astype(np.int64), np.concatenate(weight)
