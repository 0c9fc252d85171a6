"""The ball rule: from every outer point the same product rule of the ball, along rays through the mesh.

The number of bonds is that of the rule, whatever the mesh, or follows how many vertices the horizon spans. Rays that
end at the boundary, a slit or a hole carry a rule of their own on what is left of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from .._types import Floats, Ints, Longs, Mesh
from ..geometry.neighbours import curve_order
from ..geometry.rays import Tracer
from ..geometry.simplices import describe_point, vertex_sizes, vertex_volumes
from ..material.influence import Influence
from . import rule as bond_parts
from .ball_bonds import BallBonds, BallStencil
from .quadrature import half_sphere, largest_half_sphere, radial_rule
from .rule import Part
from .samples import Samples, gauss_count, gauss_samples, vertex_samples

_FEWEST = (3, 8)  # nodes and directions of a rule that follows the mesh
_LOOSE = 1e-6  # of the median stiffness of a vertex and its volume: less is no stiffness


@dataclass(frozen=True)
class BallRule:
    """A product rule of the ball about every outer point: nodes along rays.

    A symmetric rule samples the energy: half the ball does, each bond stands for both orders, the force acts on
    both ends. The radial rule is Gauss's for ``J(s) s^d``, which gives the elastic energy of linear fields exactly.
    A rule that is not symmetric is the paper's literal ``-a(u, phi_i) = (P(u), phi_i)``: the whole ball, the force
    acts on x only, radial weight ``J(s) s^(d-1)``. It is accurate on any mesh but is the gradient of no energy.
    With vertices outside it is the paper's strong form, by collocation.

    What is not given follows the mesh, so that the rule converges with it: with ``m`` the horizon over the lower
    quartile of the sizes of vertices, ``3/4 m`` nodes, at least 3, and ``2 m`` directions in 2D (a multiple of 4),
    ``2.75 m^2`` in 3D, at least 8. Bonds of an outer point then grow with ``m`` in 1D, ``m^2`` in 2D, ``m^3`` in 3D, as
    vertex pairs do: 24 at ``m = 4`` in 2D, 96 at 8, 216 at 12; in 3D 165 at 4. Counts that are given stay: a cost that
    does not grow, and an error that does not fall any more.

    Parameters
    ----------
    radial : int or None
        Nodes on each ray.
    angular : int or None
        Directions of half the ball: equispaced in 2D, in 3D the smallest Lebedev rule of positive weights with so
        many (8 gives 13), one in 1D.
    outer : {"gauss", "vertices"}
        The outer points: Gauss points, for the weak form with consistent mass, or vertices, with lumped mass.
    symmetric : bool
        Whether it samples the energy.
    order : int
        Order of the Gauss points, at least this, 2 to 12: there are 2, 3, 4 of them an element at order 2 (line,
        triangle, tetrahedron), 3, 6, 14 at order 4 and 4, 12, 15 at order 6, and bonds as many times.

    Raises
    ------
    ValueError
        For counts below 1, another ``outer`` or another ``order``.

    Examples
    --------
    >>> BallRule(radial=3, angular=8, outer="vertices").name
    'ball 3 x 8, vertices outside'
    >>> import skfem
    >>> BallRule().fitted(skfem.MeshTri().refined(5), horizon=0.25).name       # m = 8
    'ball 6 x 16, Gauss points outside'
    """

    radial: int | None = None
    angular: int | None = None
    outer: str = "gauss"
    symmetric: bool = True
    order: int = 2

    def __post_init__(self) -> None:
        for name in ("radial", "angular"):
            value = getattr(self, name)
            if value is None:
                continue
            if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
                raise ValueError(f"{name} = {value!r} must be a whole number, at least 1")
        if not isinstance(self.symmetric, bool):
            raise ValueError(f"symmetric = {self.symmetric!r} must be True or False")
        if self.outer not in ("gauss", "vertices"):
            raise ValueError(f'outer = {self.outer!r} must be "gauss" or "vertices"')
        if isinstance(self.order, bool) or self.order not in range(2, 13):
            raise ValueError(f"order = {self.order!r} of the Gauss points must be a whole number from 2 to 12")
        if self.order != 2 and self.outer == "vertices":
            raise ValueError(f'order = {self.order} goes with outer = "gauss"')

    @property
    def name(self) -> str:
        outer = "Gauss points" if self.outer == "gauss" else "vertices"
        order = f" of order {self.order}" if self.order != 2 else ""
        counts = [str(count) for count in (self.radial, self.angular) if count is not None]
        side = "" if self.symmetric else ", one-sided"
        return f"ball {' x '.join(counts) if len(counts) == 2 else 'of the mesh'}{side}, {outer}{order} outside"

    def fitted(self, mesh: Mesh, horizon: float) -> BallRule:
        """Return the rule with the counts that a mesh asks for.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        horizon : float
            A length.

        Returns
        -------
        BallRule
            The rule, both counts given.
        """
        if self.radial is not None and self.angular is not None:
            return self
        dim = int(mesh.dim())
        # where the mesh is fine the rule has most to resolve
        m = horizon / float(np.quantile(vertex_sizes(mesh), 0.25))
        # 4 vertices per horizon are 4 to the last bits only
        radial = max(_FEWEST[0], round(0.75 * m))
        # in 2D a multiple of 4: of other counts some direction lies along an axis or a diagonal, and so do facets
        angular = max(_FEWEST[1], 4 * round(0.5 * m) if dim == 2 else round(2.75 * m * m)) if dim > 1 else 1
        if dim == 3:
            angular = min(angular, largest_half_sphere())
        return dataclasses.replace(self, radial=self.radial or radial, angular=self.angular or angular)

    def _counts(self) -> tuple[int, int]:
        """Both counts. Raises ``ValueError`` where they follow a mesh."""
        if self.radial is None or self.angular is None:
            raise ValueError(f"rule = {self.name}: its counts follow the mesh; rule.fitted(mesh, horizon) has them")
        return self.radial, self.angular

    def samples(self, mesh: Mesh) -> Samples:
        """Return the outer points and, for the far ends, the vertices.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.

        Returns
        -------
        Samples
            The points where the rule reads the displacement.
        """
        if self.outer == "vertices":
            return vertex_samples(mesh)
        return gauss_samples(mesh, with_vertices=True, order=self.order)

    def directions(self, dim: int) -> tuple[Floats, Floats]:
        """Return the directions (n, dim) of the rays and their weights (n,).

        Parameters
        ----------
        dim : int
            Dimension of the body, 1, 2 or 3.

        Returns
        -------
        directions : ndarray, (n, dim)
            Unit vectors.
        weights : ndarray, (n,)
            Their shares of the sphere.
        """
        e, w = half_sphere(dim, self._counts()[1])
        return (e, w) if self.symmetric else (np.concatenate([e, -e]), np.concatenate([w, w]))

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        """Return about how many bonds there will be, before they are made.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        horizon : float
            A length.

        Returns
        -------
        int
            Number of bonds.
        """
        rule = self.fitted(mesh, horizon)
        sites = int(mesh.nvertices)
        if self.outer == "gauss":
            sites = int(mesh.nelements) * gauss_count(mesh, self.order)
        return sites * rule._counts()[0] * len(rule.directions(int(mesh.dim()))[0])

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds, by site, direction and node.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        samples : Samples
            The points of the rule on that mesh.
        horizon : float
            A length.
        influence : Influence
            The influence function.

        Returns
        -------
        list of BallBonds
            The bonds, a part of them at a time.

        Raises
        ------
        ValueError
            When there are too few directions to hold a vertex, at a corner of the body for example.
        """
        if self.radial is None or self.angular is None:
            return self.fitted(mesh, horizon).parts(mesh, samples, horizon, influence)
        out = self.made(mesh, samples, horizon, influence)
        self.check_support(support(samples, out), mesh.p, vertex_volumes(mesh), np.arange(int(mesh.nvertices)))
        return out

    def made(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds of the sites of some samples; what they hold of the vertices is not looked at.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        samples : Samples
            The points of the rule on that mesh, with some or all of its sites.
        horizon : float
            A length.
        influence : Influence
            The influence function.

        Returns
        -------
        list of BallBonds
            The bonds, a part of them at a time.

        Raises
        ------
        ValueError
            Where the counts of the rule follow the mesh: see :meth:`fitted`.
        """
        nrad, _ = self._counts()
        dim = int(mesh.dim())
        directions, angle = self.directions(dim)
        nodes, radial = (
            np.stack(both) for both in zip(*(self._radial(dim, J) for J in (influence, np.ones_like)), strict=True)
        )
        shares = (2.0 if self.symmetric else 1.0) * angle[:, None] * radial[:, None, :]
        stencil = BallStencil(
            directions, nodes, shares, horizon, Tracer(mesh), samples.place[mesh.t.T].astype(np.int32)
        )
        per_site = len(directions) * nrad
        out: list[Part] = []
        order = curve_order(samples.points[samples.sites])  # so that a part reaches as few elements as it can
        count = max(1, bond_parts.BLOCK // per_site)
        for run in (order[low : low + count] for low in range(0, len(order), count)):
            site = samples.sites[run]
            reach, element = self._march(stencil, samples, site, samples.element[run])
            corners = stencil.corners[element.reshape(-1)]
            first = int(min(site.min(), corners.min()))
            width = int(max(site.max(), corners.max())) + 1 - first
            out.append(BallBonds(samples, stencil, first, width, (site - first).astype(np.int32), reach, element))
        return out

    def check_support(self, support: Floats, points: Floats, volumes: Floats, number: Longs) -> None:
        """Raise ``ValueError`` for a vertex that its bonds do not hold in every direction: K would be singular.

        Parameters
        ----------
        support : ndarray, (nvertices, dim, dim)
            What bonds hold vertices with, see :func:`support`.
        points : ndarray, (dim, nvertices)
            Where they are.
        volumes : ndarray, (nvertices,)
            Their volumes.
        number : ndarray of int, (nvertices,)
            Their numbers in the mesh.

        Raises
        ------
        ValueError
            For such a vertex.
        """
        lam = np.linalg.eigvalsh(support) / volumes[:, None]
        loose = np.flatnonzero(lam[:, 0] < _LOOSE * np.median(lam[:, -1]))
        if len(loose):
            raise ValueError(
                f"rule = {self.name}: its bonds do not hold vertex {number[loose[0]]} at "
                f"{describe_point(points[:, loose[0]])} in every direction "
                f"({len(loose)} of {len(number)} vertices); "
                'take more directions, a larger angular, or outer = "gauss"'
            )

    def _radial(self, dim: int, influence: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
        """Nodes and weights of the plain integral of ``s^(d-1)`` over a ray; the rule itself holds ``J s^power``."""
        power = dim if self.symmetric else dim - 1
        s, W = radial_rule(influence, power, self._counts()[0])
        J = influence(s)
        if not J.min() > 0.0:  # a node where J vanishes would lose its share: take the rule for s^power, J comes later
            s, W = radial_rule(np.ones_like, power, self._counts()[0])
            J = np.ones_like(s)
        return s, W * s ** (dim - 1 - power) / J

    def _march(self, stencil: BallStencil, samples: Samples, site: Longs, element: Longs) -> tuple[Floats, Ints]:
        """Reach (nsites, ndir) and elements (nsites, ndir, nrad) of the rays of some sites."""
        n, ndir = len(site), len(stencil.directions)
        x, way = np.repeat(samples.points[site], ndir, axis=0), np.tile(stencil.directions, (n, 1))
        if self.outer == "vertices":
            vertex = samples.vertices[site, 0].astype(np.int64)
            own = stencil.tracer.any_element(vertex)
            start = stencil.tracer.first_elements(np.repeat(vertex, ndir), way)
        else:
            # a Gauss point begins in its own element, a vertex in the one that a ray enters
            own, start = element, np.repeat(element, ndir)
        rays = stencil.tracer.march(x, start, way, stencil.horizon, stencil.nodes[0], stencil.nodes[1])
        # a ray that leaves at once has no weight; its nodes are put where the site is
        inside = np.where(start[:, None] >= 0, rays.element, np.repeat(own, ndir)[:, None]).astype(np.int32)
        return rays.reach.reshape(n, ndir), inside.reshape(n, ndir, -1)


def support(samples: Samples, parts: Sequence[Part]) -> Floats:
    """Return ``sum weight e e^T`` over the bonds of each vertex, by P1 values, (nvertices, dim, dim)."""
    dim = samples.points.shape[1]
    supported = np.zeros((samples.nsamples, dim * dim))
    for part in parts:
        xi = part.vectors()
        e = xi / np.maximum(np.linalg.norm(xi, axis=1, keepdims=True), np.finfo(float).tiny)
        stiffness = part.weight[:, None] * np.einsum("na,nb->nab", e, e).reshape(len(e), -1)
        supported[part.first : part.first + part.width] += part.incidence(1.0).T @ stiffness
    return samples.spread(supported).reshape(-1, dim, dim)
