"""Tell a run that has become unstable from one that merely ripples, where it is, and what is likely to be the cause."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..geometry.simplices import describe_point
from ..model.led_body import LedBody
from .cfl import StepLimit
from .energy import Energies
from .mass_solver import Lumped
from .state import State
from .tangent_limit import TangentLimit

# The alarms. Of the peak energy, what the balance of a run may be off beyond the ripple of its fast modes: round-off in
# a linear run, at most 0.0013 (ripple included) in the branching plate.
# And how many times the energy put in may be found: at 0.995 of the limit a ripple can reach 100 times.
BROKEN_BALANCE = 0.1
# The same where dt is beyond the limit of the linear model for certain. Forces are bounded: an instability stops
# growing where bonds soften so much that the step is stable again, and that can be soon. On small strains the balance
# of stable runs is better than 1e-4, of runs at 1.001 of the limit worse than 1.3e-3 (docs/evidence/stability.md).
BROKEN_BEYOND = 1e-3
ENERGY_FROM_NOWHERE = 100.0
_ROUNDED = 1e-12  # of the ripple: what sums in another order may differ by
_HALF = 0.5  # of the limit: fast impacts were reported to run at 0.45 of it
_EARLY = (10, 30)  # a step far beyond the limit shows itself at once


class UnstableRun(RuntimeError):
    """The energy balance broke: the step is too large, or the load is not what was meant.

    ``state`` is a copy of the last state whose balance was seen to hold, at first the initial one; ``step`` is
    where the alarm was given, ``vertex`` where the acceleration was largest, or the first that is not finite.

    Examples
    --------
    >>> try:
    ...     raise UnstableRun("too long a step", step=30)
    ... except UnstableRun as error:
    ...     error.step
    30
    """

    def __init__(self, message: str, state: State | None = None, step: int = 0, vertex: int | None = None) -> None:
        super().__init__(message)
        self.state, self.step, self.vertex = state, step, vertex


@dataclass
class Watch:
    """Check the energy balance now and then, and stop the run when it is broken.

    ``every`` so many steps (0: never); :meth:`check` does it at once. ``good`` is a copy of the last state that held.
    """

    every: int
    limit: StepLimit | None
    peak: float = 0.0
    damps: bool = False  # energy may be lost, as by Newmark's method with gamma > 1/2
    good: State | None = None

    def check(self, state: State, energies: Energies | None = None) -> None:
        """Check the balance of a state, and keep a copy. Raises :class:`UnstableRun`.

        ``energies`` are those of the state, where they are known.
        """
        complaint = self._complaint(state, energies)
        if complaint is None:
            self.good = state.copy()
            return
        known = ""
        if self.limit is not None:
            known = f", which is {state.dt / self.limit.dt:.4g} times the stable limit {self.limit.dt:.6g}"
        vertex, place = _place(state)
        raise UnstableRun(
            f"the run became unstable by step {state.step} (t = {state.t:.6g}){place}: {complaint}; "
            f"dt = {state.dt:.6g}{known}. {self._cause(state)}",
            self.good,
            state.step,
            vertex,
        )

    def _cause(self, state: State) -> str:
        """What is likely to be the cause, and what to do."""
        body = state._body
        if not getattr(body, "symmetric", True):
            return "Its rule is one-sided: such a force can feed a motion at any dt; take a symmetric rule"
        if self.limit is None:
            return "Take a smaller dt, or let loads and motions grow over several steps"
        if state.dt > self.limit.dt:
            return "Take a smaller dt: the step is above the limit"
        if hasattr(body, "tangent_operator") and not isinstance(body, LedBody):
            now = self._stiffest_limit(state)
            if state.dt > 1.05 * now:  # that limit is 2 % on the safe side, and more
                return f"Take a smaller dt: the material has stiffened, the limit is {now:.6g} by now"
        if self.limit is not None and state.dt > _HALF * self.limit.dt:
            return (
                f"The step is below the limit of small motions, and fast ones may need a smaller one: take half of it, "
                f"{_HALF * self.limit.dt:.3g}, first; if that does not do, let loads and motions grow over several "
                "steps, or look at their units"
            )
        return (
            "The step is below the limit: let loads and motions grow over several steps, or look at their units, "
            "for a load far beyond what the body carries throws parts of it about"
        )

    def _stiffest_limit(self, state: State) -> float:
        """The limit of the tangent, at the last good state or where the run is now: the smaller one."""
        mass = state._mass
        tangent = TangentLimit(state._body, mass.m if isinstance(mass, Lumped) else mass.M)
        displacements = [known.u for known in (self.good, state) if known is not None and np.isfinite(known.u).all()]
        with np.errstate(all="ignore"), contextlib.suppress(ValueError):  # numbers too large for an eigenvalue
            return min((tangent.at(u) for u in displacements), default=np.inf)
        return float(np.inf)

    def _complaint(self, state: State, energies: Energies | None) -> str | None:
        if not hasattr(state._body, "energy"):
            return None if np.isfinite(state.v).all() else "the velocities are no longer finite"
        with np.errstate(over="ignore", invalid="ignore"):
            energies = state.energies if energies is None else energies
            ripple = state.ripple - state.initial_ripple
        supplied = abs(energies.initial) + abs(energies.work)
        self.peak = max(self.peak, supplied, energies.total)
        if not np.isfinite(energies.total) or (
            state.step >= _EARLY[0] and energies.total > ENERGY_FROM_NOWHERE * supplied
        ):  # in the very first steps of a growing load the work lags behind
            return f"its energy is {energies.total:.3g}, and {supplied:.3g} was put in"
        if not getattr(state._body, "symmetric", True):
            return None  # the force of a one-sided rule is the gradient of no energy: there is no balance to break
        off = energies.imbalance - ripple
        if self.limit is not None and not self.damps and self.limit.exceeded(state.dt):
            allowed = BROKEN_BEYOND
        else:
            allowed = BROKEN_BALANCE
        # where nothing has moved yet all but the ripples is 0, and these are sums, not always taken in the same order
        if not (off if self.damps else abs(off)) <= allowed * self.peak + _ROUNDED * abs(state.ripple):
            return f"the energy balance is off by {abs(energies.imbalance):.3g}, the peak energy is {self.peak:.3g}"
        return None

    def due(self, step: int, last: bool) -> bool:
        """Return whether it is time for a check."""
        return self.every > 0 and (step % self.every == 0 or step in _EARLY or last)


def watching(watch: int | Watch, limit: StepLimit | None, peak: float, damps: bool = False) -> Watch:
    """Return the watch of a run: every so many steps, or the caller's own, which learns of the limit and the peak."""
    if not isinstance(watch, Watch):
        return Watch(watch, limit, peak, damps)
    watch.limit, watch.peak, watch.damps = limit, max(watch.peak, peak), damps
    return watch


def _place(state: State) -> tuple[int | None, str]:
    """The vertex where a state is worst, and words for it: the first that is not finite, or the most accelerated."""
    wrong = ~(np.isfinite(state.u) & np.isfinite(state.v) & np.isfinite(state.a))
    at = int(np.argmax(wrong)) if wrong.any() else int(np.argmax(np.abs(state.a)))
    over_ranks = getattr(state._body, "worst", None)
    if over_ranks is not None:
        vertex, point = over_ranks(np.where(wrong, np.inf, np.abs(state.a)))
        return vertex, f" at vertex {vertex}, {describe_point(point)}"
    basis: Any = getattr(state._body, "basis", None)
    if basis is None:
        return None, f" at degree of freedom {at}"
    vertex = at // basis.mesh.dim()
    return vertex, f" at vertex {vertex}, {describe_point(basis.mesh.p[:, vertex])}"
