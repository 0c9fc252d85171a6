"""Energy of a fully opened straight crack over G_c: second differences in the size of the body leave the interior."""

import numpy as np
import pytest

from bodies import grid, vector_basis
from fields import opened
from skfem_peridynamics import BondBasis, Material, Peridynamics


def relative(dim, influence, calibrate, per_horizon=4):
    n = 2 * per_horizon + 2
    if dim == 2:
        return (
            opened(2, [n + 4], per_horizon, influence, calibrate) - opened(2, [n], per_horizon, influence, calibrate)
        ) / 4
    E = {
        (a, b): opened(3, [n + a, n + b], per_horizon, influence, calibrate)
        for a, b in ((0, 0), (2, 0), (0, 2), (2, 2))
    }
    return (E[2, 2] - E[2, 0] - E[0, 2] + E[0, 0]) / 4


@pytest.mark.parametrize("dim", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_a_straight_crack_costs_its_toughness(dim):
    plain = {J: relative(dim, J, "continuum") for J in ("constant", "conical")}
    discrete = {J: relative(dim, J, "discrete") for J in ("constant", "conical")}
    print(f"{dim}D, eps/h = 4, energy per area over G_c: M_d {plain}, discrete {discrete}")
    assert plain["constant"] == pytest.approx(1.0, abs=0.02)
    assert discrete["constant"] == pytest.approx(1.0, abs=0.02)
    assert discrete["conical"] == pytest.approx(1.0, abs=0.02)
    # without it the conical influence is measurably off: the calibration is what mends it
    assert abs(plain["conical"] - 1.0) > 0.03


@pytest.mark.parametrize("per_horizon", [3, 8, 16])
def test_toughness_does_not_depend_on_the_ratio_in_2d(per_horizon):
    assert relative(2, "constant", "continuum", per_horizon) == pytest.approx(1.0, abs=0.01)


def test_cracks_in_other_directions_of_a_lattice_cost_a_little_more():
    """Counted over the bonds of one vertex: sum of weight J |xi.n|, relative to a crack along a mesh line."""
    bonds = {J: BondBasis(vector_basis(grid((20.0, 20), (20.0, 20))), 4.0, J) for J in ("constant", "conical")}
    for J, dearest in (("constant", 1.017), ("conical", 1.027)):
        one = bonds[J]
        centre = np.flatnonzero(np.abs(one.mesh.p - 10).max(axis=0) < 1e-9)[0]
        mine = (one.ends == centre).any(axis=0)
        k, xi = one.measure()[mine], one.vectors()[:, mine]
        cost = {t: k @ np.abs(np.array([np.cos(t), np.sin(t)]) @ xi) for t in np.radians([0, 22.5, 45])}
        relative = np.array(list(cost.values())) / cost[0.0]
        print(f"{J}: a crack at 22.5 and 45 degrees costs {relative[1]:.3f} and {relative[2]:.3f} times one at 0")
        assert relative[1] == pytest.approx(dearest, abs=1e-3)
        assert 1.0 < relative[2] < relative[1]


def test_discrete_calibration_of_a_body():
    mesh = grid((1.0, 16), (1.0, 16))
    material = Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane="stress")
    bonds = BondBasis(vector_basis(mesh), 0.25, "conical")
    plain, discrete = (Peridynamics(bonds, material.with_(calibrate=c)) for c in ("continuum", "discrete"))
    ratio, crack = (moment / bonds.moment for moment in bonds.discrete_moments)
    assert abs(ratio - 1) > 0.02
    assert plain.law.slope / discrete.law.slope == pytest.approx(ratio, rel=1e-12)
    assert plain.law.limit / discrete.law.limit == pytest.approx(crack, rel=1e-12)
    assert discrete.elastic.young == pytest.approx(1.0, rel=1e-12)
    assert [discrete.elastic.toughness, plain.elastic.toughness] == pytest.approx([1.0, 1.0], rel=1e-12)
    # deep inside, the energy density of a linear field is that of the material, averaged over directions
    assert np.isclose(
        ratio, np.mean([_density(bonds, t) for t in np.linspace(0, np.pi, 16, endpoint=False)]), rtol=0.02
    )


def _density(bonds, angle):
    """Stored energy of a uniaxial strain at the central vertex, relative to the exact integral."""
    e = np.array([np.cos(angle), np.sin(angle)])
    centre = np.flatnonzero(np.abs(bonds.mesh.p - 0.5).max(axis=0) < 1e-9)[0]
    mine = (bonds.ends == centre).any(axis=0)
    xi = bonds.vectors()[:, mine]
    r = np.linalg.norm(xi, axis=0)
    strain = (e @ xi / r) ** 2
    total = (bonds.measure()[mine] * r * strain**2).sum() / 2 * 256
    return total / (bonds.moment * 2 * 3 / 8)
