"""Statics: equilibria along a path of loads and prescribed displacements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from .._types import Floats, Load
from ..model.breaking import Breaking
from ..model.peridynamics import Peridynamics
from ..model.rigidity import check_rigid, check_supported
from ..model.vertex_stiffness import vertex_stiffness_scale
from .constraints import Prescribed, check_fixed
from .energy import inner
from .inputs import check_start, checked_load, initial_vector
from .newton import Effort, NotConverged, Objective, minimise
from .preconditioner import Preconditioner
from .state import Equilibrium

CUTS = 10  # times a load step may be cut in half
_MOST = 400  # iterations of Newton's method: a crack that runs away within a step takes many


def static(
    body: Peridynamics,
    u0: Floats | None = None,
    *,
    steps: int,
    until: float = 1.0,
    load: Load | None = None,
    fixed: Sequence[Prescribed] = (),
    tolerance: float = 1e-8,
    linear: str = "auto",
    effort: Effort | None = None,
    start: Equilibrium | None = None,
) -> Iterator[Equilibrium]:
    """Follow the equilibria ``force(u) + load(t) = 0`` from t = 0 to ``until`` in so many steps; yield one per step.

    t is no time but how far loads and displacements have come. Each equilibrium is a minimum of ``PD(u) - load.u``,
    found by Newton's method from where the last two point to, so that prescribed displacements lead through the largest
    force and down the other side. Where a crack runs away within a step the next minimum below is taken, and the energy
    that is lost is in ``imbalance``. ``linear`` and ``effort`` are those of :func:`newmark`. A step without an
    equilibrium is cut in half, and grown again. ``start`` continues an earlier path with the
    same bits.

    Raises ``ValueError`` for a body, or a part of one, that can move rigidly, for bonds that leave a vertex free, and
    for one-sided rules; :class:`NotConverged`, with the last equilibrium in its ``state``, when the step is cut to a
    thousandth: a load beyond the largest that the body carries has no equilibrium.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 41)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.1), Linear(slope=1.0))
    >>> ends = [Prescribed(np.flatnonzero(basis.mesh.p[0] < 0.11), displacement=0.0),
    ...         Prescribed(np.flatnonzero(basis.mesh.p[0] > 0.89), displacement=lambda t: 0.1 * t)]
    >>> last = [state for state in static(body, steps=2, fixed=ends)][-1]
    >>> round(float(last.u[20]), 6), bool(last.reaction[ends[1].dofs].sum() > 0.0)
    (0.05, True)
    """
    size = body.basis.N
    if not (isinstance(steps, (int, np.integer)) and steps > 0):
        raise ValueError(f"steps = {steps} must be a whole number, 1 or more")
    if not (np.isfinite(until) and until > 0.0):
        raise ValueError(f"until = {until} must be positive")
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance = {tolerance} must be between 0 and 1")
    if not body.symmetric:
        raise ValueError(
            f"rule = {body.bonds.rule.name}: its force is the gradient of no energy, and an equilibrium is the minimum "
            "of one; take a symmetric rule"
        )
    for one in fixed:
        if one.displacement is None:
            raise ValueError("a body at rest has no velocity: prescribe the displacement, as a function of t")
    prescribed = check_fixed(fixed, size)
    check_rigid(body.whole)
    check_supported(body.whole, prescribed)
    free = np.setdiff1d(np.arange(size), prescribed)
    u = initial_vector(u0, size, "u0")
    inverse = Preconditioner(body.whole, None, free, linear)
    path = _Path(
        body,
        inverse,
        fixed,
        load,
        vertex_stiffness_scale(body.whole),
        tolerance,
        effort if effort is not None else Effort(),
    )
    return _follow(path, u, until / steps, int(steps), start)


@dataclass(frozen=True, eq=False)
class _Path:
    """What stays the same along a path."""

    body: Peridynamics
    inverse: Preconditioner
    fixed: Sequence[Prescribed]
    load: Load | None
    held: Floats
    tolerance: float
    effort: Effort

    def pull(self, t: float) -> Floats | None:
        return None if self.load is None else checked_load(self.load(t), len(self.held), t)

    def place(self, t: float, u: Floats) -> None:
        """Put prescribed displacements into u."""
        for one in self.fixed:
            there = one.start(t)
            if there is not None:
                u[one.dofs] = there

    def first(self, u: Floats, b: Floats | None) -> Floats:
        """Return the equilibrium at t = 0."""
        guess = u.copy()
        self.place(0.0, guess)
        moved = guess - u
        if len(self.inverse.free) and (moved.any() or b is not None):
            guess = u + self.elastic(moved, b)
        try:
            return self.settle(guess, b)
        except NotConverged as error:
            raise NotConverged(f"there is no equilibrium at t = 0 to start from: {error}") from None

    def let_break(self, body: Breaking, u: Floats, b: Floats | None) -> tuple[Floats, float]:
        """Break bonds and settle again, until none breaks; return the equilibrium and what they had stored."""
        before, lost = tuple(body.state.broken), 0.0
        try:
            while True:
                body.force_and_break(u)
                if not body.state.last:
                    return u, lost
                lost += body.state.energy
                u = self.settle(u, b)
        except NotConverged:
            body.recall(before)
            raise

    def settle(self, guess: Floats, b: Floats | None) -> Floats:
        """Return the equilibrium near a guess that has the prescribed displacements."""
        objective = Objective(self.body, self.inverse.free, self.held, b)
        return minimise(objective, guess, self.inverse, tolerance=self.tolerance, effort=self.effort, most=_MOST)

    def elastic(self, du: Floats, b: Floats | None) -> Floats:
        """Return how a body at rest would follow: prescribed changes du, and a load."""
        K = self.body.stiffness_operator()
        pulled = -(K @ du) if b is None else b - K @ du
        free = self.inverse.free
        full = np.zeros(len(du))

        def apply(x: Floats) -> Floats:
            full[free] = x
            y: Floats = K @ full
            self.effort.products += 1
            return y[free]

        A = LinearOperator((len(free), len(free)), matvec=apply, dtype=np.dtype(float))
        with np.errstate(all="ignore"):  # pulled where nothing holds: Newton's method will say so
            x, _ = cg(A, pulled[free], rtol=1e-6, maxiter=3000, M=self.inverse.at(0.0))
        out = du.copy()
        out[free] += x
        return out

    def reaction(self, u: Floats, b: Floats | None) -> Floats:
        out = np.zeros(len(u))
        for one in self.fixed:
            out[one.dofs] = -self.body.force(u)[one.dofs] - (0.0 if b is None else b[one.dofs])
        return out


def _follow(path: _Path, u: Floats, dt: float, steps: int, start: Equilibrium | None) -> Iterator[Equilibrium]:
    whole = 1 << CUTS
    ticks, cuts, count, work = 0, 0, 0, 0.0

    def at(ticks: int) -> float:
        return ticks // whole * dt + ticks % whole * (dt / whole)

    def equilibrium() -> Equilibrium:
        views = [u.view(), held.view()] + ([] if ahead is None else [ahead[0].view()])
        for x in views:
            x.flags.writeable = False
        change = None if ahead is None else views[2]
        t, made_with = at(ticks), dt / 2**cuts
        memory = path.inverse.memory
        return Equilibrium(
            *(t, count, made_with, views[0], views[1], work, initial, path.body, change, memory, dissipated),
            None if breaking is None else tuple(breaking.state.broken),
        )

    breaking, dissipated = (path.body if isinstance(path.body, Breaking) else None), 0.0
    if breaking is not None:
        breaking.recall(None if start is None else start.broken)
    ahead: tuple[Floats, int] | None = None  # the last change, and over how many ticks
    if start is None:
        b = path.pull(0.0)
        u = path.first(u, b)
        held = path.reaction(u, b)
        initial = path.body.energy(u)
    else:
        check_start(start.u, len(u))
        ticks, cuts = round(start.t / dt * whole), round(np.log2(dt / start.dt))
        if abs(at(ticks) - start.t) > 1e-9 * dt or not 0 <= cuts <= CUTS or dt / 2**cuts != start.dt:
            raise ValueError(f"steps of {dt}: the equilibrium to start from is at t = {start.t:g}, after {start.dt}")
        u, held, count = start.u.copy(), start.reaction.copy(), start.step
        work, initial, b, dissipated = start.work, start.initial, path.pull(start.t), start.dissipated
        ahead = None if start.change is None else (start.change.copy(), whole >> cuts)
        path.inverse.recall(start.memory)
    now = equilibrium()
    if start is None:
        yield now
    while ticks < steps * whole:
        while cuts and count and ticks % (whole >> max(cuts - 2, 0)) == 0:
            cuts -= 1
        while True:
            part = whole >> cuts
            t1 = at(ticks + part)
            b1 = path.pull(t1)
            if ahead is None:
                guess = u.copy()
                path.place(t1, guess)
                rise = None if b1 is None or b is None else b1 - b
                guess = u + path.elastic(guess - u, rise) if len(path.inverse.free) else guess
            else:
                guess = u + ahead[0] * (part / ahead[1])
            path.place(t1, guess)
            try:
                found = path.settle(guess, b1)
                if breaking is not None:
                    found, lost = path.let_break(breaking, found, b1)
                    dissipated += lost
                break
            except NotConverged as error:
                if cuts == CUTS:
                    raise NotConverged(
                        f"no equilibrium was found beyond t = {at(ticks):.6g}, with steps from {dt:.6g} down to "
                        f"{dt / 2**cuts:.6g}: {error}",
                        now.copy(),
                    ) from None
                cuts += 1
        ticks, count = ticks + part, count + 1
        pulled = path.reaction(found, b1)
        work += 0.5 * inner(held + pulled, found - u)
        if b is not None and b1 is not None:
            work += 0.5 * inner(b + b1, found - u)
        ahead = (found - u, part)
        u, b, held = found, b1, pulled
        now = equilibrium()
        yield now
