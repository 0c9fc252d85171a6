"""
A convergence study of your own
===============================

Error against run time, for a problem whose motion is known: a standing wave in a bar that is longer than a wave.
"""

# %%
# In an infinite bar a sine moves with the frequency of the dispersion relation, which ``peri.dispersion`` gives for
# the continuous model at this horizon. Prescribing the motion in a collar at both ends makes the bar infinite, and what
# is left is the error of the discretisation.
import time

import numpy as np
import skfem

import skfem_peridynamics as peri

horizon, k, law = 0.1, 2.0 * np.pi, peri.Linear(slope=1.5)
omega = float(peri.dispersion(k, dim=1, horizon=horizon, slope=law.slope, density=1.0))
until = 1.0


def exact(x, t):
    return np.sin(k * x) * np.cos(omega * t)


def one(per_horizon, rule, mass, balanced):
    begin = time.perf_counter()
    mesh = skfem.MeshLine(np.linspace(0.0, 1.0, round(per_horizon / horizon) + 1))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementLineP1()), intorder=4)
    bonds = peri.BondBasis(basis, horizon, rule=rule)
    body = peri.Peridynamics(bonds.balanced() if balanced else bonds, law)
    M = peri.mass_matrix(basis, kind=mass)
    ends = peri.collar(mesh, mesh.boundary_facets(), horizon)
    moved = peri.Prescribed(ends, lambda t: exact(mesh.p[0][ends], t))
    u0 = peri.project(basis, lambda x: exact(x, 0.0))
    limit = peri.stable_time_step(body, M)
    # at a fixed horizon the stable step hardly changes with h: take it smaller by hand, or its error is all one sees
    dt = limit.step_for(until) / per_horizon
    for state in peri.central_difference(body, M, u0, dt=dt, until=until, fixed=[moved], limit=limit):
        pass
    square = skfem.Functional(lambda w: (w["u"][0] - exact(w.x[0], until)) ** 2)
    off = square.assemble(basis, u=basis.interpolate(state.u))
    return np.sqrt(off), time.perf_counter() - begin


rules = {
    "vertex pairs": (peri.PairRule(), "lumped", False),
    "balls, balanced, consistent mass": (peri.BallRule(), "consistent", True),
}
sizes = (4, 8, 16, 32)
found = {name: np.array([one(m, *options) for m in sizes]) for name, options in rules.items()}
for name, rows in found.items():
    rates = np.log2(rows[:-1, 0] / rows[1:, 0])
    print(f"{name}: errors {', '.join(f'{e:.1e}' for e in rows[:, 0])}; rates {', '.join(f'{r:.2f}' for r in rates)}")

# %%
# The picture that decides: which error for which time.
import matplotlib.pyplot as plt

figure, above = plt.subplots(figsize=(5.5, 4), layout="constrained")
for name, rows in found.items():
    above.loglog(rows[:, 1], rows[:, 0], "o-", label=name)
above.set_xlabel("seconds, set-up included")
above.set_ylabel("L2 error at t = 1")
above.legend()
