"""The run that a scene describes: states of its scheme, and what looks like a slip before it starts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...geometry.simplices import vertex_sizes
from ...material.elastic import SAME
from ...material.elastic import state as plane_state
from ...solve.central_difference import central_difference
from ...solve.instability import Watch
from ...solve.newmark import newmark
from ...solve.static import static
from ..scene.reading import blame
from .problem import Problem

_NEAR = 0.02  # Poisson ratios so near to that of bonds alone are told apart by few tables
_FEW = 1.5  # vertices per horizon: with fewer a lattice has bonds along its edges alone


def states(problem: Problem, dt: float, start: Any = None, watch: int | Watch = 100) -> Iterator[Any]:
    """Return the run: states of the scheme that the scene names, with steps of dt, from the beginning or ``start``."""
    time = problem.scene.time
    given: dict[str, Any] = {"load": problem.load, "fixed": problem.fixed, "start": start}
    if not problem.explicit:
        given["effort"] = problem.effort
    if time.scheme == "static":
        with blame("time"):
            if problem.v0 is not None:
                raise ValueError('scheme = "static" has no initial velocity')
            return static(problem.body, problem.u0, until=time.until, steps=round(time.until / dt), **given)
    if time.scheme == "newmark":
        beta, gamma = 0.25 if time.beta is None else time.beta, 0.5 if time.gamma is None else time.gamma
        with blame("time"):
            return newmark(
                *(problem.body, problem.mass, problem.u0, problem.v0),
                dt=dt,
                until=time.until,
                beta=beta,
                gamma=gamma,
                watch=watch,
                **given,
            )
    return central_difference(
        *(problem.body, problem.mass, problem.u0, problem.v0),
        dt=dt,
        until=time.until,
        limit=problem.limit,
        watch=watch,
        **given,
    )


def remarks(problem: Problem) -> list[str]:
    """What is allowed and yet looks like a slip of units, in sentences."""
    time, out = problem.scene.time, []
    steps = round(time.until / problem.dt)
    if problem.explicit:
        out = _on_the_limit(problem, steps)
    if steps > 1_000_000:
        out.append(f"the run takes {steps:.3g} steps; are the units of time.until = {time.until:g} what you mean?")
    spanned = problem.scene.bonds.horizon / float(np.median(vertex_sizes(problem.mesh)))
    if spanned < _FEW:
        out.append(
            f"bonds.horizon = {problem.scene.bonds.horizon:g} spans {spanned:.2g} vertices: bonds reach hardly more "
            "than the nearest neighbours, and waves and cracks follow the mesh; take 3 vertices per horizon, or 4"
        )
    for material in problem.materials:
        nu = plane_state(int(problem.mesh.dim()), material.plane)[1]
        if problem.dilated >= 0.0 and nu is not None and SAME < abs((material.poisson or nu) - nu) < _NEAR:
            out.append(
                f"poisson = {material.poisson:g} is near {nu:.4g}, which bonds alone have: there nothing is added to "
                "them, and a force takes half the time"
            )
    at = problem.scene.material.breaking
    if at is not None:
        law = next(law for law in problem.body_at_rest.laws if np.isfinite(law.inflection))
        part = float(law.energy(np.array([at * law.inflection]))[0]) / law.limit
        out.append(
            f"bonds break for good at {at:g} times the critical strain, with {part:.0%} of the energy that it takes to "
            "open them under the law: cracks cost so much of the toughness"
        )
    return out


def _on_the_limit(problem: Problem, steps: int) -> list[str]:
    time, limit, out = problem.scene.time, problem.limit, []
    if problem.dt > limit.dt:
        out.append(f"the step of {problem.dt:.4g} is {problem.dt / limit.dt:.3g} times the stable limit {limit.dt:.4g}")
    if steps <= 5:
        out.append(
            f"the run ends after {steps} steps: time.until = {time.until:g} is {time.until / limit.dt:.3g} times "
            "the stable limit; are the units of time, stiffness and density those of one system?"
        )
    return out
