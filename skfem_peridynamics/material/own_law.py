"""Laws of the user's own, and the choice of a law: by name, or by a function that makes one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._compile import on_arrays, scalar
from .._types import Floats
from .potential import Exponential, Linear, Potential, Rational, bend_of
from .tension_only import TensionOnly

# where a law is compared with its derivatives, times f_inf / f'(0): at no round number, where a law may change its form
_SAMPLES = np.array([1.037e-3, 0.0313, 0.1037, 0.313, 0.7131, 1.037, 1.731, 3.137, 9.731])


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
    def compiled(self) -> tuple[Any, Any, Any]:
        """f, f' and f'' as numba compiles them where they are used."""
        f, df, d2f = (scalar(function) for function in self._functions)
        return f, df, d2f

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
        When ``f(0)`` is not 0, ``f'(0)`` is not positive, or ``df`` or ``d2f`` is no derivative of what it should be.

    Examples
    --------
    >>> import math
    >>> law = own_potential(Scalars(lambda q: 1 - math.exp(-q), lambda q: math.exp(-q), lambda q: -math.exp(-q)))
    >>> round(law.slope, 12), round(law.limit, 6), round(law.inflection**2, 6)          # 1, 1 and 1 / (2 b)
    (1.0, 1.0, 0.5)
    """
    slope = float(np.asarray(law.df(np.zeros(1)), dtype=float)[0])
    if not (np.isfinite(slope) and slope > 0.0):
        raise ValueError(f"potential {law!r}: f'(0) = {slope:g} must be positive and finite")
    wrapped = Own(slope=slope, limit=_limit_of(law.f, slope), law=law)
    check_law(wrapped, repr(law))
    return wrapped


def _limit_of(f: Callable[[Floats], Floats], slope: float) -> float:
    """``f_inf``, infinite where f goes on growing."""
    bend = bend_of(f, slope)
    if not np.isfinite(bend):
        return float("inf")
    with np.errstate(all="ignore"):
        near, far = (float(value) for value in np.asarray(f(bend * np.array([1e12, 1e15])), dtype=float))
    return far if np.isfinite(near) and near > 0.0 and abs(far - near) <= 1e-6 * near else float("inf")


def check_law(law: Potential, name: str = "") -> None:
    """Raise ``ValueError`` for a law whose ``df``, ``d2f``, slope or limit are not those of its ``f``.

    >>> class Steep(Rational):
    ...     def df(self, q):
    ...         return 2.0 * super().df(q)
    >>> check_law(Steep(8.0, 2.0), "Steep")
    Traceback (most recent call last):
    ValueError: potential Steep: its slope is given as 8 and df(0) is 16
    """
    if type(law) in (Exponential, Rational, Linear):
        return
    if isinstance(law, TensionOnly):
        check_law(law.law, name)
        return
    name = name or type(law).__name__
    zero = np.zeros(1)
    if abs(float(law.f(zero)[0])) > 0.0:
        raise ValueError(f"potential {name}: f(0) = {float(law.f(zero)[0]):g} must be 0")
    at_zero = float(law.df(zero)[0])
    if not abs(at_zero - law.slope) <= 1e-6 * law.slope:
        raise ValueError(f"potential {name}: its slope is given as {law.slope:g} and df(0) is {at_zero:g}")
    scale = law._scale**2
    if np.isfinite(law.limit):
        with np.errstate(all="ignore"):
            far = float(law.f(np.array([1e12 * scale]))[0])
        if not abs(far - law.limit) <= 1e-4 * law.limit:
            raise ValueError(f"potential {name}: its f_inf is given as {law.limit:g} and f goes to {far:g}")
    q = scale * _SAMPLES
    step = 1e-4 * q
    pairs = [("df", "f", law.f, law.df(q), law.slope)]
    if type(law).d2f is not Potential.d2f:
        pairs.append(("d2f", "df", law.df, law.d2f(q), law.slope / scale))
    for derivative, of, function, given, unit in pairs:
        difference = (function(q + step) - function(q - step)) / (2.0 * step)
        # what a centred difference with that step leaves of a smooth law, and the rounding of the function
        wrong = np.flatnonzero(~(np.abs(difference - given) <= 1e-5 * np.abs(given) + 1e-6 * unit))
        if len(wrong):
            k = wrong[0]
            raise ValueError(
                f"potential {name}: {derivative} is not the derivative of {of} (at q = {q[k]:g}: {given[k]:g}, "
                f"difference quotient {difference[k]:g})"
            )


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
    check_law(own)
    if not abs(own.slope - slope) <= 1e-6 * slope:
        raise ValueError(f"potential {potential!r} was asked for f'(0) = {slope:g} and gives {own.slope:g}")
    if np.isfinite(limit) and not abs(own.limit - limit) <= 1e-4 * limit:
        raise ValueError(
            f"potential {potential!r} was asked for f_inf = {limit:g} and gives {own.limit:g}: "
            "the toughness would be another than that of the material"
        )
    return own
