"""A quadrature of the double integral, and the bonds it makes, a part of them at a time."""

from __future__ import annotations

from typing import Protocol, TypeAlias

import numpy as np

from .._types import Longs, Mesh
from ..material.influence import Influence
from .ball_bonds import BallBonds
from .pair_bonds import PairBonds
from .samples import Samples

BLOCK = 1 << 17  # bonds of a part: large enough to outweigh the calls, small enough to stay in cache
Part: TypeAlias = PairBonds | BallBonds


def rows_of(starts: Longs, most: int = BLOCK) -> list[slice]:
    """Split items with running counts ``starts`` (n + 1,) into runs of at most ``most`` counts (at least one item).

    >>> rows_of(np.array([0, 3, 6, 9]), most=6)
    [slice(0, 2, None), slice(2, 3, None)]
    """
    out, low, n = [], 0, len(starts) - 1
    while low < n:
        # the last item whose running count still fits
        high = int(np.searchsorted(starts, starts[low] + most, side="right")) - 1
        high = min(n, max(high, low + 1))
        out.append(slice(low, high))
        low = high
    return out


class Rule(Protocol):
    """A quadrature of the double integral over D x D.

    Bonds of a ``symmetric`` rule stand for both orders of their ends; the others are directed, from x to y.
    """

    @property
    def name(self) -> str: ...

    @property
    def symmetric(self) -> bool: ...

    def samples(self, mesh: Mesh) -> Samples: ...

    def estimate(self, mesh: Mesh, horizon: float) -> int: ...

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]: ...
