"""
A form of your own: nonlocal diffusion
======================================

Bonds are a basis for scikit-fem: a form on them is a double integral. Here it is
:math:`-\\int k\\,(u(y) - u(x))\\,dy = f`, with u given in a collar as wide as the horizon.
"""

# %%
# In a form on bonds each argument comes twice, at x and at y, and ``w`` has ``x, y, xi, r``. With this kernel the
# operator of a quadratic is its Laplacian, whatever the horizon: :math:`u = x^2` is exact for :math:`f = -2`.
import numpy as np
import skfem

import skfem_peridynamics as peri


@skfem.BilinearForm
def diffusion(u1, u2, v1, v2, w):
    return 4.0 / (np.pi * w.eps**4) * (u2 - u1) * (v2 - v1)


horizon = 0.2
axis = np.linspace(0.0, 1.0, 31)
basis = skfem.Basis(skfem.MeshTri.init_tensor(axis, axis), skfem.ElementTriP1())
bonds = peri.BondBasis(basis, horizon, rule=peri.BallRule())

# %%
# Assemble, condense and solve as ever. ``peri.collar`` gives the vertices within a horizon of the boundary.
load = skfem.LinearForm(lambda v, w: -2.0 * v).assemble(basis)
collar = peri.collar(basis.mesh, basis.mesh.boundary_facets(), horizon)
exact = basis.mesh.p[0] ** 2
u = skfem.solve(*skfem.condense(diffusion.assemble(bonds, eps=horizon), load, x=exact, D=collar))
print(f"{bonds.nbonds} bonds; largest error {np.abs(u - exact).max():.1e}, of a solution up to 1")
assert np.abs(u - exact).max() < 2e-3
bonds

# %%
import matplotlib.pyplot as plt

figure, (left, right) = plt.subplots(1, 2, figsize=(8, 3.4), layout="constrained")
for above, values, name in ((left, u, "u"), (right, np.abs(u - exact), "error")):
    peri.plot(basis.mesh, of=values, ax=above)
    figure.colorbar(above.collections[0], label=name)
