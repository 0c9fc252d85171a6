import numpy as np
import pytest

from skfem_peridynamics import Material
from skfem_peridynamics.material.volumetric import make_volumetric

STATES = [(1, None, None), (2, "stress", 1 / 3), (2, "strain", 1 / 4), (3, None, 1 / 4)]
OMEGA = [1.0, 2.0, np.pi, 4 * np.pi / 3]


def lame(young, nu, plane):
    """First Lamé constant as textbooks give it, the plane-stress one reduced."""
    full = young * nu / ((1 + nu) * (1 - 2 * nu))
    return young * nu / (1 - nu**2) if plane == "stress" else full


@pytest.mark.parametrize(("dim", "plane", "nu"), STATES)
def test_round_trip(dim, plane, nu):
    m = Material.from_elastic(young=72e9, toughness=135.0, density=2440.0, plane=plane, poisson=nu)
    law = m.law(dim, moment=0.3)
    back = m.elastic(law, dim, moment=0.3)
    assert back.young == pytest.approx(72e9, rel=1e-14)
    assert back.toughness == pytest.approx(135.0, rel=1e-14)
    if nu is not None:
        assert back.lame == pytest.approx(lame(72e9, nu, plane), rel=1e-12)
        mu = 72e9 / (2 * (1 + nu))
        assert back.lame == pytest.approx(mu, rel=1e-12)  # lambda = mu


@pytest.mark.parametrize(("dim", "plane", "nu"), STATES)
def test_formulas_of_the_paper(dim, plane, nu):
    m = Material.from_elastic(lame=3.0, toughness=2.0, density=1.0, plane=plane)
    law = m.law(dim, moment=0.25)
    assert law.slope == pytest.approx(3.0 * (dim + 2) / (2 * 0.25))
    assert 2 * OMEGA[dim - 1] / OMEGA[dim] * law.limit * 0.25 == pytest.approx(2.0)
    paper = m.with_(convention="paper").law(dim, moment=0.25)
    assert paper.slope / law.slope == pytest.approx(1.0 if dim == 1 else 2.0)
    assert paper.limit == law.limit


def test_toughness_from_stress_intensity():
    for plane, dim, young in [
        ("stress", 2, 70e9),
        ("strain", 2, 70e9 / (1 - 1 / 16)),
        (None, 3, 70e9 / (1 - 1 / 16)),
    ]:
        m = Material.from_elastic(young=70e9, K_Ic=0.75e6, density=2500.0, plane=plane)
        assert m.elastic(m.law(dim, 0.3), dim, 0.3).toughness == pytest.approx(0.75e6**2 / young, rel=1e-12)


def test_rayleigh_speed_solves_rayleighs_equation():
    e = Material.from_elastic(young=5.0, toughness=1.0, density=2.0).elastic(
        Material.from_elastic(young=5.0, toughness=1.0, density=2.0).law(3, 0.25), 3, 0.25
    )
    a, b = (e.rayleigh_speed / e.pressure_speed) ** 2, (e.rayleigh_speed / e.shear_speed) ** 2
    assert (2 - b) ** 2 == pytest.approx(4 * np.sqrt(1 - a) * np.sqrt(1 - b), rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"young": -1.0}, "young = -1.0 must be a positive number"),
        ({"density": 0.0}, "density = 0.0 must be a positive number"),
        ({"toughness": np.nan}, "toughness = nan must be a positive number"),
        ({"toughness": None}, "toughness = None: a law that can fail needs"),
        ({"lame": 1.0}, "one of young = 1.0 and lame = 1.0"),
        ({"young": None}, "one of young = None and lame = None"),
        ({"K_Ic": 1.0}, "one of toughness = 1.0 and K_Ic = 1.0"),
        ({"plane": "stres"}, "plane = 'stres' must be"),
        ({"convention": "other"}, "convention = 'other' must be one of physical, paper"),
        ({"calibrate": "no"}, "calibrate = 'no' must be"),
    ],
)
def test_constants_that_make_no_sense(changes, message):
    good = {"young": 1.0, "toughness": 1.0, "density": 1.0}
    with pytest.raises(ValueError, match=message):
        Material.from_elastic(**(good | changes))


RATIOS = [-0.9, -0.3, 0.0, 0.2, 0.3, 0.45, 0.49]


@pytest.mark.parametrize(("dim", "plane"), [(2, "stress"), (2, "strain"), (3, None)])
@pytest.mark.parametrize("nu", RATIOS)
def test_any_ratio_there_and_back(dim, plane, nu):
    """Against the textbook, in all three ways to say it; the law holds mu, the energy beside it lambda - mu."""
    young, moment = 72e9, 0.3
    mu, lam = young / (2 * (1 + nu)), lame(young, nu, plane)
    bulk = lam + mu if plane == "stress" else lam + 2 * mu / 3
    rest = {"toughness": 135.0, "density": 2440.0, "plane": plane}
    for given in ({"young": young, "poisson": nu}, {"lame": lam, "mu": mu}, {"bulk": bulk, "mu": mu}):
        m = Material.from_elastic(**given, **rest)
        law = m.law(dim, moment)
        assert 2 / (dim + 2) * law.slope * moment == pytest.approx(mu, rel=1e-13)
        assert m.volumetric_energy(law, dim, moment).modulus == pytest.approx(lam - mu, rel=1e-10)
        back = m.elastic(law, dim, moment)
        assert (back.young, back.poisson) == pytest.approx((young, nu), rel=1e-11, abs=1e-13)
        assert (back.lame, back.shear) == pytest.approx((lam, mu), rel=1e-11, abs=1e-2)
        cp, cs, cr = back.pressure_speed, back.shear_speed, back.rayleigh_speed
        assert (cp**2 * 2440, cs**2 * 2440) == pytest.approx((lam + 2 * mu, mu), rel=1e-11)
        a, b = (cr / cp) ** 2, (cr / cs) ** 2
        assert (2 - b) ** 2 == pytest.approx(4 * np.sqrt(1 - a) * np.sqrt(1 - b), rel=1e-11)
    K = Material.from_elastic(young=young, poisson=nu, K_Ic=0.75e6, density=1.0, plane=plane)
    stiff = young if plane == "stress" else young / (1 - nu**2)
    assert K.elastic(K.law(dim, moment), dim, moment).toughness == pytest.approx(0.75e6**2 / stiff, rel=1e-12)
    # the paper's factor makes a body stiffer as a whole
    paper = Material.from_elastic(young=young, poisson=nu, convention="paper", **rest)
    back = paper.elastic(paper.law(dim, moment), dim, moment)
    assert (back.young, back.poisson) == pytest.approx((2 * young, nu), rel=1e-11, abs=1e-13)


@pytest.mark.parametrize(("dim", "plane", "nu"), STATES[1:])
def test_at_the_ratio_of_bonds_nothing_is_added_and_no_bit_changes(dim, plane, nu):
    rest = {"toughness": 135.0, "density": 2440.0, "plane": plane}
    alone = Material.from_elastic(young=72e9, **rest)
    lam = alone.elastic(alone.law(dim, 0.3), dim, 0.3).lame
    for given in ({"young": 72e9, "poisson": nu}, {"young": 72e9, "poisson": round(nu, 6)}):
        m = Material.from_elastic(**given, **rest)
        law = m.law(dim, 0.3)
        assert law == alone.law(dim, 0.3)
        assert m.volumetric_energy(law, dim, 0.3) is None
        assert m.elastic(law, dim, 0.3) == alone.elastic(law, dim, 0.3)
    both = Material.from_elastic(lame=lam, mu=lam, **rest)
    assert both.law(dim, 0.3) == Material.from_elastic(lame=lam, **rest).law(dim, 0.3)
    assert both.volumetric_energy(both.law(dim, 0.3), dim, 0.3) is None


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"young": 1.0, "poisson": -1.0}, "poisson = -1: in 3D Poisson's ratio lies between -1 and 0.5"),
        ({"young": 1.0, "poisson": 0.5}, "poisson = 0.5: .* change its volume for nothing"),
        ({"young": 1.0, "poisson": 0.5, "plane": "strain"}, "in plane strain Poisson's ratio lies between -1 and 0.5"),
        ({"young": 1.0, "poisson": 1.0, "plane": "stress"}, "in plane stress Poisson's ratio lies between -1 and 1"),
        ({"young": 1.0, "poisson": np.nan}, "poisson = nan must be a number"),
        ({"lame": -0.7, "mu": 1.0}, "lame = -0.7 with mu = 1 is Poisson's ratio -1.167"),
        ({"lame": -1.0}, "lame = -1.0 must be a positive number"),
        ({"lame": 1.0, "poisson": 0.3}, "poisson = 0.3 goes with young; beside lame give mu"),
        ({"young": 1.0, "mu": 1.0}, "mu = 1 goes with lame or with bulk, not with young"),
        ({"lame": 1.0, "mu": 1.0, "poisson": 0.25}, "not with poisson"),
        ({"bulk": 1.0}, "bulk = 1 goes with mu"),
        ({"bulk": 1.0, "lame": 1.0, "mu": 1.0}, "give one of young = None and lame = 1.0"),
        ({"bulk": -1.0, "mu": 1.0}, "bulk = -1.0 must be a positive number"),
        ({"young": 1.0, "volumetric": "cubic"}, "volumetric = 'cubic' must be"),
    ],
)
def test_constants_that_no_solid_has(given, message):
    def make():
        m = Material.from_elastic(toughness=1.0, density=1.0, **given)
        return m.volumetric_energy(m.law(2 if m.plane else 3, 0.3), 2 if m.plane else 3, 0.3)

    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("second", [{"poisson": 0.25}, {"poisson": 0.3}])
def test_a_line_has_one_elastic_constant(second):
    with pytest.raises(ValueError, match="poisson = 0.* has no meaning in 1D"):
        Material.from_elastic(young=1.0, toughness=1.0, density=1.0, **second).law(1, 0.3)


def own_volumetric(g, dg, d2g):
    class Own:
        def __init__(self, modulus):
            self.m = modulus

    Own.g, Own.dg, Own.d2g = (lambda self, e, h=h: self.m * h(e) for h in (g, dg, d2g))
    return Own


@pytest.mark.parametrize(
    ("functions", "message"),
    [
        ((np.cosh, np.sinh, np.cosh), r"g\(0\) = .* must be 0"),
        ((lambda e: np.exp(e) - 1, np.exp, np.exp), r"dg\(0\) = .* must be 0"),
        (
            (lambda e: 1 - np.cos(2 * e), lambda e: 2 * np.sin(2 * e), lambda e: 4 * np.cos(2 * e)),
            r"asked for d2g\(0\)",
        ),
        ((lambda e: np.cosh(e) - 1, lambda e: np.sinh(e) * (1 + e**2), np.cosh), "dg is not the derivative of g"),
        ((lambda e: np.cosh(e) - 1, np.sinh, lambda e: 1 + e**2), "d2g is not the derivative of dg"),
    ],
)
def test_an_own_volumetric_energy_that_is_none(functions, message):
    m = Material.from_elastic(young=1.0, poisson=0.3, toughness=1.0, density=1.0, volumetric=own_volumetric(*functions))
    with pytest.raises(ValueError, match=message):
        m.volumetric_energy(m.law(3, 0.3), 3, 0.3)


class Quadratic:
    """One number for all second derivatives, and a first derivative that writes into what it was given."""

    def __init__(self, modulus):
        self.m = modulus

    def g(self, e):
        return 0.5 * self.m * e**2

    def dg(self, e):
        e *= self.m
        return e

    def d2g(self, e):
        return self.m


def test_own_volumetric_energies_as_people_write_them():
    own, named = (make_volumetric(what, 2.0) for what in (Quadratic, "quadratic"))
    e = np.array([-0.3, 0.0, 0.7])
    for name in ("energy", "gradient", "hessian"):
        assert getattr(own, name)(e).tolist() == getattr(named, name)(e).tolist()
    assert e.tolist() == [-0.3, 0.0, 0.7]
    assert make_volumetric(Quadratic, 2.0).energy(e).tolist() == named.energy(e).tolist()  # once more, as before
    assert make_volumetric(Quadratic, 0.0) is None
    with pytest.raises(ValueError, match=r"gives None, which has no g\(e\)"):
        make_volumetric(lambda modulus: None, 2.0)


def test_plane_state_belongs_to_2d():
    m = Material.from_elastic(young=1.0, toughness=1.0, density=1.0)
    with pytest.raises(ValueError, match="a body in 2D is in plane"):
        m.law(2, 0.3)
    with pytest.raises(ValueError, match="no meaning in 3D"):
        m.with_(plane="stress").law(3, 0.3)
    with pytest.raises(ValueError, match="K_Ic = 1.0 has no meaning in 1D"):
        Material.from_elastic(young=1.0, K_Ic=1.0, density=1.0).law(1, 0.5)
