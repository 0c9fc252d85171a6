"""The discretisation error of a scene, by itself on meshes refined once and twice: no exact solution is needed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import ceil, log2
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sparse

from ..._clock import Clock
from ..._memory import free_memory
from ..._types import Csr, Floats, Mesh
from ...model.mass import mass_matrix
from ...study.result import Level, Result
from ..files.whole_files import make_folder
from ..problem.cost import SPARE
from ..problem.problem import Problem
from ..problem.states import states
from ..scene.scene import Scene

_TIMES = 4  # at which motions are compared, the last at the end


@dataclass(frozen=True, eq=False)
class RefinedRun:
    """A scene run on one mesh: displacements at the times of comparison, and what it cost."""

    problem: Problem
    u: list[Floats]
    dt: float
    steps: int
    seconds_setup: float
    seconds_steps: float


def prolongation(mesh: Mesh) -> Csr:
    """Return the matrix that carries P1 values from a mesh to ``mesh.refined()``, (fine vertices, coarse vertices).

    New vertices are midpoints, one for each element in 1D, facet in 2D, edge in 3D, in scikit-fem's order.

    >>> import skfem
    >>> mesh = skfem.MeshTet().refined(1)
    >>> bool(np.allclose(prolongation(mesh) @ mesh.p.T, mesh.refined().p.T))
    True
    """
    pairs = mesh.t if mesh.dim() == 1 else mesh.facets if mesh.dim() == 2 else mesh.edges
    n, m = int(mesh.nvertices), pairs.shape[1]
    rows = np.repeat(np.arange(m), 2)
    middle = sparse.csr_matrix((np.full(2 * m, 0.5), (rows, pairs.T.ravel())), shape=(m, n))
    return sparse.csr_matrix(sparse.vstack([sparse.identity(n), middle]))


def run_once(problem: Problem, coarse: RefinedRun | None = None) -> RefinedRun:
    """Run a problem without output; its step is shortened so that the times of comparison are met.

    A refined problem takes half the step of the coarser one, or less: its distance then holds the error in time too.
    """
    clock = Clock()
    with clock.phase("setup"):
        until = problem.scene.time.until
        for part in ("load", "fixed", "mass", "u0", "v0"):
            getattr(problem, part)
        dt = problem.dt if coarse is None else min(problem.dt, 0.5 * coarse.dt)
        steps = _TIMES * ceil(until / dt / _TIMES - 1e-9)
    u: list[Floats] = []
    with clock.phase("steps"):
        for state in states(problem, until / steps):
            if state.t > (len(u) + 1) * until / _TIMES * (1.0 - 1e-9):
                u.append(state.u.copy())
    return RefinedRun(problem, u, until / steps, steps, clock.seconds["setup"], clock.seconds["steps"])


def fits(problem: Problem) -> bool:
    """Return whether a refined problem can be run in the memory that is free."""
    return problem.expected_bytes <= SPARE * free_memory()


def distance(coarse: RefinedRun, fine: RefinedRun) -> float:
    """Return the largest L2 distance of two motions, the second on the finer mesh, over the largest norm of it."""
    raised = sparse.identity(coarse.problem.mesh.nvertices, format="csr")
    for k in range(coarse.problem.refinements, fine.problem.refinements):
        raised = prolongation(replace(fine.problem, refinements=k).mesh) @ raised
    dim = int(fine.problem.mesh.dim())
    M = mass_matrix(fine.problem.full_basis, kind="consistent")

    def norm(v: Floats) -> float:
        return float(np.sqrt(v @ (M @ v)))

    gaps = [norm((raised @ u.reshape(-1, dim)).ravel() - v) for u, v in zip(coarse.u, fine.u, strict=True)]
    return max(gaps) / max(max(map(norm, fine.u)), np.finfo(float).tiny)


def order_of(first: float, second: float) -> float:
    """Return the order that two distances between neighbouring refinements tell, kept between 1/2 and 2."""
    if not (first > 0.0 and second > 0.0):
        return 2.0
    return float(np.clip(log2(first / second), 0.5, 2.0))


def estimate(problem: Problem) -> dict[str, Any]:
    """Return the error of a scene as its distance to itself refined once, and the seconds that took.

    Space and time step are halved together. The distance is the error but for what the refined run misses: with order
    2 that is a quarter (4/3 of the distance is given); where bonds have softened the order is taken as 1/2.
    """
    finer = replace(problem, refinements=1)
    if not fits(finer):
        need = finer.expected_bytes / 1e9
        return {"error_estimate": None, "estimate_note": f"the refined mesh would need {need:.3g} GB of memory"}
    coarse = run_once(problem)
    fine = run_once(finer, coarse)
    gap = distance(coarse, fine)
    from ...analysis.damage import census

    whole = census(problem.body, coarse.u[-1]).softened == 0
    p = 2.0 if whole else 0.5
    return {
        "error_estimate": gap / (1.0 - 0.5**p),
        "estimate_note": f"relative L2 error of u, from one refinement, taken to be of order {p:g} in h",
        "estimate_seconds": coarse.seconds_setup + coarse.seconds_steps + fine.seconds_setup + fine.seconds_steps,
    }


def study_scene(scene: Scene, out: Path, report: Callable[[str], None], levels: int = 3) -> Result:
    """Run a scene on its own mesh and on that refined, and return distances, order and estimated errors.

    Refinements that would not fit into memory are left out, and the result says so.
    """
    first = Problem(scene)
    _ = first.load, first.fixed, first.body  # the scene's mistakes are told before a folder is made
    make_folder(out)
    study = Result(scene.title, "self-convergence of a scene", quick=levels < 3)
    runs: list[RefinedRun] = []
    for k in range(levels):
        problem = replace(first, refinements=k)
        if k and not fits(problem):
            study.notes.append(f"Refinement {k} would need {problem.expected_bytes / 1e9:.3g} GB and is left out.")
            break
        runs.append(run_once(problem, runs[-1] if runs else None))
        run = runs[-1]
        report(
            f"refined {k} times: {run.steps} steps, set-up {run.seconds_setup:.3g} s, steps {run.seconds_steps:.3g} s"
        )
    gaps = [distance(a, b) for a, b in pairwise(runs)]
    p = order_of(gaps[0], gaps[1]) if len(gaps) > 1 else 2.0
    rows: list[tuple[Any, ...]] = []
    for k, run in enumerate(runs):
        gap = gaps[k] if k < len(gaps) else float("nan")
        missed = gaps[-1] / (2.0**p - 1.0) * 2.0 ** (p * (len(runs) - 1 - k)) if gaps else float("nan")
        size = (int(run.problem.mesh.nvertices), int(run.problem.bonds.nbonds), run.steps)
        rows.append((k, *size, gap, missed, run.seconds_setup, run.seconds_steps))
        if missed > 0.0:
            study.levels.append(Level(size[0], run.seconds_setup + run.seconds_steps, missed))
    columns = ("refined", "nodes", "bonds", "steps", "distance to the next", "estimated error", "set-up s", "steps s")
    study.tables.append((f"Relative L2 error of u, {first.rule_name}, {first.scheme_name}", columns, rows))
    if len(gaps) > 1:
        study.notes.append(f"Observed order of the distances: {log2(gaps[0] / gaps[1]):.2f}; errors use {p:.2f}.")
    return study
