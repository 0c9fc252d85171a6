"""The stable step of a body over ranks: SLEPc's largest eigenvalue, and the bounds of the lumped mass."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, nan
from typing import Any

import numpy as np

from .._types import Floats
from ..geometry.simplices import vertex_volumes
from ..solve.cfl import StepLimit, closed_form, with_margins
from ..solve.mass_solver import Lumped, MassSolver, mass_solver
from .body import RankBody
from .mass import RankMass

_VECTORS = 38  # as the serial Lanczos has


def stable_time_step(body: RankBody, m: Floats | RankMass, tolerance: float = 5e-3) -> StepLimit:
    """Return the largest stable step of a body at rest; ``m`` is the lumped mass (nown dim,) or the consistent one."""
    if not (np.isfinite(tolerance) and tolerance > 0.0):
        raise ValueError(f"tolerance = {tolerance} must be a positive number")
    lumped = m.lumped if isinstance(m, RankMass) else np.asarray(m, dtype=float)
    sound = lumped.shape == (body.share.own * body.dim,) and bool(np.isfinite(lumped).all() and (lumped > 0.0).all())
    if not all(body.comm.allgather(sound)):
        raise ValueError("m must be the positive, finite lumped mass of each rank's own part, or a RankMass")
    scale = 1.0 / np.sqrt(lumped).reshape(-1, body.dim)
    scaled = body.vertex_stiffness(bounding=True) * scale[:, :, None] * scale[:, None, :]
    trace = float(2.0 * np.trace(scaled, axis1=1, axis2=2).max(initial=0.0))
    nodal = float(2.0 * np.linalg.eigvalsh(scaled)[:, -1].max(initial=0.0)) if body.symmetric else trace
    volume = vertex_volumes(body.share.mesh)[: body.share.own]
    density = -max(body.comm.allgather(-float((lumped.reshape(-1, body.dim)[:, 0] / volume).min(initial=inf))))
    closed = closed_form(body.any_piece, density)
    nodal, trace, closed = (max(body.comm.allgather(x)) for x in (nodal, trace, closed))
    if not nodal > 0.0:
        raise ValueError("no bond has any stiffness: there is no stable step to compute")
    if isinstance(m, RankMass):
        # M is at least the lumped mass over d + 2 (Wathen); nothing is known where K is not symmetric
        nodal = nodal * (body.dim + 2) if body.symmetric else inf
    mass = mass_solver(m, np.empty(0, dtype=np.int64))
    value, residual, products = _largest(body, body.stiffness, mass, tolerance)
    bonds, beside = 0.0, body.dilatation
    if beside is not None and min(body.comm.allgather(float(beside.own.curvature().min()))) < 0.0:
        found = _largest(body, body.bond_stiffness, mass, tolerance)
        bonds, products = with_margins(*found), products + found[2]
    return StepLimit(value, residual, nodal, trace, closed, products, bonds)


def _largest(
    body: RankBody, product: Callable[[Floats], Floats], mass: MassSolver, tolerance: float
) -> tuple[float, float, int]:
    """Ritz value, norm of its residual and products for the largest eigenvalue of ``K x = lam M x``.

    Lanczos of ``M^-1/2 K M^-1/2`` for a lumped mass, of ``M^-1 K`` in the inner product of M for a consistent one;
    Arnoldi of ``M^-1 K`` where K is not symmetric.
    """
    from petsc4py import PETSc
    from slepc4py import SLEPc

    count, size = 0, (mass.size, body.share.nvertices * body.dim)
    root = np.sqrt(mass.inverse) if isinstance(mass, Lumped) and body.symmetric else None

    def apply(x: Floats) -> Floats:
        nonlocal count
        count += 1
        if root is not None:
            return root * product(root * x)
        return product(x) if body.symmetric else mass.solve(product(x))

    kinds, made = SLEPc.EPS.ProblemType, []

    def shell(act: Callable[[Floats], Floats]) -> Any:
        made.append(PETSc.Mat().createPython((size, size), _Shell(act), comm=body.comm))
        made[-1].setUp()
        return made[-1]

    solver = SLEPc.EPS().create(body.comm)
    made.append(solver)
    try:
        K = shell(apply)
        if root is None and body.symmetric:
            solver.setOperators(K, shell(mass.times))
            solver.setProblemType(kinds.GHEP)
            inner = solver.getST().getKSP()
            inner.setType("preonly")
            inner.getPC().setType("python")
            inner.getPC().setPythonContext(_Shell(mass.solve))
        else:
            solver.setOperators(K)
            solver.setProblemType(kinds.HEP if body.symmetric else kinds.NHEP)
        which = SLEPc.EPS.Which
        solver.setWhichEigenpairs(which.LARGEST_REAL if body.symmetric else which.LARGEST_MAGNITUDE)
        solver.setDimensions(1, _VECTORS)
        solver.setTolerances(tolerance, 60)
        start = K.createVecRight()
        made.append(start)
        whole = np.random.default_rng(0).standard_normal((body.share.nvertices, body.dim))
        start.array[:] = whole[body.share.number[: body.share.own]].ravel()  # the same for any number of ranks
        solver.setInitialSpace(start)
        solver.solve()
        if solver.getConverged() < 1:
            return nan, nan, count
        value = solver.getEigenvalue(0)
        if root is None and body.symmetric:
            solver.getEigenvector(0, start)
            residual = _residual(body, product, mass, float(value.real), np.array(start.array_r))
        else:
            residual = solver.computeError(0, SLEPc.EPS.ErrorType.ABSOLUTE)
        return float(value.real if body.symmetric else abs(value)), float(residual), count
    finally:  # by hand: at the end of a process it is too late
        for thing in made:
            thing.destroy()


def _residual(body: RankBody, product: Callable[[Floats], Floats], mass: MassSolver, value: float, x: Floats) -> float:
    """The norm of the residual in that of M^-1, for x of unit norm in M."""
    gap, Mx = product(x), mass.times(x)
    gap -= value * Mx
    return float(np.sqrt(body.total(float(gap @ mass.solve(gap))) / body.total(float(x @ Mx))))


class _Shell:
    """A matrix, or a preconditioner, that is only applied."""

    def __init__(self, act: Callable[[Floats], Floats]) -> None:
        self.act = act

    def mult(self, matrix: Any, x: Any, y: Any) -> None:
        y.array[:] = self.act(np.array(x.array_r))

    apply = mult
