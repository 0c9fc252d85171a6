"""The stable step of a body over ranks: SLEPc's largest eigenvalue, and the bounds of a lumped mass."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np

from .._types import Floats
from ..geometry.simplices import vertex_volumes
from ..solve.cfl import StepLimit, closed_form
from .body import RankBody

_VECTORS = 38  # as the serial Lanczos has


def stable_time_step(body: RankBody, m: Floats, tolerance: float = 5e-3) -> StepLimit:
    """Return the largest stable step of a body at rest; ``m`` (nown dim,) is the lumped mass of the rank's own part."""
    scale = 1.0 / np.sqrt(m)
    of_vertex = scale.reshape(-1, body.dim)
    scaled = body.vertex_stiffness() * of_vertex[:, :, None] * of_vertex[:, None, :]
    nodal = float(2.0 * np.linalg.eigvalsh(scaled)[:, -1].max(initial=0.0))
    trace = float(2.0 * np.trace(scaled, axis1=1, axis2=2).max(initial=0.0))
    volume = vertex_volumes(body.share.mesh)[: body.share.own]
    density = float((m.reshape(-1, body.dim)[:, 0] / volume).min(initial=np.inf))
    nodal, trace, density = (max(body.comm.allgather(x)) for x in (nodal, trace, -density))
    value, residual, products = _largest(body, scale, tolerance)
    return StepLimit(value, residual, nodal, trace, closed_form(body.any_piece, -density), products)


def _largest(body: RankBody, scale: Floats, tolerance: float) -> tuple[float, float, int]:
    """Ritz value, norm of its residual and products for the largest eigenvalue of ``M^-1/2 K M^-1/2``."""
    from petsc4py import PETSc
    from slepc4py import SLEPc

    count, size = 0, (len(scale), body.share.nvertices * body.dim)

    class Shell:
        def mult(self, matrix: Any, x: Any, y: Any) -> None:
            nonlocal count
            count += 1
            y.array[:] = scale * body.stiffness(scale * x.array_r)

    matrix = PETSc.Mat().createPython((size, size), Shell(), comm=body.comm)
    matrix.setUp()
    solver, start = SLEPc.EPS().create(body.comm), matrix.createVecRight()
    try:
        solver.setOperators(matrix)
        solver.setProblemType(SLEPc.EPS.ProblemType.HEP)
        solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_REAL)
        solver.setDimensions(1, _VECTORS)
        solver.setTolerances(tolerance, 60)
        whole = np.random.default_rng(0).standard_normal((body.share.nvertices, body.dim))
        start.array[:] = whole[body.share.number[: body.share.own]].ravel()  # the same for any number of ranks
        solver.setInitialSpace(start)
        solver.solve()
        if solver.getConverged() < 1:
            return nan, nan, count
        residual = solver.computeError(0, SLEPc.EPS.ErrorType.ABSOLUTE)
        return float(solver.getEigenvalue(0).real), float(residual), count
    finally:  # by hand: at the end of a process it is too late
        for thing in (solver, start, matrix):
            thing.destroy()
