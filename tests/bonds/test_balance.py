"""Balanced weights: what they must meet, against closed forms and brute force, and what they are worth."""

import numpy as np
import pytest
import skfem
from scipy.integrate import quad

from bodies import body_on, box, grid, vector_basis
from skfem_peridynamics import BallRule, BondBasis, Crack, PairRule, slit
from skfem_peridynamics.bonds.balance import ratio_of
from skfem_peridynamics.bonds.moment_targets import moment_targets

RULES = {
    1: [PairRule(), PairRule(points="gauss"), BallRule(3, 1), BallRule(3, 1, "vertices")],
    2: [PairRule(), BallRule(3, 8), BallRule(3, 8, "vertices")],
}


def inner(bonds):
    return moment_targets(bonds).exact_four


def patch_error(body):
    """Largest force at an inner vertex under linear fields, over the largest force near the boundary."""
    dim, mesh = body.bonds.dim, body.bonds.mesh
    G = np.random.default_rng(0).standard_normal((dim, dim))
    F = np.abs(body.force((mesh.p.T @ G).ravel())).reshape(-1, dim).max(axis=1)
    deep = inner(body.bonds)
    assert deep.sum() > 0
    return F[deep].max() / F.max()


CASES = [(dim, kind, None) for dim in (1, 2) for kind in ("structured", "random", "graded")]
CASES += [(1, "graded", "smooth"), (2, "random", "smooth")]


@pytest.mark.parametrize(("dim", "kind", "w"), CASES)
def test_patch_test_positivity_and_symmetry(dim, kind, w):
    eps = {1: 0.15, 2: 0.25}[dim] * (1.0 if w is None else 0.7)  # with w inside begins two horizons deep
    mesh = box(dim, {1: 30, 2: 12}[dim], kind)
    for rule in RULES[dim]:
        plain = body_on(mesh, eps, rule=rule, boundary_function=w)
        bonds = plain.bonds.balanced(exact=True)
        body, balance = plain.with_(bonds=bonds), bonds.balance
        before, after = patch_error(plain), patch_error(body)
        print(
            f"{dim}D {kind}, w = {w}, {rule.name}: patch test {before:.1e} -> {after:.1e}, "
            f"weights x {balance.smallest:.2f}"
        )
        assert after < 1e-8
        assert kind == "structured" or before > 1e-3
        assert balance.smallest > 0.0
        assert (bonds.weight[plain.bonds.weight > 0] > 0).all()
        assert not inner(bonds)[balance.unbalanced].any()
        u = np.random.default_rng(1).standard_normal(body.basis.N)
        F = body.force(u).reshape(-1, dim)
        assert np.abs(F.sum(axis=0)).max() < 1e-13 * np.abs(F).sum()
        K = body.stiffness()
        assert abs(K - K.T).max() == 0.0
    assert "balance" not in str(bonds)
    assert bonds.with_(horizon=0.99 * eps).balance is None


IN_3D = [PairRule(), *(pytest.param(r, marks=pytest.mark.long) for r in (BallRule(3, 8, "vertices"), BallRule(2, 7)))]


@pytest.mark.slow
@pytest.mark.parametrize("rule", IN_3D, ids=lambda rule: rule.name)
def test_patch_test_in_3d_and_beside_a_slit(rule):
    cracked = slit(grid((1.0, 12), (1.0, 12)), Crack([[0.0, 0.5], [1 / 3, 0.5]]))
    shift = 0.3 / 12 * np.random.default_rng(0).uniform(-1, 1, cracked.p.shape)
    free = np.ones(cracked.nvertices, dtype=bool)
    free[np.unique(cracked.facets[:, cracked.boundary_facets()])] = False
    moved = type(cracked)(cracked.p + shift * free, cracked.t)
    for mesh, eps in ((moved, 0.2), (box(3, 8, "random"), 0.25)):
        bonds = BondBasis(vector_basis(mesh), eps, rule=rule).balanced(exact=True)
        body = body_on(mesh, eps, rule=rule).with_(bonds=bonds)
        assert patch_error(body) < 1e-8
        assert bonds.balance.smallest > 0.0
        lam = np.linalg.eigvalsh(body.stiffness().toarray())
        dim = mesh.dim()
        assert (lam < 1e-10 * lam[-1]).sum() == dim * (dim + 1) // 2


def test_a_one_sided_rule_is_not_balanced():
    with pytest.raises(ValueError, match="a one-sided rule needs no balance"):
        BondBasis(vector_basis(box(2, 6)), 0.3, rule=BallRule(2, 4, symmetric=False)).balanced()


def test_vertices_that_cannot_be_balanced_are_named():
    """Vertex pairs, conical, two vertices per horizon, random mesh: no positive weights near the rule's will do."""
    plain = BondBasis(vector_basis(box(2, 16, "random")), 2 / 16, "conical")
    bonds = plain.balanced(exact=True)
    assert set(np.flatnonzero(inner(plain))) == set(bonds.balance.unbalanced) & set(np.flatnonzero(inner(plain)))
    assert bonds.balance.residual > 1e-3
    assert bonds.balance.smallest > 1 / 50
    good = BondBasis(vector_basis(box(2, 10)), 0.3, rule=BallRule(2, 4)).balanced()
    assert good.balanced() is good
    with pytest.raises(ValueError, match="no bond has any measure: there is nothing to balance"):
        BondBasis(vector_basis(grid((1, 1), (1, 1))), 0.6, "constant", PairRule(points="gauss"), "smooth").balanced()


def test_targets_are_the_integrals_in_1d():
    """``T3_i = 2 int phi_i w(x) int w(y) J sign(y - x) dy dx`` by nested adaptive quadrature."""
    mesh, eps = box(1, 8, "random"), 0.3
    x = np.sort(mesh.p[0])
    w = np.interp(x, [0.0, 0.4, 1.0], [0.2, 1.0, 0.5])
    for weight in (None, w):
        bonds = BondBasis(vector_basis(skfem.MeshLine(x)), eps, "conical", boundary_function=weight)
        found = moment_targets(bonds).values[:, 0]

        def omega(t, weight=weight):
            return 1.0 if weight is None else float(np.interp(t, x, weight))

        def along(t, omega=omega):
            both = []
            for side in (-1, 1):
                reach = min(eps, t if side < 0 else 1 - t)
                both.append(quad(lambda r, side=side: (1 - r / eps) * omega(t + side * r), 0, reach, limit=200)[0])
            return omega(t) * (both[1] - both[0])

        for i in (0, 1, 3):
            low, high = x[max(i - 1, 0)], x[i + 1]
            breaks = [b for b in (x[i], eps, 1 - eps) if low < b < high]
            exact = (
                2 * quad(lambda t, i=i: np.interp(t, x, np.eye(9)[i]) * along(t), low, high, points=breaks or None)[0]
            )
            assert found[i] == pytest.approx(exact, abs=2e-3 * np.abs(found).max())


def test_ratios_are_positive_and_their_slope_is_one_at_rest():
    s = np.array([-1e8, -3.0, -1e-3, 0.0, 1e-3, 3.0, 1e8])
    assert (ratio_of(s) > 0).all()
    step = 1e-6
    assert (ratio_of(np.array([step])) - ratio_of(np.array([-step])))[0] / (2 * step) == pytest.approx(1.0, rel=1e-9)
