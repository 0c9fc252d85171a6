"""Statics: equilibria along a path of loads and prescribed displacements."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from .._types import Floats, Load
from ..model.breaking import Breaking
from ..model.led_body import offered
from ..model.peridynamics import Peridynamics
from ..model.rigidity import check_rigid, check_supported
from ..model.vertex_stiffness import vertex_stiffness_scale
from .constraints import Prescribed, check_fixed
from .energy import trapezoid
from .halved_steps import HalvedSteps
from .inputs import check_load, check_start, checked_load, initial_vector
from .newton import Effort, NotConverged, Objective, minimise
from .preconditioner import Preconditioner
from .state import Equilibrium, read_only

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
    """Follow the equilibria ``force(u) + load(t) = 0`` from t = 0 to ``until``; yield one per step.

    t is no time but how far loads and displacements have come. Each equilibrium is a minimum of ``PD(u) - load.u``,
    found by Newton's method from where the last two point to, so that prescribed displacements lead through the
    largest force and down the other side. Where a crack runs away within a step the next minimum below is taken,
    and the energy that is lost is in ``imbalance``. A step without an equilibrium is cut in half, and grown again.

    Parameters
    ----------
    body : Peridynamics
        The body.
    u0 : ndarray, (N,), optional
        Where to look for the first equilibrium.
    steps : int
        Into how many the path is divided.
    until : float, optional
        The end of the path.
    load : callable, optional
        Of t, gives (N,).
    fixed : sequence of Prescribed, optional
        Prescribed motions.
    tolerance : float, optional
        Of each equilibrium, relative to the forces.
    linear : {"auto", "blocks", "amg", "direct"}, optional
        As of :func:`newmark`.
    effort : Effort, optional
        What solving costs is added to it.
    start : Equilibrium, optional
        Continue an earlier path, with the same bits.

    Yields
    ------
    Equilibrium
        One per step.

    Raises
    ------
    ValueError
        For a body, or a part of one, that can move rigidly, for bonds that leave a vertex free, and for one-sided
        rules.
    NotConverged
        With the last equilibrium in its ``state``, when the step is cut to a thousandth: a load beyond the largest
        that the body carries has no equilibrium.

    Examples
    --------
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
    over_ranks = offered(body, "static")
    if over_ranks is not None:
        if start is not None:
            raise ValueError("start does not go with a body over processes: runs of scenes are gone on with")
        options = {"until": until, "steps": steps, "tolerance": tolerance, "linear": linear, "effort": effort}
        led: Iterator[Equilibrium] = over_ranks(body, u0, load=load, fixed=fixed, **options)
        return led
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
    for motion in fixed:
        if motion.displacement is None:
            raise ValueError("a body at rest has no velocity: prescribe the displacement, as a function of t")
    check_load(load)
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
    stiffness_scale: Floats
    tolerance: float
    effort: Effort

    def load_at(self, t: float) -> Floats | None:
        """Return the load at t, None where there is none."""
        return None if self.load is None else checked_load(self.load(t), len(self.stiffness_scale), t)

    def place(self, t: float, u: Floats) -> None:
        """Put prescribed displacements into u."""
        for prescribed in self.fixed:
            there = prescribed.start(t)
            if there is not None:
                u[prescribed.dofs] = there

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

    def equilibrium(
        self, t: float, u: Floats, b: Floats | None, b1: Floats | None, ahead: tuple[Floats, int] | None, part: int
    ) -> tuple[Floats, float]:
        """Return the equilibrium at t, ``part`` ticks after u, and the energy of the bonds that broke on the way.

        It is looked for where the last change, ``ahead`` over some ticks, points to; a first step follows the body at
        rest.
        """
        if ahead is not None:
            # a path is smooth almost everywhere: go on as far as the last step did, in proportion
            guess = u + ahead[0] * (part / ahead[1])
        else:
            guess = u.copy()
            self.place(t, guess)
            # only what the load has gained: u is in equilibrium with the rest
            rise = None if b1 is None or b is None else b1 - b
            guess = u + self.elastic(guess - u, rise) if len(self.inverse.free) else guess
        self.place(t, guess)
        settled = self.settle(guess, b1)
        return self.let_break(self.body, settled, b1) if isinstance(self.body, Breaking) else (settled, 0.0)

    def let_break(self, body: Breaking, u: Floats, b: Floats | None) -> tuple[Floats, float]:
        """Break bonds and settle again, until none breaks; return the equilibrium and what they had stored."""
        before, lost = tuple(body.state.broken), 0.0
        try:
            while True:
                body.force_and_break(u)
                if not body.state.last:
                    return u, lost
                # what breaks unloads its neighbours or loads them: settle, and look again, until nothing breaks
                lost += body.state.energy
                u = self.settle(u, b)
        except NotConverged:
            body.recall(before)
            raise

    def settle(self, guess: Floats, b: Floats | None) -> Floats:
        """Return the equilibrium near a guess that has the prescribed displacements."""
        objective = Objective(self.body, self.inverse.free, self.stiffness_scale, b)
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
        for prescribed in self.fixed:
            out[prescribed.dofs] = -self.body.force(u)[prescribed.dofs] - (0.0 if b is None else b[prescribed.dofs])
        return out


def _follow(path: _Path, u: Floats, dt: float, steps: int, start: Equilibrium | None) -> Iterator[Equilibrium]:
    """Follow the path from the beginning, or from ``start``; yield an equilibrium a step."""
    ticking, work = HalvedSteps(dt), 0.0
    breaking, dissipated = (path.body if isinstance(path.body, Breaking) else None), 0.0
    if breaking is not None:
        breaking.recall(None if start is None else start.broken)
    ahead: tuple[Floats, int] | None = None  # the last change, and over how many ticks
    if start is None:
        b = path.load_at(0.0)
        u = path.first(u, b)
        reaction = path.reaction(u, b)
        initial = path.body.energy(u)
    else:
        check_start(start.u, len(u))
        if not ticking.resume(start.t, start.dt, start.step):
            raise ValueError(f"steps of {dt}: the equilibrium to start from is at t = {start.t:g}, after {start.dt}")
        u, reaction = start.u.copy(), start.reaction.copy()
        work, initial, b, dissipated = start.work, start.initial, path.load_at(start.t), start.dissipated
        ahead = None if start.change is None else (start.change.copy(), ticking.part)
        path.inverse.recall(start.memory)

    def equilibrium() -> Equilibrium:
        views = read_only(u, reaction)
        change = None if ahead is None else read_only(ahead[0])[0]
        return Equilibrium(
            *(ticking.time, ticking.count, ticking.length, views[0], views[1], work, initial),
            *(path.body, change, path.inverse.memory, dissipated),
            None if breaking is None else tuple(breaking.state.broken),
        )

    now = equilibrium()
    if start is None:
        yield now
    while ticking.ticks < steps * ticking.whole:
        ticking.grow()
        while True:
            t1 = ticking.end
            b1 = path.load_at(t1)
            try:
                # a failure of Newton's method cuts the step; bonds that broke on the way have been made whole
                u1, lost = path.equilibrium(t1, u, b, b1, ahead, ticking.part)
                dissipated += lost
                break
            except NotConverged as error:
                shortest = ticking.length
                if not ticking.halve():
                    raise NotConverged(
                        f"no equilibrium was found beyond t = {ticking.time:.6g}, with steps from {dt:.6g} down to "
                        f"{shortest:.6g}: {error}",
                        now.copy(),
                    ) from None
        ahead = (u1 - u, ticking.part)
        ticking.advance()
        reaction1 = path.reaction(u1, b1)
        work += trapezoid(reaction, reaction1, u1 - u)
        work += trapezoid(b, b1, u1 - u)
        u, b, reaction = u1, b1, reaction1
        now = equilibrium()
        yield now
