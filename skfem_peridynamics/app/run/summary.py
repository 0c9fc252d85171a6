"""What the summary of a run says: of what it is made, what it cost, and what came out."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..._clock import Clock
from ..._memory import peak_memory_mb
from ..._threads import usable_cores
from ..._version import __version__
from ...analysis.crack import WINDOW, speeds
from ..files.history import History, step_limits
from ..problem.problem import Problem
from .record import COLUMNS, Record


def summary_before(problem: Problem, dt: float, steps: int, blocks: int) -> dict[str, Any]:
    """Return sizes, names of rule, scheme and kernels, the step and its limits, the constants of the material."""
    limit = problem.limit if problem.explicit else None
    return {
        "title": problem.scene.title,
        "version": __version__,
        "status": "running",
        "rule": problem.rule_name,
        "scheme": problem.scheme_name,
        "nodes": int(problem.mesh.nvertices),
        "bonds": int(problem.bonds.nbonds),
        **_balance(problem),
        "blocks": blocks,
        "kernels": "compiled" if problem.body.compiles else "sparse products",
        "cores": usable_cores(),
        "step": dt,
        **({"step_limits": step_limits(limit)} if limit is not None else {}),
        "steps": steps,
        "elastic": _elastic(problem),
    }


def _balance(problem: Problem) -> dict[str, Any]:
    """What the summary says of balanced weights; nothing where there are none."""
    balance = problem.bonds.balance
    if balance is None:
        return {}
    return {"unbalanced_vertices": len(balance.unbalanced), "smallest_weight_ratio": balance.smallest}


def _elastic(problem: Problem) -> dict[str, Any]:
    """The constants that the (first) material has with these bonds, with its wave speeds."""
    body, first = problem.body, problem.materials[0]
    elastic = first.elastic(body.laws[0], body.bonds.dim, *body.moments)
    speeds = {name: getattr(elastic, name) for name in ("pressure_speed", "shear_speed", "rayleigh_speed")}
    return dataclasses.asdict(elastic) | speeds


def summary_after(record: Record, clock: Clock, resumed: Sequence[int]) -> dict[str, Any]:
    """Return what a run has done and cost up to its last state; nothing where it was not stepped."""
    state, problem = record.state, record.problem
    if state is None:
        return {}
    implicit = {}
    if not problem.explicit:
        effort = problem.effort
        implicit = {"newton_iterations": effort.iterations, "hessian_products": effort.products}
    return {
        "steps": state.step,
        **figures(problem, record.history),
        **implicit,
        "seconds": {name: round(value, 6) for name, value in clock.seconds.items()},
        "seconds_per_step": clock.seconds["steps"] / max(1, state.step),
        "peak_memory_mb": round(peak_memory_mb(), 1),
        **({"stiffness_products_for_cfl": problem.limit.products} if problem.explicit else {}),
        "resumed_at_steps": list(resumed),
        "checkpoints": record.checkpoints,
    }


def figures(problem: Problem, history: History) -> dict[str, Any]:
    """Return the figures that the rows of a history come to: drift, softened bonds, what was measured."""
    total, imbalance = history.column("total"), history.column("imbalance")
    peak = max(float(np.max(total, initial=0.0)), np.finfo(float).tiny)
    out = {}
    if problem.scene.time.scheme == "static":  # what cracks that ran away have lost
        out["energy_lost"] = -float(np.min(imbalance, initial=0.0)) / peak
        imbalance = np.maximum(imbalance, 0.0)
    rows = history.rows
    return out | {
        "energy_drift": float(np.max(np.abs(imbalance), initial=0.0)) / peak,
        "softened_bonds": int(rows[-1][8]) if rows else 0,
        "largest_Z": max((row[9] for row in rows), default=0.0),
        **_measured(history),
    }


def _measured(history: History) -> dict[str, Any]:
    """The last value of what was measured, and what follows from the crack's."""
    if not history.rows:
        return {}
    out: dict[str, Any] = dict(zip(history.columns[len(COLUMNS) :], history.rows[-1][len(COLUMNS) :], strict=True))
    if "crack_reach" in out:
        out["largest_tip_speed"] = float(speeds(history.column("t"), history.column("crack_reach"), WINDOW).max())
        energy = history.rows[-1][4] + out.get("dissipated", 0.0)
        for size in ("area", "length"):
            if f"crack_{size}" in out:
                out[f"energy_per_crack_{size}"] = (energy / out[f"crack_{size}"]) if out[f"crack_{size}"] else None
    return out
