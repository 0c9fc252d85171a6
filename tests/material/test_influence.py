import numpy as np
import pytest

from skfem_peridynamics import Influence, conical, constant, gaussian
from skfem_peridynamics.material.influence import as_influence


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_moments_of_constant_and_conical(dim):
    assert constant.moment(dim) == pytest.approx(1 / (dim + 1), rel=1e-13)
    assert conical.moment(dim) == pytest.approx(1 / (dim + 1) - 1 / (dim + 2), rel=1e-13)


def test_moment_of_gaussian_against_the_error_function():
    # int_0^1 exp(-4 s^2) s ds = (1 - exp(-4)) / 8
    assert gaussian(0.5).moment(1) == pytest.approx((1 - np.exp(-4)) / 8, rel=1e-13)


@pytest.mark.parametrize(
    ("influence", "a", "dim", "expected"),
    [
        (constant, 1, 1, np.inf),
        (constant, 1, 2, 2.0),
        (constant, 1, 3, 1.5),
        (constant, 1.5, 2, 4.0),
        (constant, 2, 2, np.inf),
        (constant, 2, 3, 3.0),
        (conical, 1, 1, np.inf),
        (conical, 1, 2, 1.0),
        (conical, 1, 3, 0.5),
        (Influence("ramp", lambda s: s), 1, 1, 1.0),
        (Influence("ramp", lambda s: s), 2, 1, np.inf),
        (Influence("root", np.sqrt), 1, 1, 2.0),
        (Influence("hollow", lambda s: np.where(s < 0.5, 0.0, 1.0)), 1, 1, np.log(2.0)),
    ],
)
def test_mean_inverse_power_is_infinite_where_it_diverges(influence, a, dim, expected):
    assert influence.mean_inverse_power(a, dim) == pytest.approx(expected, rel=1e-6)


def test_rim_takes_the_limit_from_inside():
    cut = Influence("cut", lambda s: np.where(s < 1.0, 2.0, 0.0))
    assert cut(np.array([0.5, 1.0, 1.1])).tolist() == [2.0, 2.0, 2.0]
    assert conical(np.array([1.0, 1.2])) == pytest.approx(0.0, abs=1e-11)


@pytest.mark.parametrize("profile", [lambda s: s - 0.5, lambda s: 0.0 * s, lambda s: np.full_like(s, np.nan)])
def test_a_profile_that_is_no_influence_is_refused(profile):
    with pytest.raises(ValueError, match="non-negative and somewhere positive"):
        Influence("bad", profile)


def test_names_and_own_functions():
    assert as_influence("conical") is conical
    assert as_influence(lambda s: 1 - s**2)(np.array([0.5]))[0] == 0.75
    with pytest.raises(ValueError, match="'cone' is not known; it can be constant, conical, gaussian"):
        as_influence("cone")
    with pytest.raises(ValueError, match=r"width = -1"):
        gaussian(-1)
