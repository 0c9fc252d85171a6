"""The operators by SciPy's sparse products."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .._threads import Threads
from .._types import Floats, Longs
from ..bonds.bond_basis import BondBasis
from .block import _T, Block


@dataclass(frozen=True, eq=False)
class SparseEngine:
    """The operators by SciPy's sparse products: block by block, each into a window, windows added in order."""

    bonds: BondBasis
    blocks: Sequence[Block]
    pool: Threads

    def _samples(self, u: Floats) -> Floats:
        return self.bonds.samples.take(u.reshape(-1, self.bonds.dim))

    def _gather(self, function: Callable[[Block], Floats]) -> Floats:
        total = np.zeros((self.bonds.samples.nsamples, self.bonds.dim))
        for block, part in zip(self.blocks, self.pool.map(function, self.blocks), strict=True):
            # in the order of the blocks, whatever thread was first
            total[block.window] += part
        return total

    def energy(self, u: Floats) -> float:
        v = self._samples(u)
        return float(sum(self.pool.map(lambda block: block.energy(v), self.blocks)))

    def force(self, u: Floats) -> Floats:
        v = self._samples(u)
        F = self._gather(lambda block: block.force(v))
        return self.bonds.samples.spread(np.negative(F, out=F)).ravel()

    def break_and_force(self, u: Floats, at: float) -> tuple[Floats, list[tuple[Block, Longs]]]:
        beyond = list(self.each(u, lambda block, T: block.beyond(T, at)))
        for block, which in zip(self.blocks, beyond, strict=True):
            block.k[which] = 0.0
        return self.force(u), [
            (block, numbers) for block, numbers in zip(self.blocks, beyond, strict=True) if len(numbers)
        ]

    def product(self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False) -> Floats:
        x = self._samples(v)
        given = {id(block): weight for block, weight in zip(self.blocks, weights or (), strict=weights is not None)}

        def apply(block: Block) -> Floats:
            weight = block.rest_stiffness if weights is None else given[id(block)]
            return block.product(weight, x, transposed)

        return self.bonds.samples.spread(self._gather(apply)).ravel()

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        v = self._samples(u)
        return self.pool.map(lambda block: function(block, block.strains(v)), self.blocks)
