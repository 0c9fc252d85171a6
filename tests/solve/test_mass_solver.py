"""Accelerations with a consistent mass, against dense solves."""

import numpy as np
import pytest
import scipy.sparse as sparse

from bodies import body_on, box, vector_basis
from skfem_peridynamics import (
    BallRule,
    Exponential,
    Linear,
    Prescribed,
    central_difference,
    discrete_energy,
    mass_matrix,
    stable_time_step,
)
from skfem_peridynamics.solve import mass_solver as module
from skfem_peridynamics.solve.mass_solver import Chebyshev, Factored, Lumped, mass_solver

NONE = np.array([], dtype=int)


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("kind", ["structured", "random", "graded"])
def test_solvers_agree_with_a_dense_solve(dim, kind, monkeypatch):
    basis = vector_basis(box(dim, {1: 20, 2: 6, 3: 3}[dim], kind))
    M = mass_matrix(basis, density=3.0, kind="consistent")
    force = np.random.default_rng(0).standard_normal(basis.N)
    fixed = np.array([0, dim, basis.N - 1])
    free = np.setdiff1d(np.arange(basis.N), fixed)
    expected = np.zeros(basis.N)
    expected[free] = np.linalg.solve(M.toarray()[np.ix_(free, free)], force[free])
    assert isinstance(mass_solver(M, fixed), Factored)
    assert mass_solver(M, fixed).solve(force) == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())
    monkeypatch.setattr(module, "FACTOR_UP_TO", 0)
    monkeypatch.setattr(module, "FACTOR_UP_TO_3D", 0)
    iterated = mass_solver(M, fixed)
    assert isinstance(iterated, Chebyshev)
    assert iterated.solve(force) == pytest.approx(expected, abs=1e-13 * np.abs(expected).max())
    assert iterated.times(force) == pytest.approx(M @ force, abs=1e-15)


def test_a_mass_that_is_not_p1_is_factored(monkeypatch):
    monkeypatch.setattr(module, "FACTOR_UP_TO", 0)
    M = sparse.diags([np.full(9, -0.49), np.ones(10), np.full(9, -0.49)], [-1, 0, 1], format="csr")
    solver = mass_solver(M, NONE)
    assert isinstance(solver, Factored)
    assert M @ solver.solve(np.ones(10)) == pytest.approx(np.ones(10))


def test_a_lumped_mass_is_never_factored():
    basis = vector_basis(box(2, 3))
    for M in (mass_matrix(basis), mass_matrix(basis).diagonal()):
        assert isinstance(mass_solver(M, NONE), Lumped)


@pytest.mark.parametrize("chebyshev", [False, True])
def test_the_discrete_energy_is_kept_with_a_consistent_mass(chebyshev, monkeypatch):
    if chebyshev:
        monkeypatch.setattr(module, "FACTOR_UP_TO", 0)
    body = body_on(box(2, 6, "random"), 0.4, Linear(1.0), rule=BallRule(3, 8))
    M, K = mass_matrix(body.basis, kind="consistent"), body.stiffness()
    limit = stable_time_step(body, M)
    u0 = np.random.default_rng(0).standard_normal(body.basis.N)
    values = []
    for state in central_difference(body, M, u0, dt=0.99 * limit.dt, until=2000 * limit.dt):
        if state.step % 50 == 0:
            values.append(discrete_energy(K, M, state))
    assert np.ptp(values) < 1e-12 * np.mean(values)


def test_recursion_and_reactions_with_a_consistent_mass():
    """The paper's two-step form on the free unknowns, the pulled ones moved; work of reactions closes the balance."""
    body = body_on(box(1, 12, "random"), 0.3, Exponential(1.0, 1.0), rule=BallRule(2, 1))
    M = mass_matrix(body.basis, kind="consistent")
    dt = 0.5 * stable_time_step(body, M).dt
    pulled = np.array([12])
    fixed = [Prescribed(pulled, displacement=lambda t: 0.02 * t**3)]
    free = np.setdiff1d(np.arange(13), pulled)
    dense = M.toarray()
    states = [s.copy() for s in central_difference(body, M, dt=dt, until=20 * dt, fixed=fixed)]
    for before, now, after in zip(states, states[1:], states[2:], strict=False):
        a = (after.u - 2 * now.u + before.u) / dt**2
        missed = (dense @ a - body.force(now.u))[free]
        assert np.abs(missed).max() < 1e-9 * np.abs(body.force(now.u)).max() + 1e-12
        assert after.u[12] == pytest.approx(0.02 * (after.t) ** 3, rel=1e-12)
    drifts = []
    for fraction in (1.0, 0.5, 0.25):
        *_, state = central_difference(body, M, dt=fraction * dt, until=200 * dt, fixed=fixed)
        drifts.append(abs(state.energies.imbalance) / state.energies.work)
    rate = np.polyfit(np.log([1.0, 0.5, 0.25]), np.log(drifts), 1)[0]
    assert rate == pytest.approx(2.0, abs=0.06)  # 1.97 measured
