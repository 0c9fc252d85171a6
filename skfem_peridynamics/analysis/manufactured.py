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

from .._types import Basis, Bools, Floats, Load, Mesh
from ..material.potential import Exponential, Linear, Potential
from ..solve.constraints import Prescribed
from .box_force import force_moments


def unit_box(dim: int, n: int, kind: str = "regular", seed: int = 0) -> Mesh:
    """Return the unit interval, square or cube, n elements a side: ``regular``, ``random`` or ``graded``.

    ``random`` shifts inner vertices by up to 40 % of h along each axis, less where an element would fold; ``graded``
    elements grow from 0.5 h to 1.5 h along each axis. Raises ``ValueError`` for another kind.

    >>> unit_box(2, 4, "random").p.shape
    (2, 25)
    """
    import skfem

    if kind not in ("regular", "random", "graded"):
        raise ValueError(f"kind = {kind!r} must be regular, random or graded")
    axis = np.linspace(0.0, 1.0, n + 1)
    if kind == "graded":
        axis = 0.5 * axis + 0.5 * axis**2
    make = (skfem.MeshLine, skfem.MeshTri, skfem.MeshTet)[dim - 1]
    mesh = make(axis) if dim == 1 else make.init_tensor(*[axis] * dim)
    if kind != "random":
        return mesh
    inner = ((mesh.p > 1e-9) & (mesh.p < 1.0 - 1e-9)).all(axis=0)
    shift = np.random.default_rng(seed).uniform(-0.4, 0.4, mesh.p.shape) / n * inner

    def signed(p: Floats) -> Floats:
        return np.asarray(np.linalg.det(np.moveaxis(p[:, mesh.t[1:]] - p[:, mesh.t[:1]], 2, 0)))

    before = signed(mesh.p)
    while (wrong := np.asarray(before * signed(mesh.p + shift) < 0.05 * before**2)).any():
        shift[:, np.unique(mesh.t[:, wrong])] *= 0.7
    return type(mesh)(mesh.p + shift, mesh.t)


class Motion:
    """A known motion ``g(t) field(x)`` of the unit box, and what it takes to run schemes against it."""

    dim: int
    horizon: float
    law: Potential
    influence: str
    omega: float
    until: float
    boundary: str | None = None

    def field(self, x: Floats) -> Floats:
        """Return the field at points (n, dim), (n, dim)."""
        return np.array(self.at(x.T).T)

    def at(self, x: Floats) -> Floats:
        """Return the field at points x (dim, ...) as scikit-fem gives them, (dim, ...)."""
        raise NotImplementedError

    def gradient(self, x: Floats) -> Floats:
        """Return ``d u_i / d x_j``, (dim, dim, ...), of the field at points (dim, ...)."""
        raise NotImplementedError

    def g(self, t: float, derivative: int = 0) -> float:
        """Return the amplitude ``cos(omega t)`` or one of its derivatives."""
        return float(self.omega**derivative * np.cos(self.omega * t + 0.5 * pi * derivative))

    def w(self, x: Floats) -> Floats:
        """Return the boundary function at points (n, dim), (n,)."""
        return np.ones(len(x))

    def load(self, basis: Basis, kind: str) -> Load | None:
        """Return the body force as a function of time: ``"weak"``, ``(b, phi_i)``, or ``"nodal"``, ``V_i b(x_i)``."""
        return None

    def held(self, basis: Basis) -> list[Prescribed]:
        """Return the prescribed motions."""
        return []

    def errors(self, mesh: Mesh, nodal: Floats, t: float, derivative: int = 0) -> tuple[float, float]:
        """Return L2 and H1-seminorm errors of a P1 field against the motion at t, relative to the field's own norms.

        ``derivative=1`` is for a velocity, relative to omega times the field.
        """
        from skfem import Basis as MakeBasis
        from skfem import ElementLineP1, ElementTetP1, ElementTriP1, ElementVector

        element = (ElementLineP1, ElementTriP1, ElementTetP1)[self.dim - 1]()
        basis = MakeBasis(mesh, ElementVector(element), intorder=5)
        found = basis.interpolate(nodal)
        x, amplitude = np.asarray(basis.global_coordinates()), self.g(t, derivative)
        scale = self.omega**derivative
        out = []
        for got, true in ((np.asarray(found), self.at(x)), (np.asarray(found.grad), self.gradient(x))):
            miss = np.sqrt(((got - amplitude * true) ** 2 * basis.dx).sum())
            out.append(float(miss / (scale * np.sqrt((true**2 * basis.dx).sum()))))
        return out[0], out[1]


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
    def _zones(self) -> Floats:
        depth = [self.horizon * k for k in (1, 2) if self.horizon * k < 0.5 - 1e-9]
        if not depth or depth[-1] < 0.5 - 1e-9:
            depth.append(0.5)
        thin = [self.horizon / 64, self.horizon / 8] if self._bent else []  # near the side it has a logarithm
        cuts = [0.0, *thin, *depth]
        return np.array([*cuts, *(1.0 - c for c in reversed(cuts[:-1]))])

    @cached_property
    def _table(self) -> Floats:
        """Moments over w at Chebyshev nodes of the zones that the layers of the horizon cut, (terms, m, .., m, dim).

        The force of a field with equal components that is symmetric in the axes is too, so sorted points do.
        """
        axis = self._axis
        grid = np.stack([g.ravel() for g in np.meshgrid(*[axis] * self.dim, indexing="ij")], axis=1)
        order = np.argsort(grid, axis=1, kind="stable")
        sorted_points = np.take_along_axis(grid, order, axis=1)
        unique, back = np.unique(sorted_points, axis=0, return_inverse=True)
        found = self.exact(unique) / self.w(unique)[:, None]
        values = np.empty((len(self.series), *grid.shape))
        sorted_values = found[:, back.ravel()]
        for k in range(len(values)):
            np.put_along_axis(values[k], order, sorted_values[k], axis=1)
        return values.reshape(len(self.series), *[len(axis)] * self.dim, self.dim)

    @cached_property
    def _axis(self) -> Floats:
        low, high = self._zones[:-1, None], self._zones[1:, None]
        share = np.tile(0.5 - 0.5 * self._chebyshev, (len(low), 1))
        if self._bent:
            share[2], share[-3] = 1.0 - (1.0 - share[2]) ** 2, share[-3] ** 2
        return np.asarray(low + (high - low) * share).ravel()

    @property
    def _bent(self) -> bool:
        """In 2D a side enters the ball with the power 3/2 of the depth: zones that end there use its root."""
        return self.dim == 2 and self.boundary is None

    @cached_property
    def _chebyshev(self) -> Floats:
        """Nodes of the first kind: none on the boundary, where w is 0."""
        return np.asarray(np.cos(pi * (np.arange(self.table) + 0.5) / self.table))

    def _values(self, x: Floats) -> Floats:
        """Lagrange's basis of one axis at points (n,), (n, m)."""
        zone = np.clip(np.searchsorted(self._zones, x, side="right") - 1, 0, len(self._zones) - 2)
        low, high = self._zones[zone], self._zones[zone + 1]
        share = np.clip((x - low) / (high - low), 0.0, 1.0)
        if self._bent:
            share = np.where(zone == 2, 1.0 - np.sqrt(1.0 - share), share)
            share = np.where(zone == len(self._zones) - 4, np.sqrt(share), share)
        s = 1.0 - 2.0 * share
        node = self._chebyshev
        c = (-1.0) ** np.arange(self.table) * np.sin(pi * (np.arange(self.table) + 0.5) / self.table)
        gap = s[:, None] - node
        exact: Bools = np.abs(gap) < 1e-14
        ratio = c / np.where(exact, 1.0, gap)
        local = np.where(np.asarray(exact.any(axis=1))[:, None], exact, ratio / ratio.sum(axis=1, keepdims=True))
        out = np.zeros((len(x), len(self._axis)))
        np.put_along_axis(out, zone[:, None] * self.table + np.arange(self.table), local, axis=1)
        return out

    def moments(self, x: Floats) -> Floats:
        """Return the force moments (terms, n, dim) at points (n, dim), from the table; near corners in 2D directly."""
        table, terms = self._table, len(self.series)
        out = np.empty((terms, *x.shape))
        m = len(self._axis)
        for low in range(0, len(x), 20_000):
            run = slice(low, low + 20_000)
            B = [self._values(x[run, a]) for a in range(self.dim)]
            for k in range(terms):
                for a in range(self.dim):
                    value = table[k, ..., a].reshape(m, -1)
                    got = B[0] @ value
                    for b in B[1:]:
                        got = np.einsum("ni,nij->nj", b, got.reshape(len(b), m, -1))
                    out[k, run, a] = got.reshape(-1)
        out *= self.w(x)[:, None]
        if self.dim == 2:  # where a corner enters or leaves the ball the force is not smooth
            corner = np.flatnonzero((np.minimum(x, 1.0 - x) < self.horizon).all(axis=1))
            out[:, corner] = self.exact(x[corner])
        return out

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
            for some, order in ((np.flatnonzero(rough), high), (np.flatnonzero(~rough), low)):
                if not len(some):
                    continue
                fine = MakeBasis(mesh, basis.elem, intorder=intorder or order, elements=some)
                x = np.asarray(fine.global_coordinates())
                at = self.moments(x.reshape(dim, -1).T)
                form = LinearForm(lambda v, w: dot(w["b"], v))
                inertia += LinearForm(lambda v, w: dot(self.at(w.x), v)).assemble(fine)
                for k, one in enumerate(at):
                    forces[k] += form.assemble(fine, b=one.T.reshape(x.shape))
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
