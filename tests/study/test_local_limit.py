"""eps -> 0 with eps/h fixed: statics of the linear model against scikit-fem's own local elasticity."""

import numpy as np
import pytest

from skfem_peridynamics import BallRule, PairRule
from skfem_peridynamics.study.local_limit import distance_to_local as distance
from skfem_peridynamics.study.local_limit import distances


@pytest.mark.parametrize("per_horizon", [2, 4, pytest.param(8, marks=pytest.mark.slow)])
@pytest.mark.parametrize("rule", [BallRule(3, 8), BallRule(3, 8, outer="vertices")], ids=["gauss", "vertices"])
def test_ball_rules_are_asymptotically_compatible(rule, per_horizon):
    horizons = [1 / 3, 1 / 6, 1 / 12] if per_horizon < 8 else [1 / 2, 1 / 4, 1 / 6]
    gaps = [distance(eps, per_horizon, rule) for eps in horizons]
    rate = np.polyfit(np.log(horizons), np.log(gaps), 1)[0]
    print(f"{rule.name}, eps/h = {per_horizon}: {', '.join(f'{g:.2e}' for g in gaps)}, rate {rate:.2f}")
    assert rate > 1.8


def test_pairs_keep_the_error_of_their_moment():
    """At a fixed number of vertices per horizon the moment of pairs is off by a fixed amount: they do not converge."""
    gaps = [distance(eps, 4, PairRule()) for eps in (1 / 3, 1 / 6, 1 / 12)]
    print(f"vertex pairs, eps/h = 4: {', '.join(f'{g:.2e}' for g in gaps)}")
    assert gaps[2] > 0.4 * gaps[1]


@pytest.mark.parametrize("lame", [-0.5, 1.5, 9.0, 49.0])
def test_any_poisson_ratio_goes_to_its_own_elasticity(lame):
    """Plane strain, nu = -0.5, 0.3, 0.45, 0.49; balanced pairs at four vertices per horizon."""
    horizons = [1 / 4, 1 / 8, 1 / 16]
    gaps = [distance(eps, 4, PairRule(), True, lame) for eps in horizons]
    rate = np.polyfit(np.log(horizons), np.log(gaps), 1)[0]
    print(f"lambda = {lame} mu: {', '.join(f'{g:.2e}' for g in gaps)}, rate {rate:.2f}")
    assert rate > 1.5  # 1.62 to 2.26 measured: the moments of pairs leave a floor
    assert gaps[-1] < 1.5e-3


def test_near_one_half_it_locks_no_more_than_the_local_element():
    """From nu = 0.49 to 0.499 in plane strain: the error to the exact solution grows less than that of local P1."""
    horizons = [1 / 4, 1 / 8, 1 / 16]
    errors = {lame: np.array([distances(eps, 4, PairRule(), True, lame) for eps in horizons]) for lame in (49.0, 499.0)}
    grows = (errors[499.0] / errors[49.0])[:, 1:]
    for lame, each in errors.items():
        print(f"lambda = {lame} mu: local {each[:, 1]}, nonlocal {each[:, 2]}")
    print("grows, local and nonlocal:", grows.round(2).tolist())
    assert (grows[:, 1] < grows[:, 0]).all()
    rate = np.polyfit(np.log(horizons), np.log(errors[499.0][:, 2]), 1)[0]
    assert rate > 1.8  # 2.03 measured
