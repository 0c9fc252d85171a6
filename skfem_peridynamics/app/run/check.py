"""Tell the size of a scene before it runs."""

from __future__ import annotations

from math import ceil, inf, isfinite

from ..._memory import free_memory
from ...solve.cfl import exact_eigenvalue_bound
from ..problem.cost import at_vertices, seconds_of_run
from ..problem.measures import measures
from ..problem.problem import Problem
from ..problem.states import remarks, states
from ..report import figure
from ..scene.reading import Mistakes, blame
from ..scene.scene import Scene

_FRAME_BYTES = {1: 30, 2: 42, 3: 68}  # a vertex, compressed
_FIELD_BYTES = 8  # a component of what a frame has besides
_TRIED = 3_000_000  # so many bonds are made in a second or two; a scene with more is told from estimates


def check(scene: Scene) -> list[tuple[str, str]]:
    """Check all that a scene says and return its dimension, nodes, bonds, memory and steps, as rows of a table.

    Small scenes are built to their step limit, so what is sound here runs. Raises :class:`SceneError`.
    """
    problem = Problem(scene)
    _ = problem.mesh  # what is wrong with it is told once
    mistakes = Mistakes()
    for part in ("load", "fixed", "u0", "v0"):
        with mistakes.noted():
            getattr(problem, part)
    for k, table in enumerate(scene.no_fail):
        with mistakes.noted():
            problem.vertices(table, f"no_fail[{k}]")
    mistakes.tell()
    measures(problem)
    rows = [("dimension, nodes", f"{problem.mesh.dim()}, {problem.mesh.nvertices}")]
    _ = problem.largest_slope
    expected, need = problem.expected_bonds, problem.expected_bytes
    problem.check_memory()
    if expected <= _TRIED:
        steps, more = _built(problem)
    else:
        steps, more = _expected(problem)
    rows += more
    rows.append(("memory", f"about {need / 1e6:.0f} MB of {free_memory() / 1e6:.0f} MB free"))
    return [*rows, ("time", _seconds(problem, expected, steps)), ("output", _output(problem))]


def _built(problem: Problem) -> tuple[float, list[tuple[str, str]]]:
    """Steps and rows of a scene that is small enough to be built."""
    rows = [("bonds", f"{problem.bonds.nbonds}")]
    with blame("material"):
        _ = problem.body_at_rest.laws
    steps = round(problem.scene.time.until / problem.dt)
    if problem.explicit:
        part = problem.dt / problem.limit.dt
        rows.append(("steps", f"{steps} of {problem.dt:.4g}, {part:.3g} of the stable limit"))
    else:
        rows.append(("steps", f"{steps} of {problem.dt:.4g}, {problem.scheme_name}"))
        states(problem, problem.dt)
    return steps, rows + [("note", remark) for remark in remarks(problem)]


def _expected(problem: Problem) -> tuple[float, list[tuple[str, str]]]:
    """The same from estimates."""
    time, dim = problem.scene.time, int(problem.mesh.dim())
    rows = [("bonds", f"about {problem.expected_bonds}")]
    if time.step is not None or time.steps is not None:
        steps = ceil(time.until / problem.dt - 1e-9)
        return steps, [*rows, ("steps", f"{steps} of {problem.dt:.4g}")]
    # the exact integrals allow at least this step, wherever they bound it
    mean = problem.influence.mean_inverse_power(1.0, dim)
    horizon = problem.scene.bonds.horizon
    lam = exact_eigenvalue_bound(problem.largest_slope, mean, problem.smallest_density, dim, horizon)
    if not isfinite(lam):
        unknown = "not known before the bonds are made: in 1D the exact integrals have no bound"
        return inf, [*rows, ("steps", unknown)]
    steps = ceil(time.until * (lam * (1.0 + max(0.0, problem.dilated))) ** 0.5 / 2 / time.part)
    return steps, [*rows, ("steps", f"at most about {steps}")]


def _seconds(problem: Problem, nbonds: int, steps: float) -> str:
    """Say how long it takes on two cores."""
    scene = problem.scene
    parts = seconds_of_run(
        int(problem.mesh.nvertices),
        nbonds,
        steps,
        explicit=problem.explicit,
        balanced=problem.discretisation.balanced,
        frames=scene.output.frames,
        dim=int(problem.mesh.dim()),
        rows=scene.output.history,
        pairs=at_vertices(problem.rule),
        dilated=problem.dilated >= 0.0,
        pictures=scene.output.pictures is not False and figure.available(),
    )
    listed = ", ".join(f"{name} {value:.2g} s" for name, value in parts.items() if isfinite(value))
    return (f"about {sum(parts.values()):.2g} s: " if isfinite(steps) else "") + listed


def _output(problem: Problem) -> str:
    output = problem.scene.output
    dim = int(problem.mesh.dim())
    each = _FRAME_BYTES[dim] + len(output.fields) * _FIELD_BYTES * dim * (dim + 1) // 2
    each -= _FIELD_BYTES * dim if problem.scene.time.scheme == "static" else 0  # no velocity
    size = int(problem.mesh.nvertices) * each / 1e6
    written = f"{output.frames} frames of about {size:.2g} MB, {output.history} rows, "
    every = output.every
    if every.steps:
        return f"{written}a checkpoint every {every.steps} steps"
    return written + (f"a checkpoint every {every.seconds:g} s" if every.seconds else "no checkpoints")
