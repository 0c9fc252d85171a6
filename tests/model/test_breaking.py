"""Bonds that break for good, and laws that soften in tension only: two engines, energies, three schemes, restarts."""

import math

import numpy as np
import pytest
import skfem

import skfem_peridynamics as peri
from bodies import at_vertices, body_on, box, grid
from skfem_peridynamics import BallRule, Breaking, Exponential, Linear, PairRule, Rational, Scalars, own_potential
from skfem_peridynamics.engine.sparse_engine import SparseEngine
from skfem_peridynamics.material.tension_only import TensionOnly

LAW = Exponential(2.0, 0.5)


def d2f(q):
    return -2 * math.tanh(q) / math.cosh(q) ** 2


OWN = own_potential(Scalars(lambda q: math.tanh(q), lambda q: 1 / math.cosh(q) ** 2, d2f))


class Half:
    """A law that only Python can evaluate."""

    f = staticmethod(lambda q: q / (1 + q))
    df = staticmethod(lambda q: 1 / (1 + q) ** 2)
    d2f = staticmethod(lambda q: -2 / (1 + q) ** 3)


def breaking(mesh, horizon, law=LAW, at=1.5, **options):
    body = body_on(mesh, horizon, law, **options)
    keys = {name: getattr(body, name) for name in ("no_fail", "threads", "compiled", "matrix_memory")}
    return Breaking(body.bonds, law, at=at, **keys)


def bar(at=1.5, law=LAW, **options):
    return breaking(grid((1, 40)), 0.1, law, at, **options)


# ---- the tension switch
@pytest.mark.parametrize("law", [Exponential(2.0, 0.5), Rational(2.0, 0.5), own_potential(Half())])
def test_tension_only_is_the_law_or_the_line(law):
    one, T = TensionOnly.of(law), np.linspace(-3, 3, 241)
    out, pressed = T > 0, T <= 0
    for name in ("energy", "gradient", "hessian", "severity"):
        whole = getattr(one, name)(T)
        assert np.allclose(whole[out], getattr(law, name)(T)[out], rtol=1e-14)
    assert np.allclose(one.energy(T)[pressed], law.slope * T[pressed] ** 2)
    assert (one.severity(T)[pressed] == 0.0).all()
    h = 1e-6
    assert np.allclose((one.energy(T + h) - one.energy(T - h)) / (2 * h), one.gradient(T), atol=1e-8)
    off = np.abs(T) > 1e-3  # at 0 the second derivative is continuous, the third is not
    assert np.allclose((one.gradient(T + h) - one.gradient(T - h))[off] / (2 * h), one.hessian(T)[off], atol=1e-7)
    assert np.allclose(one.secant(T)[off] * T[off], one.gradient(T)[off])
    assert one.inflection == law.inflection
    assert one.suprema[0] == float("inf")
    assert one.suprema[1] == law.suprema[1]
    assert TensionOnly.of(Linear(1.0)) == Linear(1.0)


@pytest.mark.parametrize("law", [Exponential(2.0, 0.5), Rational(2.0, 0.5), OWN, own_potential(Half())])
@pytest.mark.parametrize("rule", [PairRule(), BallRule(3, 8)])
def test_tension_only_in_both_engines(law, rule):
    body = body_on(box(2, 6, "random"), 0.4, TensionOnly.of(law), rule=rule, no_fail=[0])
    sparse = body.with_(compiled=False)
    u = 0.3 * np.random.default_rng(1).standard_normal(body.basis.N)
    assert np.abs(body.force(u) - sparse.force(u)).max() <= 1e-12 * np.abs(sparse.force(u)).max()
    assert body.energy(u) == pytest.approx(sparse.energy(u), rel=1e-12)
    softens = body.with_(material=law)
    assert abs(softens.energy(u) / body.energy(u) - 1.0) > 0.1


def test_pressing_heals_nothing_and_softens_nothing():
    mesh = grid((1, 8), (1, 8))
    for sign, softened in ((1.0, True), (-1.0, False)):
        u = at_vertices(mesh, sign * 3.0 * mesh.p[0], 0.0)
        assert (peri.census(body_on(mesh, 0.3, TensionOnly.of(LAW)), u).softened > 0) is softened
    both = [peri.census(body_on(mesh, 0.3, LAW), at_vertices(mesh, s * mesh.p[0], 0.0)).softened for s in (3.0, -3.0)]
    assert both[0] == both[1] > 0


def test_materials_and_composites_hand_the_switch_on():
    hard = peri.Material.from_elastic(
        lame=1.0, toughness=1.0, density=1.0, plane="strain", compression="elastic", potential="rational"
    )
    law = hard.law(2, 1 / 3)
    assert isinstance(law, TensionOnly)
    assert isinstance(law.law, Rational)
    other = peri.Composite(hard, {"x": hard.with_(lame=3.0)})
    assert isinstance(other.mixed(other.laws(2, 1 / 3), [0, 1]), TensionOnly)
    with pytest.raises(ValueError, match="compression = 'hard' must be one of soften, elastic"):
        hard.with_(compression="hard")


# ---- breaking
def brute_force(body, u, at, broken):
    """Force and energy of bonds one by one, with those broken that are beyond their limit."""
    x, dim = body.bonds.mesh.p.T, body.bonds.dim
    v, F, energy = u.reshape(-1, dim), np.zeros((len(x), dim)), 0.0
    for part in body.bonds.parts:
        s = part.samples
        i, j = s.vertices[part.ends + part.first, 0].T
        k = body.bonds.measure_of(part)
        for a, b, weight in zip(i, j, k, strict=True):
            xi = x[b] - x[a]
            r = np.linalg.norm(xi)
            T = xi @ (v[b] - v[a]) / r**1.5
            if abs(T) > at * body.law.inflection:
                broken.add((a, b))
            if (a, b) in broken:
                continue
            q = np.array([T * T])
            energy += weight * body.law.f(q)[0]
            pull = weight * 2 * T * body.law.df(q)[0] / np.sqrt(r) * xi / r
            F[a] += pull
            F[b] -= pull
    return F.ravel(), energy


@pytest.mark.parametrize("compiled", [True, False])
def test_bonds_break_and_stay_broken(compiled):
    mesh, broken = box(2, 5, "random"), set()
    body = breaking(mesh, 0.45, compiled=compiled)
    rng = np.random.default_rng(3)
    for size in (0.1, 0.3, 0.2, 0.01):
        u = size * rng.standard_normal(body.basis.N)
        F, energy = brute_force(body, u, 1.5, broken)
        assert np.allclose(body.force_and_break(u), F, rtol=1e-11, atol=1e-12 * np.abs(F).max())
        assert body.energy(u) == pytest.approx(energy, rel=1e-11)
        assert np.array_equal(body.force(u), body.force_and_break(u))
        assert body.state.count == len(broken)
        assert peri.census(body, u).broken == len(broken)
    assert 10 < len(broken) < body.bonds.nbonds
    assert body.with_(at=1.5).state.count == 0
    assert body.with_(at=1.5).energy(u) > body.energy(u)


LAWS = {"exponential": LAW, "tension": TensionOnly.of(Rational(2.0, 0.5)), "own": OWN, "python": own_potential(Half())}


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_both_engines_break_the_same(law, dim):
    n, eps = {1: (20, 0.2), 2: (7, 0.4), 3: (4, 0.6)}[dim]
    fast = breaking(box(dim, n, "random"), eps, LAWS[law], no_fail=[0, 1], boundary_function=None)
    slow = fast.with_(compiled=False)
    assert not isinstance(fast.engine, SparseEngine)
    for k in range(3):
        u = 0.2 * np.random.default_rng(k).standard_normal(fast.basis.N)
        a, b = fast.force_and_break(u), slow.force_and_break(u)
        assert np.abs(a - b).max() <= 1e-12 * np.abs(b).max()
        for one, other in zip(fast.state.broken, slow.state.broken, strict=True):
            assert np.array_equal(one, other)
        assert fast.state.energy == pytest.approx(slow.state.energy, rel=1e-12)
        assert np.allclose(peri.damage(fast, u).intact, peri.damage(slow, u).intact)
    assert fast.state.count > 10
    assert (fast.stiffness() != slow.stiffness()).nnz == 0


def test_weights_of_the_bond_list_are_left_alone():
    """Balanced weights are the list's own, and shared: a body that breaks keeps a copy."""
    bonds = body_on(box(2, 6, "random"), 0.4, LAW).bonds.balanced()
    body, u = Breaking(bonds, LAW), 0.5 * np.random.default_rng(0).standard_normal(2 * 49)
    before = [part.weight.copy() for part in bonds.parts]
    whole = peri.Peridynamics(bonds, LAW)
    energy = whole.energy(u)
    body.force_and_break(u)
    assert body.state.count > 100
    assert all(np.array_equal(a, part.weight) for a, part in zip(before, bonds.parts, strict=True))
    assert whole.with_().energy(u) == energy
    assert np.array_equal(body.with_().force(u), whole.force(u))


def test_ball_bonds_break_too():
    body = breaking(grid((1, 6), (1, 6)), 0.4, rule=BallRule(3, 8))
    u = at_vertices(body.bonds.mesh, 3.0 * (body.bonds.mesh.p[0] > 0.5), 0.0)
    body.force_and_break(u)
    assert isinstance(body.engine, SparseEngine)
    assert body.state.count > 10
    assert peri.damage(body, 0 * u).intact.min() < 0.8


def test_damage_of_broken_bonds_stays():
    """Two halves torn apart and closed again: with the paper's law they heal, and here they do not."""
    mesh = grid((1, 10), (1, 10))
    torn = at_vertices(mesh, 0.0, 5.0 * (mesh.p[1] > 0.55))
    softens, breaks = body_on(mesh, 0.3, LAW), breaking(mesh, 0.3, at=3.0)
    breaks.force_and_break(torn)
    for u in (torn, 0 * torn):
        assert np.allclose(peri.damage(breaks, u).intact, peri.damage(softens, torn).intact)
    assert (peri.damage(softens, 0 * torn).intact == 1.0).all()
    assert breaks.energy(torn) < 1e-12
    assert peri.census(breaks, 0 * torn).softened == 0


def test_toughness_of_bonds_that_break():
    """A straight crack, opened far beyond, takes 1 - exp(-at^2 / 2) of what the paper's law takes: F1 at the limit."""
    n, eps = 32, 0.125
    mesh = grid((1, n), (1, n))
    glass = peri.Material.from_elastic(lame=1.0, toughness=1.0, density=1.0, plane="strain")
    bonds = body_on(mesh, eps).bonds
    apart = at_vertices(mesh, 0.0, 1e3 * (mesh.p[1] > 0.51))
    full = peri.census(peri.Peridynamics(bonds, glass), apart).energy_softened
    for at, part in ((1.0, 1 - np.exp(-0.5)), (2.0, 1 - np.exp(-2.0))):
        body, taken = Breaking(bonds, glass, at=at), 0.0
        steps = np.linspace(0.0, 4.1 * at, 401)  # pairs of neighbouring rows, an horizon apart, open a quarter as fast
        for gap in steps * body.law.inflection * np.sqrt(eps):
            body.force_and_break(at_vertices(mesh, 0.0, gap * (mesh.p[1] > 0.51)))
            taken += body.state.energy
        # each is caught at most a hundredth of its way later
        assert taken / full == pytest.approx(part, rel=0.02)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"at": 0.5}, "at = 0.5: bonds break at 1 or more times their critical strain"),
        ({"law": Linear(1.0)}, "a linear law has no critical strain"),
        ({"rule": BallRule(2, 4, symmetric=False)}, "bonds that break need a symmetric rule"),
    ],
)
def test_what_cannot_break(keys, message):
    with pytest.raises(ValueError, match=message):
        bar(**keys)


# ---- the schemes
def pulled(body, speed=4.0):
    """A bar pulled apart at its ends, which are moved."""
    x = body.bonds.mesh.p[0]
    return [
        peri.Prescribed(np.flatnonzero(x < 0.05), displacement=0.0),
        peri.Prescribed(np.flatnonzero(x > 0.95), displacement=lambda t: speed * t**2),
    ]


def test_explicit_balance_over_the_break():
    """Kinetic, elastic, what broke and the work: the balance is that of the leapfrog, second order in dt."""
    off = []
    for dt in (2e-3, 1e-3, 5e-4):
        body = bar(at=1.2)
        mass = peri.mass_matrix(body.basis)
        states = [s.copy() for s in peri.central_difference(body, mass, dt=dt, until=0.5, fixed=pulled(body))]
        last = states[-1]
        assert body.state.count > 5
        assert last.dissipated > 0.1 * last.work
        off.append(max(abs(s.energies.imbalance - s.ripple + s.initial_ripple) for s in states) / last.dissipated)
    assert off[0] < 1e-4  # 2e-5 measured, and 12 times less at a quarter of the step
    assert off[2] < 0.1 * off[0]


def test_what_broke_stays_in_the_ledger():
    body = bar(at=1.2)
    mass = peri.mass_matrix(body.basis)
    s = list(peri.central_difference(body, mass, dt=1e-3, until=0.5, fixed=pulled(body), watch=1))[-1]
    rest = s.energies
    assert rest.dissipated == s.dissipated > 0.0
    assert rest.imbalance == pytest.approx(rest.kinetic + rest.elastic + rest.dissipated - rest.work - rest.initial)


def run_of(scheme, body, **keys):
    mass = peri.mass_matrix(body.basis)
    if scheme == "explicit":
        return peri.central_difference(body, mass, dt=2e-3, until=0.5, fixed=pulled(body), **keys)
    if scheme == "newmark":
        return peri.newmark(body, mass, dt=1e-2, until=0.5, fixed=pulled(body), **keys)
    return peri.static(body, steps=25, until=0.5, fixed=pulled(body), **keys)


@pytest.mark.parametrize("scheme", ["explicit", "newmark", "static"])
def test_schemes_break_and_restart_with_the_same_bits(scheme, tmp_path):
    whole = [s.copy() for s in run_of(scheme, bar(at=1.2))]
    assert len(whole[-1].broken[0]) > 0
    assert whole[-1].dissipated > 0.0
    late = next(k for k, s in enumerate(whole) if len(s.broken[0]))
    for at in (late, late + 1, len(whole) - 2):
        start = whole[at]
        if scheme != "static":
            peri.save_state(tmp_path / "state.npz", start)
            start = peri.load_state(tmp_path / "state.npz")
        other = bar(at=1.2)
        other.force_and_break(at_vertices(other.bonds.mesh, 9.0 * other.bonds.mesh.p[0]))  # it has a past of its own
        again = [s.copy() for s in run_of(scheme, other, start=start)]
        assert np.array_equal(again[-1].u, whole[-1].u)
        assert again[-1].dissipated == whole[-1].dissipated
        # a file knows which bonds are broken, not which was first
        assert [sorted(one) for one in again[-1].broken] == [sorted(one) for one in whole[-1].broken]


def test_implicit_balance_over_the_break():
    """Newmark, second order over the break: 7.7e-4, 1.9e-4 of what broke; 6e-2 with the acceleration of before."""
    off = []
    for dt in (1e-2, 5e-3):
        body = bar(at=1.2)
        s = list(peri.newmark(body, peri.mass_matrix(body.basis), dt=dt, until=0.5, fixed=pulled(body)))[-1]
        assert s.dissipated > 0.1 * s.work
        off.append(abs(s.energies.imbalance) / s.dissipated)
    assert off[0] < 2e-3
    assert off[1] < 0.4 * off[0]


def test_statics_settles_until_nothing_breaks():
    """A plate slit from the left is pulled open: in one step the crack runs, each break loading the next bonds."""
    mesh = peri.slit(grid((1, 12), (1, 12)), peri.Crack([[0.0, 0.5], [0.5, 0.5]]))
    body = breaking(mesh, 0.25, Exponential(2.0, 0.02), at=1.5)
    low, high = (np.flatnonzero(np.abs(mesh.p[1] - y) < 0.05) for y in (0.0, 1.0))
    dofs = [(2 * some[:, None] + [0, 1]).ravel() for some in (low, high)]
    pull = np.tile([0.0, 1.0], len(high))
    fixed = [
        peri.Prescribed(dofs[0], displacement=0.0),
        peri.Prescribed(dofs[1], displacement=lambda t: 0.3 * t * pull),
    ]
    counts = []
    for e in peri.static(body, steps=4, fixed=fixed):
        assert peri.census(body, e.u).Z <= 1.5
        counts.append(body.state.count)
    assert max(np.diff(counts)) > 50
    assert e.elastic < 0.05 * e.work
    e = list(run_of("static", bar(at=1.2)))[-1]
    assert e.elastic < 1e-6 * e.work  # torn
    assert -0.9 * e.work < e.imbalance < 1e-9 * e.work  # what the jump has lost, never gained


def test_a_state_of_another_body():
    body, other = bar(at=1.2), breaking(grid((1, 20)), 0.1)
    with pytest.raises(ValueError, match="the broken bonds of the state to start from are not bonds of this body"):
        other.recall([np.array([10**6])])
    with pytest.raises(ValueError, match="are not bonds of this body"):
        body.recall([np.array([1, 1])])
    body.recall([np.array([3, 1])])
    assert body.state.count == 2
    body.recall(None)
    assert body.state.count == 0
    u = 0.01 * np.random.default_rng(0).standard_normal(body.basis.N)
    assert np.array_equal(body.force(u), peri.Peridynamics(body.bonds, LAW, compiled=body.compiled).with_().force(u))


def test_a_thread_of_any_number_breaks_the_same():
    bodies = [breaking(skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 41)] * 2), 0.1, threads=n) for n in (1, 3)]
    for k in range(3):
        u = 0.03 * np.random.default_rng(k).standard_normal(bodies[0].basis.N)
        one, other = (body.force_and_break(u) for body in bodies)
        assert np.array_equal(one, other)
    assert bodies[0].state.count > 100
    assert [x.tolist() for x in bodies[0].state.broken] == [x.tolist() for x in bodies[1].state.broken]
