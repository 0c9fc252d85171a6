"""Prescribed motion of degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .._types import Floats, Longs

# a number or array, or a function of time that gives one
Motion: TypeAlias = npt.ArrayLike | Callable[[float], npt.ArrayLike]


@dataclass(frozen=True, eq=False)
class Prescribed:
    """Move some degrees of freedom as given.

    Parameters
    ----------
    dofs : DofsView or array_like of int
        What ``basis.get_dofs(...)`` returns, or indices; pick components with
        ``basis.get_dofs("left").all("u^1")``.
    displacement : float, array_like or callable, optional
        A number, an array (ndofs,), or a function of t that gives one.
    velocity : float, array_like or callable, optional
        The same; one of the two is given.

    Raises
    ------
    ValueError
        For an empty set, or unless exactly one of the two motions is given.

    Examples
    --------
    >>> Prescribed(np.array([0, 1]), velocity=lambda t: 2 * t).mean_velocity(1.0, 3.0).tolist()
    [4.0, 4.0]
    """

    dofs: Any
    displacement: Motion | None = None
    velocity: Motion | None = None

    def __post_init__(self) -> None:
        if isinstance(self.dofs, str):
            raise ValueError(f"dofs = {self.dofs!r} is a name: give basis.get_dofs({self.dofs!r})")
        dofs = self.dofs.all() if hasattr(self.dofs, "all") and not isinstance(self.dofs, np.ndarray) else self.dofs
        dofs = np.asarray(dofs)
        if not dofs.size:
            raise ValueError("dofs of a prescribed motion is an empty set")
        if dofs.dtype.kind not in "iu" or dofs.ndim != 1:
            raise ValueError(f"dofs of a prescribed motion must be an index array, not {dofs.dtype} {dofs.shape}")
        object.__setattr__(self, "dofs", dofs.astype(np.int64))
        if (self.displacement is None) == (self.velocity is None):
            raise ValueError("a prescribed motion needs one of displacement and velocity, not both and not none")

    def _value(self, motion: Motion | None, t: float) -> Floats:
        value = np.asarray(motion(t) if callable(motion) else motion, dtype=float)
        if not np.isfinite(value).all():
            raise ValueError(f"the prescribed motion is not finite at t = {t:g}")
        return np.broadcast_to(value, self.dofs.shape)

    def start(self, t: float) -> Floats | None:
        """Return the displacement at the first time.

        Parameters
        ----------
        t : float
            The first time.

        Returns
        -------
        ndarray, (ndofs,), or None
            None where a velocity is prescribed: the initial value stands.
        """
        return None if self.displacement is None else self._value(self.displacement, t)

    def mean_velocity(self, t0: float, t1: float) -> Floats:
        """Return the velocity that carries the degrees of freedom from their place at t0 to that at t1.

        Parameters
        ----------
        t0 : float
            A time.
        t1 : float
            A later one.

        Returns
        -------
        ndarray, (ndofs,)
            Velocities.
        """
        if self.displacement is None:
            return self._value(self.velocity, 0.5 * (t0 + t1))
        if not callable(self.displacement):
            return np.zeros(len(self.dofs))
        # not the derivative: with this mean velocity the place at t1 is met exactly
        return (self._value(self.displacement, t1) - self._value(self.displacement, t0)) / (t1 - t0)


def check_fixed(fixed: Sequence[Prescribed], size: int) -> Longs:
    """Return all prescribed degrees of freedom. Raises ``ValueError`` when one is out of range or prescribed twice."""
    if not fixed:
        return np.empty(0, dtype=np.int64)
    every = np.concatenate([prescribed.dofs for prescribed in fixed])
    if every.min() < 0 or every.max() >= size:
        raise ValueError(f"a prescribed degree of freedom, {every.max()}, is not among the {size} of the basis")
    unique, count = np.unique(every, return_counts=True)
    if (count > 1).any():
        raise ValueError(f"degree of freedom {unique[count > 1][0]} is prescribed twice; one motion each, please")
    return every
