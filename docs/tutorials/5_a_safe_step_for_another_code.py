"""
A safe time step for another code
=================================

Whoever runs bond-based peridynamics elsewhere can take the step from here: the largest eigenvalue of a body at rest.
"""

# %%
# The mesh of the other code (here a disc), its horizon and constants are enough. With vertex pairs without partial
# volumes the bonds are those of a meshless code with a node at each vertex.
import skfem

import skfem_peridynamics as peri

mesh = skfem.MeshTri.init_circle(5)
basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
steel = peri.Material.from_elastic(young=200e9, density=7850.0, plane="strain", potential="linear")
bonds = peri.BondBasis(basis, horizon=0.1, rule=peri.PairRule(partial_volume=False))
body = peri.Peridynamics(bonds, steel)
limit = peri.stable_time_step(body, peri.mass_matrix(basis, density=steel.density))
for name, dt in limit.steps().items():
    print(f"{name:12s} {dt:.4g} s, {dt / limit.dt:.3f} of the limit")

# %%
# The row sum, what most codes use, is safe and wastes steps: so many more of them to the same time.
wasted = limit.dt / limit.steps()["row_sum"]
print(f"the row sum takes {wasted:.2f} times the steps")
assert wasted > 1.2

# %%
# The limit is sharp: a little below it a run keeps its energy, a little above it blows up, and says so.
import numpy as np

M = peri.mass_matrix(basis, density=steel.density)
u0 = 1e-6 * basis.project(lambda x: np.array([np.sin(x[0]), x[1] ** 2]))
for part in (0.99, 1.02):
    try:
        for state in peri.central_difference(body, M, u0, dt=part * limit.dt, until=1000 * limit.dt):
            pass
        off = state.energies.imbalance / state.energies.initial
        print(f"{part} of the limit: energy off by {off:.1e} after {state.step} steps")
    except peri.UnstableRun as error:
        print(f"{part} of the limit: {error}")

# %%
# In a shell: ``skfem-peridynamics cfl --mesh disc.msh --horizon 0.1 --young 200e9 --density 7850 --plane strain``, with
# ``--json`` for a program.
