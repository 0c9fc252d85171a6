"""
A law of your own
=================

What a bond stores is ``f(r S^2)``: any smooth function that starts linearly. Three functions of a number are enough,
and where numba is installed they are compiled into the loops over the bonds.
"""

# %%
# A law that softens slowly: its force falls off like the inverse square of the opening, not like an exponential.
import math

import numpy as np
import skfem

import skfem_peridynamics as peri

law = peri.own_potential(
    peri.Scalars(
        lambda q: (1.0 - (1.0 + 50.0 * q) ** -0.5) / 25.0,
        lambda q: (1.0 + 50.0 * q) ** -1.5,
        lambda q: -75.0 * (1.0 + 50.0 * q) ** -2.5,
    )
)
print(f"f'(0) = {law.slope:g}, f_inf = {law.limit:g}, force largest at q = {law.inflection**2:.4f}")

# %%
# A wrong derivative is found when the law is made, not after the run.
try:
    peri.own_potential(peri.Scalars(math.log1p, lambda q: 2.0 / (1.0 + q), lambda q: -2.0 / (1.0 + q) ** 2))
except ValueError as error:
    print(error)

# %%
# Beside the exponential law of the same stiffness, whose bonds lose their force much faster:
mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 31), np.linspace(0, 0.5, 16)).with_defaults()
basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
bonds = peri.BondBasis(basis, horizon=0.12)
stretched = basis.project(lambda x: np.array([0.5 * x[0], 0.0 * x[0]]))
bodies = {"slow": peri.Peridynamics(bonds, law), "exponential": peri.Peridynamics(bonds, peri.Exponential(1.0, 50.0))}
strains = np.linspace(0.0, 1.0, 41)
import matplotlib.pyplot as plt

figure, above = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
for name, body in bodies.items():
    energies = [body.energy(2.0 * s * stretched) for s in strains]
    above.plot(strains, np.gradient(energies, strains), label=name)
above.set_xlabel("uniform strain")
above.set_ylabel("force")
above.legend()

# %%
# Force, tangent and step limit are exact for it as for any other law.
body, d = bodies["slow"], 1e-6
v = np.random.default_rng(0).standard_normal(basis.N)
slope = (body.energy(stretched + d * v) - body.energy(stretched - d * v)) / (2 * d)
print(f"-force.v = {-(body.force(stretched) @ v):.6f}, difference quotient {slope:.6f}")
assert abs(slope + body.force(stretched) @ v) < 1e-5 * abs(slope)
print(f"stable step {peri.stable_time_step(body, peri.mass_matrix(basis)).dt:.4g}")
