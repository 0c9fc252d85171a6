"""Ball bonds for the compiled loops: tasks of some sites, and the table of elements they read."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._types import Floats, Ints, Longs
from ..bonds.bond_basis import BondBasis
from ..bonds.parts import BallPart
from . import ball_loops
from .ball_loops import IDS
from .compiled_law import Law, law_of, secant
from .kernels import Block, Team
from .pair_tasks import aligned
from .schedule import Schedule, marked, piece


@dataclass(frozen=True, eq=False)
class BallDesk:
    """Arrays of one call, nodal: the displacement and what the tasks add, (nvertices, dim)."""

    u: Floats
    F: Floats


@dataclass(frozen=True, eq=False)
class BallTask:
    """All bonds that start at some sites; those of another law have measure 0.

    ``chosen`` says where the bonds of the law are among all of the task's (None: all are).
    """

    field: BallField
    block: Block
    law: Law | None
    x: Floats
    own: Ints
    reach: Floats
    element: Ints
    given: Floats
    scale: float
    chosen: Longs | None
    bonds: slice  # among those of the block

    def split(self, most: int) -> Iterator[BallTask]:
        """Yield tasks of runs of sites, about ``most`` bonds each."""
        per_site = self.element.size // len(self.own)
        count = max(1, most // per_site)
        for low in range(0, len(self.own), count):
            run = slice(low, low + count)
            bonds, chosen = slice(low * per_site, min(self.element.size, (low + count) * per_site)), None
            given = self.given[bonds]
            if self.chosen is not None:
                start, end = np.searchsorted(self.chosen, [bonds.start, bonds.stop])
                bonds, chosen = slice(int(start), int(end)), self.chosen[start:end] - bonds.start
            arrays = {name: getattr(self, name)[run] for name in ("x", "own", "reach", "element")}
            yield dataclasses.replace(self, **arrays, given=given, chosen=chosen, bonds=bonds)

    def _bonds(self, desk: BallDesk) -> tuple[Any, ...]:
        field = self.field
        rays = self.own, self.reach, self.element, field.fan.horizon, field.way, field.node
        return ((0,) * field.bonds.dim, self.x, *rays, field.table, field.table.view(np.int32), desk.u)

    def strains(self, desk: BallDesk) -> Floats:
        """Return the scaled strains of the bonds."""
        T = np.empty(self.element.size)
        ball_loops.strains(*self._bonds(desk), T)
        return T if self.chosen is None else T[self.chosen]

    def energy(self, desk: BallDesk) -> float:
        if self.law is None:
            return float(self.block.k @ self.block.law.energy(self.strains(desk)))
        loop = self.law.loop(ball_loops.energy)
        return float(loop(*self._bonds(desk), self.given, self.scale, *self.law.energy))

    def add_force(self, desk: BallDesk, law: Law | None) -> None:
        """Add the forces of the bonds to the sums, under a law."""
        if law is None:
            self._take(desk, secant(self.block, self.strains(desk), self.bonds))
        else:
            loop, sums = law.loop(ball_loops.force), (self.block.symmetric, desk.F)
            loop(*self._bonds(desk), self.given, self.scale, *law.gradient, *sums)

    def take_product(self, desk: BallDesk, weight: Floats) -> None:
        """Take ``X^T diag(weight) B u`` off the sums; weights are those of the block's bonds."""
        self._take(desk, weight[self.bonds])

    def _take(self, desk: BallDesk, weight: Floats) -> None:
        if self.chosen is not None:
            whole = np.zeros(self.element.size)
            whole[self.chosen] = weight
            weight = whole
        ball_loops.product(*self._bonds(desk), weight, self.block.symmetric, desk.F)


class BallField:
    """What all tasks of a body share: the fan, the elements, and how these hand over to the vertices."""

    def __init__(self, bonds: BondBasis, blocks: list[Block]) -> None:
        part = blocks[0].part
        assert isinstance(part, BallPart)
        self.bonds, self.fan = bonds, part.fan
        dim = bonds.dim
        self.way = np.zeros((len(self.fan.directions), 3))
        self.way[:, :dim] = self.fan.directions
        self.node = np.stack([self.fan.nodes, 1.0 / self.fan.nodes])
        self.tasks = [self._task(block) for block in blocks]

    def _task(self, block: Block) -> BallTask:
        part, bonds, samples, tracer = block.part, block.bonds, block.bonds.samples, self.fan.tracer
        assert isinstance(part, BallPart)
        site, reach, element = part.first + part.site.astype(np.int64), part.reach, part.element
        chosen = None
        if block.which is None:
            given, scale = (part.weight, bonds.prefactor) if bonds.plain else (block.k, 1.0)
        else:
            rows, place = np.unique(block.which // part.per_site, return_inverse=True)
            site, reach, element = site[rows], reach[rows], element[rows]
            chosen = place * part.per_site + block.which % part.per_site
            given, scale = np.zeros(element.size), 1.0
            given[chosen] = block.k
        own = samples.element[np.searchsorted(samples.sites, site)]
        at_vertex = own < 0
        own[at_vertex] = tracer.any_element(samples.vertices[site[at_vertex], 0])
        dim = bonds.dim
        x = np.zeros((len(site), 3))
        x[:, :dim] = samples.points[site]
        whole = slice(0, element.size if chosen is None else len(chosen))
        holds = own.astype(np.int32)
        return BallTask(self, block, law_of(block.law), x, holds, reach, element, given, scale, chosen, whole)

    @cached_property
    def table(self) -> Floats:
        """A row of whole cache lines for each element, as the loops want it."""
        mesh, tracer, dim = self.bonds.mesh, self.fan.tracer, self.bonds.dim
        rows = aligned(int(mesh.nelements), {1: 4, 2: 8, 3: 16}[dim])
        rows[:, :dim] = tracer.base
        rows[:, dim : dim + dim * dim] = tracer.gradient[:, 1:].reshape(-1, dim * dim)
        rows.view(np.int32)[:, IDS[dim] : IDS[dim] + dim + 1] = mesh.t.T
        return rows

    def schedule(self) -> Schedule:
        """Return the tasks, split to keep all threads busy, in a fixed order of what they add to."""
        most, mesh = piece(self.bonds.nbonds), self.bonds.mesh
        pieces = [some for task in self.tasks for some in task.split(most)]
        held = marked(np.empty(0, dtype=np.int64), int(mesh.nelements))
        marks = []
        for some in pieces:
            held[:] = False
            held[some.element.ravel()] = held[some.own] = True
            marks.append(marked(mesh.t[:, held].ravel(), int(mesh.nvertices)))
        return Schedule.of(pieces, marks)

    def desk(self) -> BallDesk:
        """Return arrays for a call."""
        shape = int(self.bonds.mesh.nvertices), self.bonds.dim
        return BallDesk(np.empty(shape), np.empty(shape))

    def load(self, desk: BallDesk, u: Floats, team: Team) -> None:
        """Take in a displacement."""
        desk.u[:] = u.reshape(desk.u.shape)
        desk.F.fill(0.0)

    def collect(self, desk: BallDesk, team: Team) -> Floats:
        """Return what the tasks have added, as nodal values."""
        return desk.F.ravel().copy()
