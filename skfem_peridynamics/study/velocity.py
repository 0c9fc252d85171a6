"""The equation of the velocity, ``rho v'' = Q(v; u) + b'`` (paper, eq. 5.1), integrated beside the motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from .._types import Floats, Load
from ..model.peridynamics import Peridynamics
from ..solve.mass_solver import mass_solver
from ..solve.state import State


def velocity_equation(
    body: Peridynamics, M: Any, states: Iterable[State], load_rate: Load | None = None
) -> Iterator[tuple[State, Floats]]:
    """Yield each state of a run with the velocity that its own equation gives, both at the same time.

    ``Q(v; u)`` is minus the tangent at u; the equation starts from ``v(0)`` and ``v'(0) = u''(0)`` and is stepped by
    central difference with the run's own dt. ``load_rate(t)`` is the derivative of the load. The difference from
    ``state.v`` is second order in dt. Free bodies only: no motion may be prescribed.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential, central_difference, mass_matrix
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 11)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body, M = Peridynamics(BondBasis(basis, 0.25), Exponential(1.0, 1.0)), mass_matrix(basis)
    >>> u0 = 0.5 * np.sin(3 * basis.mesh.p[0])
    >>> def miss(dt):
    ...     run = central_difference(body, M, u0, dt=dt, until=0.5)
    ...     return max(np.abs(v - state.v).max() for state, v in velocity_equation(body, M, run))
    >>> bool(3.5 < miss(0.02) / miss(0.01) < 4.5)
    True
    """
    solver = mass_solver(M, np.empty(0, dtype=np.int64))

    def rate(state: State, v: Floats) -> Floats:
        total = -(body.tangent_operator(state.u) @ v)
        return solver.solve(total if load_rate is None else total + load_rate(state.t))

    v, middle = np.empty(0), np.empty(0)  # v' at half steps
    for state in states:
        if state.step == 0:
            v = state.v.copy()
            middle = state.a + 0.5 * state.dt * rate(state, v)
        else:
            v = v + state.dt * middle
            middle = middle + state.dt * rate(state, v)
        yield state, v
