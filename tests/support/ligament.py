"""A strip with a slit that is torn along its ligament, and what that costs."""

import numpy as np
import skfem

import skfem_peridynamics as peri
from bodies import vector_basis
from skfem_peridynamics import BondBasis, Crack, Material, Peridynamics, slit


def solid(nu, plane="stress", **options):
    return Material.from_elastic(
        **{"young": 1.0, "poisson": nu, "toughness": 1.0, "density": 1.0, "plane": plane} | options
    )


def rectangle(width, height, h):
    axes = [np.linspace(-side / 2, side / 2, round(side / h) + 1) for side in (width, height)]
    return skfem.MeshTri.init_tensor(*axes)


def torn(dim, nu, bonds=None):
    """The energy of softened bonds of a strip torn along 24 horizons, over G_c of its ligament."""
    length, height, depth, eps, toughness = 32.0, 12.0, 4 / 3, 1.0, 2e-4
    if bonds is not None:
        mesh = bonds.mesh
    elif dim == 2:
        mesh = slit(rectangle(length, height, eps / 4), Crack([[-16.0, 0.0], [-8.0, 0.0]]))
    else:
        sides = ((-0.5 * length, 0.5 * length), (-0.5 * height, 0.5 * height), (0.0, depth))
        axes = [np.linspace(low, high, round(3 * (high - low) / eps) + 1) for low, high in sides]
        plane = [[-16.0, 0.0, 0.0], [-8.0, 0.0, 0.0], [-8.0, 0.0, depth], [-16.0, 0.0, depth]]
        mesh = slit(skfem.MeshTet.init_tensor(*axes), Crack(plane))
    x, y = mesh.p[:2]
    edge = np.flatnonzero(np.abs(y) > 0.5 * height - eps)
    bonds = bonds or BondBasis(vector_basis(mesh), eps).balanced()
    body = Peridynamics(bonds, solid(nu, "stress" if dim == 2 else None, toughness=toughness), no_fail=edge)
    M, speed = peri.mass_matrix(body.basis), 0.15 * body.elastic.rayleigh_speed

    def open_up(t):
        return np.sign(y[edge]) * np.clip(6e-3 * (speed * t - x[edge] - 0.5 * length), 0.0, 0.07)

    fixed = [peri.Prescribed(dim * edge + 1, displacement=open_up), peri.Prescribed(dim * edge, displacement=0.0)]
    until = (length + 16.0) / speed
    step = peri.stable_time_step(body, M).step_for(until)
    *_, last = peri.central_difference(body, M, until=until, dt=step, fixed=fixed)
    return peri.census(body, last.u).energy_softened / (24.0 * toughness * (1.0 if dim == 2 else depth))
