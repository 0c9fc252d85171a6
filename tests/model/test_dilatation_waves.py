"""Waves of any Poisson ratio: the closed symbol against brute force, bodies against the symbol and against speeds."""

import numpy as np
import pytest
from scipy.integrate import dblquad

from bodies import box, vector_basis
from skfem_peridynamics import BondBasis, Material, Peridynamics, dispersion, mass_matrix
from skfem_peridynamics.material.influence import as_influence

STATES = [(2, "stress"), (2, "strain"), pytest.param(3, None, marks=pytest.mark.slow)]
RATIOS = [-0.3, 0.0, 0.2, 0.3, 0.45]


def solid(nu, plane):
    return Material.from_elastic(young=1.0, poisson=nu, toughness=1.0, density=1.0, plane=plane)


@pytest.mark.parametrize("influence", ["constant", "conical"])
@pytest.mark.parametrize("dim", [2, 3])
def test_symbol_by_brute_force(dim, influence):
    """``(lambda - mu) |e|^2`` with e the integral over the ball, by SciPy's cubature."""
    J, eps, k, beside = as_influence(influence), 0.2, 9.0, 1.7

    def mean(function):
        # around the axis of the wave nothing changes: a circle, or the zones of a sphere
        ring = (lambda t: 1.0) if dim == 2 else (lambda t: np.sin(t))
        return dblquad(lambda t, s: ring(t) * J(np.array([s]))[0] * function(s, np.cos(t)), 0, 1, 0, np.pi)[0]

    strain = dim * mean(lambda s, c: s ** (dim - 1) * c * np.sin(k * eps * s * c) / eps) / mean(lambda s, c: s**dim)
    options = {"dim": dim, "horizon": eps, "slope": 3.0, "density": 2.0, "influence": influence}
    with_it, without = (dispersion(k, **options, volumetric=each) for each in (beside, 0.0))
    assert with_it**2 - without**2 == pytest.approx(beside * strain**2 / 2.0, rel=1e-7)
    assert dispersion(k, **options, wave="S", volumetric=beside) == dispersion(k, **options, wave="S")


def speeds(dim, plane, nu):
    """Wave speeds in the middle of a body, 16 horizons a wave, over those of the symbol and of elasticity, less 1."""
    n = {2: 30, 3: 22}[dim]
    mesh, eps = box(dim, n), 4 / n
    body = Peridynamics(BondBasis(vector_basis(mesh), eps).balanced(), solid(nu, plane))
    M, elastic = mass_matrix(body.basis).diagonal().reshape(-1, dim), body.elastic
    middle = np.abs(mesh.p - 0.5).max(axis=0) < 1 / n
    out = []
    for wave, c in (("P", elastic.pressure_speed), ("S", elastic.shear_speed)):
        k = 2 * np.pi / (16 * eps)
        omega = dispersion(
            k, dim=dim, horizon=eps, slope=body.law.slope, density=1.0, wave=wave,
            volumetric=elastic.lame - elastic.shear,
        )  # fmt: skip
        for turn in (0.0, 0.3, np.pi / 4):
            along = np.array([np.cos(turn), np.sin(turn), 0.3][:dim])
            along /= np.linalg.norm(along)
            way = along if wave == "P" else np.array([-along[1], along[0], 0.0][:dim])
            U = ((way / np.linalg.norm(way))[:, None] * np.cos(k * along @ (mesh.p - 0.5))).T
            KU = (body.stiffness_operator() @ U.ravel()).reshape(-1, dim)
            found = np.sqrt((KU * U)[middle].sum() / (M * U * U)[middle].sum())
            out.append((found / omega - 1, found / (k * c) - 1))
    return np.array(out)


@pytest.mark.parametrize(("dim", "plane"), STATES)
@pytest.mark.parametrize("nu", RATIOS)
def test_waves_run_as_they_should(dim, plane, nu):
    off_symbol, off = np.abs(speeds(dim, plane, nu)).max(axis=0)
    print(f"{dim}D {plane} nu = {nu}: off the symbol {100 * off_symbol:.2f} %, off the speed {100 * off:.2f} %")
    assert off_symbol < 0.004  # at most 0.0031 measured
    # near 1/2 in plane strain the symbol itself is 0.9 % slow at 16 horizons a wave
    assert off < (0.012 if nu == 0.45 else 0.01)
