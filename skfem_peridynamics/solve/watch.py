"""Tell a run that has become unstable from one that merely ripples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .cfl import StepLimit
from .state import State

# The alarms. Of the peak energy, what the balance of a run may be off beyond the ripple of its fast modes: round-off in
# a linear run, at most 0.0013 (ripple included) in the branching plate.
# And how many times the energy put in may be found: at 0.995 of the limit a ripple can reach 100 times.
BROKEN_BALANCE = 0.1
# The same where dt is beyond the limit of the linear model for certain. Forces are bounded: an instability stops
# growing where bonds soften so much that the step is stable again, and that can be soon. On small strains the balance
# of stable runs is better than 1e-4, of runs at 1.001 of the limit worse than 1.3e-3 (docs/stability.md).
BROKEN_BEYOND = 1e-3
ENERGY_FROM_NOWHERE = 100.0
_EARLY = (10, 30)  # a step far beyond the limit shows itself at once


class UnstableRun(RuntimeError):
    """The energy balance broke: the step is too large, or the load is not what was meant."""


@dataclass
class Watch:
    """Look at the energy balance now and then, and stop the run when it is broken."""

    every: int
    limit: StepLimit | None
    peak: float = 0.0
    damps: bool = False  # energy may be lost, as by Newmark's method with gamma > 1/2

    def look(self, state: State) -> None:
        what = self._complaint(state)
        if what is not None:
            known = ""
            if self.limit is not None:
                known = f", which is {state.dt / self.limit.dt:.4g} times the stable limit {self.limit.dt:.6g}"
            advice = "Take a smaller dt, or let loads and motions grow over several steps"
            if not getattr(state._body, "symmetric", True):
                advice = "Its rule is one-sided: such a force can feed a motion at any dt; take a symmetric rule"
            raise UnstableRun(
                f"the run became unstable by step {state.step} (t = {state.t:.6g}): {what}; "
                f"dt = {state.dt:.6g}{known}. {advice}"
            )

    def _complaint(self, state: State) -> str | None:
        if not hasattr(state._body, "energy"):
            return None if np.isfinite(state.v).all() else "the velocities are no longer finite"
        with np.errstate(over="ignore", invalid="ignore"):
            energies, ripple = state.energies, state.ripple - state.initial_ripple
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
        if not (off if self.damps else abs(off)) <= allowed * self.peak:
            return f"the energy balance is off by {abs(energies.imbalance):.3g}, the peak energy is {self.peak:.3g}"
        return None

    def due(self, step: int, last: bool) -> bool:
        """Return whether it is time to look."""
        return self.every > 0 and (step % self.every == 0 or step in _EARLY or last)
