"""What the summary of a run says before the first step: what it is made of."""

from __future__ import annotations

import dataclasses
from typing import Any

from ..._version import __version__
from ...engine.threads import usable_cores
from ..problem.problem import Problem


def first_facts(problem: Problem, dt: float, steps: int, blocks: int) -> dict[str, Any]:
    """Return sizes, names of rule, scheme and kernels, the step and its limits, the constants of the material."""
    limit = problem.limit if problem.explicit else None
    return {
        "title": problem.scene.title,
        "version": __version__,
        "status": "running",
        "rule": problem.bonds.rule.name,
        "scheme": problem.scheme,
        "nodes": int(problem.mesh.nvertices),
        "bonds": int(problem.bonds.nbonds),
        **_balance(problem),
        "blocks": blocks,
        "kernels": "compiled" if problem.body.compiles else "sparse products",
        "cores": usable_cores(),
        "dt": dt,
        **({"dt_limit": limit.steps()} if limit is not None else {}),
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
    one = first.elastic(body.laws[0], body.bonds.dim, *body.moments)
    speeds = {name: getattr(one, name) for name in ("pressure_speed", "shear_speed", "rayleigh_speed")}
    return dataclasses.asdict(one) | speeds
