"""The motion at one time, and its energies."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from .._types import Floats


@dataclass(frozen=True)
class Energies:
    """Energies at one time. ``work`` is that of loads and prescribed motions so far, ``initial`` the first total."""

    kinetic: float
    elastic: float
    work: float
    initial: float

    @property
    def total(self) -> float:
        return self.kinetic + self.elastic

    @property
    def imbalance(self) -> float:
        """``kinetic + elastic - work - initial``, 0 for the exact motion."""
        return self.kinetic + self.elastic - self.work - self.initial


@dataclass(frozen=True, eq=False)
class State:
    """The motion at one time: read-only views, valid until the next step; :meth:`copy` keeps them.

    ``v`` is the velocity at the full step, second order in dt: ``(u^{k+1} - u^{k-1}) / (2 dt)``; ``a`` the
    acceleration, so that ``v + dt a / 2`` is the paper's next difference quotient.
    """

    t: float
    step: int
    dt: float
    u: Floats
    v: Floats
    a: Floats
    work: float
    initial: float
    initial_ripple: float = 0.0
    _body: Any = field(repr=False, default=None)
    _mass: Any = field(repr=False, default=None)

    @property
    def kinetic(self) -> float:
        """``v.M v / 2``"""
        return 0.5 * float(self._mass @ (self.v * self.v))

    @property
    def ripple(self) -> float:
        """``dt^2/8 a.M a``: by this the energy of a linear run swings about a constant, without being wrong."""
        return 0.125 * self.dt**2 * float(self._mass @ (self.a * self.a))

    @cached_property
    def energies(self) -> Energies:
        """Kinetic and elastic energy and external work, computed when first read."""
        return Energies(self.kinetic, float(self._body.energy(self.u)), self.work, self.initial)

    def copy(self) -> State:
        """Return a state that later steps leave alone."""
        return dataclasses.replace(self, u=self.u.copy(), v=self.v.copy(), a=self.a.copy())
