"""Manufactured solutions on the unit interval, square or cube: a motion given first, the body force that makes it.

``u(x, t) = g(t) field(x)``, every component ``prod sin(pi x_i)``, so u is zero on the boundary. The law is nonlinear:
the body force comes from the exact force, by quadrature that shares nothing with the rules under test.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import cached_property
from math import factorial, pi
from typing import Any

import numpy as np

from .._types import Basis, Floats, Load
from ..material.potential import Exponential, Linear, Potential
from ..solve.constraints import Prescribed
from .exact_force import force_moments
from .force_table import ForceTable
from .known_motion import Motion


@dataclass(frozen=True)
class Manufactured(Motion):
    """A motion ``cos(omega t) field(x)`` of the unit box with density 1 and the body force that drives it.

    ``boundary`` is None, a free body, or ``"smooth"``: a boundary function w, the product over the axes of
    ``s^3 (10 - 15 s + 6 s^2)``, s the distance to the nearer side over the horizon. (The package's own is that of the
    distance to the boundary; it has creases at corners of a box, the product has none.) ``law`` must be exponential
    or linear: the force is summed from the series of ``f'``.

    Raises ``ValueError`` for another law.
    """

    dim: int
    horizon: float
    law: Potential
    boundary: str | None = None
    influence: str = "constant"
    omega: float = 4.0
    until: float = 1.0
    order: int = 8
    table: int = 10
    terms: int = 7

    def __post_init__(self) -> None:
        if not isinstance(self.law, (Exponential, Linear)):
            raise ValueError(f"law = {self.law!r} must be exponential or linear: the series of f' is summed")

    def with_(self, **changes: Any) -> Manufactured:
        """Return a copy with some parameters changed."""
        return dataclasses.replace(self, **changes)

    # ---- the motion
    def at(self, x: Floats) -> Floats:
        """Return the field at points x (dim, ...) as scikit-fem gives them, (dim, ...)."""
        return np.broadcast_to(np.sin(pi * x).prod(axis=0), x.shape)

    def gradient(self, x: Floats) -> Floats:
        """Return ``d u_i / d x_j``, (dim, dim, ...), of the field at points (dim, ...)."""
        s, c = np.sin(pi * x), pi * np.cos(pi * x)
        row = np.stack([np.prod([c[j] if j == k else s[j] for j in range(self.dim)], axis=0) for k in range(self.dim)])
        return np.broadcast_to(row, (self.dim, *row.shape))

    @property
    def l2_norm(self) -> float:
        """``||field||``"""
        return float(np.sqrt(self.dim * 0.5**self.dim))

    @property
    def h2_norm(self) -> float:
        """``||field||_2``: the field, its gradient and its whole Hessian."""
        d = self.dim
        return float(self.l2_norm * np.sqrt(1.0 + d * pi**2 + d**2 * pi**4))

    # ---- its force
    def w(self, x: Floats) -> Floats:
        """Return the boundary function at points (n, dim), (n,)."""
        if self.boundary is None:
            return np.ones(len(x))
        s = np.clip(np.minimum(x, 1.0 - x) / self.horizon, 0.0, 1.0)
        return np.asarray(np.minimum(s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 1.0).prod(axis=1))

    @cached_property
    def series(self) -> Floats:
        """``a_k`` of ``f'(q) = sum a_k q^k``."""
        if isinstance(self.law, Linear):
            return np.array([self.law.slope])
        b = self.law.b
        return np.array([self.law.slope * (-b) ** k / factorial(k) for k in range(self.terms)])

    def exact(self, x: Floats) -> Floats:
        """Return the force moments (terms, n, dim) at points (n, dim), by quadrature: see :func:`force_moments`."""
        boundary = None if self.boundary is None else self.w
        return force_moments(
            x,
            self.horizon,
            self.field,
            len(self.series),
            influence=self.influence,
            boundary=boundary,
            order=self.order,
        )

    @cached_property
    def moments(self) -> ForceTable:
        """The force moments as a function of points (n, dim), from a table: (terms, n, dim)."""
        return ForceTable(
            self.dim, self.horizon, self.table, len(self.series), self.boundary is None, self.exact, self.w
        )

    # ---- load vectors
    def load(self, basis: Basis, kind: str, intorder: int | None = None) -> Load:
        """Return the body force of :meth:`Motion.load`.

        The weak one is integrated with ``intorder``; without it with order 8 (3D: 4), and with 18 (6) in elements
        where the force is not smooth: at the boundary and across the depths where its layer ends.
        """
        from skfem import Basis as MakeBasis
        from skfem import LinearForm

        from ..geometry.simplices import vertex_volumes

        mesh, dim = basis.mesh, self.dim
        if kind == "nodal":
            V = vertex_volumes(mesh)[:, None]
            inertia = (V * self.field(mesh.p.T)).ravel()
            forces = (V * self.moments(mesh.p.T)).reshape(len(self.series), -1)
        elif kind == "weak":
            from skfem.helpers import dot

            inertia, forces = np.zeros(basis.N), np.zeros((len(self.series), basis.N))
            depth = np.minimum(mesh.p, 1.0 - mesh.p).min(axis=0)[mesh.t]
            nearest, farthest = depth.min(axis=0) - 1e-9, depth.max(axis=0) + 1e-9
            rough = nearest < 0.0
            for layer in (self.horizon, 2.0 * self.horizon)[: 1 if self.boundary is None else 2]:
                rough |= (nearest + 2e-9 < layer) & (layer < farthest - 2e-9)
            low, high = (8, 18) if dim < 3 else (4, 6)
            for points, order in ((np.flatnonzero(rough), high), (np.flatnonzero(~rough), low)):
                if not len(points):
                    continue
                fine = MakeBasis(mesh, basis.elem, intorder=intorder or order, elements=points)
                x = np.asarray(fine.global_coordinates())
                at = self.moments(x.reshape(dim, -1).T)
                form = LinearForm(lambda v, w: dot(w["b"], v))
                inertia += LinearForm(lambda v, w: dot(self.at(w.x), v)).assemble(fine)
                for k, point in enumerate(at):
                    forces[k] += form.assemble(fine, b=point.T.reshape(x.shape))
        else:
            raise ValueError(f'kind = {kind!r} must be "weak" or "nodal"')
        odd = 2 * np.arange(len(self.series)) + 1

        def at_time(t: float) -> Floats:
            total: Floats = self.g(t, 2) * inertia - (self.series * self.g(t) ** odd) @ forces
            return total

        return at_time

    def held(self, basis: Basis) -> list[Prescribed]:
        """Return what holds the body: the boundary where w is 0 there (V_h lies in H^1_0), else nothing."""
        if self.boundary is None:
            return []
        return [Prescribed(basis.get_dofs(basis.mesh.boundary_facets()).all(), displacement=0.0)]
