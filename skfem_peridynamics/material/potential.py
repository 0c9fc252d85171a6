"""Potentials f of a bond and what follows from them: energy, its gradient and its Hessian together.

A bond of length r and strain S stores ``f(r S^2)``. With the scaled strain ``T = sqrt(r) S`` this is
``F1(T) = f(T^2)`` (the paper's F1), so every kernel needs only ``F1, F1', F1''`` of one number per bond.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np

from .._types import Floats

_LARGEST = 1e300  # that is squared nowhere
_LARGEST_BEND = 1e280  # of a law that bends over at all


@dataclass(frozen=True)
class Potential:
    """A smooth, increasing, concave ``f(q)`` with ``f(0) = 0``, initial slope and limit at infinity.

    The energy of a bond of length r under the strain S is ``f(r S^2)``. For a law of your own, derive from it and
    give ``f``, ``df`` and ``d2f``, arrays to arrays of the same shape, or see :func:`own_potential`.

    Parameters
    ----------
    slope : float
        ``f'(0)``, a stress.
    limit : float
        ``f_inf``, an energy per area, as toughness is.

    Raises
    ------
    ValueError
        Unless both are positive, and their ratio a number.

    References
    ----------
    Paper, section 2.1.

    Examples
    --------
    >>> law = Exponential(slope=8.0, limit=2.0)                # a potential, with b = f'(0) / f_inf = 4
    >>> law.b, law.hessian(np.array([0.0])).tolist()           # F1''(0) = 2 f'(0)
    (4.0, [16.0])
    """

    slope: float
    limit: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.slope) and self.slope > 0.0):
            raise ValueError(f"slope = {self.slope}: f'(0) must be positive and finite")
        if not self.limit > 0.0:
            raise ValueError(f"limit = {self.limit}: f_inf must be positive")
        if np.isfinite(self.limit) and not 1.0 / _LARGEST <= self.b <= _LARGEST:
            raise ValueError(
                f"slope = {self.slope} and limit = {self.limit}: b = f'(0) / f_inf must lie between "
                f"{1.0 / _LARGEST:g} and {_LARGEST:g}, for numbers end near there"
            )

    @property
    def b(self) -> float:
        """The paper's b = f'(0) / f_inf, the inverse of the q at which the law bends over."""
        return self.slope / self.limit

    def f(self, q: Floats) -> Floats:
        """Return ``f(q)``.

        Parameters
        ----------
        q : ndarray
            ``q = r S^2 = T^2``, not negative, any shape, a length.

        Returns
        -------
        ndarray
            Energies per area, the shape of q.

        Raises
        ------
        TypeError
            Where a law of your own does not define it.
        """
        raise TypeError(f"{type(self).__name__} must define f(q)")

    def df(self, q: Floats) -> Floats:
        """Return ``f'(q)``.

        Parameters
        ----------
        q : ndarray
            ``q = r S^2 = T^2``, not negative, any shape, a length.

        Returns
        -------
        ndarray
            Stresses, the shape of q.

        Raises
        ------
        TypeError
            Where a law of your own does not define it.
        """
        raise TypeError(f"{type(self).__name__} must define df(q), the derivative of f")

    def d2f(self, q: Floats) -> Floats:
        """Return ``f''(q)``.

        Parameters
        ----------
        q : ndarray
            ``q = r S^2 = T^2``, not negative, any shape, a length.

        Returns
        -------
        ndarray
            Stresses per length, the shape of q.

        Raises
        ------
        TypeError
            Where a law of your own does not define it.
        """
        raise TypeError(f"{type(self).__name__} must define d2f(q), the second derivative of f")

    # F1 and its derivatives: the only form in which the kernels see a law.
    def energy(self, T: Floats) -> Floats:
        """Return ``F1(T) = f(T^2)``.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T.
        """
        return self.f(T * T)

    def gradient(self, T: Floats) -> Floats:
        """Return ``F1'(T) = 2 T f'(T^2)``.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T.
        """
        g = self.df(T * T)
        g *= T
        g *= 2.0
        return g

    def hessian(self, T: Floats) -> Floats:
        """Return ``F1''(T) = 2 f'(T^2) + 4 T^2 f''(T^2)``; ``hessian(0) = 2 f'(0)``.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T; it falls from ``2 f'(0)`` and is negative beyond the inflection.
        """
        q = np.minimum(T * T, _LARGEST)  # beyond it nothing is left, and infinity times nothing is no number
        return 2.0 * self.df(q) + 4.0 * q * self.d2f(q)

    def third(self, T: Floats) -> Floats:
        """Return the third derivative of F1, ``12 T f'' + 8 T^3 f'''``; by differences of F1'' where f''' is not known.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T.
        """
        # five points, of order four: 1e-12 of the largest value for a law that is smooth on the scale of its bend
        d = 1e-3 * self._scale
        near, wide = (self.hessian(T + n * d) - self.hessian(T - n * d) for n in (1, 2))
        third: Floats = (8.0 * near - wide) / (12.0 * d)
        return third

    def secant(self, T: Floats) -> Floats:
        """Return ``F1'(T) / T = 2 f'(T^2)``.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T; never negative.
        """
        g: Floats = 2.0 * self.df(T * T)
        return g

    def severity(self, T: Floats) -> Floats:
        """Return ``Z = |S| / S_c = |T| / rbar``: beyond 1 a bond has softened.

        Parameters
        ----------
        T : ndarray
            Scaled strains ``T = sqrt(r) S``, any shape.

        Returns
        -------
        ndarray
            The shape of T; 0 for a law that never softens.
        """
        Z: Floats = np.abs(T)
        Z *= 1.0 / self.inflection
        return Z

    @cached_property
    def inflection(self) -> float:
        """``rbar``, where the force of a bond is largest: the root of ``f'(T^2) + 2 T^2 f''(T^2) = 0``."""
        from scipy import optimize

        scale = self._scale
        grid = scale * np.geomspace(1e-6, 1e6, 1201)
        with np.errstate(all="ignore"):  # far out a user's law may overflow; what is not a number bends nowhere
            bend = np.nan_to_num(self.hessian(grid), nan=1.0)
        falling = np.flatnonzero(bend <= 0.0)
        if not len(falling):
            return float("inf")
        first = falling[0]
        if first == 0 or bend[first] == 0.0:
            return float(grid[first])
        return float(optimize.brentq(lambda T: float(self.hessian(np.array([T]))[0]), grid[first - 1], grid[first]))

    def critical_strain(self, r: Floats | float) -> Floats:
        """Return ``S_c = rbar / sqrt(r)``, beyond which a bond softens.

        Parameters
        ----------
        r : float or ndarray
            Lengths of bonds.

        Returns
        -------
        ndarray
            Strains, dimensionless.

        References
        ----------
        Paper, section 2.1.
        """
        S_c: Floats = self.inflection / np.sqrt(np.asarray(r, dtype=float))
        return S_c

    @cached_property
    def suprema(self) -> tuple[float, float, float, float]:
        """The suprema ``C1..C4`` of the first four derivatives of F1 (paper, before eq. 2.20), found numerically."""
        from scipy.interpolate import make_interp_spline

        # in units of the scale: knots of 1e-7 would leave a spline of degree 7 no digits
        x = np.linspace(-0.5, 12.0, 6001)
        second = make_interp_spline(x, self.hessian(self._scale * x) / self.slope, k=7)
        inner = x[40:-40]
        third, fourth = (self.slope * second.derivative(n)(inner) / self._scale**n for n in (1, 2))
        T = self._scale * inner
        return (
            float(np.abs(self.gradient(T)).max()),
            float(np.abs(self.hessian(T)).max()),
            float(np.abs(third).max()),
            float(np.abs(fourth).max()),
        )

    @cached_property
    def _scale(self) -> float:
        """The T at which ``f'(0) T^2`` reaches ``f_inf``; without a limit, where f falls to half of it (1 if never)."""
        if np.isfinite(self.limit):
            return float(1.0 / np.sqrt(self.b))
        bend = bend_of(self.f, self.slope)
        return float(np.sqrt(bend)) if np.isfinite(bend) else 1.0


def bend_of(f: Callable[[Floats], Floats], slope: float) -> float:
    """Return the q, to a factor of 2, from which on ``f(q)`` is less than half of ``f'(0) q``; infinity if never.

    >>> bend_of(lambda q: np.tanh(1e9 * q), 1e9) * 1e9 < 4.0
    True
    """
    with np.errstate(all="ignore"):
        # from above: near 0 a law may have lost its digits, as 1 - exp(-q) has; far out it may overflow
        for q in (2.0 ** np.arange(960, -960, -1)).tolist():
            try:
                value = float(np.asarray(f(np.array([q])), dtype=float)[0])
            except ArithmeticError:
                continue
            if value >= 0.5 * slope * q:
                return 2.0 * q if q < _LARGEST_BEND else float("inf")
    return float("inf")


@dataclass(frozen=True)
class Exponential(Potential):
    """``f(q) = C (1 - exp(-b q))`` with ``C = f_inf``, ``b = f'(0) / f_inf``.

    Parameters
    ----------
    slope : float
        ``f'(0)``, a stress.
    limit : float
        ``f_inf``, an energy per area.

    Examples
    --------
    >>> law = Exponential(slope=8.0, limit=2.0)
    >>> round(law.inflection ** 2, 12)           # 1 / (2 b)
    0.125
    """

    @cached_property
    def _far(self) -> float:
        """The q from which on exp(-b q) is 0: beyond it nothing is computed with, and nothing overflows."""
        return min(750.0 / self.b, _LARGEST)

    def f(self, q: Floats) -> Floats:
        return -self.limit * np.expm1(-self.b * np.minimum(q, self._far))

    def df(self, q: Floats) -> Floats:
        g = np.minimum(q, self._far)
        g *= -self.b
        np.exp(g, out=g)
        g *= self.slope
        return g

    def d2f(self, q: Floats) -> Floats:
        return -self.b * self.df(q)

    def third(self, T: Floats) -> Floats:
        q = np.minimum(T * T, self._far)
        return T * self.df(q) * (self.b * (8.0 * self.b * q - 12.0))

    @cached_property
    def inflection(self) -> float:
        return float(np.sqrt(0.5 / self.b))

    @cached_property
    def suprema(self) -> tuple[float, float, float, float]:
        from scipy import special

        # The n-th derivative of exp(-x^2) is largest at the smallest root of the Hermite polynomial H_{n+1}.
        roots = [np.abs(special.roots_hermite(n + 1)[0]).min() for n in (1, 2, 3, 4)]
        values = [abs(special.eval_hermite(n, x)) * np.exp(-(x**2)) for n, x in zip((1, 2, 3, 4), roots, strict=True)]
        c1, c2, c3, c4 = (self.limit * np.sqrt(self.b) ** n * v for n, v in zip((1, 2, 3, 4), values, strict=True))
        return float(c1), float(c2), float(c3), float(c4)


@dataclass(frozen=True)
class Rational(Potential):
    """``f(q) = C b q / (1 + b q)`` with ``C = f_inf``, ``b = f'(0) / f_inf``.

    Parameters
    ----------
    slope : float
        ``f'(0)``, a stress.
    limit : float
        ``f_inf``, an energy per area.

    Examples
    --------
    >>> Rational(slope=8.0, limit=2.0).f(np.array([0.25]))
    array([1.])
    """

    def f(self, q: Floats) -> Floats:
        z = self.b * np.minimum(q, self._far)
        return self.limit * (z / (1.0 + z))

    @cached_property
    def _far(self) -> float:
        """The q beyond which nothing is computed with: b q stays a number, and f' and f'' have long been 0."""
        return _LARGEST / max(self.b, 1.0)

    def _root(self, q: Floats) -> Floats:
        """``1 / (1 + b q)``"""
        g = np.minimum(q, self._far)
        g *= self.b
        g += 1.0
        return np.reciprocal(g, out=g)

    def df(self, q: Floats) -> Floats:
        g = self._root(q)
        g *= g
        g *= self.slope
        return g

    def d2f(self, q: Floats) -> Floats:
        g = self._root(q)
        return g * g * g * (-2.0 * self.b * self.slope)

    def third(self, T: Floats) -> Floats:
        q = np.minimum(T * T, self._far)
        g = self._root(q)
        cube = g * g * g
        return T * cube * (self.b * self.slope * (48.0 * (self.b * q) * g - 24.0))

    @cached_property
    def inflection(self) -> float:
        return float(np.sqrt(1.0 / (3.0 * self.b)))

    @cached_property
    def suprema(self) -> tuple[float, float, float, float]:
        # With x = cot(t) the n-th derivative of 1/(1 + x^2) is n! sin((n+1) t) sin(t)^(n+1), extremal where
        # sin((n+2) t) = 0.
        def largest(n: int) -> float:
            t = np.pi * np.arange(1, n + 2) / (n + 2)
            return float(factorial(n) * np.abs(np.sin((n + 1) * t) * np.sin(t) ** (n + 1)).max())

        c1, c2, c3, c4 = (self.limit * np.sqrt(self.b) ** n * largest(n) for n in (1, 2, 3, 4))
        return float(c1), float(c2), float(c3), float(c4)


@dataclass(frozen=True)
class Linear(Potential):
    """``f(q) = f'(0) q``: bonds that never soften; the reference law and the law of no-fail regions.

    Parameters
    ----------
    slope : float
        ``f'(0)``, a stress.
    limit : float
        Infinite: nothing ever breaks.

    Examples
    --------
    >>> Linear(slope=3.0).gradient(np.array([0.5]))
    array([3.])
    """

    limit: float = float("inf")

    def f(self, q: Floats) -> Floats:
        return self.slope * q

    def df(self, q: Floats) -> Floats:
        return np.full_like(q, self.slope)

    def d2f(self, q: Floats) -> Floats:
        return np.zeros_like(q)

    def gradient(self, T: Floats) -> Floats:
        return T * (2.0 * self.slope)

    def third(self, T: Floats) -> Floats:
        return np.zeros_like(T)

    @cached_property
    def inflection(self) -> float:
        return float("inf")

    @cached_property
    def suprema(self) -> tuple[float, float, float, float]:
        return float("inf"), 2.0 * self.slope, 0.0, 0.0
