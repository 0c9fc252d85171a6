"""Impulses, pulses, reversals and unloading: the energy balance at the default step, and how it falls with dt."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise

import numpy as np

from .._types import Floats
from ..analysis.damage import census
from ..geometry.boxes import unit_box
from ..material.potential import Exponential
from ..model.mass import mass_matrix
from ..solve.central_difference import central_difference
from ..solve.cfl import SAFETY, stable_time_step
from ..solve.newmark import newmark
from .bodies import body_on, stretch
from .verdicts import Verdicts

_ALLOWED = 5e-3  # of the peak energy


def _pulse(t: float) -> float:
    return float(0.25 < t < 0.5)


def _reversed(t: float) -> float:
    return 1.0 if t < 0.4 else -1.0


def _impulse(t: float) -> float:
    """A blow of a sixteenth of the run."""
    return float(np.sin(16.0 * np.pi * t) ** 2) if t < 1.0 / 16.0 else 0.0


LOADS: dict[str, Callable[[float], float]] = {
    "impulse": _impulse,
    "square pulse": _pulse,
    "load reversed": _reversed,
    "unloading of softened bonds": lambda t: float(np.sin(2.0 * np.pi * t)),
}


def bodies(quick: bool) -> Iterator[tuple[str, int, int, float, float]]:
    """Yield loads with dimension, elements a side, horizon and strength.

    Bodies are so fine that the slowest wave, which a sudden load excites, takes forty steps or more.
    """
    for dim, n, horizon in ((1, 80, 0.05),) if quick else ((1, 80, 0.05), (2, 48, 0.08)):
        for name in ("impulse", "square pulse", "load reversed"):
            yield name, dim, n, horizon, 0.01
    yield "unloading of softened bonds", 2, 24, 0.15, 0.2  # more would tear the square


def energy_balance(verdicts: Verdicts, quick: bool) -> None:
    """Kinetic plus elastic energy minus work, at most, over the peak energy; halved steps show the order."""
    for name, dim, n, horizon, strength in bodies(quick):
        mesh = unit_box(dim, n)
        body = body_on(mesh, horizon, Exponential(1.0, 1e-2))
        M = mass_matrix(body.basis)
        limit = stable_time_step(body, M)
        until = 400.0 * limit.dt
        shape = np.zeros(mesh.p.T.shape)
        shape[:, 0] = strength * np.cos(np.pi * mesh.p[0])
        load = partial(_pull, LOADS[name], until, M.diagonal() * shape.ravel())
        parts, off, largest = (1, 2, 4), [], 0.0
        for part in parts:
            peak = worst = 0.0
            dt = limit.step_for(until) / part
            for state in central_difference(body, M, dt=dt, until=until, load=load, limit=limit):
                peak, worst = max(peak, state.energies.total), max(worst, abs(state.energies.imbalance))
                if part == 1 and state.step % 10 == 0:
                    largest = max(largest, census(body, state.u).Z)
            off.append(worst / peak)
        where = f"{dim}D, {name}"
        verdicts.add("loads", where, f"energy balance at {SAFETY:g} of the limit", off[0], _ALLOWED)
        verdicts.add("loads", where, "order in dt", float(np.log2(off[1] / off[2])), 2.3, 1.8)
        if "softened" in name:
            verdicts.add("loads", where, "largest strain over the critical one", largest, low=1.0)
        dts = [SAFETY / part for part in parts]
        verdicts.draw("energy balance", where, dts, off, ("dt / limit", "energy error / peak"), (True, True))


def _pull(course: Callable[[float], float], until: float, b: Floats, t: float) -> Floats:
    return course(t / until) * b


def both_ways(verdicts: Verdicts, quick: bool) -> None:
    """Explicit and implicit steps come to the same motion, each with its order."""
    for dim, n, horizon in ((1, 40, 0.1),) if quick else ((1, 40, 0.1), (2, 12, 0.25)):
        mesh = unit_box(dim, n, "random")
        law = Exponential(1.0, 0.1)
        body = body_on(mesh, horizon, law)
        M = mass_matrix(body.basis)
        u0, limit = stretch(mesh, horizon, 0.05, law.b), stable_time_step(body, M).dt
        ends: dict[str, Floats] = {}
        for name, scheme in (("explicit", central_difference), ("implicit", newmark)):
            runs: list[Floats] = []
            for parts in (4, 8, 16, 32):
                *_, state = scheme(body, M, u0, dt=limit / parts, until=16.0 * limit)
                runs.append(state.u.copy())
            changes = [float(np.abs(a - b).max()) for a, b in pairwise(runs)]
            order = float(np.log2(changes[-2] / changes[-1]))
            verdicts.add("both ways", f"{dim}D, {name}", "order in dt", order, 2.2, 1.8)
            ends[name] = runs[-1] + (runs[-1] - runs[-2]) / 3.0  # if changes go on to fall by four
            axes = ("dt / limit", "change of u when dt is halved")
            verdicts.draw("orders", f"{dim}D, {name}", [0.25, 0.125, 0.0625], changes, axes, (True, True))
        gap = float(np.abs(ends["explicit"] - ends["implicit"]).max() / np.abs(u0).max())
        verdicts.add("both ways", f"{dim}D", "difference as dt -> 0", gap, 5e-6)  # 1.4e-6 seen
