"""A law that softens in tension only: bonds that are pressed stay linear, as the contact of a closed crack does."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._types import Floats
from .potential import Linear, Potential

COMPRESSION = ("soften", "elastic")


@dataclass(frozen=True)
class TensionOnly(Potential):
    """``law`` where a bond is longer than it was, ``f'(0) q`` where it is shorter; F1'' is continuous at 0.

    >>> from skfem_peridynamics import Rational
    >>> law = TensionOnly.of(Rational(slope=8.0, limit=2.0))
    >>> law.energy(np.array([0.5, -0.5])).tolist()         # F1 of the law in tension, 8 T^2 in compression
    [1.0, 2.0]
    """

    law: Potential

    @classmethod
    def of(cls, law: Potential) -> Potential:
        """Return the law that is ``law`` in tension; one that never softens is that already."""
        return law if isinstance(law, Linear) else cls(law.slope, law.limit, law)

    def f(self, q: Floats) -> Floats:
        return self.law.f(q)

    def df(self, q: Floats) -> Floats:
        return self.law.df(q)

    def d2f(self, q: Floats) -> Floats:
        return self.law.d2f(q)

    def energy(self, T: Floats) -> Floats:
        pressed = np.minimum(T, 0.0)
        return self.law.energy(np.maximum(T, 0.0)) + self.slope * (pressed * pressed)

    def gradient(self, T: Floats) -> Floats:
        return self.law.gradient(np.maximum(T, 0.0)) + (2.0 * self.slope) * np.minimum(T, 0.0)

    def hessian(self, T: Floats) -> Floats:
        return self.law.hessian(np.maximum(T, 0.0))  # at 0 it is 2 f'(0)

    def third(self, T: Floats) -> Floats:
        return np.where(T > 0.0, self.law.third(np.maximum(T, 0.0)), 0.0)

    def secant(self, T: Floats) -> Floats:
        return self.law.secant(np.maximum(T, 0.0))

    def severity(self, T: Floats) -> Floats:
        return self.law.severity(np.maximum(T, 0.0))

    @cached_property
    def inflection(self) -> float:
        return self.law.inflection

    @cached_property
    def suprema(self) -> tuple[float, float, float, float]:
        return (float("inf"), *self.law.suprema[1:])
