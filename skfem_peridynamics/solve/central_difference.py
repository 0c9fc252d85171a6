"""Central difference in time, started and continued as the paper does (eqs. 4.2, 4.3), in velocity form."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import ceil
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sparse

from .._types import Floats, Load, Longs
from ..model.peridynamics import Peridynamics
from .cfl import StepLimit
from .constraints import Prescribed, check_fixed
from .energy import inner, total, trapezoid
from .inputs import check_load, check_start, checked_load, initial_vector
from .instability import Watch, watching
from .mass_solver import MassSolver, mass_solver
from .state import State, read_only
from .tangent_limit import TangentLimit


class Body(Protocol):
    """What a scheme needs of a body; ``energy`` is asked for only when energies are read."""

    def force(self, u: Floats) -> Floats: ...


@runtime_checkable
class Breakable(Protocol):
    """A body whose bonds break for good."""

    @property
    def state(self) -> Any: ...

    def force_and_break(self, u: Floats) -> Floats: ...

    def work_of_last(self, du: Floats) -> float: ...

    def recall(self, broken: Sequence[Longs] | None) -> None: ...


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

    The first state is the initial one. Bonds of a :class:`Breaking` body break as they pass their limit. The step
    is never longer than ``dt``: softened bonds that close again are stiff again (docs/evidence/stability.md). There
    is no mass scaling: it buys a longer step with another motion; take :func:`newmark` or :func:`static` where
    inertia does not matter.

    Parameters
    ----------
    body : object
        Anything with ``force(u)``; its ``energy(u)`` is asked for only when energies are read.
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
    adapt : int, optional
        Estimate the limit again from the tangent every so many steps, and keep dt at most the same part of it: for
        laws of your own that stiffen. It takes ``limit`` and a symmetric rule; 0 never.

    Yields
    ------
    State
        The motion after each step; views, valid until the next.

    Raises
    ------
    ValueError
        For arguments and loads that make no sense.
    UnstableRun
        When the balance breaks; it holds the last good state.

    References
    ----------
    Paper, eqs. 4.2 and 4.3.

    Examples
    --------
    >>> class Spring:
    ...     def force(self, u): return -u
    ...     def energy(self, u): return 0.5 * float(u @ u)
    >>> for state in central_difference(Spring(), np.ones(1), np.ones(1), dt=0.01, until=np.pi): pass
    >>> state.step, round(float(state.u[0]), 6), round(state.energies.total, 6)
    (315, -0.999965, 0.5)
    """
    size = M.shape[0]
    check_load(load)
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt = {dt} must be a positive time")
    if not np.isfinite(until):
        raise ValueError(f"until = {until} must be a time")
    prescribed = check_fixed(fixed, size, until)
    mass = mass_solver(M, prescribed)
    if adapt < 0 or (adapt and (limit is None or not getattr(body, "symmetric", False))):
        raise ValueError(f"adapt = {adapt} must be 0, or positive with a limit and a body of a symmetric rule")
    if adapt and not isinstance(body, Peridynamics):
        raise ValueError(
            f"adapt = {adapt} takes a Peridynamics body: of others, and over processes, no tangent is known"
        )
    if adapt and start is not None:
        raise ValueError(f"adapt = {adapt} does not go with start, whose steps are all of one length")
    motion = _Motion(body, mass, initial_vector(u0, size, "u0"), initial_vector(v0, size, "v0"), dt, load, fixed)
    tangent = TangentLimit(body, M) if adapt and isinstance(body, Peridynamics) else None
    return _steps(motion, until, limit, watch, start, adapt, tangent)


class _Motion:
    """Displacement, velocity and acceleration that go from step to step in place, and the ledger of their energies.

    ``b`` is the load, ``reaction`` what holds or moves the prescribed degrees of freedom (0 elsewhere).
    """

    a: Floats
    b: Floats | None
    half: Floats  # half a step's change of velocity, taken twice

    def __init__(
        self,
        body: Body,
        mass: MassSolver,
        u: Floats,
        v: Floats,
        dt: float,
        load: Load | None,
        fixed: Sequence[Prescribed],
    ) -> None:
        self.body, self.mass, self.load, self.fixed = body, mass, load, fixed
        self.breaking = body if isinstance(body, Breakable) else None
        self.u, self.v, self.dt, self.step = u, v, dt, 0
        self.origin, self.first = 0.0, 0  # time and step since which dt is what it is
        self.work, self.dissipated, self.initial, self.ripple = 0.0, 0.0, 0.0, 0.0
        # where the body is dealt out over ranks, on any of them: a mass may have them meet
        self.held = total(body, float(len(fixed))) > 0.0
        self.reaction = np.zeros(mass.size if self.held else 0)
        self._room = np.empty(mass.size)  # for accelerations
        self._du = np.empty_like(u)

    def at(self, step: int) -> float:
        """Return the time of a step."""
        return self.origin + (step - self.first) * self.dt

    @property
    def time(self) -> float:
        """The time of the step that was made last."""
        return self.at(self.step)

    def place(self) -> None:
        """Put prescribed displacements into the first state."""
        for prescribed in self.fixed:
            displacement = prescribed.start(0.0)
            if displacement is not None:
                self.u[prescribed.dofs] = displacement

    def begin(self) -> None:
        """Make the first state: prescribed velocities, acceleration, energy."""
        for prescribed in self.fixed:
            self.v[prescribed.dofs] = prescribed.mean_velocity(0.0, self.dt)
        self._accelerate()
        kinetic = 0.5 * inner(self.v, self.mass.times(self.v))
        elastic = float(self.body.energy(self.u)) if hasattr(self.body, "energy") else 0.0
        self.initial = total(self.body, kinetic + elastic)
        self.ripple = total(self.body, 0.125 * self.dt**2 * inner(self.a, self.mass.times(self.a)))
        self.half = 0.5 * self.dt * self.a

    def resume(self, start: State) -> None:
        """Go to an earlier state. Raises ``ValueError`` for one of another body, or of steps of another length."""
        check_start(start.u, self.mass.size)
        if start.dt != self.dt:
            raise ValueError(f"dt = {self.dt}: the state to start from was made with dt = {start.dt}")
        self.u, self.v, self.step = start.u.copy(), start.v.copy(), start.step
        self.work, self.dissipated = start.work, start.dissipated
        self.initial, self.ripple = start.initial, start.initial_ripple
        if self.breaking is not None:
            self.breaking.recall(start.broken)
        self._accelerate()
        self.half = 0.5 * self.dt * self.a

    def _accelerate(self) -> None:
        """Acceleration from force and load; prescribed degrees of freedom follow their own motion."""
        now = self.time
        self.b = None if self.load is None else checked_load(self.load(now), self.mass.size, now)
        total = self.body.force(self.u) if self.breaking is None else self.breaking.force_and_break(self.u)
        if self.b is not None:
            total = total + self.b
        if not self.held:
            # in place: the state that was yielded before is a view, and over by now
            self.a = self.mass.solve(total, out=self._room)
            return
        given = np.zeros(self.mass.size)
        for prescribed in self.fixed:
            before = prescribed.mean_velocity(self.at(self.step - 1), now) if self.step else None
            after = prescribed.mean_velocity(now, self.at(self.step + 1))
            given[prescribed.dofs] = 0.0 if before is None else (after - before) / self.dt
        # a consistent mass couples what is prescribed to what is free: its inertia goes to the other side
        self.a = self.mass.solve(total - self.mass.times(given))
        for prescribed in self.fixed:
            self.a[prescribed.dofs] = given[prescribed.dofs]
        inertia = self.mass.times(self.a)
        for prescribed in self.fixed:
            self.reaction[prescribed.dofs] = inertia[prescribed.dofs] - total[prescribed.dofs]

    def advance(self) -> None:
        """Make a step, in velocity form.

        k = 0: u1 = u0 + dt v0 + dt^2/2 a0 (4.3); k >= 1: u_{k+1} = 2 u_k - u_{k-1} + dt^2 a_k (4.2).
        """
        du = self._du
        with np.errstate(over="ignore", invalid="ignore"):  # the watch looks at the numbers
            self.v += self.half
            np.multiply(self.v, self.dt, out=du)
            self.u += du
            self.step += 1
            load, reaction = self.b, self.reaction.copy()
            self._accelerate()
            self.work += trapezoid(load, self.b, du)
            if self.held:
                self.work += trapezoid(reaction, self.reaction, du)
            if self.breaking is not None and self.breaking.state.last:
                # what broke has pulled along half of this step only: the motion lacks that work
                lacking = 0.5 * self.breaking.work_of_last(du)
                self.dissipated += self.breaking.state.energy - lacking
            np.multiply(self.a, 0.5 * self.dt, out=self.half)
            self.v += self.half

    def change_step(self, dt: float) -> None:
        """Go on with steps of another length."""
        self.origin, self.first, self.dt = self.time, self.step, dt
        for prescribed in self.fixed:  # what is prescribed arrives where it should after the next step, too
            velocity = prescribed.mean_velocity(self.time, self.at(self.step + 1))
            self.a[prescribed.dofs] = 2.0 / dt * (velocity - self.v[prescribed.dofs])
        np.multiply(self.a, 0.5 * dt, out=self.half)

    def state(self) -> State:
        """Return the state after the last step, a view of it."""
        u, v, a = read_only(self.u, self.v, self.a)
        return State(
            *(self.time, self.step, self.dt, u, v, a),
            *(self.work, self.initial, self.ripple, 0.25, self.body, self.mass),
            dissipated=self.dissipated,
            broken=None if self.breaking is None else tuple(self.breaking.state.broken),
        )


def _steps(
    motion: _Motion,
    until: float,
    limit: StepLimit | None,
    watch: int | Watch,
    start: State | None,
    adapt: int,
    tangent: TangentLimit | None,
) -> Iterator[State]:
    """Step from the beginning, or from ``start``, to ``until``; yield a state a step."""
    # an adapted step stays the same part of the limit, and is never longer than asked for
    part, longest = motion.dt / limit.dt if limit is not None else 1.0, motion.dt
    if start is None:
        motion.place()
        if tangent is not None:
            motion.dt = min(motion.dt, part * tangent.at(motion.u))
        motion.begin()
    else:
        motion.resume(start)
    guard = watching(watch, limit, abs(motion.initial))
    now = motion.state()
    guard.good = now.copy()
    if start is None:
        yield now
    end = until * (1.0 - 1e-12)
    while motion.time < end:
        motion.advance()
        now = motion.state()
        again = tangent is not None and motion.step % adapt == 0 and motion.time < end
        if guard.due(motion.step, last=motion.time >= end) or again:
            guard.check(now)
        yield now
        if tangent is not None and again:
            # whole steps to the end, so that the run still ends on time
            left = until - motion.time
            motion.change_step(left / max(1, ceil(left / min(longest, part * tangent.at(motion.u)) - 1e-9)))
