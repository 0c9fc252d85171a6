"""Steps just below and just above the limit: stable there, and caught here."""

from __future__ import annotations

import re

import numpy as np

from ..geometry.boxes import unit_box
from ..material.potential import Exponential, Linear, Potential, Rational
from ..model.mass import mass_matrix
from ..solve.central_difference import central_difference
from ..solve.cfl import stable_time_step
from ..solve.instability import BROKEN_BEYOND, UnstableRun
from ..solve.newmark import newmark
from .bodies import ball, body_on, exact_limit, pairs, stretch
from .verdicts import Verdicts

STEPS = 1000
FACTORS = (0.90, 0.99, 0.999, 1.001, 1.01)
_SIZE = {1: (40, 0.1), 2: (12, 0.3), 3: (5, 0.5)}  # elements a side, horizon
_SMALL = 1e-5  # b r S^2: at larger strains a softened body is stable a little above the limit at rest


def around_the_limit(verdicts: Verdicts, quick: bool) -> None:
    """Central difference at five parts of the exact limit, for each rule and mass, mesh and law."""
    for dim in (1, 2) if quick else (1, 2, 3):
        n, horizon = _SIZE[dim]
        for kind in ("regular", "random", "graded"):
            mesh = unit_box(dim, n, kind)
            schemes = {"vertex pairs, lumped": (pairs(), "lumped")}
            if not quick or (dim == 1 and kind == "random"):
                schemes |= {
                    "balls, consistent": (ball(dim), "consistent"),
                    "vertex balls, lumped": (ball(dim, "vertices"), "lumped"),
                }
            for name, (rule, mass) in schemes.items():
                laws: dict[str, Potential] = {"linear": Linear(1.0), "exponential": Exponential(1.0, 1.0)}
                if not quick:
                    laws["rational"] = Rational(1.0, 1.0)
                for label, law in laws.items():
                    body = body_on(mesh, horizon, law, rule)
                    M = mass_matrix(body.basis, kind=mass)
                    limit, exact = stable_time_step(body, M), exact_limit(body, M)
                    u0 = stretch(mesh, horizon, _SMALL, 1.0)
                    where = f"{dim}D, {kind}, {name}, {label}"
                    for factor in FACTORS:
                        dt = factor * exact
                        step, said, worst = 0, "", 0.0
                        run = central_difference(body, M, u0, dt=dt, until=STEPS * dt, limit=limit)
                        try:
                            for state in run:
                                step = state.step
                                if step % 100 == 0:
                                    off = state.energies.imbalance - state.ripple + state.initial_ripple
                                    worst = max(worst, abs(off) / state.energies.total)
                        except UnstableRun as error:
                            said = str(error)
                        if factor < 1.0:
                            must = f"{STEPS} steps, energy balance"
                            verdicts.add(
                                "limit", f"{where}, {factor}", must, worst if not said else np.inf, BROKEN_BEYOND
                            )
                        else:
                            match = re.search(r"by step (\d+) .*times the stable limit", said)
                            at = int(match.group(1)) if match else np.inf
                            must = "stopped by step, message with step and limit"
                            verdicts.add("limit", f"{where}, {factor}", must, at, STEPS)
            if dim == 1 or not quick:
                body = body_on(mesh, horizon, Linear(1.0))
                M = mass_matrix(body.basis)
                dt = 1000.0 * exact_limit(body, M)
                u0 = np.random.default_rng(0).standard_normal(body.basis.N)
                totals = [s.energies.total for s in newmark(body, M, u0, dt=dt, until=50 * dt, watch=0)]
                off = float(np.abs(np.array(totals) / totals[0] - 1.0).max())
                verdicts.add(
                    "limit", f"{dim}D, {kind}, Newmark, 1000", "50 steps, energy of the linear model", off, 1e-10
                )
