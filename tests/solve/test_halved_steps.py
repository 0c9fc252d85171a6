"""Steps that are cut and grown, states taken apart and rebuilt, the residual of Lanczos: each by itself."""

import numpy as np
import pytest
import scipy.linalg

import skfem_peridynamics as peri
from bodies import body_on, box
from skfem_peridynamics.solve.halved_steps import CUTS, HalvedSteps
from skfem_peridynamics.solve.lanczos import largest_mode
from skfem_peridynamics.solve.mass_solver import mass_solver
from skfem_peridynamics.solve.preconditioner import SolverMemory
from skfem_peridynamics.solve.state import Equilibrium, State, contents, rebuilt


def test_a_step_grows_where_the_one_it_was_cut_from_twice_ends():
    steps = HalvedSteps(dt=1.0)
    for _ in range(3):
        assert steps.halve()
    lengths = []
    while steps.time < 1.0:
        steps.grow()
        lengths.append(steps.length)
        steps.advance()
    assert lengths == [0.125] * 4 + [0.25] * 2  # doubled at 1/2, a multiple of four eighths; the quarters end at 1
    steps.grow()
    assert steps.length == 1.0


def test_steps_are_cut_a_thousand_times_at_most():
    steps = HalvedSteps(dt=3.0)
    assert [steps.halve() for _ in range(CUTS + 1)] == [True] * CUTS + [False]
    assert steps.length == 3.0 / 1024
    assert not HalvedSteps(dt=1.0).resume(0.3, 0.3, 1)
    assert steps.resume(1.5, 0.75, 4)
    assert (steps.time, steps.length, steps.count) == (1.5, 0.75, 4)
    steps.advance()
    assert (steps.time, steps.count) == (2.25, 5)
    assert not HalvedSteps(dt=1e-6).resume(1.001e-6, 1e-6, 1)  # a thousandth of a step is no round-off
    assert HalvedSteps(dt=1e-6).resume(1e-6 * (1 + 1e-12), 1e-6, 1)


@pytest.mark.parametrize("kind", [State, Equilibrium])
def test_what_is_taken_apart_is_put_together(kind):
    x, memory = np.arange(3.0), SolverMemory(17, np.ones(3))
    vectors = {name: x + k for k, name in enumerate(kind.VECTORS)}
    state = kind(t=1.0, step=2, dt=0.5, **vectors, work=3.0, initial=4.0, memory=memory, broken=(np.array([1, 2]),))
    again = rebuilt(kind, *contents(state))
    for name in (*kind.NUMBERS, *kind.VECTORS):
        assert np.array_equal(getattr(again, name), getattr(state, name)), name
    assert again.memory.spent == 17
    assert again.memory.tangent.tolist() == [1.0, 1.0, 1.0]
    assert again.broken[0].tolist() == [1, 2]


@pytest.mark.parametrize("kind", ["lumped", "consistent"])
def test_the_residual_bounds_how_far_the_spectrum_is(kind):
    """There is an eigenvalue within the residual of a Ritz value, also of one that is far from converged."""
    body = body_on(box(2, 6, "random"), 0.4)
    M = peri.mass_matrix(body.basis, kind=kind)
    exact = scipy.linalg.eigh(body.stiffness().toarray(), M.toarray(), eigvals_only=True)
    K = body.stiffness_operator()
    mass = mass_solver(M, np.empty(0, dtype=np.int64))
    start = np.random.default_rng(0).standard_normal(mass.size)
    value, _, residual = largest_mode(lambda x: K @ x, mass, k=1, v0=start, ncv=4, tol=0.3, maxiter=300)
    assert 0.0 < abs(exact - value).min() <= residual < 0.3 * exact[-1]
