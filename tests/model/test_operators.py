import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bodies import at_vertices, body_on, box, grid
from skfem_peridynamics import BallRule, Crack, Exponential, Linear, PairRule, Rational, own_potential, slit
from skfem_peridynamics.geometry.simplices import vertex_sizes, vertex_volumes

OMEGA = [1.0, 2.0, np.pi, 4 * np.pi / 3]
KINDS = ["structured", "random", "graded"]
DIVISIONS = {1: 12, 2: 5, 3: 3}
HORIZON = {1: 0.3, 2: 0.5, 3: 0.8}

RULES = [
    PairRule(),
    PairRule(partial_volume=False),
    PairRule(points="gauss"),
    BallRule(2, 20, outer="vertices"),
    BallRule(3, 5),
]

bodies = st.tuples(
    st.sampled_from([1, 2, 3]),
    st.sampled_from(KINDS),
    st.sampled_from(["constant", "conical", "gaussian"]),
    st.sampled_from([Exponential(1.7, 0.9), Rational(1.7, 0.9), Linear(1.7)]),
    st.sampled_from([None, "smooth"]),
    st.sampled_from(RULES),
    st.booleans(),
    st.booleans(),
    st.integers(0, 2**31),
)


def make(case):
    dim, kind, influence, law, w, rule, kept, compiled, seed = case
    mesh = box(dim, DIVISIONS[dim], kind, seed % 7)
    memory = 1e9 if kept else 0.0  # matrices or measures of bonds kept, or remade at every use
    options = {"rule": rule, "threads": 1, "matrix_memory": memory, "compiled": compiled}
    body = body_on(mesh, HORIZON[dim], law, influence, boundary_function=w, **options)
    return body, mesh, np.random.default_rng(seed)


def brute_energy(mesh, horizon, u, J, f, w=None):
    """The double sum of the paper's energy over ordered pairs, with loops."""
    n, dim = mesh.nvertices, mesh.dim()
    V, h, u = vertex_volumes(mesh), vertex_sizes(mesh), u.reshape(n, dim)
    total = 0.0
    for x, y in itertools.permutations(range(n), 2):
        xi = mesh.p[:, y] - mesh.p[:, x]
        r = np.sqrt(xi @ xi)
        share = np.mean([np.clip((horizon + 0.5 * size - r) / size, 0, 1) for size in (h[x], h[y])])
        strain = (u[y] - u[x]) @ xi / r**2
        weight = V[x] * V[y] * share * (1.0 if w is None else w[x] * w[y])
        total += weight * J(min(r / horizon, 1.0)) * f(r * strain**2)
    return total / (horizon ** (dim + 1) * OMEGA[dim])


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_energy_is_the_double_sum(dim):
    mesh = box(dim, {1: 10, 2: 4, 3: 2}[dim], "random")
    u = np.random.default_rng(0).standard_normal(mesh.nvertices * dim)
    w = np.linspace(0.2, 1.0, mesh.nvertices)
    for name, J in [("constant", lambda s: 1.0), ("conical", lambda s: 1 - s)]:
        body = body_on(mesh, 0.7, Exponential(2.0, 0.7), name, boundary_function=w)
        exact = brute_energy(mesh, 0.7, u, J, lambda q: 0.7 * (1 - np.exp(-2.0 / 0.7 * q)), w)
        assert body.energy(u) == pytest.approx(exact, rel=1e-11)


@settings(max_examples=40, deadline=None)
@given(bodies)
def test_force_is_minus_the_gradient_of_the_energy(case):
    body, _, rng = make(case)
    u, v = 0.3 * rng.standard_normal((2, body.basis.N))
    step = 1e-5
    slope = (body.energy(u + step * v) - body.energy(u - step * v)) / (2 * step)
    scale = np.abs(body.force(u)) @ np.abs(v) + body.energy(u)
    assert -body.force(u) @ v == pytest.approx(slope, abs=1e-7 * scale)


@settings(max_examples=40, deadline=None)
@given(bodies)
def test_tangent_is_the_gradient_of_the_force(case):
    body, _, rng = make(case)
    u, v = 0.3 * rng.standard_normal((2, body.basis.N))
    step = 1e-5
    slope = (body.force(u + step * v) - body.force(u - step * v)) / (2 * step)
    T = body.tangent(u)
    assert -(T @ v) == pytest.approx(slope, abs=1e-7 * np.abs(T @ v).max())
    assert body.tangent_operator(u) @ v == pytest.approx(T @ v, abs=1e-12 * np.abs(T @ v).max())
    assert abs(T - T.T).max() == 0.0


@settings(max_examples=40, deadline=None)
@given(bodies)
def test_stiffness_is_symmetric_positive_and_the_tangent_at_rest(case):
    body, _, rng = make(case)
    K = body.stiffness()
    assert abs(K - K.T).max() == 0.0
    scale = abs(K).max()
    assert abs(K - body.tangent(np.zeros(body.basis.N))).max() <= 1e-14 * scale
    lam = np.linalg.eigvalsh(K.toarray())
    assert lam[0] >= -1e-12 * lam[-1]
    v = rng.standard_normal(body.basis.N)
    assert body.stiffness_operator() @ v == pytest.approx(K @ v, abs=1e-12 * scale * np.abs(v).max())
    tiny = 1e-6 * v
    assert body.energy(tiny) == pytest.approx(0.5 * tiny @ K @ tiny, rel=1e-6)


@settings(max_examples=40, deadline=None)
@given(bodies)
def test_momentum_angular_momentum_and_rigid_motions(case):
    body, mesh, rng = make(case)
    dim = mesh.dim()
    F = body.force(rng.standard_normal(body.basis.N)).reshape(-1, dim)
    scale = np.abs(F).sum() + 1e-300
    assert np.abs(F.sum(axis=0)).max() <= 1e-13 * scale
    moment = np.einsum("ni,jn->ij", F, mesh.p)
    assert np.abs(moment - moment.T).max() <= 1e-13 * scale
    spin = rng.standard_normal((dim, dim))
    rigid = (mesh.p.T @ (spin - spin.T) + rng.standard_normal(dim)).ravel()
    # the strain of a short bond magnifies the round-off of its ends
    shortest = min(np.linalg.norm(xi[xi.any(axis=1)], axis=1).min() for xi in (p.vectors() for p in body.bonds.parts))
    largest = max(float(np.abs(block.strains(body.inward(rigid))).max()) for block in body.blocks)
    assert largest <= 2e-15 * np.abs(rigid).max() / np.sqrt(shortest)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("rule", [*RULES, BallRule(3, 5, symmetric=False)], ids=lambda rule: rule.name)
def test_only_rigid_motions_cost_nothing(dim, kind, rule):
    K = body_on(box(dim, DIVISIONS[dim], kind), HORIZON[dim], rule=rule).stiffness().toarray()
    K = 0.5 * (K + K.T)  # a one-sided rule has the same kernel
    lam = np.linalg.eigvalsh(K)
    assert (lam < 1e-10 * lam[-1]).sum() == dim * (dim + 1) // 2


def test_translation_of_a_piece_is_exactly_free():
    mesh = box(2, 6, "random")
    body = body_on(mesh, 0.4)
    u = at_vertices(mesh, 0.1, -0.7)
    assert body.energy(u) == 0.0
    assert not body.force(u).any()


def test_bits_do_not_depend_on_the_threads(monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.bonds.rule.BLOCK", 500)
    mesh = grid((1, 20), (1, 20))
    u = np.random.default_rng(0).standard_normal(2 * mesh.nvertices)
    results = []
    for threads in (1, 2, 5):
        body = body_on(mesh, 0.2, Exponential(1.0, 1.0), threads=threads)
        assert len(body.blocks) > 8
        results.append((body.energy(u), body.force(u).tobytes(), body.stiffness().data.tobytes()))
    assert results[0] == results[1] == results[2]


def test_blocks_of_any_size_give_the_same_operators(monkeypatch):
    mesh = box(2, 8, "random")
    u = np.random.default_rng(0).standard_normal(2 * mesh.nvertices)
    whole = body_on(mesh, 0.3, Exponential(1.0, 1.0))
    expected = whole.energy(u), whole.force(u), whole.stiffness().toarray()
    monkeypatch.setattr("skfem_peridynamics.bonds.rule.BLOCK", 61)
    parts = body_on(mesh, 0.3, Exponential(1.0, 1.0))
    assert len(parts.blocks) > 10
    assert parts.energy(u) == pytest.approx(expected[0], rel=1e-13)
    assert parts.force(u) == pytest.approx(expected[1], abs=1e-12)
    assert parts.stiffness().toarray() == pytest.approx(expected[2], abs=1e-12)


def test_no_fail_bonds_stay_linear():
    mesh = grid((1, 10))
    law = Exponential(1.0, 1e-6)
    u = at_vertices(mesh, mesh.p[0])
    spared = body_on(mesh, 0.25, law, no_fail=np.arange(11))
    assert spared.energy(u) == pytest.approx(body_on(mesh, 0.25, Linear(1.0)).energy(u), rel=1e-14)
    some = body_on(mesh, 0.25, law, no_fail=[0])
    # by hand: the bonds with an end at vertex 0 are linear, the others are not
    soft, hard = body_on(mesh, 0.25, law), body_on(mesh, 0.25, Linear(1.0))
    bonds = soft.bonds
    touched = (bonds.ends == 0).any(axis=0)
    q = np.linalg.norm(bonds.vectors(), axis=0)
    k = bonds.measure()
    assert some.energy(u) == pytest.approx(
        (k[touched] * q[touched]).sum() + (k[~touched] * law.f(q[~touched])).sum(), rel=1e-13
    )
    assert hard.energy(u) > some.energy(u) > soft.energy(u)
    for bad in ([], [11], [-1], [0.5]):
        with pytest.raises(ValueError, match="no_fail must list vertices, numbers from 0 to 10"):
            body_on(mesh, 0.25, law, no_fail=bad).energy(u)


def test_own_law_runs_through_every_operator():
    class Law:
        f = staticmethod(np.tanh)
        df = staticmethod(lambda q: 1 / np.cosh(q) ** 2)
        d2f = staticmethod(lambda q: -2 * np.tanh(q) / np.cosh(q) ** 2)

    mesh = box(2, 5)
    u, v = np.random.default_rng(0).standard_normal((2, 2 * mesh.nvertices))
    body = body_on(mesh, 0.4, own_potential(Law()))
    step = 1e-6
    assert -body.force(u) @ v == pytest.approx(
        (body.energy(u + step * v) - body.energy(u - step * v)) / (2 * step), rel=1e-6
    )


def test_a_slit_body_has_its_rigid_motions_twice():
    mesh = slit(grid((1, 4), (1, 4)), Crack([[0.0, 0.5], [1.0, 0.5]]))
    lam = np.linalg.eigvalsh(body_on(mesh, 0.4).stiffness().toarray())
    assert (lam < 1e-10 * lam[-1]).sum() == 6


def test_a_vector_of_another_length_is_refused():
    body = body_on(grid((1, 4)), 0.3)
    with pytest.raises(ValueError, match=r"u has shape \(4,\); the basis has 5 degrees of freedom"):
        body.force(np.zeros(4))
    with pytest.raises(ValueError, match="threads = 0"):
        body.with_(threads=0).energy(np.zeros(5))


def test_a_bare_potential_has_no_elastic_constants():
    with pytest.raises(ValueError, match="need a Material"):
        _ = body_on(grid((1, 4)), 0.3).elastic
