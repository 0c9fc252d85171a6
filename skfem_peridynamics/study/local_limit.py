"""The limit of a vanishing horizon: statics of the linear model against scikit-fem's own local elasticity, in 2D."""

from __future__ import annotations

import numpy as np
import skfem
from scipy.sparse.linalg import spsolve
from skfem.helpers import ddot, div, dot, sym_grad

from .._types import Floats
from ..bonds.bond_basis import BondBasis
from ..bonds.rule import Rule
from ..material.material import Material
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics


def _displacement(x: Floats) -> Floats:
    return np.array([np.sin(2 * x[0] + 0.3) * np.cos(x[1]), 0.5 * np.cos(x[0] - 2 * x[1])])


def _body_force(x: Floats, lame: float) -> Floats:
    """``-((lambda + 1) grad div u + lap u)`` of that displacement, mu = 1."""
    s, c, t = np.sin(2 * x[0] + 0.3), np.cos(2 * x[0] + 0.3), x[0] - 2 * x[1]
    lap = np.array([-5 * s * np.cos(x[1]), -2.5 * np.cos(t)])
    grad_div = np.array([-4 * s * np.cos(x[1]) + np.cos(t), -2 * c * np.sin(x[1]) - 2 * np.cos(t)])
    force: Floats = -((lame + 1) * grad_div + lap)
    return force


def distance_to_local(horizon: float, per_horizon: int, rule: Rule, balanced: bool = False, lame: float = 1.0) -> float:
    """Return the relative L2 distance of the nonlocal from the local solution on the unit square, mu = 1."""
    return distances(horizon, per_horizon, rule, balanced, lame)[0]


def distances(
    horizon: float, per_horizon: int, rule: Rule, balanced: bool = False, lame: float = 1.0
) -> tuple[float, float, float]:
    """Return the relative L2 distances: nonlocal to local, local to exact, nonlocal to exact; unit square, mu = 1.

    Both have the same load and the same smooth displacement in a collar around the square: of one horizon, and of two
    where lambda is not mu, whose forces reach as far. The exact one is that of local elasticity.
    """
    n, collar = round(1 / horizon) * per_horizon, 1 if lame == 1.0 else 2
    axis = np.linspace(-collar * horizon, 1 + collar * horizon, n + 2 * collar * per_horizon + 1)
    mesh = skfem.MeshTri.init_tensor(axis, axis)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    bonds = BondBasis(basis, horizon, rule=rule)
    solid = Material.from_elastic(lame=lame, mu=1.0, density=1.0, plane="strain", potential="linear")
    body = Peridynamics(bonds.balanced() if balanced else bonds, solid)
    local = skfem.BilinearForm(lambda u, v, w: lame * div(u) * div(v) + 2 * ddot(sym_grad(u), sym_grad(v))).assemble(
        basis
    )
    load = skfem.LinearForm(lambda v, w: dot(_body_force(w.x, lame), v)).assemble(basis)
    inside = ((mesh.p > 1e-9) & (mesh.p < 1 - 1e-9)).all(axis=0)
    dofs, u0 = np.flatnonzero(np.repeat(~inside, 2)), _displacement(mesh.p).T.ravel()
    solutions = []
    for K in (body.stiffness(), local):
        inner, right, *_ = skfem.condense(K, load, x=u0, D=dofs)
        u = u0.copy()
        u[np.setdiff1d(np.arange(len(u)), dofs)] = spsolve(inner.tocsc(), right)
        solutions.append(u)
    M = mass_matrix(basis, kind="consistent")
    size = np.sqrt(solutions[1] @ M @ solutions[1])
    gaps = (solutions[0] - solutions[1], solutions[1] - u0, solutions[0] - u0)
    nonlocal_to_local, local_to_exact, nonlocal_to_exact = (float(np.sqrt(gap @ M @ gap) / size) for gap in gaps)
    return nonlocal_to_local, local_to_exact, nonlocal_to_exact
