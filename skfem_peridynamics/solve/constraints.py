"""Prescribed motion of degrees of freedom."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from .._types import Floats, Longs

_SAME = 1e-12  # of a value: two formulas that say the same are rounded differently
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


class FixedConflict(ValueError):
    """Two motions are prescribed for one degree of freedom ``dof``: those of numbers ``first`` and ``second``."""

    def __init__(self, dof: int, first: int, second: int, how: str) -> None:
        super().__init__(f"degree of freedom {dof} is prescribed twice, and not the same: {how}")
        self.dof, self.first, self.second, self.how = dof, first, second, how


def check_fixed(fixed: Sequence[Prescribed], size: int, until: float = 1.0) -> Longs:
    """Return all prescribed degrees of freedom, each once. Raises ``ValueError`` when one is out of range.

    Sets may meet, as two sides do in a corner, where they move alike: that is looked at now and at three times to come.
    Raises :class:`FixedConflict` where they do not.

    >>> left, low = Prescribed(np.array([0, 1]), displacement=0.0), Prescribed(np.array([1, 2]), displacement=0.0)
    >>> check_fixed([left, low], 4).tolist()
    [0, 1, 2]
    """
    if not fixed:
        return np.empty(0, dtype=np.int64)
    every = np.concatenate([prescribed.dofs for prescribed in fixed])
    if every.min() < 0 or every.max() >= size:
        raise ValueError(f"a prescribed degree of freedom, {every.max()}, is not among the {size} of the basis")
    unique, first, count = np.unique(every, return_index=True, return_counts=True)
    if (count > 1).any():
        _check_meeting(fixed, unique[count > 1], until)
    found: Longs = every[np.sort(first)]
    return found


def _check_meeting(fixed: Sequence[Prescribed], shared: Longs, until: float) -> None:
    """Raise :class:`FixedConflict` where motions of the same degrees of freedom differ."""
    for t in (0.0, 0.37 * until, 0.71 * until, until):
        seen = np.full(len(shared), np.nan)
        owner = np.full(len(shared), -1)
        kind = np.zeros(len(shared), dtype=bool)
        for k, prescribed in enumerate(fixed):
            here = np.flatnonzero(np.isin(prescribed.dofs, shared))
            if not len(here):
                continue
            by_velocity = prescribed.displacement is None
            values = prescribed._value(prescribed.velocity if by_velocity else prescribed.displacement, t)[here]
            at = np.searchsorted(shared, prescribed.dofs[here])
            known = owner[at] >= 0
            scale = np.maximum(np.abs(values), np.abs(seen[at]))
            apart = known & ((kind[at] != by_velocity) | (np.abs(values - seen[at]) > _SAME * scale))
            if apart.any():
                place = np.flatnonzero(apart)[0]
                names = [("displacement", "velocity")[int(which)] for which in (kind[at[place]], by_velocity)]
                raise FixedConflict(
                    int(shared[at[place]]),
                    int(owner[at[place]]),
                    k,
                    f"{names[0]} {seen[at[place]]:g} and {names[1]} {values[place]:g} at t = {t:g}",
                )
            seen[at], owner[at], kind[at] = values, np.where(known, owner[at], k), by_velocity
