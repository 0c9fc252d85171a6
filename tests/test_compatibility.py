"""eps -> 0 with eps/h fixed: statics of the linear model against scikit-fem's own local elasticity."""

import numpy as np
import pytest
import scipy.sparse.linalg
import skfem
from skfem.helpers import ddot, div, sym_grad

from bodies import body_on, grid
from skfem_peridynamics import BallRule, Linear, PairRule

MU = 1.0


def exact(x):
    return np.array([np.sin(2 * x[0] + 0.3) * np.cos(x[1]), 0.5 * np.cos(x[0] - 2 * x[1])])


def body_force(x):
    """``-mu (2 grad div u + lap u)`` of the field above, derived by hand."""
    s, c, t = np.sin(2 * x[0] + 0.3), np.cos(2 * x[0] + 0.3), x[0] - 2 * x[1]
    lap = np.array([-5 * s * np.cos(x[1]), -2.5 * np.cos(t)])
    # div u = 2 c cos y + sin(t)
    grad_div = np.array([-4 * s * np.cos(x[1]) + np.cos(t), -2 * c * np.sin(x[1]) - 2 * np.cos(t)])
    return -MU * (2 * grad_div + lap)


@skfem.BilinearForm
def elasticity(u, v, w):
    return MU * div(u) * div(v) + 2 * MU * ddot(sym_grad(u), sym_grad(v))


@skfem.LinearForm
def load(v, w):
    b = body_force(w.x)
    return b[0] * v[0] + b[1] * v[1]


def distance(eps, per_horizon, rule):
    """Relative L2 distance of the nonlocal from the local solution, held in a collar of one horizon around."""
    n = round(1 / eps) * per_horizon
    m = n + 2 * per_horizon
    mesh = grid((1 + 2 * eps, m), (1 + 2 * eps, m)).translated((-eps, -eps))
    # lambda = mu = 2 f'(0) M_2 / 4, M_2 = 1/3
    body = body_on(mesh, eps, Linear(6 * MU), rule=rule)
    inside = ((mesh.p > 1e-9) & (mesh.p < 1 - 1e-9)).all(axis=0)
    held = np.flatnonzero(np.repeat(~inside, 2))
    u0 = exact(mesh.p).T.ravel()
    b = load.assemble(body.basis)
    M = skfem.BilinearForm(lambda u, v, w: u[0] * v[0] + u[1] * v[1]).assemble(body.basis)
    solutions = []
    for K in (body.stiffness(), elasticity.assemble(body.basis)):
        KII, bI, *_ = skfem.condense(K, b, x=u0, D=held)
        u = u0.copy()
        u[np.setdiff1d(np.arange(len(u)), held)] = scipy.sparse.linalg.spsolve(KII.tocsc(), bI)
        solutions.append(u)
    gap = solutions[0] - solutions[1]
    return np.sqrt((gap @ M @ gap) / (solutions[1] @ M @ solutions[1]))


@pytest.mark.parametrize("per_horizon", [2, 4, 8])
@pytest.mark.parametrize("rule", [BallRule(3, 8), BallRule(3, 8, outer="vertices")], ids=["gauss", "vertices"])
def test_ball_rules_are_asymptotically_compatible(rule, per_horizon):
    horizons = [1 / 3, 1 / 6, 1 / 12] if per_horizon < 8 else [1 / 2, 1 / 4, 1 / 6]
    gaps = [distance(eps, per_horizon, rule) for eps in horizons]
    rate = np.polyfit(np.log(horizons), np.log(gaps), 1)[0]
    print(f"{rule.name}, eps/h = {per_horizon}: {', '.join(f'{g:.2e}' for g in gaps)}, rate {rate:.2f}")
    assert rate > 1.8


def test_pairs_keep_the_error_of_their_moment():
    """At a fixed number of vertices per horizon the moment of pairs is off by a fixed amount: they do not converge."""
    gaps = [distance(eps, 4, PairRule()) for eps in (1 / 3, 1 / 6, 1 / 12)]
    print(f"vertex pairs, eps/h = 4: {', '.join(f'{g:.2e}' for g in gaps)}")
    assert gaps[2] > 0.4 * gaps[1]
