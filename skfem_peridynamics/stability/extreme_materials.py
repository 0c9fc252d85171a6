"""Contrasts of eight orders, the most brittle and the toughest bonds, strains from 1e-300 to 1e150."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy import linalg

from .._types import Floats, Mesh
from ..bonds.bond_basis import BondBasis
from ..geometry.boxes import unit_box
from ..material.composite import Composite
from ..material.material import Material
from ..material.potential import Exponential, Linear, Potential, Rational
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from ..solve.cfl import stable_time_step
from ..solve.newmark import newmark
from .bodies import ball, body_on, exact_limit, stretch
from .verdicts import Verdicts

# A matrix of contrast 1e8 does not know the soft springs that stiff parts hang on better than this: round-off of its
# stiff entries, 1e-16 * 1e8 * (body / horizon)^2, is 1e-6 to 1e-5 of them, and Newmark's accelerations add it up.
_KNOWN = 1e-3


def chequered(dim: int, n: int, kind: str) -> Mesh:
    """Return a unit box with every other quarter in the subdomain "stiff"."""
    mesh = unit_box(dim, n, kind)
    middle = mesh.p[:, mesh.t].mean(axis=1)
    stiff = np.flatnonzero(np.floor(4.0 * middle).sum(axis=0) % 2 == 1)
    return mesh.with_subdomains({"stiff": stiff})


def newmark_by_dense_algebra(K: Floats, m: Floats, b: Floats, dt: float, steps: int) -> Floats:
    """Return the displacement of a body at rest under a constant load b after some steps of the trapezoidal rule.

    In long doubles, by a scaled Cholesky factor and refinement.
    """
    wide: Any = np.longdouble
    h = wide(dt)
    m, b = m.astype(wide), b.astype(wide)
    A: Any = K.astype(wide) + np.diag(4 / h**2 * m)
    scale = (1.0 / np.sqrt(np.diag(A))).astype(float)
    factor = linalg.cho_factor((scale[:, None] * A * scale).astype(float))
    u = v = np.zeros_like(b)
    a: Any = b / m
    for _ in range(steps):
        wanted = b + m * (4 / h**2 * (u + h * v + h**2 / 4 * a))
        new: Any = np.zeros_like(b)
        for _ in range(6):
            new = new + scale * linalg.cho_solve(factor, (scale * (wanted - A @ new)).astype(float))
        after = 4 / h**2 * (new - u - h * v) - a
        u, v, a = new, v + h / 2 * (a + after), after
    return np.asarray(u, dtype=float)


def contrasts(verdicts: Verdicts, quick: bool) -> None:
    """Newmark's steps against dense algebra, and the explicit limit against the dense spectrum."""
    pairs = [(1e8, 1.0), (1e8, 1e6)] if quick else [(1e8, 1.0), (1.0, 1e6), (1e8, 1e6), (1e8, 1e-6)]
    for dim, n, horizon in ((1, 40, 0.1), (2, 12, 0.25)):
        for kind in ("random",) if quick else ("regular", "random"):
            mesh = chequered(dim, n, kind)
            soft = Material.from_elastic(
                lame=1.0, density=1.0, plane="strain" if dim == 2 else None, potential="linear"
            )
            for stiffness, density in pairs:
                both = Composite(soft, {"stiff": soft.with_(lame=stiffness, density=density)})
                body = Peridynamics(BondBasis(vector_basis(mesh), horizon), both)
                M = mass_matrix(body.basis, density=both.density_on(mesh))
                where = f"{dim}D, {kind}, stiffness 1:{stiffness:.0e}, density 1:{density:.0e}"
                limit, exact = stable_time_step(body, M), exact_limit(body, M)
                verdicts.add("contrast", where, "limit over the dense spectrum's", limit.dt / exact, 1.0 + 1e-9, 0.99)
                pulled = M.diagonal() * np.cos(np.pi * mesh.p.T).ravel()
                dt = 10.0 * horizon  # a wave crosses the soft part in some tenths of it
                u = newmark_by_dense_algebra(body.stiffness().toarray(), M.diagonal(), pulled, dt, 5)
                for solver in ("auto", "blocks"):
                    *_, state = newmark(body, M, dt=dt, until=5 * dt, load=lambda t, b=pulled: b, linear=solver)  # type: ignore[misc]
                    error = float(np.abs(state.u - u).max() / np.abs(u).max())
                    verdicts.add("contrast", f"{where}, {solver}", "5 Newmark steps against dense", error, _KNOWN)
                    verdicts.add("contrast", f"{where}, {solver}", "step that was cut to", state.dt / dt, 1.0, 1.0)


def brittle_and_tough(verdicts: Verdicts, quick: bool) -> None:
    """Energies of one displacement by toughness, and runs that stay finite."""
    dim, n, horizon = 2, 10, 0.3
    mesh = unit_box(dim, n, "random")
    limits = (1e-250, 1e-12, 1e-4, 1.0, 1e4, 1e12, 1e250)
    u0 = stretch(mesh, horizon, 1.0, 1.0)
    for kind in (Exponential, Rational):
        energies = []
        for limit in limits:
            law: Potential = kind(1.0, limit)
            body = body_on(mesh, horizon, law)
            M = mass_matrix(body.basis)
            where = f"{kind.__name__.lower()}, f_inf = {limit:g}"
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                energies.append(body.energy(u0))
                dt = 0.9 * exact_limit(body, M)
                steps = 50 if quick else 500
                highest, finite = 0.0, True
                for state in central_difference(body, M, u0, dt=dt, until=steps * dt, watch=0):
                    highest = max(highest, state.energies.elastic)
                    finite = finite and bool(np.isfinite(state.a).all())
            store = limit * float(body.bonds.measure().sum())
            verdicts.add("brittle", where, f"{steps} steps, finite", float(finite), 1.0, 1.0)
            verdicts.add("brittle", where, "elastic energy over what bonds can store", highest / store, 1.0 + 1e-12)
        rise = np.diff(energies)
        linear = body_on(mesh, horizon, Linear(1.0)).energy(u0)
        name = kind.__name__.lower()
        verdicts.add("brittle", name, "energy grows with toughness", float(rise.min()), low=0.0)
        verdicts.add("brittle", name, "toughest is linear", abs(energies[-1] / linear - 1.0), 1e-12)
        verdicts.add("brittle", name, "most brittle stores nothing", energies[0] / linear, 1e-200)


def any_strain(verdicts: Verdicts, quick: bool) -> None:
    """Forces and energies of strains from 1e-300 to 1e150, of round-off and of large rigid motions."""
    laws: dict[str, Potential] = {
        "exponential": Exponential(1.0, 1.0),
        "brittle": Rational(1.0, 1e-30),
        "linear": Linear(1.0),
    }
    rng = np.random.default_rng(0)
    for dim in (2,) if quick else (1, 2, 3):
        mesh = unit_box(dim, {1: 12, 2: 6, 3: 3}[dim], "random")
        for rule_name, rule in (("pairs", None), ("balls", ball(dim))):
            for name, law in laws.items():
                body = body_on(mesh, 0.6, law, rule)
                K, store = body.stiffness(), float(body.bonds.measure().sum()) * law.limit
                where = f"{dim}D, {rule_name}, {name}"
                small = large = 0.0
                u = rng.uniform(0.5, 1.0, body.basis.N)
                with warnings.catch_warnings(), np.errstate(all="raise", under="ignore"):
                    warnings.simplefilter("error")
                    for size in (1e-300, 1e-200, 1e-100, 1e-30):
                        F, linear = body.force(size * u), K @ (size * u)
                        small = max(small, float(np.abs(F + linear).max() / np.abs(linear).max()))
                        small = max(small, 0.0 if np.isfinite(body.energy(size * u)) else np.inf)
                    for size in (1e20, 1e100, 1e150):
                        E, pull = body.energy(size * u), float(np.abs(body.force(size * u)).max())
                        tangent = float(np.abs(body.tangent_operator(size * u) @ u).max())
                        if np.isfinite(store):
                            large = max(
                                large, abs(E / store - 1.0), pull / store, 0.0 if np.isfinite(tangent) else np.inf
                            )
                    far = np.tile(1e6 * np.ones(dim), mesh.nvertices)
                    moved = float(np.abs(body.force(far)).max()) / (1e6 * float(abs(K).max()))
                    shaken = far * (1.0 + np.finfo(float).eps * rng.integers(-1, 2, len(far)))
                    noise = float(np.abs(body.force(shaken)).max()) / (1e6 * float(abs(K).max()))
                verdicts.add("strains", where, "1e-300 to 1e-30: force is the linear one", small, 1e-9)
                if np.isfinite(store):
                    verdicts.add("strains", where, "1e20 to 1e150: all bonds store f_inf, pull nothing", large, 1e-9)
                verdicts.add("strains", where, "no force of a translation by 1e6", moved, 1e-15)
                verdicts.add("strains", where, "round-off makes forces of round-off", noise, 1e-14)
