"""Linear fields with the closed forms of their energies, and the energy of a body that a crack has opened."""

import numpy as np

from bodies import at_vertices, grid, vector_basis
from skfem_peridynamics import BondBasis, Material, PairRule, Peridynamics

EPS = 0.25
PI = np.pi
EXACT = {
    (1, "x"): 1 - 2 * EPS / 3,
    (2, "x"): 1 / 2 - 22 * EPS / (15 * PI) + 4 * EPS**2 / (15 * PI),
    (2, "y"): 1 / 6 - 8 * EPS / (15 * PI) + 2 * EPS**2 / (15 * PI),
    (2, "xy"): 4 / 3 - 4 * EPS / PI + 4 * EPS**2 / (5 * PI),
    (3, "x"): 3 / 10 - 7 * EPS / 20 + 38 * EPS**2 / (105 * PI) - EPS**3 / (28 * PI),
    (3, "y"): 1 / 10 - EPS / 8 + 16 * EPS**2 / (105 * PI) - EPS**3 / (56 * PI),
}


def field(mesh, name):
    x, zero = mesh.p, 0.0
    rows = {"x": [x[0]], "y": [x[1]] if mesh.dim() > 1 else [], "xy": [*x]}[name]
    return at_vertices(mesh, *rows, *[zero] * (mesh.dim() - len(rows)))


def opened(dim, widths, per_horizon, influence, calibrate, rule=None):
    rule = rule or PairRule()
    half = per_horizon + 1
    sides = [(float(n), n) for n in widths] + [(float(2 * half + 1), 2 * half + 1)]
    mesh = grid(*sides)
    material = Material.from_elastic(
        young=1.0, toughness=1.0, density=1.0, plane="strain" if dim == 2 else None, calibrate=calibrate
    )
    bonds = BondBasis(vector_basis(mesh), float(per_horizon), influence, rule)
    if calibrate == "discrete":  # the moment of a body large enough to have an inside
        n = 2 * per_horizon + 4
        deep = BondBasis(vector_basis(grid(*((float(n), n),) * dim)), float(per_horizon), influence, rule)
        law = material.law(dim, *deep.discrete_moments)
    else:
        law = material.law(dim, bonds.moment)
    u = at_vertices(mesh, *[0.0] * (dim - 1), 1e6 * (mesh.p[-1] > half + 0.5))
    return Peridynamics(bonds, law).energy(u)
