"""Tell what each process of a run would have, before any is started."""

from __future__ import annotations

import numpy as np

from ...ranks.distributed import reach_of, work_of_vertices
from ...ranks.share import divided, shares
from ..problem.problem import Problem
from ..scene.reading import SceneError
from ..scene.scene import Scene
from .lead import refuse_problem


def check(scene: Scene, nranks: int) -> list[tuple[str, str]]:
    """Return the vertices, ghosts and bonds of the ranks, as rows of a table. Raises :class:`SceneError`."""
    problem = Problem(scene)
    refuse_problem(problem)
    mesh, horizon = problem.mesh, scene.bonds.horizon
    if mesh.nvertices < nranks:
        raise SceneError(f"--mpi {nranks}: so many processes are too many for {mesh.nvertices} vertices")
    rule, weighted = problem.rule, scene.bonds.boundary_function is not None
    work = work_of_vertices(mesh, horizon, rule)
    owner = divided(mesh.p, work, nranks)
    dealt = list(shares(mesh, owner, reach_of(mesh, horizon, rule, weighted)))
    load = np.bincount(owner, work, minlength=nranks) * (problem.expected_bonds / work.sum())
    own = np.array([share.own for share in dealt])
    ghosts = np.array([share.mesh.nvertices for share in dealt]) - own

    def spread(values: np.ndarray) -> str:
        low, high = round(values.min()), round(values.max())
        return f"{low}" if low == high else f"{low} to {high}"

    return [
        ("processes", f"{nranks}: {spread(own)} vertices each, {spread(ghosts)} ghosts, about {spread(load)} bonds"),
        ("imbalance", f"{load.max() / load.mean() - 1.0:.1%} of the bonds; ghosts {ghosts.sum() / own.sum():.1%}"),
    ]
