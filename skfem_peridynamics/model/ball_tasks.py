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
from .compiled_law import Law, law_of, secant
from .kernels import Block, Team
from .pair_tasks import aligned
from .schedule import Schedule, marked, piece

_ELEMENTS = 1 << 12  # of a task that tabulates or hands over


@dataclass(frozen=True, eq=False)
class BallDesk:
    """Working arrays of one call: the table of elements, their sums (at zero between calls)."""

    E: Floats
    M: Floats


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
        return ((0,) * field.bonds.dim, self.x, *rays, desk.E)

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
            loop, sums = law.loop(ball_loops.force), (self.block.symmetric, desk.M)
            loop(*self._bonds(desk), self.given, self.scale, *law.gradient, *sums)

    def take_product(self, desk: BallDesk, weight: Floats) -> None:
        """Take ``X^T diag(weight) B u`` off the sums; weights are those of the block's bonds."""
        self._take(desk, weight[self.bonds])

    def _take(self, desk: BallDesk, weight: Floats) -> None:
        if self.chosen is not None:
            whole = np.zeros(self.element.size)
            whole[self.chosen] = weight
            weight = whole
        ball_loops.product(*self._bonds(desk), weight, self.block.symmetric, desk.M)


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
        x = np.zeros((len(site), 6))
        x[:, :dim], x[:, 3 : 3 + dim] = samples.points[site], tracer.base[own]
        whole = slice(0, element.size if chosen is None else len(chosen))
        holds = own.astype(np.int32)
        return BallTask(self, block, law_of(block.law), x, holds, reach, element, given, scale, chosen, whole)

    @cached_property
    def _pieces(self) -> list[tuple[int, int]]:
        """Elements in runs."""
        count = int(self.bonds.mesh.nelements)
        return [(low, min(count, low + _ELEMENTS)) for low in range(0, count, _ELEMENTS)]

    @cached_property
    def _handing(self) -> Schedule:
        """The runs of elements in a fixed order of the vertices that they add to."""
        mesh = self.bonds.mesh
        marks = [marked(mesh.t[:, low:high].ravel(), int(mesh.nvertices)) for low, high in self._pieces]
        return Schedule.of(self._pieces, marks)

    def schedule(self) -> Schedule:
        """Return the tasks, split to keep all threads busy, in a fixed order of what they add to."""
        most = piece(self.bonds.nbonds)
        pieces = [some for task in self.tasks for some in task.split(most)]
        size = int(self.bonds.mesh.nelements)
        return Schedule.of(pieces, [marked(np.append(some.element, some.own), size) for some in pieces])

    def desk(self) -> BallDesk:
        """Return new working arrays."""
        size, dim = int(self.bonds.mesh.nelements), self.bonds.dim
        E = aligned(size, {1: 4, 2: 8, 3: 16}[dim])  # whole lines of the cache
        E[:, :dim] = self.fan.tracer.base
        return BallDesk(E, aligned(size, {1: 2, 2: 8, 3: 12}[dim]))

    def load(self, desk: BallDesk, u: Floats, team: Team) -> None:
        """Tabulate a displacement."""
        dim = self.bonds.dim
        fixed = (0,) * dim, self.bonds.mesh.t, self.fan.tracer.gradient, u.reshape(-1, dim)
        for _ in team.map(lambda piece: ball_loops.tabulate(*fixed, *piece, desk.E), self._pieces):
            pass

    def collect(self, desk: BallDesk, team: Team) -> Floats:
        """Return what the tasks have added, as nodal values."""
        dim = self.bonds.dim
        out = np.zeros((int(self.bonds.mesh.nvertices), dim))
        fixed = (0,) * dim, self.bonds.mesh.t, self.fan.tracer.gradient, desk.M
        self._handing.run(lambda piece: ball_loops.hand_over(*fixed, *piece, out), team)
        return out.ravel()
