"""Potentials as the compiled loops take them: a number and constants, or compiled functions of the user's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from .._compile import compiled
from .._types import Floats
from ..material.own_law import Scalars
from ..material.potential import Exponential, Linear, Potential, Rational
from ..material.tension_only import TensionOnly
from .block import Block
from .law_loops import EXPONENTIAL, LINEAR, OWN, RATIONAL, TENSION

_KINDS: dict[type, int] = {Exponential: EXPONENTIAL, Rational: RATIONAL, Linear: LINEAR}


@dataclass(frozen=True)
class Law:
    """Number, ``f'(0)`` and b of a law, and ``f``, ``f'`` and ``f''`` of one of the user's own."""

    kind: int
    slope: float
    b: float
    f: Any = None
    df: Any = None
    d2f: Any = None

    @property
    def gradient(self) -> tuple[int, float, float, Any]:
        """The arguments of loops that need f'."""
        return self.kind, self.slope, self.b, self.df

    @property
    def hessian(self) -> tuple[int, float, float, Any, Any]:
        """The arguments of loops that need f' and f''."""
        return self.kind, self.slope, self.b, self.df, self.d2f

    @property
    def energy(self) -> tuple[int, float, float, Any]:
        """The arguments of loops that need f."""
        return self.kind, self.slope, self.b, self.f

    def loop(self, shared: Callable[..., Any]) -> Callable[..., Any]:
        """Return a loop for this law: with functions of the user's own in it, its code is not kept on disk."""
        return _unkept(shared) if self.kind % TENSION == OWN else shared


@cache
def _unkept(loop: Any) -> Callable[..., Any]:
    return compiled(loop.py_func, keep=False)


def linear(block: Block) -> Law:
    """Return the law of the bonds at rest."""
    return Law(LINEAR, block.law.slope, 0.0)


def law_of(potential: Potential) -> Law | None:
    """Return the law for the loops, None for one that only Python can evaluate.

    >>> law_of(Exponential(slope=8.0, limit=2.0)).b
    4.0
    """
    if isinstance(potential, TensionOnly):
        law = law_of(potential.law)
        return None if law is None else dataclasses.replace(law, kind=law.kind + TENSION)
    if type(potential) in _KINDS:
        return Law(_KINDS[type(potential)], potential.slope, potential.b)
    scalars = getattr(potential, "law", None)
    if isinstance(scalars, Scalars):
        return Law(OWN, potential.slope, 0.0, *scalars.compiled)
    return None


def secant(block: Block, T: Floats, bonds: slice) -> Floats:
    """Return weights w that make ``B^T w B u`` the force of some bonds of a law that only Python can evaluate."""
    weight: Floats = block.k[bonds] * block.law.secant(T)
    return weight
