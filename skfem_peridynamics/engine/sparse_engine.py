"""The operators by SciPy's sparse products."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .._threads import Threads
from .._types import Floats, Longs
from ..bonds.bond_basis import BondBasis
from .block import _T, Beside, Block, Pressure


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

    def force(self, u: Floats, pressure: Pressure | None = None) -> Floats:
        v = self._samples(u)
        if pressure is None:
            F = self._gather(lambda block: block.force(v))
        else:
            p = self.bonds.samples.take(pressure(self._virial(v)))
            F = self._gather(lambda block: block.pressed_force(v, p))
        return self.bonds.samples.spread(np.negative(F, out=F)).ravel()

    def virial(self, u: Floats) -> Floats:
        return self._virial(self._samples(u))

    def _virial(self, v: Floats) -> Floats:
        return self._to_vertices(lambda block: block.virial(v))

    def _to_vertices(self, function: Callable[[Block], Floats]) -> Floats:
        """One number a sample from each block, added up and handed to the vertices."""
        total = np.zeros(self.bonds.samples.nsamples)
        for block, part in zip(self.blocks, self.pool.map(function, self.blocks), strict=True):
            total[block.window] += part
        return self.bonds.samples.spread(total)

    def break_and_force(
        self, u: Floats, at: float, pressure: Pressure | None = None
    ) -> tuple[Floats, list[tuple[Block, Longs]], Floats | None]:
        beyond = list(self.each(u, lambda block, T: block.beyond(T, at)))
        for block, which in zip(self.blocks, beyond, strict=True):
            block.k[which] = 0.0
        broken = [(block, numbers) for block, numbers in zip(self.blocks, beyond, strict=True) if len(numbers)]
        return self.force(u, pressure), broken, None if pressure is None else self.virial(u)

    def product(
        self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False, beside: Beside | None = None
    ) -> Floats:
        x, given = self._samples(v), {} if weights is None else self._of(weights)

        def apply(block: Block) -> Floats:
            weight = block.rest_stiffness if weights is None else given[id(block)]
            return block.product(weight, x, transposed)

        out = self._gather(apply)
        if beside is not None:
            out += self._beside(beside, x)
        return self.bonds.samples.spread(out).ravel()

    def _of(self, arrays: Sequence[Floats]) -> dict[int, Floats]:
        return {id(block): array for block, array in zip(self.blocks, arrays, strict=True)}

    def _beside(self, beside: Beside, x: Floats) -> Floats:
        """``R^T diag(stiffness) R x`` on the samples."""
        given = {} if beside.rates is None else self._of(beside.rates)

        def rate(block: Block) -> Floats:
            return given[id(block)] if given else block.rates(None)

        dilated = self._to_vertices(lambda block: block.dilate(rate(block), x))
        q = self.bonds.samples.take(beside.pressure(dilated))
        return self._gather(lambda block: block.squeeze(rate(block), q))

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        v = self._samples(u)
        return self.pool.map(lambda block: function(block, block.strains(v)), self.blocks)
