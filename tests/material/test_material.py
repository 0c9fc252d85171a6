import numpy as np
import pytest

from skfem_peridynamics import Material

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


@pytest.mark.parametrize(
    ("dim", "plane", "nu", "can"),
    [(2, "stress", 0.3, "0.333333"), (3, None, 0.3, "0.25"), (1, None, 0.25, "none in 1D")],
)
def test_a_poisson_ratio_the_law_cannot_have_is_refused_with_the_reason(dim, plane, nu, can):
    """Where it is written, as far as the plane state tells; in 1D, which has none, when the law is made."""
    with pytest.raises(ValueError, match=f"one elastic constant .* {can}"):
        Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane=plane, poisson=nu).law(dim, 0.3)
    if dim > 1:
        with pytest.raises(ValueError, match="leave poisson out"):
            Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane=plane, poisson=nu)


def test_plane_state_belongs_to_2d():
    m = Material.from_elastic(young=1.0, toughness=1.0, density=1.0)
    with pytest.raises(ValueError, match="a body in 2D is in plane"):
        m.law(2, 0.3)
    with pytest.raises(ValueError, match="no meaning in 3D"):
        m.with_(plane="stress").law(3, 0.3)
    with pytest.raises(ValueError, match="K_Ic = 1.0 has no meaning in 1D"):
        Material.from_elastic(young=1.0, K_Ic=1.0, density=1.0).law(1, 0.5)
