"""Tell the size of a scene before it runs."""

from __future__ import annotations

from math import ceil, isfinite

from ..material.influence import as_influence
from .build import Problem
from .march import march, notes
from .meshes import blame, free_memory
from .reading import SceneError
from .scene import Scene

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
    for k, table in enumerate(scene.no_fail):
        problem.vertices(table, f"no_fail[{k}]")
    influence = as_influence(scene.bonds.influence)
    with blame("material"):
        slope = max(one.law(dim, influence.moment(dim)).slope for one in problem.materials)
    expected, need = problem.expected_bonds, problem.expected_bytes
    rows = [("dimension, nodes", f"{dim}, {problem.mesh.nvertices}")]
    # the exact integrals allow at least this step, wherever they bound it
    lam = 8.0 * slope * influence.mean_inverse_power(1.0, dim) / (problem.lightest * dim * scene.bonds.horizon**2)
    if need > free_memory():
        raise SceneError(
            f"bonds.horizon = {scene.bonds.horizon:g} makes about {expected:.3g} bonds: {need / 1e9:.3g} GB"
        )
    if expected <= _TRIED:
        rows.append(("bonds", f"{problem.bonds.nbonds}"))
        with blame("material"):
            _ = problem.resting.laws
        steps = round(time.until / problem.dt)
        if problem.explicit:
            of_limit = problem.dt / problem.limit.dt
            rows.append(("steps", f"{steps} of {problem.dt:.4g}, {of_limit:.3g} of the stable limit"))
            per_bond = _COMPILED if problem.body.compiles else _SPARSE
            rows.append(("stepping", f"about {steps * problem.bonds.nbonds * per_bond:.2g} s"))
        else:
            rows.append(("steps", f"{steps} of {problem.dt:.4g}, {problem.scheme}"))
            march(problem, problem.dt)
        rows += [("note", note) for note in notes(problem)]
    else:
        rows.append(("bonds", f"about {expected}"))
        if time.step is not None or time.steps is not None:
            rows.append(("steps", f"{ceil(time.until / problem.dt - 1e-9)} of {problem.dt:.4g}"))
        elif isfinite(lam):
            rows.append(("steps", f"at most about {ceil(time.until * lam**0.5 / 2 / time.part)}"))
        else:
            rows.append(("steps", "not known before the bonds are made: in 1D the exact integrals have no bound"))
    rows.append(("memory", f"about {need / 1e6:.0f} MB of {free_memory() / 1e6:.0f} MB free"))
    return rows
