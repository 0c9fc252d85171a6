from types import SimpleNamespace

import numpy as np
import pytest

from bodies import body_on, box
from skfem_peridynamics import Exponential, Linear, Material, Rational, own_potential
from skfem_peridynamics.material.own_law import make_potential
from skfem_peridynamics.material.potential import Potential
from skfem_peridynamics.material.tension_only import TensionOnly

LAWS = [
    Exponential(8.0, 2.0),
    Rational(8.0, 2.0),
    Linear(8.0),
    Exponential(1.6e11, 318.0),
    Rational(3e-9, 5e4),
]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_derivatives_are_those_of_f(law):
    scale = 1.0 / np.sqrt(law.b) if np.isfinite(law.limit) else 1.0
    T = scale * np.linspace(-3.0, 3.0, 61)
    h = 1e-5 * scale
    assert law.gradient(T) * scale == pytest.approx(
        (law.energy(T + h) - law.energy(T - h)) / (2e-5), abs=1e-8 * law.slope * scale**2
    )
    assert law.hessian(T) == pytest.approx((law.gradient(T + h) - law.gradient(T - h)) / (2 * h), abs=1e-7 * law.slope)
    assert law.energy(np.zeros(1))[0] == 0.0
    assert law.hessian(np.zeros(1))[0] == pytest.approx(2 * law.slope, rel=1e-14)


@pytest.mark.parametrize("law", LAWS[:2])
def test_limit_and_slope(law):
    assert law.f(np.array([1e9]))[0] == pytest.approx(2.0, rel=1e-8)
    assert law.f(np.array([1e-9]))[0] == pytest.approx(8e-9, rel=1e-7)


@pytest.mark.parametrize("law", LAWS[:2])
def test_inflection_is_where_the_force_is_largest_and_the_numeric_search_agrees(law):
    T = np.linspace(0, 3, 300001)
    assert law.inflection == pytest.approx(T[law.gradient(T).argmax()], abs=2e-5)
    assert Potential.inflection.func(law) == pytest.approx(law.inflection, rel=1e-9)
    assert law.critical_strain(0.25) == pytest.approx(2 * law.inflection)


@pytest.mark.parametrize("law", [LAWS[0], LAWS[1], LAWS[3], LAWS[4]], ids=repr)
def test_closed_suprema_agree_with_the_numeric_ones(law):
    assert law.suprema == pytest.approx(Potential.suprema.func(law), rel=1e-4)


def test_linear_never_softens():
    assert Linear(1.0).inflection == np.inf
    assert Linear(3.0).suprema == (np.inf, 6.0, 0.0, 0.0)


def test_extremes_give_numbers():
    for law in LAWS:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            T = np.array([0.0, 1e-200, 1e-100, 1e70])
            assert np.isfinite(law.energy(T)).all()
            assert np.isfinite(law.gradient(T)).all()


class Cubic:
    """Bounded: q / (1 + q^2)^(1/2)."""

    def f(self, q):
        return q / np.sqrt(1 + q**2)

    def df(self, q):
        return (1 + q**2) ** -1.5

    def d2f(self, q):
        return -3 * q * (1 + q**2) ** -2.5


def test_own_law_from_any_object():
    law = own_potential(Cubic())
    assert (law.slope, law.limit) == (1.0, pytest.approx(1.0))
    # f' + 2 q f'' = 0: 1 + q^2 = 6 q^2
    assert law.inflection**2 == pytest.approx(np.sqrt(1 / 5), rel=1e-9)


def test_own_law_that_lies_is_refused():
    class Wrong(Cubic):
        def df(self, q):
            return (1 + q**2) ** -1.0

    with pytest.raises(ValueError, match="df is not the derivative of f"):
        own_potential(Wrong())

    class Shifted(Cubic):
        def f(self, q):
            return 1.0 + q / np.sqrt(1 + q**2)

    with pytest.raises(ValueError, match=r"f\(0\) = 1 must be 0"):
        own_potential(Shifted())

    class Bent(Cubic):
        def d2f(self, q):
            return -2.9 * q * (1 + q**2) ** -2.5

    with pytest.raises(ValueError, match="d2f is not the derivative of df"):
        own_potential(Bent())


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_own_law_in_any_units(unit):
    """Its limit and its suprema follow the units: C_n is ``f_inf b^(n/2)`` times a number of its shape."""

    def own(law):
        return own_potential(SimpleNamespace(f=law.f, df=law.df, d2f=law.d2f))

    for kind in (Exponential, Rational):
        law = kind(2.0 * unit, 0.5 / unit)
        assert own(law).limit == pytest.approx(0.5 / unit, rel=1e-9)
        assert own(law).suprema == pytest.approx(law.suprema, rel=1e-4)
    growing = own_potential(
        SimpleNamespace(
            f=lambda q: np.log1p(unit * q),
            df=lambda q: unit / (1 + unit * q),
            d2f=lambda q: -((unit / (1 + unit * q)) ** 2),
        )
    )
    assert growing.limit == np.inf
    # F1'' = 2 b (1 - b T^2) / (1 + b T^2)^2
    assert growing.inflection == pytest.approx(unit**-0.5, rel=1e-9)
    assert growing.suprema[1] == pytest.approx(2.0 * unit, rel=1e-4)


class Strong(Exponential):
    """Its f goes to three times the limit that it is given."""

    def f(self, q):
        return 3.0 * Exponential(self.slope / 3.0, self.limit).f(q)

    def df(self, q):
        return 3.0 * Exponential(self.slope / 3.0, self.limit).df(q)

    def d2f(self, q):
        return 3.0 * Exponential(self.slope / 3.0, self.limit).d2f(q)


def test_a_law_with_another_limit_than_asked_is_refused():
    """Else the toughness of the material would be another, without a word."""
    with pytest.raises(ValueError, match="its f_inf is given as 0.5 and f goes to 1.5"):
        make_potential(Strong, 2.0, 0.5)
    with pytest.raises(ValueError, match="its f_inf is given as 0.5 and f goes to 1.5"):
        body_on(box(1, 8), 0.3, Strong(2.0, 0.5))
    with pytest.raises(ValueError, match="its f_inf is given as 0.5 and f goes to 1.5"):
        body_on(box(1, 8), 0.3, TensionOnly.of(Strong(2.0, 0.5)))
    with pytest.raises(ValueError, match=r"was asked for f_inf = 0.5 and gives 1.5: the toughness"):
        make_potential(lambda slope, limit: Exponential(slope, 3.0 * limit), 2.0, 0.5)
    with pytest.raises(ValueError, match=r"was asked for f_inf = 0.5 and gives inf"):
        make_potential(lambda slope, limit: Linear(slope), 2.0, 0.5)
    material = Material.from_elastic(
        young=1.0, toughness=1.0, density=1.0, potential=lambda slope, limit: Rational(slope, 3.0 * limit)
    )
    with pytest.raises(ValueError, match="the toughness would be another"):
        _ = body_on(box(1, 8), 0.3, material).laws


def test_make_potential():
    assert isinstance(make_potential("rational", 1.0, 2.0), Rational)
    with pytest.raises(ValueError, match="'cubic' is not known; it can be exponential, rational, linear"):
        make_potential("cubic", 1.0, 2.0)
    with pytest.raises(ValueError, match=r"asked for f'\(0\) = 2 and gives 1"):
        make_potential(lambda slope, limit: Cubic(), 2.0, 1.0)
    for slope, limit in [(-1.0, 1.0), (np.nan, 1.0), (1.0, 0.0)]:
        with pytest.raises(ValueError, match="must be positive"):
            Exponential(slope, limit)
