"""The discrete energy of the paper's CFL theorem."""

from __future__ import annotations

from typing import Any

from ..solve.state import State


def discrete_energy(K: Any, M: Any, state: State) -> float:
    """Return ``1/2 (rho ||d+ u||^2 + a_l(u^k, u^{k+1}))``, conserved by the linear scheme without loads.

    It equals the paper's ``1/2 (||d+ u||^2 - dt^2/4 a_l(d+ u, d+ u) + a_l(ubar, ubar))`` (theorem 4.4) with density,
    norms in the scheme's own mass. ``K`` and ``M`` are matrices or operators.

    >>> import numpy as np
    >>> s = State(t=0.0, step=0, dt=0.5, u=np.ones(1), v=np.zeros(1), a=-np.ones(1), work=0.0, initial=0.0)
    >>> discrete_energy(np.eye(1), np.eye(1), s)            # u1 = 0.875, d+ u = -0.25
    0.46875
    """
    rate = state.v + 0.5 * state.dt * state.a
    following = state.u + state.dt * rate
    return 0.5 * float(rate @ (M @ rate) + state.u @ (K @ following))
