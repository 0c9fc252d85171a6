"""Plane waves: the exact relation against brute-force integrals, the discrete one of each rule against the exact."""

from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from bodies import body_on, grid
from skfem_peridynamics import BallRule, Linear, PairRule, dispersion, mass_matrix

PROFILE = {"constant": lambda s: 1.0, "conical": lambda s: 1.0 - s}
OMEGA = [1.0, 2.0, np.pi, 4 * np.pi / 3]


def brute_symbol(kappa, dim, wave, J):
    """``4 / omega_d int_{|z|<1} J (1 - cos(kappa z_1)) / |z| e_m^2 dz``, in polar or spherical coordinates."""
    if dim == 1:
        return 4 / 2 * 2 * quad(lambda s: J(s) * (1 - np.cos(kappa * s)) / s, 0, 1)[0]

    def along(c):
        return c**2 if wave == "P" else (1 - c**2) / (dim - 1)

    if dim == 2:
        return (
            4
            / np.pi
            * dblquad(lambda t, s: J(s) * (1 - np.cos(kappa * s * np.cos(t))) * along(np.cos(t)), 0, 1, 0, 2 * np.pi)[0]
        )
    return (
        4
        / OMEGA[3]
        * dblquad(lambda c, s: 2 * np.pi * s * J(s) * (1 - np.cos(kappa * s * c)) * along(c), 0, 1, -1, 1)[0]
    )


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("influence", ["constant", "conical"])
def test_the_exact_relation_is_the_integral(dim, influence):
    eps, slope, density = 0.3, 2.0, 5.0
    for wave in ("P", "S")[: 1 if dim == 1 else 2]:
        for kappa in (0.5, 2.0, 9.0):
            exact = np.sqrt(slope / (density * eps**2) * brute_symbol(kappa, dim, wave, PROFILE[influence]))
            omega = dispersion(
                kappa / eps, dim=dim, horizon=eps, slope=slope, density=density, influence=influence, wave=wave
            )
            assert omega == pytest.approx(exact, rel=1e-9)


@pytest.mark.slow
def test_long_waves_are_elastic_and_short_ones_bounded():
    for dim, moment in ((1, 1 / 2), (2, 1 / 3), (3, 1 / 4)):
        mu = 2 * 3.0 * moment / (dim + 2)
        k = np.array([0.0, 0.01])
        omega = dispersion(k, dim=dim, horizon=0.1, slope=3.0, density=2.0)
        assert omega[0] == 0.0
        assert omega[1] / k[1] == pytest.approx(np.sqrt(3 * mu / 2.0), rel=1e-6)
        if dim > 1:
            across = dispersion(k, dim=dim, horizon=0.1, slope=3.0, density=2.0, wave="S")
            assert across[1] / k[1] == pytest.approx(np.sqrt(mu / 2.0), rel=1e-6)
            # the symbol's supremum in units of f'(0)/(rho eps^2): 4.5291 in 2D, 2.8034 in 3D
            many = dispersion(np.linspace(1, 400, 4000), dim=dim, horizon=0.1, slope=3.0, density=2.0)
            assert (many**2).max() / (3.0 / (2.0 * 0.01)) == pytest.approx({2: 4.5291, 3: 2.8034}[dim], abs=1e-3)
    with pytest.raises(ValueError, match="wave = 'S' must be \"P\" in 1D"):
        dispersion(1.0, dim=1, horizon=1.0, slope=1.0, density=1.0, wave="S")
    with pytest.raises(ValueError, match="dim = 4"):
        dispersion(1.0, dim=4, horizon=1.0, slope=1.0, density=1.0)


@lru_cache(maxsize=2)
def lattice(dim, rule, per_horizon, mass):
    """A piece of a lattice, and the rows of stiffness and mass of the vertex in its middle."""
    n = 2 * (per_horizon + 2)
    mesh = grid(*((float(n), n),) * dim)
    body = body_on(mesh, float(per_horizon), Linear(1.0), rule=rule)
    centre = np.flatnonzero(np.abs(mesh.p - n / 2).max(axis=0) < 1e-9)[0]
    rows = slice(centre * dim, centre * dim + dim)
    return mesh, body.stiffness()[rows], mass_matrix(body.basis, kind=mass)[rows]


def discrete(dim, rule, per_horizon, lengths, direction, mass):
    """Frequencies of Bloch waves on an infinite lattice, ascending, for waves of so many horizons: (nlengths, dim)."""
    mesh, K, M = lattice(dim, rule, per_horizon, mass)
    reach = per_horizon + 2
    e = np.array(direction) / np.linalg.norm(direction)
    out = []
    for length in lengths:
        k = 2 * np.pi / (length * per_horizon)
        bloch = np.exp(1j * k * (e @ (mesh.p - reach)))
        waves = np.kron(bloch[:, None], np.eye(dim))
        symbol = np.linalg.solve(M @ waves, K @ waves)
        out.append(np.sqrt(np.sort(np.linalg.eigvals(symbol).real)))
    return np.array(out)


LENGTHS = (40.0, 6.0, 3.0)
DIRECTIONS = {1: [(1.0,)], 2: [(1.0, 0.0), (1.0, 1.0), (2.0, 1.0), (-1.0, 2.0)], 3: [(1.0, 0.0, 0.0), (1.0, 1.0, 1.0)]}


def worst(dim, rule, per_horizon, mass):
    """Largest relative error of any polarisation and direction, for each wave length."""
    error = np.zeros(len(LENGTHS))
    for direction in DIRECTIONS[dim]:
        found = discrete(dim, rule, per_horizon, LENGTHS, direction, mass)
        k = 2 * np.pi / (np.array(LENGTHS) * per_horizon)
        keys = {"dim": dim, "horizon": float(per_horizon), "slope": 1.0, "density": 1.0}
        exact = [dispersion(k, **keys, wave=wave) for wave in ("S",) * (dim - 1) + ("P",)]
        error = np.maximum(error, np.abs(found / np.stack(exact, axis=1) - 1).max(axis=1))
    return error


@pytest.mark.slow
def test_gauss_balls_match_in_3d_at_three_vertices_per_horizon():
    error = worst(3, BallRule(3, 8), 3, "consistent")
    print(f"3D, {BallRule(3, 8).name}, consistent, eps/h = 3: waves off by {', '.join(f'{e:.1e}' for e in error)}")
    assert (error < (1.1e-5, 4.5e-4, 2.1e-3)).all()


@pytest.mark.parametrize(
    ("dim", "rule", "mass", "bounds"),
    [
        # measured, and a tenth. Lumping the mass costs two per cent at three horizons; pairs miss their moment by one
        (1, BallRule(3, 1), "consistent", (5.3e-6, 2.4e-4, 9.3e-4)),
        (2, BallRule(3, 8), "consistent", (5.7e-6, 2.6e-4, 1.1e-3)),
        (2, BallRule(3, 8, outer="vertices"), "lumped", (1.5e-4, 6.3e-3, 2.6e-2)),
        (2, PairRule(), "lumped", (1.2e-2, 1.2e-2, 9.4e-3)),
        (3, BallRule(3, 13, outer="vertices"), "lumped", (1.5e-4, 6.6e-3, 2.7e-2)),
    ],
)
def test_discrete_waves_at_four_vertices_per_horizon(dim, rule, mass, bounds):
    error = worst(dim, rule, 4, mass)
    print(f"{dim}D, {rule.name}, {mass}: waves of 40, 6 and 3 horizons off by {', '.join(f'{e:.1e}' for e in error)}")
    assert (error < bounds).all()


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_wave_without_end_does_not_move(dim):
    """At wave number 0 the symbols vanish, by the limits of their Bessel functions over their argument."""
    from skfem_peridynamics.analysis.dispersion import _angular

    for wave in ("P", "S")[: 1 if dim == 1 else 2]:
        at, near = _angular(np.array([0.0, 1e-4]), dim, wave)
        assert abs(at) < 1e-14  # 1.4e-15 was seen
        assert abs(near) < 1e-7


@pytest.mark.parametrize(("dim", "wave"), [(1, "P"), (2, "P"), (2, "S"), (3, "P"), (3, "S")])
def test_what_does_not_vary_in_space_does_not_vary_in_time(dim, wave):
    """Round-off of the root of a sum that is zero: 2e-8 of the frequencies of the horizon."""
    options = {"dim": dim, "horizon": 0.5, "slope": 2.0, "density": 1.0, "wave": wave}
    assert float(dispersion(0.0, **options)) < 1e-7 * float(dispersion(2 * np.pi, **options))
