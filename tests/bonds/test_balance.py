"""Balanced weights: what they must meet, against closed forms and brute force, and what they are worth."""

import numpy as np
import pytest
import scipy.sparse.linalg
import skfem
from scipy.integrate import quad
from skfem.quadrature import get_quadrature

from bodies import ELEMENT, at_vertices, body_on, box, grid, vector_basis
from reference import force_on_square
from skfem_peridynamics import BallRule, BondBasis, Crack, Exponential, Linear, PairRule, mass_matrix, slit
from skfem_peridynamics.bonds.balance import ratio_of
from skfem_peridynamics.bonds.moment_targets import moment_targets
from skfem_peridynamics.geometry.simplices import element_volumes

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
    assert "Balance(" not in str(bonds)
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


@pytest.mark.parametrize("rule", RULES[1])
def test_in_one_dimension_weights_are_exact_unasked(rule):
    """What is missed travels along the whole line there: 6e-11 of the largest moment at most."""
    balance = BondBasis(vector_basis(box(1, 40, "random")), 0.12, rule=rule).balanced().balance
    assert balance.residual < 1e-9


def test_ratios_are_positive_and_their_slope_is_one_at_rest():
    s = np.array([-1e8, -3.0, -1e-3, 0.0, 1e-3, 3.0, 1e8])
    assert (ratio_of(s) > 0).all()
    step = 1e-6
    assert (ratio_of(np.array([step])) - ratio_of(np.array([-step])))[0] / (2 * step) == pytest.approx(1.0, rel=1e-9)


def test_toughness_hardly_moves():
    """Energy of a fully opened crack, straight on a lattice and ragged on a random mesh, before and after."""
    for kind in ("structured", "random"):
        mesh = box(2, 24, kind)
        body = body_on(mesh, 4 / 24, Exponential(1.0, 1e-9))
        balanced = body.with_(bonds=body.bonds.balanced())
        u = at_vertices(mesh, 0.0, 1.0 * (mesh.p[1] > 0.51))
        change = balanced.energy(u) / body.energy(u) - 1
        print(f"toughness after balancing, {kind}: {change:+.2%}")
        assert abs(change) < 0.02


# ---- accuracy: forces of a smooth field, nonlinear law, on the unit square with its boundary
def field(x):
    return 0.1 * np.array(
        [np.sin(2 * x[0] + 0.3) * np.cos(x[1]) + 0.3 * x[1] ** 2, np.cos(1.5 * x[0]) * np.sin(2 * x[1] + 1)]
    )


def exact_dual(mesh, eps):
    """``(P(u), phi_i)`` of the field itself: polar quadrature inside scikit-fem's rule of order five."""
    X, W = get_quadrature(ELEMENT[2](), 5)
    lam = np.vstack([1 - X.sum(axis=0), X])
    points = np.einsum("kg,dke->deg", lam, mesh.p[:, mesh.t]).reshape(2, -1)
    P = force_on_square(points, eps, field, lambda q: np.exp(-2 * q), n=10)
    volume = (element_volumes(mesh)[:, None] * W / W.sum()).ravel()
    out = np.zeros((mesh.nvertices, 2))
    for corner in range(3):
        for a in range(2):
            out[:, a] += np.bincount(
                np.repeat(mesh.t[corner], len(W)), volume * P[a] * np.tile(lam[corner], mesh.nelements), mesh.nvertices
            )
    return out.ravel()


def force_errors(kind, per_horizon, rules, eps=0.2):
    """Errors that a rule makes with the interpolant of the field, relative and in L2.

    The force, ``M^-1 force - r_h P(u)``, over the whole body and deeper than the horizon and a half; and the
    displacement by which the body would answer to that error at rest, rigid motions taken out.
    """
    mesh = box(2, round(per_horizon / eps), kind)
    basis = vector_basis(mesh)
    M = mass_matrix(basis, kind="consistent")
    solve = scipy.sparse.linalg.splu(M.tocsc()).solve
    dual, u = exact_dual(mesh, eps), field(mesh.p).T.ravel()
    exact = solve(dual)
    deep = np.repeat(np.minimum(mesh.p, 1 - mesh.p).min(axis=0) > 1.5 * eps, 2)
    x, y = mesh.p - 0.5
    rigid = np.stack([at_vertices(mesh, 1.0, 0.0), at_vertices(mesh, 0.0, 1.0), at_vertices(mesh, -y, x)], axis=1)

    def norm(v):
        return np.sqrt(v @ (M @ v))

    def without_rigid(v):
        return v - rigid @ np.linalg.solve(rigid.T @ (M @ rigid), rigid.T @ (M @ v))

    reference = body_on(mesh, eps, Linear(2.0), rule=BallRule(3, 8)).stiffness()[3:, 3:].tocsc()
    answer = scipy.sparse.linalg.splu(reference).solve
    out = {}
    for rule, balance in rules:
        bonds = BondBasis(basis, eps, rule=rule)
        bonds = bonds.balanced() if balance else bonds
        body = body_on(mesh, eps, Exponential(1.0, 0.5), rule=rule).with_(bonds=bonds)
        miss = body.force(u) - dual
        shift = np.concatenate(
            [np.zeros(3), answer((miss - M @ (rigid @ np.linalg.solve(rigid.T @ (M @ rigid), rigid.T @ miss)))[3:])]
        )
        errors = (
            norm(solve(miss)) / norm(exact),
            norm(solve(miss) * deep) / norm(exact * deep),
            norm(without_rigid(shift)) / norm(without_rigid(u)),
        )
        name = f"{rule.name}{', balanced' if balance else ''}"
        out[name] = errors
        whole, inside, static = (f"{e:.1e}" for e in errors)
        print(
            f"{kind}, eps/h = {per_horizon}, {name}, {bonds.nbonds / mesh.nvertices:.0f} bonds a node: "
            f"force {whole}, inside {inside}; displacement {static}",
            flush=True,
        )
    return out


# at four vertices per horizon: force over the body and inside, displacement; measured. The interpolant itself,
# integrated exactly, misses the force by 2.4e-3, 8.7e-3 and 3.9e-3 on the three meshes: no rule can do better
MEASURED = {
    ("structured", 8): (8.1e-3, 1.3e-3, 1.1e-3),
    ("random", 8): (1.4e-2, 1.7e-2, 1.5e-3),
    ("graded", 8): (1.2e-2, 3.4e-3, 1.6e-3),
}


@pytest.mark.parametrize(
    "kind", ["random", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("structured", "graded"))]
)
def test_forces_of_smooth_fields(kind):
    plain, balanced = force_errors(kind, 4, [(BallRule(3, 8), False), (BallRule(3, 8), True)]).values()
    for found, known in zip(balanced, MEASURED[kind, 8], strict=True):
        assert found < 1.1 * known
    assert plain[0] > 2.5 * balanced[0]
    assert plain[2] > 2.5 * balanced[2]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["structured", "random", "graded"])
def test_forces_of_smooth_fields_at_two_sizes(kind):
    """The table of docs/evidence/verification.md."""
    rules = [
        (PairRule(), False),
        (PairRule(), True),
        (BallRule(3, 8, "vertices"), False),
        (BallRule(3, 8), False),
        (BallRule(3, 8), True),
        (BallRule(3, 16), True),
        (BallRule(5, 16), True),
        (BallRule(3, 16, symmetric=False), False),
    ]
    coarse, fine = (force_errors(kind, m, rules) for m in (4, 8))
    best = f"{BallRule(5, 16).name}, balanced"
    assert fine[best][2] < 1e-3
    assert fine[best][2] < coarse[best][2] < 1.3e-3  # 1.24e-3 on the random mesh
    name = f"{BallRule(3, 16).name}, balanced"
    assert (
        fine[name][1] < 0.6 * coarse[name][1]
    )  # inside the force converges; near a free boundary, docs say what happens
    assert coarse[name][2] < 1.5e-3
    assert fine[name][2] < {"structured": 1e-3, "random": 1e-3, "graded": 2.3e-3}[kind]


@pytest.mark.long
@pytest.mark.parametrize("kind", ["structured", "random"])
def test_forces_in_3d(kind):
    """Quadratic field, linear law: deep inside the force per volume is ``mu (2 grad div u + lap u)``, a constant."""
    eps, n = 0.25, 10
    mesh = box(3, n, kind)
    basis = vector_basis(mesh)
    solve = scipy.sparse.linalg.splu(mass_matrix(basis, kind="consistent").tocsc()).solve
    lumped = mass_matrix(basis).diagonal()
    x, y, z = mesh.p
    u = at_vertices(mesh, x**2 + y * z, x * y, z**2 + 0.5 * y**2)
    exact = np.array([2 * 3 + 2, 0, 2 * 2 + 3]) * 2 * (1 / 4) / 5  # grad div u = (3, 0, 2), lap u = (2, 0, 3)
    deep = np.abs(mesh.p - 0.5).max(axis=0) < 0.15
    errors = []
    for rule, balance in (
        (PairRule(), False),
        (PairRule(), True),
        (BallRule(2, 13), False),
        (BallRule(2, 13), True),
        (BallRule(2, 13, symmetric=False), False),
    ):
        bonds = BondBasis(basis, eps, rule=rule)
        body = body_on(mesh, eps, rule=rule).with_(bonds=bonds.balanced() if balance else bonds)
        F = body.force(u)
        P = (F / lumped if isinstance(rule, PairRule) else solve(F)).reshape(-1, 3)[deep]
        error = np.linalg.norm(P - exact) / np.linalg.norm(np.broadcast_to(exact, P.shape))
        name = f"{rule.name}{', balanced' if balance else ''}"
        print(
            f"3D {kind}, eps/h = 2.5, {name}, {bonds.nbonds / mesh.nvertices:.0f} bonds a node: {error:.1e} at {len(P)}"
        )
        errors.append(error)
    if kind == "random":
        assert errors[1] < 0.6 * errors[0]
        assert errors[3] < 0.6 * errors[2]


@pytest.mark.parametrize(("dim", "n", "kind", "most"), [(1, 20, "random", 2.5e-3), (2, 10, "graded", 6e-4)])
def test_near_the_boundary_balls_and_lines_are_met_nearly(dim, n, kind, most):
    """1.8e-3 and 4.5e-4 of the largest moment. Targets that are first made to fit what weights can do leave 2.2e-4 and
    8.7e-5, and change no error of a motion by more than a hundredth (smooth-1d, 2D balls at four vertices per horizon).
    """
    rule = PairRule() if dim == 1 else BallRule(3, 8)
    balance = BondBasis(vector_basis(box(dim, n, kind)), 3.1 / n, rule=rule).balanced().balance
    print(f"{dim}D: {balance.residual_near:.1e}")
    assert balance.residual_near < most
    assert not len(balance.unbalanced)


def test_five_per_cent_count_as_met():
    """At 2.2 vertices per horizon the worst vertex is off by 12 %, and a quarter of all are named; at 3.2 by 3.2 %."""
    for per_horizon, least, most in ((2.2, 10, 30), (3.2, 0, 0)):
        balance = BondBasis(vector_basis(box(2, 8, "random")), per_horizon / 8).balanced().balance
        print(f"{per_horizon} vertices: {balance.residual_near:.1e}, {len(balance.unbalanced)} named")
        assert (balance.residual_near > 0.05) == (per_horizon < 3)
        assert least <= len(balance.unbalanced) <= most
