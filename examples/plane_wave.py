"""Drop-in use: a plane pressure pulse in a plain scikit-fem script (2D), judged against sqrt((lambda + 2 mu) / rho).

python examples/plane_wave.py
"""

import time

import numpy as np
from skfem import Basis, ElementTriP1, ElementVector, MeshTri

import skfem_peridynamics as peri


def main(divisions: int = 120) -> dict[str, float]:
    begin = time.perf_counter()
    # --- what a scikit-fem user has already
    grid = np.linspace(-1.0, 1.0, divisions + 1)
    mesh = MeshTri.init_tensor(grid, grid).with_defaults()
    basis = Basis(mesh, ElementVector(ElementTriP1()))

    # --- the nonlocal part
    material = peri.Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane="strain")
    body = peri.Peridynamics(peri.BondBasis(basis, horizon=8.0 / divisions), material)
    mass = peri.mass_matrix(basis, density=material.density)
    limit = peri.stable_time_step(body, mass)

    # a right-moving pulse u = (g(x - c t), 0), by scikit-fem's L2 projection
    speed, width, start = body.elastic.pressure_speed, 0.2, -0.3

    def pulse(x):
        return np.exp(-(((x[0] - start) / width) ** 2))

    u0 = 1e-4 * peri.project(basis, lambda x: np.array([pulse(x), 0 * x[0]]))
    v0 = 1e-4 * peri.project(basis, lambda x: np.array([speed * 2 * (x[0] - start) / width**2 * pulse(x), 0 * x[0]]))
    fixed = [peri.Prescribed(basis.get_dofs("left"), displacement=0.0)]
    run = peri.central_difference(body, mass, u0, v0, dt=0.9 * limit.dt, until=0.6 / speed, fixed=fixed, limit=limit)
    *_, state = run

    # --- and plain scikit-fem again: the trace on the axis, which the free sides have not reached yet
    axis = np.flatnonzero(np.abs(mesh.p[1]) < 1e-12)
    ux = state.u[basis.nodal_dofs[0, axis]]
    measured = (float(np.average(mesh.p[0, axis], weights=ux**2)) - start) / state.t
    return {
        "speed": measured,
        "speed_error": measured / speed - 1.0,
        "energy_drift": abs(state.energies.imbalance) / state.energies.initial,
        "steps": state.step,
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:>12}  {value:.6g}")
