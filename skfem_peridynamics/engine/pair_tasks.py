"""Pairs of samples for the compiled loops: tasks of consecutive rows, and the table of samples they read."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._compile import compiled
from .._threads import Threads
from .._types import Floats, Ints, Longs
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_bonds import PairBonds
from ..bonds.rule import rows_of
from ..material.tension_only import TensionOnly
from . import pair_loops, virial_loops
from .block import Block
from .compiled_law import Law, law_of, secant
from .schedule import Schedule, task_size

_SAMPLES = 1 << 15  # filled or emptied at a time


@dataclass(frozen=True, eq=False)
class PairArrays:
    """Working arrays of one call: the table of samples, and their sums, a row for each component.

    The virial V and the pressure p of the samples are made where a dilatation needs them.
    """

    P: Floats
    F: Floats

    @cached_property
    def V(self) -> Floats:
        return np.zeros(len(self.P))

    @cached_property
    def p(self) -> Floats:
        return np.zeros(len(self.P))

    def view(self, window: slice) -> tuple[Floats, Floats, Floats]:
        """Three rows of sums; the last ones are not used where the dimension has fewer."""
        return self.F[0, window], self.F[len(self.F) // 2, window], self.F[-1, window]


@dataclass(frozen=True, eq=False)
class PairTask:
    """Bonds of one law: ``row`` is the number, in the window of the block, of the first near end."""

    block: Block
    law: Law | None
    row: int
    start: Longs
    partner: Ints
    given: Floats | None
    reach: float
    scale: float
    bonds: slice  # among those of the block

    def split(self, most: int) -> Iterator[PairTask]:
        """Yield tasks of runs of rows, about ``most`` bonds each."""
        total = len(self.partner)
        # runs of whole rows are longer by up to one row than asked for: leave room for it, or the last run is a crumb
        even = total // max(1, round(total / most)) + int(np.diff(self.start).max(initial=0))
        for run in rows_of(self.start, even):
            low, high = int(self.start[run.start]), int(self.start[run.stop])
            yield dataclasses.replace(
                self,
                row=self.row + run.start,
                start=self.start[run.start : run.stop + 1] - low,
                partner=self.partner[low:high],
                given=None if self.given is None else self.given[low:high],
                bonds=slice(low, high),
            )

    def touched(self) -> Ints:
        """The samples at the ends of the bonds, some of them more than once."""
        rows = np.arange(self.row, self.row + len(self.start) - 1, dtype=np.int32)
        return np.concatenate([rows, self.partner]) + np.int32(self.block.part.first)

    def _bonds(self, arrays: PairArrays) -> tuple[Any, ...]:
        return (0,) * len(arrays.F), self.start, self.partner, self.row, arrays.P[self.block.window]

    def strains(self, arrays: PairArrays) -> Floats:
        """Return the scaled strains of the bonds."""
        T = np.empty(len(self.partner))
        pair_loops.strains(*self._bonds(arrays), T)
        return T

    def energy(self, arrays: PairArrays) -> float:
        if self.law is None:
            return float(self.block.k @ self.block.law.energy(self.strains(arrays)))
        measure = self.given, self.reach, self.scale
        return float(self.law.loop(pair_loops.energy)(*self._bonds(arrays), *measure, *self.law.energy))

    def add_force(self, arrays: PairArrays, law: Law | None) -> None:
        """Add the forces of the bonds to the sums, under a law."""
        if law is None:
            weight = secant(self.block, self.strains(arrays), self.bonds)
            pair_loops.product(*self._bonds(arrays), weight, arrays.view(self.block.window))
        else:
            measure, sums = (self.given, self.reach, self.scale), arrays.view(self.block.window)
            law.loop(pair_loops.force)(*self._bonds(arrays), *measure, *law.gradient, sums)

    def break_and_add_force(self, arrays: PairArrays, at: float) -> int:
        """Break the bonds beyond ``at`` times their critical strain, add the forces of the others; return how many.

        Those that broke have the measure -1.
        """
        if self.law is None:
            # a law that only Python can evaluate: the strains come out of the loop and weights go in
            which = self.block.beyond(self.strains(arrays), at, self.bonds)
            self.block.k[which] = 0.0
            self.add_force(arrays, None)
            self.block.k[which] = -1.0
            return len(which)
        if not np.isfinite(self.block.law.inflection):
            self.add_force(arrays, self.law)
            return 0
        measure, sums = (self.given, self.reach, self.scale), arrays.view(self.block.window)
        # the loops compare q = T^2 with the square of the strain; a law of tension only breaks in tension only
        limit, both = (at * self.block.law.inflection) ** 2, not isinstance(self.block.law, TensionOnly)
        loop = self.law.loop(pair_loops.force)
        return int(loop(*self._bonds(arrays), *measure, *self.law.gradient, sums, limit, both))

    def _measured(self, arrays: PairArrays) -> tuple[Any, ...]:
        return *self._bonds(arrays), self.given, self.reach, self.scale

    def add_virial(self, arrays: PairArrays, law: Law) -> None:
        """Add what the bonds pull with to the virial of their ends, under a law."""
        window = self.block.window
        law.loop(virial_loops.virial)(*self._measured(arrays), *law.gradient, arrays.V[window])

    def break_and_add_virial(self, arrays: PairArrays, at: float) -> int:
        """Break the bonds beyond ``at`` times their critical strain; add the virial of the others; return how many."""
        assert self.law is not None
        if not np.isfinite(self.block.law.inflection):
            self.add_virial(arrays, self.law)
            return 0
        limit, both = (at * self.block.law.inflection) ** 2, not isinstance(self.block.law, TensionOnly)
        loop, V = self.law.loop(virial_loops.virial), arrays.V[self.block.window]
        return int(loop(*self._measured(arrays), *self.law.gradient, V, limit, both))

    def add_pressed_force(self, arrays: PairArrays, law: Law) -> None:
        """Add the forces of the bonds under the pressure of the dilatation, and a law."""
        window = self.block.window
        p, sums = arrays.p[window], arrays.view(window)
        law.loop(virial_loops.force)(*self._measured(arrays), *law.hessian, p, sums)

    def dilate(self, arrays: PairArrays, rates: Floats) -> None:
        """Add the rates of the virial by a displacement."""
        virial_loops.dilate(*self._bonds(arrays), rates[self.bonds], arrays.V[self.block.window])

    def squeeze(self, arrays: PairArrays, rates: Floats) -> None:
        """Take the transpose of it, of a pressure, off the sums."""
        window = self.block.window
        virial_loops.squeeze(*self._bonds(arrays), rates[self.bonds], arrays.p[window], arrays.view(window))

    def take_product(self, arrays: PairArrays, weight: Floats) -> None:
        """Take ``B^T diag(weight) B u`` off the sums; weights are those of the block's bonds."""
        pair_loops.product(*self._bonds(arrays), weight[self.bonds], arrays.view(self.block.window))


class PairLoops:
    """What all tasks of a body share: where their arrays come from, and what they add to."""

    def __init__(self, bonds: BondBasis, blocks: list[Block]) -> None:
        self.bonds = bonds
        self.groups = [[self._task(block)] for block in blocks]

    def _task(self, block: Block) -> PairTask:
        part, plain = block.part, block.bonds.plain
        assert isinstance(part, PairBonds)
        start, partner, given, scale = part.start, part.partner, part.given, block.bonds.prefactor
        # ``which`` is sorted, so the rows of the chosen bonds are found by their places in it
        if block.which is not None:
            start, partner = np.searchsorted(block.which, start), partner[block.which]
            given = None if given is None else given[block.which]
        # measures go in as they are where influence or boundary function are in them, and where they may become 0; the
        # loops make the others of volumes and sizes, which takes no memory
        if not plain or block.own or (given is None and block.store):
            given, scale = block.k, 1.0
        whole = slice(0, len(partner))
        return PairTask(block, law_of(block.law), part.row, start, partner, given, part.reach, scale, whole)

    def schedule(self) -> Schedule:
        """Return the tasks, split to keep all threads busy, in a fixed order of what they add to."""
        most = task_size(self.bonds.nbonds)
        pieces = [tasks for (task,) in self.groups for tasks in task.split(most)]
        return Schedule.from_tasks(pieces, (tasks.touched() for tasks in pieces), self.bonds.samples.nsamples)

    @cached_property
    def _runs(self) -> list[tuple[int, int]]:
        """Samples in runs."""
        n = self.bonds.samples.nsamples
        return [(low, min(n, low + _SAMPLES)) for low in range(0, n, _SAMPLES)]

    def arrays(self) -> PairArrays:
        """Return new working arrays."""
        samples, dim = self.bonds.samples, self.bonds.dim
        P = aligned(samples.nsamples, 2 * dim + 2)
        # x, volume, u, 1 / size: what a bond needs of its far end, in one row
        P[:, :dim], P[:, dim], P[:, 2 * dim + 1] = samples.points, samples.volume, 1.0 / samples.size
        return PairArrays(P, np.zeros((dim, samples.nsamples)))

    def load(self, arrays: PairArrays, u: Floats, pool: Threads) -> None:
        """Put a displacement into the table, zeros into the sums."""
        samples, dim = self.bonds.samples, self.bonds.dim
        if samples.at_vertices:
            nodal = u.reshape(-1, dim)
            for _ in pool.map(lambda run: _fill(samples.vertices, nodal, *run, arrays.P, arrays.F), self._runs):
                pass
        else:
            arrays.P[:, dim + 1 : 2 * dim + 1] = samples.take(u.reshape(-1, dim))
            arrays.F.fill(0.0)

    def take_virial(self, arrays: PairArrays, pool: Threads) -> Floats:
        """Return the virial that the tasks have added, at the vertices, and empty it."""
        out = self.bonds.samples.spread(arrays.V)
        arrays.V.fill(0.0)
        return out

    def press(self, arrays: PairArrays, pressure: Floats, pool: Threads) -> None:
        """Put a pressure of the vertices in."""
        arrays.p[:] = self.bonds.samples.take(pressure)

    def collect(self, arrays: PairArrays, pool: Threads) -> Floats:
        """Return what the tasks have added, as nodal values."""
        samples = self.bonds.samples
        if not samples.at_vertices:
            return samples.spread(arrays.F.T).ravel()
        out = np.empty((samples.nvertices, len(arrays.F)))
        for _ in pool.map(lambda run: _empty(samples.vertices, arrays.F, *run, out), self._runs):
            pass
        return out.ravel()


def aligned(rows: int, columns: int) -> Floats:
    """Return zeros (rows, columns) that start where a cache line does: a row of 64 bytes is then in one line, not two.

    >>> aligned(3, 8).ctypes.data % 64
    0
    """
    raw = np.zeros(rows * columns + 8)
    skip = -(raw.ctypes.data // 8) % 8
    return raw[skip : skip + rows * columns].reshape(rows, columns)


@compiled
def _fill(vertices: Any, nodal: Any, low: int, high: int, P: Any, F: Any) -> None:
    """Nodal values into the table of samples that are vertices, zeros into their sums."""
    dim = nodal.shape[1]
    for i in range(low, high):
        for a in range(dim):
            P[i, dim + 1 + a] = nodal[vertices[i, 0], a]
    for a in range(dim):
        for i in range(low, high):
            F[a, i] = 0.0


@compiled
def _empty(vertices: Any, F: Any, low: int, high: int, nodal: Any) -> None:
    """Sums at samples that are vertices, to the vertices."""
    for i in range(low, high):
        for a in range(len(F)):
            nodal[vertices[i, 0], a] = F[a, i]
