"""Pairs of samples for the compiled loops: tasks of consecutive rows, and the table of samples they read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._compile import compiled
from .._types import Floats, Ints, Longs
from ..bonds.bond_basis import BondBasis
from ..bonds.parts import PairPart
from . import pair_loops
from .compiled_law import Law, law_of, secant
from .kernels import Block, Team
from .schedule import Schedule


@dataclass(frozen=True, eq=False)
class PairDesk:
    """Working arrays of one call: the table of samples, and their sums, a row for each component."""

    P: Floats
    F: Floats

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

    def _bonds(self, desk: PairDesk) -> tuple[Any, ...]:
        return (0,) * len(desk.F), self.start, self.partner, self.row, desk.P[self.block.window]

    def strains(self, desk: PairDesk) -> Floats:
        """Return the scaled strains of the bonds."""
        T = np.empty(len(self.partner))
        pair_loops.strains(*self._bonds(desk), T)
        return T

    def energy(self, desk: PairDesk) -> float:
        if self.law is None:
            return float(self.block.k @ self.block.law.energy(self.strains(desk)))
        measure = self.given, self.reach, self.scale
        return float(self.law.loop(pair_loops.energy)(*self._bonds(desk), *measure, *self.law.energy))

    def add_force(self, desk: PairDesk, law: Law | None) -> None:
        """Add the forces of the bonds to the sums, under a law."""
        if law is None:
            self.take_product(desk, secant(self.block, self.strains(desk)))
        else:
            measure, sums = (self.given, self.reach, self.scale), desk.view(self.block.window)
            law.loop(pair_loops.force)(*self._bonds(desk), *measure, *law.gradient, sums)

    def take_product(self, desk: PairDesk, weight: Floats) -> None:
        """Take ``B^T diag(weight) B u`` off the sums."""
        pair_loops.product(*self._bonds(desk), weight, desk.view(self.block.window))


class PairField:
    """What all tasks of a body share: where their arrays come from, and what they add to."""

    def __init__(self, bonds: BondBasis, blocks: list[Block]) -> None:
        self.bonds = bonds
        self.tasks = [self._task(block) for block in blocks]

    def _task(self, block: Block) -> PairTask:
        part, plain = block.part, block.bonds.plain
        assert isinstance(part, PairPart)
        start, partner, given, scale = part.start, part.partner, part.given, block.bonds.prefactor
        if block.which is not None:
            start, partner = np.searchsorted(block.which, start), partner[block.which]
            given = None if given is None else given[block.which]
        if not plain or (given is None and block.store):
            given, scale = block.k, 1.0
        return PairTask(block, law_of(block.law), part.row, start, partner, given, part.reach, scale)

    def schedule(self) -> Schedule:
        n = self.bonds.samples.nsamples
        marks = []
        for task in self.tasks:
            mine = np.zeros(n, dtype=bool)
            mine[task.block.window] = True
            marks.append(mine)
        return Schedule.of(self.tasks, marks)

    def desk(self) -> PairDesk:
        """Return new working arrays."""
        samples, dim = self.bonds.samples, self.bonds.dim
        P = aligned(samples.nsamples, 2 * dim + 2)
        P[:, :dim], P[:, dim], P[:, 2 * dim + 1] = samples.points, samples.volume, 1.0 / samples.size
        return PairDesk(P, np.zeros((dim, samples.nsamples)))

    def load(self, desk: PairDesk, u: Floats, team: Team) -> None:
        """Put a displacement into the table, zeros into the sums."""
        samples, dim = self.bonds.samples, self.bonds.dim
        if samples.at_vertices:
            _fill(samples.vertices, u.reshape(-1, dim), desk.P)
        else:
            desk.P[:, dim + 1 : 2 * dim + 1] = samples.take(u.reshape(-1, dim))
        desk.F.fill(0.0)

    def collect(self, desk: PairDesk, team: Team) -> Floats:
        """Return what the tasks have added, as nodal values."""
        samples = self.bonds.samples
        if not samples.at_vertices:
            return samples.spread(desk.F.T).ravel()
        out = np.empty((samples.nvertices, len(desk.F)))
        _empty(samples.vertices, desk.F, out)
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
def _fill(vertices: Any, nodal: Any, P: Any) -> None:
    """Nodal values into the table of samples that are vertices."""
    dim = nodal.shape[1]
    for i in range(len(vertices)):
        for a in range(dim):
            P[i, dim + 1 + a] = nodal[vertices[i, 0], a]


@compiled
def _empty(vertices: Any, F: Any, nodal: Any) -> None:
    """Sums at samples that are vertices, to the vertices."""
    for i in range(len(vertices)):
        for a in range(len(F)):
            nodal[vertices[i, 0], a] = F[a, i]
