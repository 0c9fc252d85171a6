from collections import deque

import numpy as np
import pytest
from scipy.linalg import eigh

from bodies import at_vertices, body_on, box, grid, vector_basis
from skfem_peridynamics import (
    BallRule,
    Exponential,
    Linear,
    Prescribed,
    Rational,
    UnstableRun,
    body_force,
    central_difference,
    discrete_energy,
    load_state,
    mass_matrix,
    save_state,
    stable_time_step,
)


class Spring:
    """One degree of freedom, u'' = -u + load."""

    def force(self, u):
        return -u

    def energy(self, u):
        return 0.5 * float(u @ u)


def last(states):
    return deque(states, maxlen=1).pop()


def test_first_step_and_recursion_are_the_papers():
    body = body_on(box(2, 5, "random"), 0.45, Exponential(1.0, 1.0))
    M = mass_matrix(body.basis)
    m, rng, dt = M.diagonal(), np.random.default_rng(0), 0.05
    u0, v0 = 0.1 * rng.standard_normal((2, body.basis.N))
    b = [rng.standard_normal(body.basis.N) * 1e-3 for _ in range(8)]
    run = central_difference(body, M, u0, v0, dt=dt, until=6 * dt, load=lambda t: b[round(t / dt)])
    states = [state.copy() for state in run]
    u = [s.u for s in states]
    assert [s.step for s in states] == list(range(7))
    # (u1 - u0) / dt^2 = 1/2 a0 + v0 / dt; (u2 - 2 u1 + u0) / dt^2 = a1, ...
    assert u[1] == pytest.approx(u0 + dt * v0 + dt**2 / 2 * (body.force(u0) + b[0]) / m, rel=1e-12, abs=1e-14)
    for k in range(1, 6):
        expected = 2 * u[k] - u[k - 1] + dt**2 * (body.force(u[k]) + b[k]) / m
        assert u[k + 1] == pytest.approx(expected, rel=1e-11, abs=1e-14)
        assert states[k].v == pytest.approx((u[k + 1] - u[k - 1]) / (2 * dt), abs=1e-11)


def test_second_order_in_time():
    def error(n):
        s = last(
            central_difference(
                Spring(),
                np.ones(1),
                np.ones(1),
                0.3 * np.ones(1),
                dt=2.0 / n,
                until=2.0,
                load=lambda t: np.array([np.sin(2 * t)]),
            )
        )
        # u'' + u = sin 2t: u = A cos t + B sin t - sin(2 t) / 3
        B = 0.3 + 2 / 3
        exact_u = np.cos(2) + B * np.sin(2) - np.sin(4) / 3
        exact_v = -np.sin(2) + B * np.cos(2) - 2 / 3 * np.cos(4)
        return abs(s.u[0] - exact_u), abs(s.v[0] - exact_v), abs(s.energies.imbalance)

    ns = np.array([20, 40, 80, 160])
    for errors in np.array([error(n) for n in ns]).T:
        assert -np.polyfit(np.log(ns), np.log(errors), 1)[0] == pytest.approx(2.0, abs=0.01)  # 1.998 to 2.001


def small_body(law, seed=0):
    body = body_on(box(2, 6, "random", seed), 0.4, law)
    M = mass_matrix(body.basis)
    u0 = 1e-3 * np.random.default_rng(seed).standard_normal(body.basis.N)
    return body, M, u0


def test_linear_model_keeps_the_discrete_energy_for_ten_thousand_steps():
    body, M, u0 = small_body(Linear(1.0))
    limit, K = stable_time_step(body, M), body.stiffness()
    assert limit.products == 0  # the exact spectrum: 0.99 of it is 0.99 of the truth
    energies, positive = [], []
    for state in central_difference(body, M, u0, dt=0.99 * limit.dt, until=10_000 * 0.99 * limit.dt, watch=0):
        if state.step % 100 == 0:
            energies.append(discrete_energy(K, M, state))
            rate = state.v + 0.5 * state.dt * state.a
            positive.append(rate @ (M @ rate) - state.dt**2 / 4 * rate @ (K @ rate))
    assert state.step == 10_000
    spread = np.ptp(energies) / energies[0]
    print(f"discrete energy over 10,000 steps at 0.99 of the limit: relative spread {spread:.1e}")
    assert spread < 1e-10
    assert min(positive) >= 0.0
    # the form with the three terms is the same number
    u1 = state.u + state.dt * rate
    bar = 0.5 * (u1 + state.u)
    three = 0.5 * (rate @ (M @ rate) - state.dt**2 / 4 * rate @ (K @ rate) + bar @ (K @ bar))
    assert three == pytest.approx(energies[-1], rel=1e-9)


def test_linear_model_beyond_the_limit_stops_and_says_so():
    body, M, u0 = small_body(Linear(1.0))
    limit = stable_time_step(body, M)
    run = central_difference(body, M, u0, dt=1.01 * limit.dt, until=1e4 * limit.dt, limit=limit)
    with pytest.raises(UnstableRun) as caught:
        last(run)
    message = str(caught.value)
    step = int(message.split("by step ")[1].split()[0])
    assert step <= 1000
    assert f"dt = {1.01 * limit.dt:.6g}, which is 1.01 times the stable limit {limit.dt:.6g}" in message
    # amplification itself, without the watch
    grown = [
        np.abs(s.u).max() for s in central_difference(body, M, u0, dt=1.01 * limit.dt, until=300 * limit.dt, watch=0)
    ]
    assert grown[-1] > 1e6 * grown[0]


@pytest.mark.parametrize("factor", [1.005, 1.01, 1.05])
def test_nonlinear_model_beyond_the_limit_is_caught_by_its_energy_balance(factor):
    """Forces are bounded, so nothing overflows; but small waves grow until bonds soften, on energy nobody put in."""
    body, M, u0 = small_body(Exponential(1.0, 1.0))
    limit = stable_time_step(body, M)
    with pytest.raises(UnstableRun, match=r"its energy is .* was put in; .* Take a smaller dt"):
        last(central_difference(body, M, u0, dt=factor * limit.dt, until=1000 * limit.dt, limit=limit))


@pytest.mark.parametrize("law", [Linear(1.0), Exponential(1.0, 1e-2)])
@pytest.mark.parametrize("factor", [0.9, 0.99, 0.995])
def test_rough_but_stable_runs_raise_no_alarm(law, factor):
    """White noise: half of the energy sits in modes that the step barely resolves, and ripples."""
    body, M, u0 = small_body(law)
    limit = stable_time_step(body, M)
    worst = 0.0
    for state in central_difference(body, M, u0, dt=factor * limit.dt, until=2000 * limit.dt, limit=limit, watch=1):
        worst = max(worst, abs(state.energies.imbalance) / state.initial)
    assert worst > 0.1  # the plain balance alone would have cried wolf


def test_the_ripple_of_a_linear_run_is_exactly_its_imbalance():
    body, M, u0 = small_body(Linear(1.0))
    limit, load = stable_time_step(body, M), np.full(body.basis.N, 1e-6)
    for state in central_difference(body, M, u0, dt=0.99 * limit.dt, until=500 * limit.dt, load=lambda t: load):
        off = state.energies.imbalance - (state.ripple - state.initial_ripple)
        assert abs(off) < 1e-12 * state.energies.total


def test_a_balance_that_nonlinear_motion_breaks_is_caught():
    """So brittle that bonds meet again and again within a step: below the linear limit, and still wrong."""
    body = body_on(box(2, 8, "random"), 0.4, Exponential(1.0, 1e-3))
    M = mass_matrix(body.basis)
    u0 = 1e-2 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
    limit = stable_time_step(body, M)
    with pytest.raises(UnstableRun, match="the energy balance is off by"):
        last(central_difference(body, M, u0, dt=0.95 * limit.dt, until=500 * limit.dt, limit=limit))


def test_a_body_without_energy_is_watched_for_numbers():
    class Runaway:
        def force(self, u):
            return 1e200 * (1.0 + u)

    run = central_difference(Runaway(), np.ones(1), dt=1.0, until=50.0, watch=1)
    with pytest.raises(UnstableRun, match="velocities are no longer finite"), np.errstate(all="ignore"):
        last(run)


@pytest.mark.parametrize("dim", [1, 2])
def test_work_of_loads_and_of_prescribed_motions_balances_the_energy(dim):
    mesh = grid(*((1.0, 10),) * dim) if dim == 1 else grid((1.0, 8), (1.0, 8)).with_defaults()
    body = body_on(mesh, 0.3, Exponential(1.0, 0.5))
    M = mass_matrix(body.basis)
    left, right = (np.flatnonzero(np.isclose(mesh.p[0], x)) for x in (0.0, 1.0))
    fixed = [
        Prescribed(left * dim, displacement=0.0),
        Prescribed(right * dim, displacement=lambda t: 0.05 * np.sin(2 * t) ** 2),
    ]
    load = 0.02 * body_force(body.basis, [1.0] * dim)

    def drift(n):
        worst = 0.0
        for state in central_difference(body, M, dt=1.0 / n, until=2.0, load=lambda t: np.cos(t) * load, fixed=fixed):
            worst = max(worst, abs(state.energies.imbalance))
        return worst / state.energies.total, state

    ns = np.array([40, 80, 160])
    drifts, states = zip(*(drift(n) for n in ns), strict=True)
    assert drifts[-1] < 1e-3
    assert -np.polyfit(np.log(ns), np.log(drifts), 1)[0] == pytest.approx(2.0, abs=0.01)  # 2.000
    state = states[-1]
    assert abs(state.energies.work) > 10 * drifts[-1] * state.energies.total
    assert state.u[right * dim] == pytest.approx(0.05 * np.sin(2 * state.t) ** 2, rel=1e-9)
    assert (state.u[left * dim] == 0.0).all()


def test_prescribed_velocity_moves_by_its_integral():
    body = body_on(grid((1.0, 10)), 0.3)
    M = mass_matrix(body.basis)
    fixed = [Prescribed([10], velocity=lambda t: 3 * t**2)]
    state = last(central_difference(body, M, dt=0.01, until=0.5, fixed=fixed))
    assert state.u[10] == pytest.approx(0.5**3, rel=1e-3)  # midpoint rule, dt^2 / 4 of t^2
    assert state.v[10] == pytest.approx(3 * 0.25, rel=1e-3)
    steady = last(central_difference(body, M, dt=0.01, until=0.5, fixed=[Prescribed([0, 10], velocity=[1.0, 2.0])]))
    assert steady.u[[0, 10]] == pytest.approx([0.5, 1.0], rel=1e-12)


def test_drop_in_dofs_of_scikit_fem():
    basis = vector_basis(grid((1.0, 4), (1.0, 4)).with_defaults())
    assert Prescribed(basis.get_dofs("left"), displacement=0.0).dofs.tolist() == basis.get_dofs("left").all().tolist()
    assert len(Prescribed(basis.get_dofs("left").all("u^1"), displacement=0.0).dofs) == 5


def test_continuing_gives_the_same_bits(tmp_path):
    body, M, u0 = small_body(Exponential(1.0, 1e-4))
    limit = stable_time_step(body, M)
    options = {
        "dt": 0.9 * limit.dt,
        "load": lambda t: np.full(body.basis.N, 1e-4 * t),
        "fixed": [Prescribed([0, 1], displacement=0.0)],
    }
    whole = last(central_difference(body, M, u0, until=50 * limit.dt, **options)).copy()
    for state in central_difference(body, M, u0, until=50 * limit.dt, **options):
        if state.step == 20:
            kept = state.copy()
    rest = last(central_difference(body, M, until=50 * limit.dt, start=kept, **options))
    assert rest.step == whole.step
    assert rest.u.tobytes() == whole.u.tobytes()
    assert rest.v.tobytes() == whole.v.tobytes()
    assert rest.work == whole.work
    save_state(tmp_path / "kept.npz", kept)
    stored = load_state(tmp_path / "kept.npz")
    assert (
        last(central_difference(body, M, until=50 * limit.dt, start=stored, **options)).u.tobytes() == whole.u.tobytes()
    )
    (tmp_path / "kept.npz").write_bytes((tmp_path / "kept.npz").read_bytes()[:-200])
    with pytest.raises(ValueError, match="is not a state that save_state wrote"):
        load_state(tmp_path / "kept.npz")
    with pytest.raises(ValueError, match="the state to start from was made with dt"):
        last(central_difference(body, M, dt=0.5 * limit.dt, until=1.0, start=kept))


def test_states_are_read_only_views_and_copies_are_kept():
    run = central_difference(Spring(), np.ones(1), np.ones(1), dt=0.1, until=1.0)
    first = next(run)
    kept = first.copy()
    with pytest.raises(ValueError, match="read-only"):
        first.u[0] = 1.0
    next(run)
    assert kept.u[0] == 1.0
    assert first.u[0] != 1.0  # a view moves on


def test_momentum_of_a_free_body_is_kept():
    body, M, u0 = small_body(Exponential(1.0, 1e-6))
    v0 = at_vertices(body.bonds.mesh, 1.0, -2.0)
    limit = stable_time_step(body, M)
    state = last(central_difference(body, M, u0, v0, dt=0.9 * limit.dt, until=500 * limit.dt))
    momentum = (M @ state.v).reshape(-1, 2).sum(axis=0)
    assert momentum == pytest.approx([1.0, -2.0], rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"dt": 0.0}, "dt = 0.0 must be a positive time"),
        ({"dt": np.nan}, "dt = nan must be"),
        ({"until": np.inf}, "until = inf must be a time"),
        ({"u0": np.array([0.0, np.nan])}, r"u0\[1\] = nan is not finite \(1 of 2 values are not\)"),
        ({"v0": np.array([np.inf, 0.0])}, r"v0\[0\] = inf is not finite"),
        ({"u0": np.zeros(3)}, r"u0 has shape \(3,\); the body has 2 degrees of freedom"),
        (
            {"fixed": [Prescribed([5], displacement=0.0)]},
            "a prescribed degree of freedom, 5, is not among the 2",
        ),
        (
            {"fixed": [Prescribed([0], displacement=0.0), Prescribed([0, 1], velocity=0.0)]},
            "degree of freedom 0 is prescribed twice",
        ),
    ],
)
def test_arguments_that_make_no_sense(changes, message):
    good = {"dt": 0.1, "until": 1.0}
    with pytest.raises(ValueError, match=message):
        last(central_difference(Spring(), np.ones(2), **(good | changes)))


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"dofs": [], "displacement": 0.0}, "is an empty set"),
        ({"dofs": [0.5], "displacement": 0.0}, "must be an index array"),
        ({"dofs": [0]}, "one of displacement and velocity, not both and not none"),
        ({"dofs": [0], "displacement": 0.0, "velocity": 0.0}, "one of displacement and velocity"),
    ],
)
def test_prescribed_motions_that_are_none(keys, message):
    with pytest.raises(ValueError, match=message):
        Prescribed(**keys)


def test_a_motion_that_is_not_finite_is_named_with_its_time():
    run = central_difference(
        Spring(),
        np.ones(1),
        dt=0.1,
        until=1.0,
        fixed=[Prescribed([0], displacement=lambda t: np.log(0.5 - t))],
    )
    with pytest.raises(ValueError, match="not finite at t = 0.5"), np.errstate(all="ignore"):
        last(run)


def test_a_load_may_fill_the_same_array_each_time():
    buffer = np.zeros(1)

    def inplace(t):
        buffer[0] = np.sin(3 * t)
        return buffer

    one, two = (
        last(central_difference(Spring(), np.ones(1), dt=0.05, until=20.0, load=load))
        for load in (inplace, lambda t: np.array([np.sin(3 * t)]))
    )
    assert one.work == two.work
    assert one.u[0] == two.u[0]


@pytest.mark.parametrize(
    ("load", "message"),
    [
        (lambda t: np.zeros((2, 1)), r"load\(0\) has shape \(2, 1\); the body has 2"),
        (lambda t: 1.0, r"load\(0\) has shape \(\)"),
        (lambda t: np.array([0.0, np.nan if t > 0.45 else 0.0]), r"load\(0.5\)\[1\] = nan is not finite \(1 of 2 "),
    ],
)
def test_loads_that_are_none(load, message):
    with pytest.raises(ValueError, match=message):
        last(central_difference(Spring(), np.ones(2), dt=0.1, until=1.0, load=load))


@pytest.mark.long
def test_what_runs_just_above_the_limit_do():
    """Where the limit is known all are caught; without it not every one. Below the limit none of them gains energy."""
    silent = {True: [], False: []}
    for law in (Exponential(1.0, 1e-2), Rational(1.0, 1e-2), Exponential(1.0, 1.0)):
        body = body_on(grid((1.0, 12), (1.0, 12)), 0.26, law)
        M = mass_matrix(body.basis)
        exact = 2.0 / np.sqrt(eigh(body.stiffness().toarray(), M.toarray(), eigvals_only=True)[-1])
        smooth = 1e-2 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
        for u0 in (smooth, 1e-3 * np.random.default_rng(0).standard_normal(body.basis.N)):
            for factor, known in ((0.95, True), (1.003, True), (1.01, True), (1.003, False), (1.01, False)):
                peak, caught, dt = 0.0, False, factor * exact
                limit = stable_time_step(body, M) if known else None
                try:
                    for state in central_difference(body, M, u0, dt=dt, until=2000 * dt, limit=limit):
                        if state.step % 10 == 0:
                            peak = max(peak, state.energies.total / state.initial)
                except UnstableRun:
                    caught = True
                if factor < 1.0:
                    assert not caught
                    assert peak < 1.05
                elif not caught:
                    silent[known].append(peak)
    for known, peaks in silent.items():
        told = ", ".join(f"{peak:.2f}" for peak in sorted(peaks))
        print(
            f"limit known: {known}; {len(peaks)} of 12 runs just above it without alarm; peaks over the start: {told}"
        )
    assert not silent[True]
    assert len(silent[False]) < 12


@pytest.mark.slow
def test_a_one_sided_force_has_no_balance_to_break():
    """It is the gradient of no energy: no alarm for that, and a word about the rule when it does feed the motion."""
    mesh = box(2, 12)
    body = body_on(mesh, 0.25, rule=BallRule(3, 8, outer="vertices", symmetric=False))
    M = mass_matrix(body.basis)
    limit = stable_time_step(body, M)
    v0 = at_vertices(mesh, np.cos(np.pi * mesh.p[0]), 0.0)
    dt = 0.5 * limit.dt
    *_, last = central_difference(body, M, v0=v0, dt=dt, until=300 * dt, limit=limit)
    assert abs(last.energies.imbalance) > 0.1 * last.energies.initial  # what would stop a symmetric rule: 0.15
    with pytest.raises(UnstableRun, match="Its rule is one-sided: such a force can feed a motion at any dt"):
        for _ in central_difference(body, M, v0=v0, dt=dt, until=4000 * dt, limit=limit):
            pass
