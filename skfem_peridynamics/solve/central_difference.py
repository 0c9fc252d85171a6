"""Central difference in time, started and continued as the paper does (eqs. 4.2, 4.3), in velocity form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil
from typing import Protocol

import numpy as np
import scipy.sparse as sparse

from .._types import Floats, Load
from ..model.breaking import Breaking
from ..model.peridynamics import Peridynamics
from .cfl import StepLimit
from .constraints import Prescribed, check_fixed
from .energy import inner
from .inputs import check_start, checked_load, initial_vector
from .instability import Watch, watching
from .mass_solver import MassSolver, mass_solver
from .state import State
from .tangent_limit import TangentLimit


class Body(Protocol):
    """What a scheme needs of a body; ``energy`` is asked for only when energies are read."""

    def force(self, u: Floats) -> Floats: ...


def central_difference(
    body: Body,
    M: sparse.spmatrix | Floats,
    u0: Floats | None = None,
    v0: Floats | None = None,
    *,
    dt: float,
    until: float,
    load: Load | None = None,
    fixed: Sequence[Prescribed] = (),
    limit: StepLimit | None = None,
    watch: int | Watch = 100,
    start: State | None = None,
    adapt: int = 0,
) -> Iterator[State]:
    """Step ``M u'' = force(u) + load(t)`` from t = 0 (or from ``start``) to ``until``; yield a state per step.

    The first state is the initial one. ``M`` is the lumped or the consistent mass, ``load(t)`` a vector (N,),
    ``fixed`` the prescribed motions. Every ``watch`` steps the energy balance is checked (0: never; or a :class:`Watch`
    of your own); ``limit`` only serves the message. Bonds of a
    :class:`Breaking` body break as they pass their limit. ``start`` continues an earlier run with the same bits. Every
    ``adapt`` steps (0: never) the limit is estimated again from the tangent, and dt kept at most the same part of it:
    for laws of your own that stiffen; it takes ``limit`` and a :class:`Peridynamics` with a symmetric rule. The step is
    never longer than ``dt``: softened bonds that close again are stiff again (docs/stability.md). There is no mass
    scaling: it buys a longer step with another motion; take :func:`newmark` or :func:`static` where inertia does not
    matter.

    Raises ``ValueError`` for arguments and loads that make no sense and :class:`UnstableRun` when the balance breaks;
    it holds the last good state.

    >>> class Spring:
    ...     def force(self, u): return -u
    ...     def energy(self, u): return 0.5 * float(u @ u)
    >>> for state in central_difference(Spring(), np.ones(1), np.ones(1), dt=0.01, until=np.pi): pass
    >>> state.step, round(float(state.u[0]), 6), round(state.energies.total, 6)
    (315, -0.999965, 0.5)
    """
    size = M.shape[0]
    prescribed = check_fixed(fixed, size)
    mass = mass_solver(M, prescribed)
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt = {dt} must be a positive time")
    if not np.isfinite(until):
        raise ValueError(f"until = {until} must be a time")
    if adapt < 0 or (adapt and (limit is None or not getattr(body, "symmetric", False))):
        raise ValueError(f"adapt = {adapt} must be 0, or positive with a limit and a body of a symmetric rule")
    if adapt and start is not None:
        raise ValueError(f"adapt = {adapt} does not go with start, whose steps are all of one length")
    return _steps(
        body,
        mass,
        initial_vector(u0, size, "u0"),
        initial_vector(v0, size, "v0"),
        dt,
        until,
        load,
        fixed,
        limit,
        watch,
        start,
        adapt,
        TangentLimit(body, M) if adapt and isinstance(body, Peridynamics) else None,
    )


def _steps(
    body: Body,
    mass: MassSolver,
    u: Floats,
    v: Floats,
    dt: float,
    until: float,
    load: Load | None,
    fixed: Sequence[Prescribed],
    limit: StepLimit | None,
    watch: int | Watch,
    start: State | None,
    adapt: int,
    tangent: TangentLimit | None,
) -> Iterator[State]:
    size = mass.size
    origin, first = 0.0, 0  # dt has been what it is since then
    part, longest = dt / limit.dt if limit is not None else 1.0, dt

    def at(step: int) -> float:
        return origin + (step - first) * dt

    def accelerate(step: int) -> tuple[Floats, Floats | None]:
        """Acceleration at a step from force and load; prescribed degrees of freedom follow their own motion."""
        b = None if load is None else checked_load(load(at(step)), size, at(step))
        total = body.force(u) if breaking is None else breaking.force_and_break(u)
        if b is not None:
            total = total + b
        if not fixed:
            return mass.solve(total, out=room), b
        given = np.zeros(size)
        for one in fixed:
            now = one.mean_velocity(at(step - 1), at(step)) if step else None
            following = one.mean_velocity(at(step), at(step + 1))
            given[one.dofs] = 0.0 if now is None else (following - now) / dt
        a = mass.solve(total - mass.times(given))
        for one in fixed:
            a[one.dofs] = given[one.dofs]
        inertia = mass.times(a)
        for one in fixed:
            resist[one.dofs] = inertia[one.dofs] - total[one.dofs]
        return a, b

    breaking = body if isinstance(body, Breaking) else None
    dissipated = 0.0
    room = np.empty(size)  # for accelerations
    resist = np.zeros(size if fixed else 0)  # reaction at prescribed degrees of freedom, 0 elsewhere
    if start is None:
        step, work, initial, ripple = 0, 0.0, None, 0.0
        for one in fixed:
            place = one.start(0.0)
            if place is not None:
                u[one.dofs] = place
        if tangent is not None:
            dt = min(dt, part * tangent.at(u))
        for one in fixed:
            v[one.dofs] = one.mean_velocity(0.0, dt)
        a, b = accelerate(0)
    else:
        check_start(start.u, size)
        if start.dt != dt:
            raise ValueError(f"dt = {dt}: the state to start from was made with dt = {start.dt}")
        u, v, step = start.u.copy(), start.v.copy(), start.step
        work, initial, ripple, dissipated = start.work, start.initial, start.initial_ripple, start.dissipated
        if breaking is not None:
            breaking.recall(start.broken)
        a, b = accelerate(step)
    if initial is None:
        initial = 0.5 * inner(v, mass.times(v)) + (float(body.energy(u)) if hasattr(body, "energy") else 0.0)
        ripple = 0.125 * dt**2 * inner(a, mass.times(a))
    guard = watching(watch, limit, abs(initial))

    def state() -> State:
        views = [x.view() for x in (u, v, a)]
        for x in views:
            x.flags.writeable = False
        return State(
            *(at(step), step, dt, views[0], views[1], views[2], work, initial, ripple, 0.25, body, mass),
            dissipated=dissipated,
            broken=None if breaking is None else tuple(breaking.state.broken),
        )

    now = state()
    guard.good = now.copy()
    if start is None:
        yield now
    du, half = np.empty_like(u), 0.5 * dt * a  # half a step's change of velocity, twice
    end = until * (1.0 - 1e-12)
    while at(step) < end:
        # k = 0: u1 = u0 + dt v0 + dt^2/2 a0; k >= 1: u_{k+1} = 2 u_k - u_{k-1} + dt^2 a_k
        with np.errstate(over="ignore", invalid="ignore"):  # the watch looks at the numbers
            v += half
            np.multiply(v, dt, out=du)
            u += du
            step += 1
            before, pulled = b, resist.copy()
            a, b = accelerate(step)
            if b is not None and before is not None:
                work += 0.5 * inner(before + b, du)
            if fixed:
                work += 0.5 * inner(pulled + resist, du)
            if breaking is not None and breaking.state.last:
                # what broke has pulled along half of this step only: the motion lacks that work
                dissipated += breaking.state.energy - 0.5 * breaking.state.work_of_last(breaking.inward(du))
            np.multiply(a, 0.5 * dt, out=half)
            v += half
        now = state()
        again = tangent is not None and step % adapt == 0 and at(step) < end
        if guard.due(step, last=at(step) >= end) or again:
            guard.check(now)
        yield now
        if tangent is not None and again:
            origin, first, left = at(step), step, until - at(step)
            dt = left / max(1, ceil(left / min(longest, part * tangent.at(u)) - 1e-9))
            for one in fixed:  # what is prescribed arrives where it should after the next step, too
                a[one.dofs] = 2.0 / dt * (one.mean_velocity(at(step), at(step + 1)) - v[one.dofs])
            np.multiply(a, 0.5 * dt, out=half)
