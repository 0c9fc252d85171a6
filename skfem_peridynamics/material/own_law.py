"""Laws of the user's own, and the choice of a law: by name, or by a function that makes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._compile import on_arrays, scalar
from .._types import Floats
from .potential import Exponential, Linear, Potential, Rational


@dataclass(frozen=True)
class Own(Potential):
    """A user's own law from any object that gives ``f, df, d2f``.

    >>> class Tanh:
    ...     f = staticmethod(np.tanh)
    ...     df = staticmethod(lambda q: 1 / np.cosh(q) ** 2)
    ...     d2f = staticmethod(lambda q: -2 * np.tanh(q) / np.cosh(q) ** 2)
    >>> law = own_potential(Tanh())
    >>> law.slope, law.limit, round(law.inflection, 6)
    (1.0, 1.0, 0.722367)
    """

    law: Any = None

    def f(self, q: Floats) -> Floats:
        return np.asarray(self.law.f(q), dtype=float)

    def df(self, q: Floats) -> Floats:
        return np.array(self.law.df(q), dtype=float)

    def d2f(self, q: Floats) -> Floats:
        return np.asarray(self.law.d2f(q), dtype=float)


class Scalars:
    """A law from three functions of one number, for :func:`own_potential`.

    Where numba is installed they are compiled, into the loops over the bonds too; they may call what numba can
    compile (``math``, arithmetic, conditions). Elsewhere Python calls them number by number: right, and slow.

    Parameters
    ----------
    f : callable
        ``f(q)``, number to number.
    df : callable
        ``f'(q)``, likewise.
    d2f : callable
        ``f''(q)``, likewise.

    Examples
    --------
    >>> import math
    >>> law = own_potential(Scalars(lambda q: math.log1p(q), lambda q: 1 / (1 + q), lambda q: -1 / (1 + q) ** 2))
    >>> law.slope, law.df(np.array([0.0, 1.0])).tolist()
    (1.0, [1.0, 0.5])
    """

    def __init__(self, f: Callable[[float], float], df: Callable[[float], float], d2f: Callable[[float], float]):
        self._functions = f, df, d2f

    @cached_property
    def compiled(self) -> tuple[Any, Any]:
        """f and f' as numba has compiled them."""
        f, df, _ = (scalar(function) for function in self._functions)
        return f, df

    @cached_property
    def _on_arrays(self) -> tuple[Callable[[Floats], Floats], ...]:
        return tuple(on_arrays(function) for function in self._functions)

    def f(self, q: Floats) -> Floats:
        """Return ``f(q)``.

        Parameters
        ----------
        q : ndarray
            Any shape.

        Returns
        -------
        ndarray
            The shape of q.
        """
        return self._on_arrays[0](q)

    def df(self, q: Floats) -> Floats:
        """Return ``f'(q)``.

        Parameters
        ----------
        q : ndarray
            Any shape.

        Returns
        -------
        ndarray
            The shape of q.
        """
        return self._on_arrays[1](q)

    def d2f(self, q: Floats) -> Floats:
        """Return ``f''(q)``.

        Parameters
        ----------
        q : ndarray
            Any shape.

        Returns
        -------
        ndarray
            The shape of q.
        """
        return self._on_arrays[2](q)


def own_potential(law: Any) -> Potential:
    """Wrap any object with ``f(q)``, ``df(q)`` and ``d2f(q)``; ``f'(0)`` and ``f_inf`` are read off it.

    Parameters
    ----------
    law : object
        Its three methods take and give arrays of any shape; or :class:`Scalars`.

    Returns
    -------
    Potential
        A law that bodies compute with.

    Raises
    ------
    ValueError
        When ``f(0)`` is not 0, ``f'(0)`` is not positive or ``df`` is not the derivative of f.

    Examples
    --------
    >>> import math
    >>> law = own_potential(Scalars(lambda q: 1 - math.exp(-q), lambda q: math.exp(-q), lambda q: -math.exp(-q)))
    >>> round(law.slope, 12), round(law.limit, 6), round(law.inflection**2, 6)          # 1, 1 and 1 / (2 b)
    (1.0, 1.0, 0.5)
    """
    zero = np.zeros(1)
    slope = float(np.asarray(law.df(zero))[0])
    if abs(float(np.asarray(law.f(zero))[0])) > 0.0:
        raise ValueError(f"potential {law!r}: f(0) = {float(np.asarray(law.f(zero))[0]):g} must be 0")
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):
        far = np.asarray(law.f(np.array([1e12, 1e15])), dtype=float)
    bounded = np.isfinite(far).all() and far[1] <= far[0] * (1.0 + 1e-6)
    wrapped = Own(slope=slope, limit=float(far[1]) if bounded else float("inf"), law=law)
    q = wrapped._scale**2 * np.array([0.1, 1.0])
    step = 1e-5 * q
    difference = (wrapped.f(q + step) - wrapped.f(q - step)) / (2 * step)
    if not np.allclose(difference, wrapped.df(q), rtol=1e-5, atol=1e-7 * slope):
        raise ValueError(
            f"potential {law!r}: df is not the derivative of f (at q = {q[0]:g}: {wrapped.df(q)[0]:g}, "
            f"difference quotient {difference[0]:g})"
        )
    return wrapped


NAMED: dict[str, Callable[[float, float], Potential]] = {
    "exponential": Exponential,
    "rational": Rational,
    "linear": lambda slope, limit: Linear(slope),
}


def make_potential(potential: Any, slope: float, limit: float) -> Potential:
    """Return the law ``what`` with this ``f'(0)`` and ``f_inf``: a name, or a callable ``(slope, limit) -> law``.

    >>> make_potential("rational", 8.0, 2.0).b
    4.0
    """
    if isinstance(potential, str):
        if potential not in NAMED:
            raise ValueError(f"potential = {potential!r} is not known; it can be {', '.join(NAMED)}")
        return NAMED[potential](slope, limit)
    if not callable(potential):
        raise ValueError(f"potential = {potential!r} must be a name or a callable (slope, limit) -> law")
    law = potential(slope, limit)
    own = law if isinstance(law, Potential) else own_potential(law)
    if not np.isclose(own.slope, slope, rtol=1e-6):
        raise ValueError(f"potential {potential!r} was asked for f'(0) = {slope:g} and gives {own.slope:g}")
    return own
