"""eps -> 0 with eps/h fixed: statics of the linear model against scikit-fem's own local elasticity."""

import numpy as np
import pytest

from skfem_peridynamics import BallRule, PairRule
from skfem_peridynamics.study.local_limit import distance_to_local as distance


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
