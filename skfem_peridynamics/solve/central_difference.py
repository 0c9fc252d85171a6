"""Central difference in time, started and continued as the paper does (eqs. 4.2, 4.3), in velocity form."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sparse

from .._types import Floats, Load
from .cfl import StepLimit, diagonal_mass
from .constraints import Prescribed, check_fixed

# The alarms, measured in tests/test_central_difference.py: of the peak energy, what the balance of a run may be off
# beyond the ripple of its fast modes (a linear run: round-off; stable fracture: below 0.05 even with rough data), and
# how many times the energy put in may be found (at 0.995 of the limit a ripple can reach 100 times).
BROKEN_BALANCE = 0.1
ENERGY_FROM_NOWHERE = 100.0
_EARLY = (10, 30)  # a step far beyond the limit shows itself at once


class UnstableRun(RuntimeError):
    """The energy balance broke: the step is too large, or the load is not what was meant."""


class Body(Protocol):
    """What a scheme needs of a body; ``energy`` is asked for only when energies are read."""

    def force(self, u: Floats) -> Floats: ...


@dataclass(frozen=True)
class Energies:
    """Energies at one time. ``work`` is that of loads and prescribed motions since the start, ``initial`` the total then."""

    kinetic: float
    elastic: float
    work: float
    initial: float

    @property
    def total(self) -> float:
        return self.kinetic + self.elastic

    @property
    def imbalance(self) -> float:
        """``kinetic + elastic - work - initial``, 0 for the exact motion."""
        return self.kinetic + self.elastic - self.work - self.initial


@dataclass(frozen=True, eq=False)
class State:
    """The motion at one time: read-only views, valid until the next step; :meth:`copy` keeps them.

    ``v`` is the velocity at the full step, second order in dt: ``(u^{k+1} - u^{k-1}) / (2 dt)``; ``a`` the
    acceleration, so that ``v + dt a / 2`` is the paper's next difference quotient.
    """

    t: float
    step: int
    dt: float
    u: Floats
    v: Floats
    a: Floats
    work: float
    initial: float
    initial_ripple: float = 0.0
    _body: Any = field(repr=False, default=None)
    _mass: Any = field(repr=False, default=None)

    @property
    def kinetic(self) -> float:
        """``v.M v / 2``"""
        return 0.5 * float(self._mass @ (self.v * self.v))

    @property
    def ripple(self) -> float:
        """``dt^2/8 a.M a``: by this the energy of a linear run swings about a constant, without being wrong."""
        return 0.125 * self.dt**2 * float(self._mass @ (self.a * self.a))

    @cached_property
    def energies(self) -> Energies:
        """Kinetic and elastic energy and external work, computed when first read."""
        return Energies(self.kinetic, float(self._body.energy(self.u)), self.work, self.initial)

    def copy(self) -> State:
        """Return a state that later steps leave alone."""
        return dataclasses.replace(self, u=self.u.copy(), v=self.v.copy(), a=self.a.copy())


@dataclass
class _Watch:
    """Look at the energy balance now and then, and stop the run when it is broken."""

    every: int
    limit: StepLimit | None
    peak: float = 0.0

    def look(self, state: State) -> None:
        what = self._complaint(state)
        if what is not None:
            known = ""
            if self.limit is not None:
                known = f", which is {state.dt / self.limit.dt:.4g} times the stable limit {self.limit.dt:.6g}"
            raise UnstableRun(
                f"the run became unstable by step {state.step} (t = {state.t:.6g}): {what}; "
                f"dt = {state.dt:.6g}{known}. Take a smaller dt"
            )

    def _complaint(self, state: State) -> str | None:
        if not hasattr(state._body, "energy"):
            return None if np.isfinite(state.v).all() else "the velocities are no longer finite"
        with np.errstate(over="ignore", invalid="ignore"):
            energies, ripple = state.energies, state.ripple - state.initial_ripple
        supplied = abs(energies.initial) + abs(energies.work)
        self.peak = max(self.peak, supplied, energies.total)
        if not energies.total <= ENERGY_FROM_NOWHERE * supplied:
            return f"its energy is {energies.total:.3g}, and {supplied:.3g} was put in"
        if not abs(energies.imbalance - ripple) <= BROKEN_BALANCE * self.peak:
            return f"the energy balance is off by {abs(energies.imbalance):.3g}, the peak energy is {self.peak:.3g}"
        return None


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
    watch: int = 100,
    start: State | None = None,
) -> Iterator[State]:
    """Step ``M u'' = force(u) + load(t)`` from t = 0 (or from ``start``) to ``until``; yield a state per step.

    The first state is the initial one. ``M`` is the lumped mass, ``load(t)`` a vector (N,), ``fixed`` the prescribed
    motions. Every ``watch`` steps the energy balance is checked (0: never); ``limit`` only serves the message.
    ``start`` continues an earlier run with the same bits.

    Raises ``ValueError`` for arguments that make no sense and :class:`UnstableRun` when the balance breaks.

    >>> class Spring:
    ...     def force(self, u): return -u
    ...     def energy(self, u): return 0.5 * float(u @ u)
    >>> for state in central_difference(Spring(), np.ones(1), np.ones(1), dt=0.01, until=np.pi): pass
    >>> state.step, round(float(state.u[0]), 6), round(state.energies.total, 6)
    (315, -0.999965, 0.5)
    """
    m = diagonal_mass(M)
    size = len(m)
    if not (np.isfinite(dt) and dt > 0.0):
        raise ValueError(f"dt = {dt} must be a positive time")
    if not np.isfinite(until):
        raise ValueError(f"until = {until} must be a time")
    check_fixed(fixed, size)
    return _steps(body, m, _initial(u0, size, "u0"), _initial(v0, size, "v0"), dt, until, load, fixed, limit, watch, start)


def _initial(x: Floats | None, size: int, name: str) -> Floats:
    if x is None:
        return np.zeros(size)
    x = np.array(x, dtype=float)
    if x.shape != (size,):
        raise ValueError(f"{name} has shape {x.shape}; the mass matrix has {size} degrees of freedom")
    bad = np.flatnonzero(~np.isfinite(x))
    if len(bad):
        raise ValueError(f"{name}[{bad[0]}] = {x[bad[0]]} is not finite ({len(bad)} of {size} values are not)")
    return x


def _steps(
    body: Body,
    m: Floats,
    u: Floats,
    v: Floats,
    dt: float,
    until: float,
    load: Load | None,
    fixed: Sequence[Prescribed],
    limit: StepLimit | None,
    watch: int,
    start: State | None,
) -> Iterator[State]:
    inverse = 1.0 / m

    def at(step: int) -> float:
        return step * dt

    def accelerate(step: int) -> tuple[Floats, Floats | None]:
        """Acceleration at a step from force and load; prescribed degrees of freedom follow their own motion."""
        b = None if load is None else load(at(step))
        a = body.force(u)
        if b is not None:
            a = a + b
        for one in fixed:
            resist[one.dofs] = -a[one.dofs]
        a = a * inverse
        for one in fixed:
            now = one.mean_velocity(at(step - 1), at(step)) if step else None
            following = one.mean_velocity(at(step), at(step + 1))
            a[one.dofs] = 0.0 if now is None else (following - now) / dt
            resist[one.dofs] += m[one.dofs] * a[one.dofs]
        return a, b

    resist = np.zeros(len(m) if fixed else 0)  # reaction at prescribed degrees of freedom, 0 elsewhere
    if start is None:
        step, work, initial, ripple = 0, 0.0, None, 0.0
        for one in fixed:
            place = one.start(0.0)
            if place is not None:
                u[one.dofs] = place
            v[one.dofs] = one.mean_velocity(0.0, dt)
        a, b = accelerate(0)
    else:
        if start.dt != dt:
            raise ValueError(f"dt = {dt}: the state to start from was made with dt = {start.dt}")
        u, v, step = start.u.copy(), start.v.copy(), start.step
        work, initial, ripple = start.work, start.initial, start.initial_ripple
        a, b = accelerate(step)
    if initial is None:
        initial = 0.5 * float(m @ (v * v)) + (float(body.energy(u)) if hasattr(body, "energy") else 0.0)
        ripple = 0.125 * dt**2 * float(m @ (a * a))
    guard = _Watch(watch, limit, abs(initial))

    def state() -> State:
        views = [x.view() for x in (u, v, a)]
        for x in views:
            x.flags.writeable = False
        return State(at(step), step, dt, *views, work, initial, ripple, body, m)

    if start is None:
        now = state()
        yield now
    du = np.empty_like(u)
    end = until * (1.0 - 1e-12)
    while at(step) < end:
        # k = 0: u1 = u0 + dt v0 + dt^2/2 a0; k >= 1: u_{k+1} = 2 u_k - u_{k-1} + dt^2 a_k
        with np.errstate(over="ignore", invalid="ignore"):  # the watch looks at the numbers
            np.multiply(a, 0.5 * dt, out=du)
            v += du
            np.multiply(v, dt, out=du)
            u += du
            step += 1
            before, pulled = b, resist.copy()
            a, b = accelerate(step)
            if b is not None and before is not None:
                work += 0.5 * float((before + b) @ du)
            if fixed:
                work += 0.5 * float((pulled + resist) @ du)
            v += 0.5 * dt * a
        now = state()
        if watch and (step % watch == 0 or step in _EARLY or at(step) >= end):
            guard.look(now)
        yield now
