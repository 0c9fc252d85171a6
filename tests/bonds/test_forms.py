"""scikit-fem's own forms on bonds, against the fast operators: two codes for one double integral."""

import numpy as np
import pytest
import skfem
from skfem import BilinearForm, Functional, LinearForm, asm, condense, solve
from skfem.helpers import dot

from bodies import body_on, box, vector_basis
from skfem_peridynamics import BallRule, BondBasis, Exponential, PairRule, conical, constant

RULES = [
    PairRule(),
    PairRule(points="gauss"),
    BallRule(2, 20, outer="vertices"),
    BallRule(2, 4),
    BallRule(2, 4, symmetric=False),
    BallRule(2, 4, outer="vertices", symmetric=False),
]
IDS = [rule.name for rule in RULES]
LAW = Exponential(1.7, 0.4)
HORIZON = {1: 0.3, 2: 0.45, 3: 0.7}
DIVISIONS = {1: 8, 2: 4, 3: 2}


def cases(dim, rule, w=None):
    body = body_on(box(dim, DIVISIONS[dim], "random"), HORIZON[dim], LAW, "conical", rule=rule, boundary_function=w)
    J, c = conical, body.bonds.prefactor
    share = 1.0 if w is None else None

    def both(w):  # c J w w; the boundary function is interpolated like a displacement
        if share is not None:
            return c * J(w.r / HORIZON[dim])
        return c * J(w.r / HORIZON[dim]) * w.omega[0][0] * w.omega[1][0]

    kwargs = {} if w is None else {"omega": np.repeat(body.bonds.vertex_weight, dim)}
    return body, both, kwargs


def strain(u1, u2, w):
    return dot(u2 - u1, w.xi) / w.r**2


@pytest.mark.parametrize("rule", RULES, ids=IDS)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_stock_forms_agree_with_the_fast_operators(dim, rule):
    for w in (None, np.linspace(0.3, 1.0, box(dim, DIVISIONS[dim]).nvertices)):
        body, both, kwargs = cases(dim, rule, w)
        u = 0.3 * np.random.default_rng(0).standard_normal(body.basis.N)

        @Functional
        def energy(w, both=both):
            return both(w) * LAW.f(w.r * strain(*w.u, w) ** 2)

        assert body.energy(u) == pytest.approx(energy.assemble(body.bonds, u=u, **kwargs), rel=1e-12)
        twice = 2.0 if rule.symmetric else 4.0  # a directed bond acts on x only, and carries the other order's force

        @LinearForm
        def force(v1, v2, w, both=both, twice=twice):
            S = strain(*w.u, w)
            test = strain(v1, v2 if rule.symmetric else 0.0 * v2, w)
            return -both(w) * twice * LAW.df(w.r * S**2) * w.r * S * test

        F = force.assemble(body.bonds, u=u, **kwargs)
        assert body.force(u) == pytest.approx(F, abs=1e-12 * np.abs(F).max())

        @BilinearForm
        def a_l(u1, u2, v1, v2, w, both=both, twice=twice):
            test = strain(v1, v2 if rule.symmetric else 0.0 * v2, w)
            return twice * both(w) * LAW.slope * w.r * strain(u1, u2, w) * test

        K = asm(a_l, body.bonds, **kwargs)
        assert abs(body.stiffness() - K).max() <= 1e-12 * abs(K).max()
        x = np.random.default_rng(1).standard_normal(body.basis.N)
        assert body.stiffness_operator() @ x == pytest.approx(K @ x, abs=1e-12 * np.abs(K @ x).max())
        assert body.stiffness_operator().rmatvec(x) == pytest.approx(K.T @ x, abs=1e-12 * np.abs(K @ x).max())


@pytest.mark.parametrize("rule", [PairRule(), BallRule(3, 8)], ids=["pairs", "ball"])
def test_condense_and_solve_a_clamped_bar(rule):
    """A bar under its own weight, clamped in a collar of one horizon: close to local elasticity."""
    n, eps = 80, 0.05
    mesh = skfem.MeshLine(np.linspace(-eps, 1.0, n + 5)).with_boundaries({"left": lambda x: x[0] < -0.049})
    basis = vector_basis(mesh)
    bonds = BondBasis(basis, eps, constant, rule)

    @BilinearForm
    def a_l(u1, u2, v1, v2, w):  # E = 2 f'(0) M_1 = 1
        return 2.0 * bonds.prefactor * w.r * strain(u1, u2, w) * strain(v1, v2, w)

    b = LinearForm(lambda v, w: v[0] * (w.x[0] > 0)).assemble(basis)
    clamped = np.flatnonzero(mesh.p[0] <= 1e-12)
    u = solve(*condense(asm(a_l, bonds), b, D=clamped))
    x = mesh.p[0, mesh.p[0] >= 0.0]
    exact = x - 0.5 * x**2
    error = np.abs(u[mesh.p[0] >= 0.0] - exact).max() / exact.max()
    print(f"clamped bar, {rule.name}: {error:.1e} from local elasticity at eps = {eps}")
    assert error < 0.07  # of the order of the horizon


def test_parameters_and_members():
    bonds = BondBasis(vector_basis(box(2, 3, "random")), 0.5, rule=BallRule(2, 3))
    w = bonds.default_parameters()
    assert set(w) == {"x", "y", "xi", "r", "h"}
    assert np.array(w["y"]) - np.array(w["x"]) == pytest.approx(np.array(w["xi"]), abs=1e-15)
    assert np.linalg.norm(w["xi"], axis=0) == pytest.approx(np.array(w["r"]))
    assert bonds.X.shape == (2, 1)
    assert bonds.dx.shape == (bonds.nelems, 1)
    assert bonds.element_dofs.shape == (bonds.Nbfun, bonds.nelems) == (12, bonds.nelems)
    assert len(bonds.basis) == len(list(bonds.basis)) == 12
    u = bonds.mesh.p.T.ravel()
    at_x, at_y = bonds.interpolate(u)
    assert np.array(at_x) == pytest.approx(np.array(w["x"]))
    assert np.array(at_y) == pytest.approx(np.array(w["y"]), abs=1e-14)
    with pytest.raises(ValueError, match=r"u has shape \(3,\); the basis has 32 degrees of freedom"):
        bonds.interpolate(np.zeros(3))
    area = Functional(lambda w: w.r**0).assemble(bonds)
    inside = np.pi * 0.5**2  # the double integral of 1 is at most |D| times the ball
    assert 0.3 * inside < area < inside
