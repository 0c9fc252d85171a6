"""Nonlocal diffusion, a scalar form on bonds: ``-int k (u(y) - u(x)) dy = f`` with u given in a collar.

With ``k = 8 / (pi eps^4)`` on the ball of radius eps the operator of a quadratic is its Laplacian, whatever eps:
u = x^2 is the exact solution for f = -2. A sine is not: its solution tends to the local one.
"""

from __future__ import annotations

import time

import numpy as np
import skfem

import skfem_peridynamics as peri


@skfem.BilinearForm
def diffusion(u1, u2, v1, v2, w):
    return 4.0 / (np.pi * w.eps**4) * (u2 - u1) * (v2 - v1)


def solve(horizon: float, per_horizon: int, exact, source) -> tuple[float, int]:
    """Return the largest error at the vertices, and the number of bonds."""
    axis = np.linspace(0, 1, round(per_horizon / horizon) + 1)
    basis = skfem.Basis(skfem.MeshTri.init_tensor(axis, axis), skfem.ElementTriP1())
    bonds = peri.BondBasis(basis, horizon, rule=peri.BallRule())
    load = skfem.LinearForm(lambda v, w: source(w.x) * v).assemble(basis)
    collar = peri.collar(basis.mesh, basis.mesh.boundary_facets(), horizon)
    given = exact(basis.mesh.p)
    u = skfem.solve(*skfem.condense(diffusion.assemble(bonds, eps=horizon), load, x=given, D=collar))
    return float(np.abs(u - given).max()), bonds.nbonds


def main(per_horizon: int = 4) -> dict[str, float]:
    """Return the error of the quadratic, and of the sine against the local solution at two horizons."""
    begin = time.perf_counter()
    quadratic, bonds = solve(0.2, per_horizon, lambda x: x[0] ** 2, lambda x: -2.0 + 0.0 * x[0])

    def sine(x):
        return np.sin(2.0 * x[0]) * np.sin(2.0 * x[1])

    local = [solve(horizon, per_horizon, sine, lambda x: 8.0 * sine(x))[0] for horizon in (0.2, 0.1)]
    return {
        "error of the quadratic": quadratic,
        "sine, off the local one at eps = 0.2": local[0],
        "sine, off the local one at eps = 0.1": local[1],
        "bonds": bonds,
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:>38}  {value:.6g}")
