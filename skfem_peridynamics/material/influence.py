"""Influence functions J(s), s = r / horizon, and the moments that calibrate a law."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._types import Floats

# The rim s = 1 belongs to the ball. Structured meshes put many bonds exactly there, so the limit
# from inside is taken a few round-offs away from it.
_RIM = 1.0 - 1e-12


@dataclass(frozen=True)
class Influence:
    """Weigh a bond by its length: ``J(s)`` with ``s = r / horizon``.

    The profile is read on ``0 < s < 1`` only; beyond the rim the limit from inside stands in, because a bond that
    sticks out of the ball keeps the part of its volume that lies inside.

    Parameters
    ----------
    name : str
        What summaries and messages call it.
    profile : callable
        ``J(s)``, array to array, dimensionless, bounded and not negative.

    Raises
    ------
    ValueError
        When the profile is negative, not finite or zero everywhere.

    References
    ----------
    Paper, section 2.1.

    Examples
    --------
    >>> round(Influence("tent", lambda s: 1 - s).moment(2), 12)   # M_2 = 1/3 - 1/4
    0.083333333333
    """

    name: str
    profile: Callable[[Floats], Floats]

    def __post_init__(self) -> None:
        sample = self(np.linspace(0.0, 1.0, 257)[1:])
        if not np.all(np.isfinite(sample)) or sample.min() < 0.0 or sample.max() <= 0.0:
            raise ValueError(
                f"influence {self.name!r} must be finite, non-negative and somewhere positive on 0 < s < 1; "
                f"its values there run from {sample.min():g} to {sample.max():g}"
            )

    def __call__(self, s: Floats) -> Floats:
        """Return ``J(s)``, shape of ``s``; on and beyond the rim its limit from inside."""
        s = np.asarray(s, dtype=float)
        return np.broadcast_to(np.asarray(self.profile(np.minimum(s, _RIM)), dtype=float), s.shape)

    def moment(self, power: float) -> float:
        """Return the moment ``int_0^1 J(s) s^power ds``; that of order d is the ``M_d`` of the calibration.

        Parameters
        ----------
        power : float
            Power of s, above -1.

        Returns
        -------
        float
            The moment, dimensionless.

        Examples
        --------
        >>> round(constant.moment(3), 12)
        0.25
        """
        if power <= -1.0 - self._order_at_zero:
            return float("inf")
        from scipy.integrate import quad

        def at(s: float) -> float:
            return float(self(np.array([s]))[0])

        if -1.0 < power < 0.0:  # QUADPACK's rule for an algebraic end point
            return float(quad(at, 0.0, 1.0, weight="alg", wvar=(power, 0.0), epsabs=0.0, epsrel=1e-12)[0])
        return float(quad(lambda s: at(s) * s**power, 0.0, 1.0, epsabs=0.0, epsrel=1e-12, limit=400)[0])

    def mean_inverse_power(self, a: float, dim: int) -> float:
        """Return ``Jbar_a``, the mean of ``J(|z|) |z|^-a`` over the unit ball.

        It enters the paper's ``L1 = 4 C2 Jbar_1`` and the closed-form step limit.

        Parameters
        ----------
        a : float
            The power.
        dim : int
            Dimension of the body, 1, 2 or 3.

        Returns
        -------
        float
            The mean; infinite where the integral diverges.

        Examples
        --------
        >>> round(constant.mean_inverse_power(1, dim=2), 12), constant.mean_inverse_power(1, dim=1)
        (2.0, inf)
        """
        return dim * self.moment(dim - 1 - a)

    @cached_property
    def _order_at_zero(self) -> float:
        """The exponent m of ``J ~ s^m`` at s = 0, seen from two points close to it."""
        near, far = (float(self(np.array([s]))[0]) for s in (1e-9, 1e-7))
        if near <= 0.0:
            return np.inf
        if far <= 0.0:
            return 0.0
        order = float(np.log(far / near) / np.log(100.0))
        return 0.0 if abs(order) < 1e-3 else order


constant = Influence("constant", lambda s: np.ones_like(s))
conical = Influence("conical", lambda s: 1.0 - s)


def gaussian(width: float = 0.5) -> Influence:
    """Return ``J(s) = exp(-(s / width)^2)``, cut off at the horizon.

    Parameters
    ----------
    width : float, optional
        Where J has fallen to 1/e, in horizons.

    Returns
    -------
    Influence
        The function.

    Raises
    ------
    ValueError
        For a width that is not positive.

    Examples
    --------
    >>> round(float(gaussian(0.5)(np.array([0.5]))[0]), 6)
    0.367879
    """
    if not width > 0.0:
        raise ValueError(f"width = {width} must be positive: it is a fraction of the horizon")
    return Influence(f"gaussian({width:g})", lambda s: np.exp(-((s / width) ** 2)))


def as_influence(influence: str | Influence | Callable[[Floats], Floats]) -> Influence:
    """Return the influence function of that name, or wrap a user's own ``J(s)``.

    >>> as_influence("conical")(np.array([0.25]))
    array([0.75])
    """
    if isinstance(influence, Influence):
        return influence
    named = {"constant": constant, "conical": conical, "gaussian": gaussian()}
    if isinstance(influence, str):
        if influence not in named:
            raise ValueError(f"influence = {influence!r} is not known; it can be {', '.join(named)}")
        return named[influence]
    return Influence(getattr(influence, "__name__", "own"), influence)
