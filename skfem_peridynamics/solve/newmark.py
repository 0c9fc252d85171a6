"""Newmark's method: implicit steps that resolve what moves slowly and need not resolve what is stiff."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import scipy.sparse as sparse

from .._types import Floats, Load, Longs
from ..model.breaking import Breaking
from ..model.led_body import offered
from ..model.peridynamics import Peridynamics
from ..model.vertex_stiffness import vertex_stiffness_scale
from .cfl import StepLimit
from .constraints import Prescribed, check_fixed
from .energy import inner, trapezoid
from .halved_steps import HalvedSteps
from .inputs import check_load, check_start, checked_load, initial_vector
from .instability import Watch, watching
from .mass_solver import MassSolver, mass_solver
from .newton import Effort, NotConverged, Objective, minimise
from .preconditioner import Preconditioner
from .state import State, read_only

_MOST = 25  # iterations of Newton's method before it is


def newmark(
    body: Peridynamics,
    M: sparse.spmatrix | Floats,
    u0: Floats | None = None,
    v0: Floats | None = None,
    *,
    dt: float,
    until: float,
    beta: float = 0.25,
    gamma: float = 0.5,
    load: Load | None = None,
    fixed: Sequence[Prescribed] = (),
    limit: StepLimit | None = None,
    watch: int | Watch = 100,
    start: State | None = None,
    tolerance: float = 1e-9,
    linear: str = "auto",
    effort: Effort | None = None,
) -> Iterator[State]:
    """Step ``M u'' = force(u) + load(t)`` implicitly; yield a state per step.

    Each step is the minimum of the energy plus inertia, found by Newton's method on the exact tangent, applied bond
    by bond. Where Newton fails the step is cut in half, and grown again once it is easy; the states tell the step
    they were made with. ``(beta, gamma) = (1/4, 1/2)`` is stable at any step for the linear model and keeps its
    energy; ``gamma > 1/2`` damps what the step does not resolve, to first order in dt.

    Parameters
    ----------
    body : Peridynamics
        The body.
    M : scipy.sparse matrix or ndarray, (N,)
        The lumped or the consistent mass.
    u0 : ndarray, (N,), optional
        Initial displacement, 0 by default.
    v0 : ndarray, (N,), optional
        Initial velocity, 0 by default.
    dt : float
        The step.
    until : float
        The time to end at.
    beta : float, optional
        Of Newmark, positive: 0 is central difference.
    gamma : float, optional
        Of Newmark, at least 1/2.
    load : callable, optional
        Of t, gives (N,).
    fixed : sequence of Prescribed, optional
        Prescribed motions.
    limit : StepLimit, optional
        The stable limit; it serves the message.
    watch : int or Watch, optional
        Check the energy balance every so many steps; 0 never.
    start : State, optional
        Continue an earlier run, with the same bits.
    tolerance : float, optional
        Of each step, relative to the forces.
    linear : {"auto", "blocks", "amg", "direct"}, optional
        What linear solves are preconditioned with: blocks of vertices, a pyamg cycle that knows the rigid motions,
        a sparse factor of the system at rest, or what is cheapest.
    effort : Effort, optional
        What solving costs is added to it.

    Yields
    ------
    State
        The motion after each step.

    Raises
    ------
    ValueError
        For ``beta <= 0``, ``gamma < 1/2`` (it grows at any step) and one-sided rules, whose force is the gradient
        of no energy.
    NotConverged
        With the last state, when the step is cut to a thousandth.
    UnstableRun
        When energy comes from nowhere.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear, mass_matrix, stable_time_step
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 41)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.1), Linear(slope=1.0))
    >>> M, u0 = mass_matrix(basis), 1e-3 * np.cos(np.pi * basis.mesh.p[0])
    >>> dt = 1000 * stable_time_step(body, M).dt
    >>> energy = [state.energies.total for state in newmark(body, M, u0, dt=dt, until=20 * dt)]
    >>> max(abs(e / energy[0] - 1) for e in energy) < 1e-6
    True
    """
    over_ranks = offered(body, "newmark")
    if over_ranks is not None:
        if start is not None:
            raise ValueError("start does not go with a body over processes: runs of scenes are gone on with")
        options: dict[str, Any] = {"beta": beta, "gamma": gamma, "limit": limit, "watch": watch, "tolerance": tolerance}
        options |= {"linear": linear, "effort": effort}
        led: Iterator[State] = over_ranks(body, M, u0, v0, dt=dt, until=until, load=load, fixed=fixed, **options)
        return led
    size = M.shape[0]
    for name, value in (("beta", beta), ("gamma", gamma), ("dt", dt), ("until", until), ("tolerance", tolerance)):
        if not np.isfinite(value):
            raise ValueError(f"{name} = {value} must be a finite number")
    if not beta > 0.0:
        raise ValueError(f"beta = {beta} must be positive; central_difference is the method of beta = 0, gamma = 1/2")
    if not gamma >= 0.5:
        raise ValueError(f"gamma = {gamma} must be at least 1/2: with less, every motion grows")
    if not dt > 0.0:
        raise ValueError(f"dt = {dt} must be a positive time")
    if not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance = {tolerance} must be between 0 and 1")
    if not body.symmetric:
        raise ValueError(
            f"rule = {body.bonds.rule.name}: its force is the gradient of no energy, and implicit steps minimise one; "
            "take a symmetric rule"
        )
    u, v = initial_vector(u0, size, "u0"), initial_vector(v0, size, "v0")
    check_load(load)
    prescribed = check_fixed(fixed, size, until)
    free = np.setdiff1d(np.arange(size), prescribed)
    step = _Step(
        *(
            body,
            mass_solver(M, prescribed),
            Preconditioner(body.whole, M, free, linear),
            fixed,
            prescribed,
            vertex_stiffness_scale(body.whole),
        ),
        *(beta, gamma, tolerance, effort if effort is not None else Effort()),
    )
    return _steps(step, u, v, dt, until, load, limit, watch, start)


@dataclass(frozen=True, eq=False)
class _Step:
    """One implicit step."""

    body: Peridynamics
    mass: MassSolver
    inverse: Preconditioner
    fixed: Sequence[Prescribed]
    prescribed: Longs
    stiffness_scale: Floats
    beta: float
    gamma: float
    tolerance: float
    effort: Effort

    def begin(self, dt: float, u: Floats, v: Floats, b: Floats | None) -> Floats:
        """Put prescribed values into u and v at t = 0; return the acceleration there."""
        given = np.zeros(len(u))
        for prescribed in self.fixed:
            place = prescribed.start(0.0)
            if place is not None:
                u[prescribed.dofs] = place
            v[prescribed.dofs] = prescribed.mean_velocity(0.0, dt)
        total = self.body.force(u) if b is None else self.body.force(u) + b
        a = self.mass.solve(total - self.mass.times(given))
        a[self.prescribed] = 0.0
        return a

    def take(self, t: float, dt: float, u: Floats, v: Floats, a: Floats, b: Floats | None) -> tuple[Floats, ...]:
        """Return displacement, velocity and acceleration a step after t, where the load is b."""
        beta, gamma, fixed = self.beta, self.gamma, self.prescribed
        # u1 is the minimum of PD(u) - b.u + shift/2 (u - centre).M (u - centre)
        shift = 1.0 / (beta * dt**2)
        centre = u + dt * v + (0.5 - beta) * dt**2 * a
        u1, v1, a1 = u.copy(), v.copy(), a.copy()
        for prescribed in self.fixed:
            before, after = prescribed.mean_velocity(t, t + dt), prescribed.mean_velocity(t + dt, t + 2.0 * dt)
            u1[prescribed.dofs] += dt * before
            v1[prescribed.dofs], a1[prescribed.dofs] = 0.5 * (before + after), (after - before) / dt
        centre[fixed] = u1[fixed] - a1[fixed] / shift  # their inertia is then what it is
        stiffness = self.stiffness_scale + shift * self.mass.times(np.ones(len(u)))
        objective = Objective(self.body, self.inverse.free, stiffness, b, shift, self.mass, centre)
        coasting = u + dt * v
        coasting[fixed] = u1[fixed]
        # from where it is, or from where it would be on its own: a wild guess breaks bonds
        guess = min(u1, coasting, key=lambda prescribed: objective.value(prescribed)[0])
        u_next = minimise(objective, guess, self.inverse, tolerance=self.tolerance, effort=self.effort, most=_MOST)
        accelerated = shift * (u_next - centre)
        # v1 = v + dt ((1 - gamma) a + gamma a1), with a1 = shift (u1 - centre)
        velocity = v + dt * ((1.0 - gamma) * a + gamma * accelerated)
        velocity[fixed], accelerated[fixed] = v1[fixed], a1[fixed]
        return u_next, velocity, accelerated

    def again(self, u: Floats, a: Floats, b: Floats | None) -> Floats:
        """Return the acceleration at u, where bonds have just broken."""
        total = self.body.force(u) if b is None else self.body.force(u) + b
        given = np.zeros(len(u))
        given[self.prescribed] = a[self.prescribed]
        out = self.mass.solve(total - self.mass.times(given))
        out[self.prescribed] = given[self.prescribed]
        return out

    def reaction(self, u: Floats, a: Floats, b: Floats | None) -> Floats:
        """Return what holds or moves the prescribed degrees of freedom; 0 elsewhere."""
        out = np.zeros(len(u))
        if len(self.prescribed):
            total = self.mass.times(a) - self.body.force(u)
            out[self.prescribed] = (total if b is None else total - b)[self.prescribed]
        return out


def _steps(
    step: _Step,
    u: Floats,
    v: Floats,
    dt: float,
    until: float,
    load: Load | None,
    limit: StepLimit | None,
    watch: int | Watch,
    start: State | None,
) -> Iterator[State]:
    """Step from the beginning, or from ``start``, to ``until``; yield a state a step."""
    # whole steps to the end, the longest that are not longer than asked for
    even = until / max(1, ceil(until / dt - 1e-9)) if until > 0.0 else dt
    if start is None or HalvedSteps(even).resume(start.t, start.dt, start.step):
        dt = even
    lag = 0.5 * step.gamma - step.beta
    ticking = HalvedSteps(dt)

    def load_at(t: float) -> Floats | None:
        return None if load is None else checked_load(load(t), len(u), t)

    breaking, dissipated = (step.body if isinstance(step.body, Breaking) else None), 0.0
    if breaking is not None:
        breaking.recall(None if start is None else start.broken)
    b = load_at(0.0 if start is None else start.t)
    if start is None:
        a, work = step.begin(dt, u, v, b), 0.0
        initial = 0.5 * inner(v, step.mass.times(v)) + step.body.energy(u)
        # by this much the energy of a linear run swings without being wrong
        ripple = 0.5 * lag * dt**2 * inner(a, step.mass.times(a))
    else:
        check_start(start.u, len(u))
        if not ticking.resume(start.t, start.dt, start.step):
            raise ValueError(f"dt = {dt}: the state to start from was made with dt = {start.dt} at t = {start.t:g}")
        u, v, a = start.u.copy(), start.v.copy(), start.a.copy()
        step.inverse.recall(start.memory)
        work, initial, ripple, dissipated = start.work, start.initial, start.initial_ripple, start.dissipated
    # the work of prescribed motions is that of what enforces them
    reaction = step.reaction(u, a, b)
    guard = watching(watch, limit, abs(initial), damps=step.gamma > 0.5)

    def state() -> State:
        views = read_only(u, v, a)
        return State(
            *(ticking.time, ticking.count, ticking.length, views[0], views[1], views[2], work, initial, ripple, lag),
            *(step.body, step.mass, step.inverse.memory),
            dissipated=dissipated,
            broken=None if breaking is None else tuple(breaking.state.broken),
        )

    now = state()
    guard.good = now.copy()
    if start is None:
        yield now
    end = until * (1.0 - 1e-12)
    while ticking.time < end:
        ticking.grow()
        while True:
            b1 = load_at(ticking.end)
            try:
                with np.errstate(over="ignore", invalid="ignore"):
                    u1, v, a = step.take(ticking.time, ticking.length, u, v, a, b1)
                break
            except NotConverged as error:
                shortest = ticking.length
                if not ticking.halve():
                    raise NotConverged(
                        f"the step at t = {ticking.time:.6g} was cut from {dt:.6g} to {shortest:.6g}, "
                        f"and still: {error}",
                        now.copy(),
                    ) from None
        ticking.advance()
        reaction1 = step.reaction(u1, a, b1)
        work += trapezoid(reaction, reaction1, u1 - u)
        work += trapezoid(b, b1, u1 - u)
        if breaking is not None:
            breaking.force_and_break(u1)
            if breaking.state.last:
                dissipated += breaking.state.energy
                # what broke pulls no more: the motion goes on from the acceleration without it
                a = step.again(u1, a, b1)
                reaction1 = step.reaction(u1, a, b1)
        u, b, reaction = u1, b1, reaction1
        now = state()
        if guard.due(ticking.count, last=ticking.time >= end):
            guard.check(now)
        yield now
