"""Ball bonds for the compiled loops: tasks of some sites, and the table of elements they read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._scaling import whole_power
from .._threads import Threads
from .._types import Floats, Ints, Longs
from ..bonds.ball_bonds import BallBonds
from ..bonds.bond_basis import BondBasis
from . import ball_loops, ball_virial_loops, element_loops
from .block import Block
from .compiled_law import Law, law_of, secant
from .pair_tasks import aligned
from .schedule import Schedule, task_size

_ELEMENTS, _MOST = 1 << 12, 512  # of a task that tabulates or hands over, and how many tasks


@dataclass(frozen=True, eq=False)
class BallArrays:
    """Working arrays of one call: the table of elements, their sums (at zero between calls).

    The virial V of the elements and their pressure p are made where a dilatation needs them.
    """

    E: Floats
    M: Floats

    @cached_property
    def V(self) -> Floats:
        return aligned(len(self.E), 4)

    @cached_property
    def p(self) -> Floats:
        return aligned(len(self.E), 4)


@dataclass(frozen=True, eq=False)
class BallTask:
    """All bonds of one law that start at some sites, sorted by the elements they end in.

    Sites have their places x and the elements that hold them, ``own``; bonds their site and the number of their vector.
    """

    loops: BallLoops
    block: Block
    law: Law | None
    x: Floats
    own: Ints
    elements: Ints
    start: Ints
    site: Ints
    code: Ints
    vectors: Floats
    given: Floats
    scale: float
    bonds: slice  # among those of the block

    @cached_property
    def order(self) -> Longs:
        """Where each bond of the task is among ``bonds`` of the block."""
        return np.argsort(self.loops.far_elements(self.block)[self.bonds], kind="stable")

    def _bonds(self, arrays: BallArrays) -> tuple[Any, ...]:
        lists = self.elements, self.start, self.site, self.code, self.vectors
        return ((0,) * self.loops.bonds.dim, self.x, self.own, *lists, arrays.E)

    def strains(self, arrays: BallArrays) -> Floats:
        """Return the scaled strains of the bonds."""
        T, sorted_T = np.empty(len(self.site)), np.empty(len(self.site))
        ball_loops.strains(*self._bonds(arrays), sorted_T)
        T[self.order] = sorted_T
        return T

    def energy(self, arrays: BallArrays) -> float:
        if self.law is None:
            return float(self.block.k[self.bonds] @ self.block.law.energy(self.strains(arrays)))
        loop = self.law.loop(ball_loops.energy)
        return float(loop(*self._bonds(arrays), self.given, self.scale, *self.law.energy))

    def add_force(self, arrays: BallArrays, law: Law | None) -> None:
        """Add the forces of the bonds to the sums, under a law."""
        if law is None:
            self._take(arrays, secant(self.block, self.strains(arrays), self.bonds))
        else:
            loop, sums = law.loop(ball_loops.force), (self.block.symmetric, arrays.M)
            loop(*self._bonds(arrays), self.given, self.scale, *law.gradient, *sums)

    def add_virial(self, arrays: BallArrays, law: Law) -> None:
        """Add what the bonds pull with to the virial of their ends, under a law."""
        loop = law.loop(ball_virial_loops.virial)
        loop(*self._bonds(arrays), self.given, self.scale, *law.gradient, arrays.V)

    def add_pressed_force(self, arrays: BallArrays, law: Law) -> None:
        """Add the forces of the bonds under the pressure of the dilatation, and a law."""
        loop = law.loop(ball_virial_loops.force)
        loop(*self._bonds(arrays), self.given, self.scale, *law.hessian, arrays.p, arrays.M)

    def dilate(self, arrays: BallArrays, rates: Floats) -> None:
        """Add the rates of the virial by a displacement."""
        ball_virial_loops.dilate(*self._bonds(arrays), rates[self.bonds][self.order], arrays.V)

    def squeeze(self, arrays: BallArrays, rates: Floats) -> None:
        """Take the transpose of it, of a pressure, off the sums."""
        ball_virial_loops.squeeze(*self._bonds(arrays), rates[self.bonds][self.order], arrays.p, arrays.M)

    def take_product(self, arrays: BallArrays, weight: Floats) -> None:
        """Take ``X^T diag(weight) B u`` off the sums; weights are those of the block's bonds."""
        self._take(arrays, weight[self.bonds])

    def _take(self, arrays: BallArrays, weight: Floats) -> None:
        ball_loops.product(*self._bonds(arrays), weight[self.order], self.block.symmetric, arrays.M)


class BallLoops:
    """What all tasks of a body share: the fan, the elements, and how these hand over to the vertices."""

    def __init__(self, bonds: BondBasis, blocks: list[Block]) -> None:
        part = blocks[0].part
        assert isinstance(part, BallBonds)
        self.bonds, self.stencil = bonds, part.stencil
        most = task_size(bonds.nbonds)
        self.groups = [list(self._tasks(block, most)) for block in blocks]

    def far_elements(self, block: Block) -> Ints:
        """The elements that the bonds of a block end in."""
        assert isinstance(block.part, BallBonds)
        every: Ints = block.part.element.ravel()
        return every if block.which is None else every[block.which]

    def _tasks(self, block: Block, most: int) -> Iterator[BallTask]:
        """Tasks of runs of sites, about ``most`` bonds each."""
        part = block.part
        assert isinstance(part, BallBonds)
        # all bonds of a site are in one task: the sums at sites are its own
        count, per_site = max(1, most // part.per_site), part.per_site
        law, plain = law_of(block.law), block.bonds.plain and block.which is None
        k = part.weight if plain else block.k
        for low in range(0, len(part.site), count):
            run = slice(low, min(len(part.site), low + count))
            ends = np.array([run.start, run.stop]) * per_site
            if block.which is None:
                chosen, bonds = np.arange(*ends), slice(*ends.tolist())
            else:
                bonds = slice(*np.searchsorted(block.which, ends).tolist())
                chosen = block.which[bonds]
            if len(chosen):
                yield self._task(block, law, run, chosen - ends[0], bonds, k, block.bonds.prefactor if plain else 1.0)

    def _task(
        self, block: Block, law: Law | None, run: slice, chosen: Longs, bonds: slice, k: Floats, scale: float
    ) -> BallTask:
        part, samples, tracer = block.part, self.bonds.samples, self.stencil.tracer
        assert isinstance(part, BallBonds)
        sites = part.first + part.site[run].astype(np.int64)
        own = samples.element[np.searchsorted(samples.sites, sites)]
        at_vertex = own < 0
        # a vertex has no element of its own: any that it is a corner of has the same value there
        own[at_vertex] = tracer.any_element(samples.vertices[sites[at_vertex], 0])
        # bonds by the element they end in: its motion is read once, its sum written once
        order = np.argsort(self.far_elements(block)[bonds], kind="stable")
        element = part.element[run].ravel()[chosen][order]
        elements, start = np.unique(element, return_index=True)
        code, vectors = self._vectors(part.reach[run])
        site = (chosen // part.per_site)[order]
        return BallTask(
            *(self, block, law, np.ascontiguousarray(samples.points[sites]), own.astype(np.int32)),
            *(
                elements,
                np.append(start, len(element)).astype(np.int32),
                _small(site),
                _small(code[chosen][order]),
                vectors,
            ),
            *(k[bonds][order], scale, bonds),
        )

    def _vectors(self, reach: Floats) -> tuple[Longs, Floats]:
        """The vector of each bond of some sites, by its number, and the vectors: those of whole rays come once."""
        stencil, dim = self.stencil, self.bonds.dim
        ndir, nrad = len(stencil.directions), stencil.nodes.shape[1]
        cut = stencil.is_cut(reach)
        code = np.broadcast_to(np.arange(ndir * nrad).reshape(ndir, nrad), (*reach.shape, nrad)).copy()
        # rays that end at the boundary have vectors of their own, behind those of whole rays
        code[cut] = ndir * nrad + np.arange(int(cut.sum()) * nrad).reshape(-1, nrad)
        way = np.concatenate([stencil.directions, stencil.directions[np.nonzero(cut)[1]]])
        r = np.concatenate(
            [np.tile(stencil.horizon * stencil.nodes[0], (ndir, 1)), reach[cut][:, None] * stencil.nodes[1]]
        )
        vectors = aligned(len(way) * nrad, 4)
        vectors[:, :dim] = (way[:, None, :] * r[:, :, None]).reshape(-1, dim)
        np.divide(1.0, whole_power(r.ravel(), 3), out=vectors[:, 3], where=r.ravel() > 0.0)
        return code.ravel(), vectors

    @cached_property
    def _element_runs(self) -> list[tuple[int, int]]:
        """Elements in runs."""
        count = int(self.bonds.mesh.nelements)
        step = max(_ELEMENTS, count // _MOST)
        return [(low, min(count, low + step)) for low in range(0, count, step)]

    @cached_property
    def _handing(self) -> Schedule:
        """The runs of elements in a fixed order of the vertices that they add to."""
        mesh = self.bonds.mesh
        touched = (mesh.t[:, low:high].ravel() for low, high in self._element_runs)
        return Schedule.from_tasks(self._element_runs, touched, int(mesh.nvertices))

    def schedule(self) -> Schedule:
        """Return the tasks in a fixed order of what they add to."""
        tasks = [task for group in self.groups for task in group]
        touched = (np.append(task.elements, task.own) for task in tasks)
        return Schedule.from_tasks(tasks, touched, int(self.bonds.mesh.nelements))

    def arrays(self) -> BallArrays:
        """Return new working arrays."""
        size, dim = int(self.bonds.mesh.nelements), self.bonds.dim
        E = aligned(size, {1: 4, 2: 8, 3: 16}[dim])  # whole lines of the cache
        E[:, :dim] = self.stencil.tracer.base
        return BallArrays(E, aligned(size, {1: 2, 2: 8, 3: 12}[dim]))

    def load(self, arrays: BallArrays, u: Floats, pool: Threads) -> None:
        """Tabulate a displacement."""
        dim = self.bonds.dim
        fixed = (0,) * dim, self.bonds.mesh.t, self.stencil.tracer.gradient, u.reshape(-1, dim)
        for _ in pool.map(lambda run: element_loops.tabulate(*fixed, *run, arrays.E), self._element_runs):
            pass

    def take_virial(self, arrays: BallArrays, pool: Threads) -> Floats:
        """Return the virial that the tasks have added, at the vertices, and empty it."""
        out = np.zeros(int(self.bonds.mesh.nvertices))
        fixed = (0,) * self.bonds.dim, self.bonds.mesh.t, self.stencil.tracer.gradient, arrays.V
        self._handing.run(lambda run: ball_virial_loops.hand_over(*fixed, *run, out), pool)
        return out

    def press(self, arrays: BallArrays, pressure: Floats, pool: Threads) -> None:
        """Tabulate a pressure of the vertices."""
        fixed = (0,) * self.bonds.dim, self.bonds.mesh.t, self.stencil.tracer.gradient, pressure
        for _ in pool.map(lambda run: ball_virial_loops.tabulate(*fixed, *run, arrays.p), self._element_runs):
            pass

    def collect(self, arrays: BallArrays, pool: Threads) -> Floats:
        """Return what the tasks have added, as nodal values."""
        dim = self.bonds.dim
        out = np.zeros((int(self.bonds.mesh.nvertices), dim))
        fixed = (0,) * dim, self.bonds.mesh.t, self.stencil.tracer.gradient, arrays.M
        self._handing.run(lambda run: element_loops.hand_over(*fixed, *run, out), pool)
        return out.ravel()


def _small(numbers: Longs) -> Ints:
    """Numbers in as few bytes as they need, two or four."""
    return numbers.astype(np.uint16 if numbers.max(initial=0) < 1 << 16 else np.uint32)
