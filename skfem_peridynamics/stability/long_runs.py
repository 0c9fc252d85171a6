"""A million steps of the linear model, a hundred thousand near softening."""

from __future__ import annotations

import numpy as np

from .._types import Floats
from ..bonds.ball_rule import BallRule
from ..geometry.boxes import unit_box
from ..material.potential import Exponential, Linear
from ..model.mass import mass_matrix
from ..solve.central_difference import central_difference
from .bodies import ball, body_on, exact_limit, stretch
from .verdicts import Verdicts

_AXES = ("steps", "energy error")
_SOFTENING = 0.02  # b r S^2 of the bar near softening, where its standing wave stays smooth


def slope_and_noise(t: Floats, y: Floats) -> tuple[float, float]:
    """Return what a line through y rises over all of t, and the standard error of that.

    Neighbours are alike, so the error is that of the means of twenty runs of values, taken as independent.

    >>> t = np.linspace(0, 1, 1000)
    >>> rise, noise = slope_and_noise(t, 3 * t + np.cos(40 * t))
    >>> round(rise, 2), round(noise, 2)
    (3.1, 0.48)
    """
    groups = np.array_split(np.arange(len(t)), 20)
    x, m = (np.array([values[group].mean() for group in groups]) for values in (t, y))
    x = (x - x.mean()) / (t[-1] - t[0])
    rise = float(x @ m / (x @ x))
    rest = m - m.mean() - rise * x
    return rise, float(np.sqrt((rest @ rest) / (len(m) - 2) / (x @ x)))


def a_million_linear_steps(verdicts: Verdicts, quick: bool) -> None:
    """Energy error bounded and without a trend, momentum exact.

    A body that drifts has displacements as large as it has drifted far, and strains have the round-off of these; so the
    energy is followed in one that stays, and the momentum in one that drifts as well.
    """
    steps, every = (20_000, 20) if quick else (1_000_000, 500)
    mesh = unit_box(1, 20, "random")
    body = body_on(mesh, 0.2, Linear(1.0))
    M = mass_matrix(body.basis)
    m = M.diagonal()
    u0, v0 = np.random.default_rng(0).standard_normal((2, body.basis.N)) * 1e-3
    dt = 0.95 * exact_limit(body, M)
    for drifts in (False, True):
        count = steps // 10 if drifts else steps
        v = v0 if drifts else v0 - m @ v0 / m.sum()
        t, error, momentum = [], [], []
        start = 0.0
        for state in central_difference(body, M, u0, v, dt=dt, until=count * dt, watch=0):
            if state.step % every == 0:
                energies = state.energies
                start = start or energies.total
                t.append(state.t)
                error.append((energies.imbalance - state.ripple + state.initial_ripple) / start)
                momentum.append(float(m @ state.v))
        where = f"{count:,} steps, 1D, random, {'drifting' if drifts else 'at rest as a whole'}"
        off = np.abs(np.array(momentum) - momentum[0]).max() / float(m @ np.abs(v))
        verdicts.add("long linear", where, "change of momentum", float(off), 1e-12)
        if drifts:
            continue
        verdicts.add("long linear", where, "energy error, all modes", float(np.abs(error).max()), 1e-12)
        rise, noise = slope_and_noise(np.array(t), np.array(error))
        # round-off walks at random: over n steps some eps sqrt(n)
        walk = float(np.finfo(float).eps * np.sqrt(count))
        verdicts.add("long linear", where, "trend over its noise", abs(rise) / (3.0 * noise + walk), 1.0)
        verdicts.draw("long runs", "linear, pairs", np.array(t) / dt, np.abs(error), _AXES, (False, True))


def near_softening(verdicts: Verdicts, quick: bool) -> None:
    """Nonlinear motion at the default part of the limit, with a symmetric rule and a one-sided one."""
    steps, every = (4_000, 10) if quick else (100_000, 100)
    law = Exponential(1.0, 1.0)
    for name, symmetric in (("balls", True), ("one-sided balls", False)):
        mesh = unit_box(1, 40, "random")
        body = body_on(mesh, 0.15, law, ball(1, "vertices", symmetric))
        M = mass_matrix(body.basis)
        u0 = stretch(mesh, 0.15, _SOFTENING, law.b)
        dt = 0.9 * exact_limit(body, M)
        t, energy = [], []
        for state in central_difference(body, M, u0, dt=dt, until=steps * dt, watch=0):
            if state.step % every == 0:
                with np.errstate(over="ignore", invalid="ignore"):
                    t.append(state.t)
                    energy.append(state.energies.total - state.ripple)
        relative = np.array(energy) / energy[0]
        rise, noise = slope_and_noise(np.array(t), relative)
        where = f"{steps:,} steps, 1D, {name}"
        if symmetric:
            verdicts.add("long nonlinear", where, "rise of the energy over the run", rise - 3.0 * noise, 0.02)
            verdicts.add(
                "long nonlinear", where, "largest error of the energy", float(np.abs(relative - 1.0).max()), 0.1
            )
        else:
            default = 1.0 if BallRule().symmetric else 0.0
            verdicts.add(
                "long nonlinear", where, "not the default", default, 1.0, 1.0, growth(np.array(t) / dt, relative)
            )
        verdicts.draw("long runs", f"nonlinear, {name}", np.array(t) / dt, np.abs(relative - 1.0), _AXES, (False, True))


def growth(step: Floats, energy: Floats) -> str:
    """Say how fast an energy, 1 at first, grows while it grows evenly: between an excess of 0.01 and of 10.

    >>> growth(np.arange(2000.0), 1.0 + 1e-3 * np.exp(np.arange(2000.0) / 150.0))
    'its energy grows, e-fold every 150 steps, to 614.34 times what it was'
    """
    excess = np.maximum.accumulate(energy - 1.0)
    even = (excess > 1e-2) & (excess < 10.0)
    if even.sum() < 3:
        return f"its energy does not grow: at most by {excess.max():.2g} of itself"
    fold = 1.0 / np.polyfit(step[even], np.log(excess[even]), 1)[0]
    return f"its energy grows, e-fold every {fold:.0f} steps, to {energy.max():.5g} times what it was"
