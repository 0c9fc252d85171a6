"""A pulse in a bar (1D): how fast it travels, what it keeps of its energy, and how long that took.

python examples/wave_bar.py
"""

import time

import numpy as np
import skfem

import skfem_peridynamics as peri


def main(divisions: int = 1000) -> dict[str, float]:
    begin = time.perf_counter()
    mesh = skfem.MeshLine(np.linspace(0.0, 1.0, divisions + 1))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementLineP1()))
    steel = peri.Material.from_elastic(young=200e9, toughness=1e5, density=7850.0)
    body = peri.Peridynamics(peri.BondBasis(basis, horizon=4.0 / divisions), steel)
    mass = peri.mass_matrix(basis, density=steel.density)
    limit = peri.stable_time_step(body, mass)

    # a right-moving Gaussian: u = g(x - c t), so v = -c g'
    speed, width, start = body.elastic.pressure_speed, 0.03, 0.25
    u0 = 1e-6 * peri.interpolate(basis, lambda x: np.exp(-(((x - start) / width) ** 2)))
    v0 = 1e-6 * peri.interpolate(
        basis, lambda x: speed * 2 * (x - start) / width**2 * np.exp(-(((x - start) / width) ** 2))
    )
    drift = 0.0
    for state in peri.central_difference(body, mass, u0, v0, dt=0.9 * limit.dt, until=0.5 / speed, limit=limit):
        if state.step % 50 == 0:
            drift = max(drift, abs(state.energies.imbalance) / state.energies.initial)
    place = float(np.average(mesh.p[0], weights=state.u**2))
    measured = (place - start) / state.t
    return {
        "speed": measured,
        "speed_error": measured / speed - 1.0,
        "energy_drift": drift,
        "steps": state.step,
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:>12}  {value:.6g}")
