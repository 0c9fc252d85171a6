"""Tell the size of a scene before it runs."""

from __future__ import annotations

from math import ceil, inf, isfinite

from ..._compile import installed
from ..._memory import free_memory
from ...material.influence import as_influence
from ..problem.cost import PER_IMPLICIT_STEP, PRODUCTS, worth_compiling
from ..problem.measures import measures
from ..problem.problem import Problem
from ..problem.states import march, notes
from ..scene.reading import blame
from ..scene.scene import Scene

# seconds a vertex and a bond of a set-up, a bond while weights are balanced, a vertex of a frame; bytes of that
_VERTEX, _BOND, _BALANCED, _IN_FRAME = 3e-6, 1.2e-7, 6e-5, 6e-6
_FRAME_BYTES = {1: 30, 2: 42, 3: 60}
# so many bonds are made in a second or two; a scene with more is told from estimates
_TRIED = 3_000_000
_SPARSE, _COMPILED = (
    22e-9,
    6e-9,
)  # seconds a bond and step, two cores, history and frames included (docs/performance.md)


def check(scene: Scene) -> list[tuple[str, str]]:
    """Check all that a scene says and return its dimension, nodes, bonds, memory and steps, as rows of a table.

    Small scenes are built to their step limit, so what is sound here runs. Raises :class:`SceneError`.
    """
    problem = Problem(scene)
    dim, time = problem.mesh.dim(), scene.time
    for part in ("load", "fixed", "u0", "v0"):
        getattr(problem, part)
    measures(problem)
    for k, table in enumerate(scene.no_fail):
        problem.vertices(table, f"no_fail[{k}]")
    influence = as_influence(scene.bonds.influence)
    with blame("material"):
        slope = max(one.law(dim, influence.moment(dim)).slope for one in problem.materials)
    expected, need = problem.expected_bonds, problem.expected_bytes
    rows = [("dimension, nodes", f"{dim}, {problem.mesh.nvertices}")]
    # the exact integrals allow at least this step, wherever they bound it
    lam = 8.0 * slope * influence.mean_inverse_power(1.0, dim) / (problem.lightest * dim * scene.bonds.horizon**2)
    problem.check_memory()
    steps: float
    if expected <= _TRIED:
        rows.append(("bonds", f"{problem.bonds.nbonds}"))
        with blame("material"):
            _ = problem.resting.laws
        steps = round(time.until / problem.dt)
        if problem.explicit:
            of_limit = problem.dt / problem.limit.dt
            rows.append(("steps", f"{steps} of {problem.dt:.4g}, {of_limit:.3g} of the stable limit"))
        else:
            rows.append(("steps", f"{steps} of {problem.dt:.4g}, {problem.scheme}"))
            march(problem, problem.dt)
        rows += [("note", note) for note in notes(problem)]
    else:
        rows.append(("bonds", f"about {expected}"))
        if time.step is not None or time.steps is not None:
            steps = ceil(time.until / problem.dt - 1e-9)
            rows.append(("steps", f"{steps} of {problem.dt:.4g}"))
        elif isfinite(lam):
            steps = ceil(time.until * lam**0.5 / 2 / time.part)
            rows.append(("steps", f"at most about {steps}"))
        else:
            steps = inf
            rows.append(("steps", "not known before the bonds are made: in 1D the exact integrals have no bound"))
    rows.append(("memory", f"about {need / 1e6:.0f} MB of {free_memory() / 1e6:.0f} MB free"))
    return [*rows, ("time", _seconds(problem, expected, steps)), ("output", _output(problem))]


def _seconds(problem: Problem, nbonds: int, steps: float) -> str:
    """Say how long it takes on two cores, from costs a bond, a vertex and a frame."""
    nodes = int(problem.mesh.nvertices)
    forces = steps if problem.explicit else steps * PER_IMPLICIT_STEP
    fast = installed() and worth_compiling(nbonds, forces)
    parts = {"set-up": nodes * _VERTEX + nbonds * (_BOND + (_BALANCED if problem.form.balanced else 0.0))}
    if problem.explicit:
        limit_fast = installed() and worth_compiling(nbonds, PRODUCTS)
        parts["step limit"] = PRODUCTS * nbonds * (_COMPILED if limit_fast else _SPARSE)
    parts["steps"] = forces * nbonds * (_COMPILED if fast else _SPARSE)
    parts["output"] = problem.scene.output.frames * nodes * _IN_FRAME
    listed = ", ".join(f"{name} {value:.2g} s" for name, value in parts.items() if isfinite(value))
    return (f"about {sum(parts.values()):.2g} s: " if isfinite(steps) else "") + listed


def _output(problem: Problem) -> str:
    output = problem.scene.output
    size = int(problem.mesh.nvertices) * _FRAME_BYTES[problem.mesh.dim()] / 1e6
    said = f"{output.frames} frames of about {size:.2g} MB, {output.history} rows, "
    every = output.every
    if every.steps:
        return f"{said}a checkpoint every {every.steps} steps"
    return said + (f"a checkpoint every {every.seconds:g} s" if every.seconds else "no checkpoints")
