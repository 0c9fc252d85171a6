"""Implicit steps against closed forms, dense algebra, the explicit scheme and the energy balance."""

import numpy as np
import pytest

import skfem_peridynamics as peri
from bodies import body_on, box, vector_basis
from skfem_peridynamics.solve.newton import Effort, Objective, _search
from skfem_peridynamics.solve.preconditioner import NAMES, Preconditioner


def small(dim, law, kind="random", n=None, horizon=None):
    body = body_on(box(dim, n or {1: 40, 2: 12, 3: 5}[dim], kind), horizon or {1: 0.1, 2: 0.3, 3: 0.45}[dim], law)
    M = peri.mass_matrix(body.basis)
    return body, M, peri.stable_time_step(body, M)


def last(run):
    *_, state = run
    return state


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_thousand_times_the_explicit_step_keeps_the_energy_of_the_linear_model(dim):
    body, M, limit = small(dim, peri.Linear(1.0))
    u0 = 1e-3 * np.random.default_rng(0).standard_normal(body.basis.N)  # all modes, the stiffest before all
    dt = 1000.0 * limit.dt
    states = [s.energies.total for s in peri.newmark(body, M, u0, dt=dt, until=50 * dt)]
    assert len(states) == 51
    assert max(abs(e / states[0] - 1.0) for e in states) < 1e-12


@pytest.mark.parametrize(("beta", "gamma"), [(0.25, 0.5), (0.3025, 0.6), (1 / 6, 0.5)])
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_the_recursion_is_that_of_the_textbook(beta, gamma, mass):
    """Dense algebra in acceleration form: (M + beta dt^2 K) a1 = b - K u~, and the two updates."""
    body, _, limit = small(2, peri.Linear(1.0), n=4, horizon=0.6)
    M = peri.mass_matrix(body.basis, kind=mass)
    rng = np.random.default_rng(1)
    u, v, b = rng.standard_normal((3, body.basis.N))
    K, D, dt = body.stiffness().toarray(), M.toarray(), 0.7 * limit.dt
    a = np.linalg.solve(D, b - K @ u)
    states = [
        s.copy()
        for s in peri.newmark(
            body, M, u, v, dt=dt, until=5 * dt, beta=beta, gamma=gamma, load=lambda t: (1 + t) * b, tolerance=1e-13
        )
    ]
    for k in range(1, 6):
        ahead = u + dt * v + dt**2 * (0.5 - beta) * a
        a1 = np.linalg.solve(D + beta * dt**2 * K, (1 + k * dt) * b - K @ ahead)
        u, v, a = ahead + beta * dt**2 * a1, v + dt * ((1 - gamma) * a + gamma * a1), a1
        for mine, theirs in ((states[k].u, u), (states[k].v, v), (states[k].a, a)):
            np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())


@pytest.mark.parametrize("kind", NAMES)
@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_every_preconditioner_leads_to_the_same_motion(kind, mass):
    body, M, limit = small(2, peri.Exponential(1.0, 5e-2))
    M = peri.mass_matrix(body.basis, kind=mass)
    u0 = 0.05 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
    ends = peri.Prescribed(body.basis.get_dofs(lambda x: x[0] < 1e-9), displacement=0.0)
    options = {"dt": 5 * limit.dt, "until": 30 * limit.dt, "fixed": [ends], "tolerance": 1e-11}
    mine = last(peri.newmark(body, M, u0, linear=kind, **options))
    other = last(peri.newmark(body, M, u0, linear="blocks", **options))
    assert np.abs(mine.u - other.u).max() < 1e-8 * np.abs(u0).max()
    assert np.abs(mine.u - u0).max() > 0.1 * np.abs(u0).max()


def test_a_lumped_mass_may_be_its_diagonal():
    body, M, limit = small(2, peri.Exponential(1.0, 5e-2))
    u0 = 0.05 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
    one, other = (last(peri.newmark(body, m, u0, dt=limit.dt, until=9 * limit.dt)) for m in (M, M.diagonal()))
    assert np.array_equal(one.u, other.u)
    assert one.energies.total == other.energies.total


def test_it_and_central_difference_come_to_the_same_motion_with_order_two():
    body, M, limit = small(2, peri.Exponential(1.0, 0.5), "structured")
    u0 = 0.05 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
    until = 8.0 * limit.dt
    exact = last(peri.central_difference(body, M, u0, dt=limit.dt / 64, until=until))
    for scheme in (peri.newmark, peri.central_difference):
        errors = [np.abs(last(scheme(body, M, u0, dt=limit.dt / n, until=until)).u - exact.u).max() for n in (2, 4, 8)]
        orders = np.log2(np.array(errors[:-1]) / errors[1:])
        assert ((orders > 1.85) & (orders < 2.2)).all(), (scheme.__name__, errors)


def test_gamma_above_a_half_damps_and_is_of_first_order():
    body, M, limit = small(1, peri.Linear(1.0), "structured")
    u0 = np.cos(np.pi * body.bonds.mesh.p[0])
    rough = 1e-3 * np.random.default_rng(0).standard_normal(body.basis.N)
    run = peri.newmark(body, M, rough, dt=50 * limit.dt, until=5000 * limit.dt, beta=0.3025, gamma=0.6)
    energies = [s.energies.total for s in run]
    assert energies[-1] < 1e-2 * energies[0]
    until = 16 * limit.dt
    exact = last(peri.central_difference(body, M, u0, dt=limit.dt / 64, until=until))
    errors = [
        np.abs(last(peri.newmark(body, M, u0, dt=limit.dt / n, until=until, beta=0.3025, gamma=0.6)).u - exact.u).max()
        for n in (4, 8, 16)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert ((orders > 0.85) & (orders < 1.25)).all(), errors


@pytest.mark.parametrize("mass", ["lumped", "consistent"])
def test_prescribed_motion_and_load_keep_the_books(mass):
    """Work of loads and of reactions: what is missing falls with dt^2."""
    body, M, limit = small(2, peri.Linear(1.0), "structured")
    M = peri.mass_matrix(body.basis, kind=mass)
    p = body.bonds.mesh.p
    left, right = np.flatnonzero(p[0] < 1e-9), np.flatnonzero(p[0] > 1 - 1e-9)
    T = 40.0 * limit.dt
    pulled = peri.Prescribed(2 * right, displacement=lambda t: 0.01 * np.sin(0.5 * np.pi * t / T) ** 2)
    held = peri.Prescribed(np.r_[2 * left, 2 * left + 1], displacement=0.0)
    b = 1e-3 * M.diagonal() * np.tile([0.0, 1.0], body.bonds.mesh.nvertices)
    off = []
    for n in (1, 2, 4):
        state = last(
            peri.newmark(body, M, dt=limit.dt / n, until=T, fixed=[held, pulled], load=lambda t: np.sin(t / T) * b)
        )
        assert state.t == pytest.approx(T)
        np.testing.assert_allclose(state.u[2 * right], 0.01, rtol=1e-12)
        assert (state.u[held.dofs] == 0.0).all()
        off.append(abs(state.energies.imbalance) / state.energies.total)
    assert off[0] < 1e-4
    assert 3.0 < off[0] / off[1] < 5.0
    assert 3.0 < off[1] / off[2] < 5.0


def test_a_run_continues_with_the_same_bits():
    body, M, limit = small(2, peri.Linear(1.0))
    u0 = 1e-3 * np.random.default_rng(0).standard_normal(body.basis.N)
    dt = 20 * limit.dt
    states = [s.copy() for s in peri.newmark(body, M, u0, dt=dt, until=10 * dt)]
    again = last(peri.newmark(body, M, dt=dt, until=10 * dt, start=states[4]))
    for name in ("u", "v", "a", "t", "step", "work"):
        assert np.array_equal(getattr(again, name), getattr(states[-1], name)), name


def test_a_step_that_fails_is_cut_and_grows_again():
    """Newton's method is kept to fewer iterations than a sudden blow takes, at the whole step."""
    body, M, limit = small(2, peri.Exponential(1.0, 1e-4), n=8)
    p = body.bonds.mesh.p
    b = 0.05 * M.diagonal() * np.tile([1.0, 0.0], len(p[0])) * np.repeat(np.where(p[0] > 0.5, 1.0, -1.0), 2)
    dt = 20 * limit.dt

    def blow(t):
        return b * (1.0 if t < 2.5 * dt else 0.0)

    import skfem_peridynamics.solve.newmark as module

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_MOST", 7)
        steps = [(s.t / dt, s.dt / dt) for s in peri.newmark(body, M, dt=dt, until=12 * dt, load=blow)]
    times, sizes = np.array(steps).T
    assert sizes.min() < 1.0
    assert sizes[np.argmin(sizes) :].max() > sizes.min()
    np.testing.assert_allclose(np.diff(times), sizes[1:], rtol=1e-12)
    assert times[-1] == pytest.approx(12.0)


def test_no_way_out_is_said_with_the_last_state():
    body, M, limit = small(1, peri.Exponential(1.0, 1e-4))
    u0 = 0.1 * np.sin(7 * body.bonds.mesh.p[0])
    run = peri.newmark(body, M, u0, dt=limit.dt, until=10 * limit.dt, tolerance=1e-9)
    assert next(run).step == 0
    import skfem_peridynamics.solve.newmark as module

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_MOST", 0)
        with pytest.raises(
            peri.NotConverged, match=r"the step at t = 0 was cut from .* to .*, and still: Newton"
        ) as it:
            next(run)
    assert it.value.state.step == 0
    np.testing.assert_array_equal(it.value.state.u, u0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"beta": 0.0}, "beta = 0.0 must be positive; central_difference is the method of beta = 0"),
        ({"gamma": 0.4}, "gamma = 0.4 must be at least 1/2: with less, every motion grows"),
        ({"dt": 0.0}, "dt = 0.0 must be a positive time"),
        ({"until": np.nan}, "until = nan must be a finite number"),
        ({"tolerance": 2.0}, "tolerance = 2.0 must be between 0 and 1"),
        ({"linear": "ilu"}, "linear = 'ilu' must be one of auto, blocks, amg, direct"),
        ({"u0": np.zeros(2)}, r"u0 has shape \(2,\); the body has 41 degrees of freedom"),
    ],
)
def test_arguments_that_make_no_sense(change, said):
    body, M, _ = small(1, peri.Linear(1.0))
    with pytest.raises(ValueError, match=said):
        peri.newmark(body, M, **({"dt": 0.1, "until": 1.0} | change))


def test_a_one_sided_rule_is_refused():
    body = body_on(box(1, 20), 0.2, rule=peri.BallRule(3, 1, symmetric=False))
    for scheme in (
        lambda: peri.newmark(body, peri.mass_matrix(body.basis), dt=0.1, until=1.0),
        lambda: peri.static(body, steps=1),
    ):
        with pytest.raises(ValueError, match="its force is the gradient of no energy"):
            scheme()


@pytest.mark.parametrize("rule", [peri.PairRule(), peri.PairRule(points="gauss"), peri.BallRule(3, 8)])
def test_objective_against_difference_quotients(rule):
    body = body_on(box(2, 4, "random"), 0.5, peri.Rational(1.0, 1e-2), rule=rule)
    size = body.basis.N
    rng = np.random.default_rng(3)
    u, centre, b = 0.05 * rng.standard_normal((3, size))
    from skfem_peridynamics.solve.mass_solver import mass_solver

    mass = mass_solver(peri.mass_matrix(body.basis, kind="consistent"), np.empty(0, dtype=np.int64))
    free = np.arange(3, size)
    objective = Objective(body, free, np.ones(size), b, 7.0, mass, centre)
    d = np.zeros(size)
    d[free] = rng.standard_normal(len(free))
    step = 1e-5
    there, here = (objective.value(u + sign * step * d)[0] for sign in (1, -1))
    g, _ = objective.gradient(u)
    assert (there - here) / (2 * step) == pytest.approx(g @ d[free], rel=1e-6)
    slopes = [objective.gradient(u + sign * step * d)[0] for sign in (1, -1)]
    np.testing.assert_allclose(
        (slopes[0] - slopes[1]) / (2 * step), objective.hessian(u)(d[free]), rtol=0, atol=1e-5 * np.abs(g).max() * 50
    )


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["blocks", "amg", "direct"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_preconditioners_are_symmetric_positive_and_near_the_inverse(kind, dim):
    body, M, limit = small(dim, peri.Linear(1.0), n={1: 30, 2: 8, 3: 4}[dim])
    N = body.basis.N
    free = np.arange(2 * dim - 1, N)  # a vertex is prescribed, and all but one component of another
    shift = 4.0 / (10 * limit.dt) ** 2
    inverse = Preconditioner(body, M, free, kind).at(shift)
    P = np.stack([inverse @ e for e in np.eye(len(free))], axis=1)
    A = (body.stiffness() + shift * M).toarray()[np.ix_(free, free)]
    assert np.abs(P - P.T).max() < 1e-6 * np.abs(P).max()
    lam = np.linalg.eigvals(P @ A).real
    assert lam.min() > 0.0
    condition = lam.max() / lam.min()
    if kind == "direct":
        assert condition < 1 + 1e-8
    else:
        assert condition < 0.7 * np.linalg.cond(A)  # 0.02 to 0.6 seen


@pytest.mark.parametrize("compiled", [False, True])
def test_a_step_stops_before_bonds_that_hold_come_near_breaking(compiled):
    law = peri.Exponential(1.0, 1e-3)
    body = body_on(box(1, 10), 0.1, law, rule=peri.PairRule(partial_volume=False), compiled=compiled)
    objective = Objective(body, np.arange(1, 11), np.ones(11))
    x = body.bonds.mesh.p[0]
    # T = sqrt(r) S: a stretch by s strains all bonds by s
    assert objective.reach(0 * x, x[1:]) == pytest.approx(0.7 * law.inflection / np.sqrt(0.1), rel=1e-12)
    slow = objective.reach(0 * x, 1e-4 * x[1:])  # of a direction in which nothing moves by its critical strain
    assert slow == pytest.approx(0.7e4 * law.inflection / np.sqrt(0.1), rel=1e-12)
    torn = np.where(x > 0.55, 1.0, 0.0)  # one bond is far beyond breaking, and may go on
    assert objective.reach(torn, torn[1:]) == np.inf
    assert objective.reach(0 * x, torn[1:]) == pytest.approx(0.7 * law.inflection * 0.1 / np.sqrt(0.1), rel=1e-9)
    linear = body_on(box(1, 10), 0.1, compiled=compiled)
    assert Objective(linear, np.arange(1, 11), np.ones(11)).reach(0 * x, x[1:]) == np.inf


@pytest.mark.parametrize(("reach", "length"), [(5.0, 4.0), (4.0, 4.0), (3.9, 2.0), (0.5, 0.5)])
def test_where_the_curvature_is_negative_a_step_doubles_within_its_reach(reach, length):
    """Down ``-x - x^2/2``, which has no end."""

    class Hill:
        free = np.array([0])

        def value(self, u):
            return float(-u[0] - u[0] ** 2 / 2), float(abs(u[0]) + u[0] ** 2 / 2)

        def gradient(self, u):
            return -1.0 - u, np.ones(3)

    effort = Effort()
    u, value, *_ = _search(Hill(), np.zeros(1), np.ones(1), -1.0, 0.0, 0.0, True, reach, effort)
    assert u[0] == length
    assert value == -length - length**2 / 2
    u, *_ = _search(Hill(), np.zeros(1), np.ones(1), -1.0, 0.0, 0.0, False, reach, effort)
    assert u[0] == min(1.0, reach)  # not looked for where the curvature is not


@pytest.mark.parametrize("beta", [1 / 12, 1 / 6, 0.25])
def test_the_swing_of_a_linear_energy_is_half_the_lag_of_its_accelerations(beta):
    """``(1/4 - beta)/2 dt^2 a.M a`` for gamma = 1/2: nothing for the rule that keeps the energy."""
    body, M, limit = small(2, peri.Linear(1.0), n=4)
    u = 1e-3 * np.random.default_rng(0).standard_normal(body.basis.N)
    dt = 0.5 * limit.dt
    state = next(peri.newmark(body, M, u, dt=dt, until=dt, beta=beta, gamma=0.5))
    a = np.linalg.solve(M.toarray(), -(body.stiffness() @ u))
    expected = 0.5 * (0.25 - beta) * dt**2 * float(a @ (M @ a))
    assert state.initial_ripple == pytest.approx(expected, rel=1e-9, abs=1e-15 * state.initial)


def test_the_entries_of_a_stiffness_are_counted_by_its_bonds():
    """Two blocks a pair; the diagonal blocks of the matrix come on top, and bonds along an axis fill a quarter."""
    body = body_on(box(2, 8, "random"), 0.3, peri.Linear(1.0), rule=peri.PairRule(partial_volume=False))
    entries = Preconditioner(body, None, np.arange(body.basis.N))._entries()
    assert entries == 8 * body.bonds.nbonds
    along = sum(int((part.vectors() == 0.0).any(axis=1).sum()) for part in body.bonds.parts)
    assert entries == body.stiffness().nnz - 4 * body.bonds.mesh.nvertices + 6 * along


def test_a_step_that_is_too_long_goes_back_to_the_lowest_point_of_its_parabola():
    """``-x + x^2 / 0.6`` is lowest at 0.3: found from the values at 0 and 1 and the slope."""

    class Valley:
        free = np.array([0])

        def value(self, u):
            return float(-u[0] + u[0] ** 2 / 0.6), 1.0

        def gradient(self, u):
            return -1.0 + u / 0.3, np.ones(3)

    effort = Effort()
    u, *_ = _search(Valley(), np.zeros(1), np.ones(1), -1.0, 0.0, 0.0, False, np.inf, effort)
    assert u[0] == pytest.approx(0.3, rel=1e-14)
    assert effort.evaluations == 2


def test_forces_are_compared_as_they_are_over_stiffness_and_over_its_root():
    body = body_on(box(1, 2), 0.9)
    force, stiffness = np.array([3.0, 8.0, 0.0]), np.array([9.0, 4.0, 1.0])
    found = Objective(body, np.arange(3), stiffness)._sizes(force, stiffness)
    np.testing.assert_allclose(found, [np.sqrt(73.0), np.sqrt(1.0 + 16.0), np.sqrt(1.0 / 9.0 + 4.0)])


def test_a_direction_of_negative_curvature_goes_down():
    """An indefinite matrix by hand: from the first direction, and after some that are not."""
    from scipy.sparse.linalg import aslinearoperator

    from skfem_peridynamics.solve.newton import _descend

    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.standard_normal((8, 8)))[0]
    for lam in (np.r_[np.linspace(1, 2, 7), -1.0], -np.ones(8)):
        A = Q @ np.diag(lam) @ Q.T
        g = rng.standard_normal(8)
        effort = peri.Effort()
        d, negative, products = _descend(
            lambda x, A=A: A @ x, g, aslinearoperator(np.eye(8)), np.ones(8), 1e-10, effort
        )
        assert negative
        assert effort.negative == 1
        assert products == effort.products <= 8
        assert g @ d < 0.0
        assert d @ A @ d < 0.0 or lam[0] > 0.0
    d, negative, _ = _descend(lambda x: 2.0 * x, g, aslinearoperator(np.eye(8)), np.ones(8), 1e-10, effort)
    assert not negative
    np.testing.assert_allclose(d, -g / 2.0, rtol=1e-12)


@pytest.mark.parametrize("strained", [False, True])
def test_a_stiff_part_does_not_drift_and_a_soft_one_does_not_hide(strained):
    """Contrast 1e8, blocks of vertices: the criterion decides, not the factor. At rest under a load, or strained."""
    mesh = box(1, 40, "random")
    middle = mesh.p[0, mesh.t].mean(axis=0)
    mesh = mesh.with_subdomains({"stiff": np.flatnonzero(np.floor(4 * middle) % 2 == 1)})
    soft = peri.Material.from_elastic(lame=1.0, density=1.0, potential="linear")
    both = peri.Composite(soft, {"stiff": soft.with_(lame=1e8)})
    body = peri.Peridynamics(peri.BondBasis(vector_basis(mesh), 0.1), both)
    M = peri.mass_matrix(body.basis)
    x = mesh.p[0]
    u0 = np.where(np.floor(4 * x) % 2 == 1, 0.0, 1e-3 * np.sin(40 * x)) if not strained else 1e-3 * np.sin(3 * x)
    b = M.diagonal() * np.cos(np.pi * x)
    ends = [
        last(peri.newmark(body, M, u0, dt=0.01, until=0.03, load=lambda t: b, linear=kind)).u
        for kind in ("direct", "blocks")
    ]
    assert np.abs(ends[0] - ends[1]).max() < 1e-3 * np.abs(ends[0]).max()


def test_the_choice_of_a_preconditioner():
    body, M, limit = small(2, peri.Linear(1.0))
    free = np.arange(body.basis.N)
    import skfem_peridynamics.solve.preconditioner as module

    def chosen(body, factor):
        shift = 0.0 if np.isinf(factor) else 4.0 / (factor * limit.dt) ** 2
        return Preconditioner(body, M, free)._chosen(shift)

    assert chosen(body, 10.0) == "direct"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "FACTOR_ENTRIES", 10.0)
        assert chosen(body, 10.0) == "blocks"
        assert chosen(body, 100.0) == "amg"
        assert chosen(body, np.inf) == "amg"
        assert chosen(body.with_(matrix_memory=1e3), 100.0) == "blocks"


def test_nothing_is_loaded_that_a_run_does_not_use():
    import subprocess
    import sys

    code = (
        "import sys, numpy as np, skfem, skfem_peridynamics as peri\n"
        "basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 41)), skfem.ElementVector(skfem.ElementLineP1()))\n"
        "body = peri.Peridynamics(peri.BondBasis(basis, 0.1), peri.Linear(1.0), compiled=False)\n"
        "M = peri.mass_matrix(basis)\n"
        "u0 = np.cos(basis.mesh.p[0])\n"
        "run = (lambda **o: list(peri.newmark(body, M, u0, dt=0.1, until=0.2, **o)))\n"
        "run(); assert 'pyamg' not in sys.modules\n"
        "run(linear='blocks'); assert 'pyamg' not in sys.modules\n"
        "run(linear='amg'); assert 'pyamg' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_work_is_counted():
    body, M, limit = small(2, peri.Linear(1.0))
    effort = peri.Effort()
    u0 = np.random.default_rng(0).standard_normal(body.basis.N)
    list(peri.newmark(body, M, u0, dt=limit.dt, until=3 * limit.dt, effort=effort, linear="direct"))
    assert (effort.iterations, effort.negative) == (3, 0)  # a linear step is one iteration
    assert effort.products == 3  # and with a factor one product
