"""The operators by compiled loops, in threads: tasks that add to shared sums, those that never meet at a time.

A task is a block of bonds with its arrays in the form the loops want. Tasks write straight into the sums of the whole
body. Two that touch the same sample or element never run together: they are sorted into phases at set-up, and phases
follow one another. What each sum receives, and in which order, is thereby fixed: the same bits for any number of
threads. Working arrays are lent to one call at a time, so that calls from several threads do not meet either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from .._compile import compiled
from .._types import Floats, Ints, Longs
from ..bonds.parts import BallPart, PairPart
from ..material.potential import Exponential, Linear, Own, Potential, Rational
from . import ball_loops, pair_loops
from .kernels import Block, SparseEngine
from .law_loops import BATCH, EXPONENTIAL, LINEAR, OWN, RATIONAL

_T = TypeVar("_T")
_ELEMENTS = 1 << 14  # of a task that tabulates or hands over


@dataclass(frozen=True)
class Law:
    """A potential as the loops take it: its number and constants, or compiled functions of the user's own."""

    kind: int
    slope: float
    b: float
    f: Any = None
    df: Any = None

    @property
    def gradient(self) -> tuple[int, float, float, Any]:
        return self.kind, self.slope, self.b, self.df

    @property
    def energy(self) -> tuple[int, float, float, Any]:
        return self.kind, self.slope, self.b, self.f

    @classmethod
    def of(cls, law: Potential) -> Law | None:
        """Return the law for the loops, None for one that only Python can evaluate."""
        kinds = {Exponential: EXPONENTIAL, Rational: RATIONAL, Linear: LINEAR}
        if type(law) in kinds:
            return cls(kinds[type(law)], law.slope, law.b)
        if isinstance(law, Own) and hasattr(law.law, "loops"):
            f, df = law.law.loops
            return cls(OWN, law.slope, 0.0, f, df)
        return None


def _loop(module: Any, name: str, law: Law | None) -> Any:
    """A loop, compiled for this law: the code of a user's own function is not kept on disk."""
    made = getattr(module, name)
    if law is None or law.kind != OWN:
        return made
    key = (module.__name__, name)
    if key not in _unkept:
        _unkept[key] = compiled(made.py_func, keep=False)
    return _unkept[key]


_unkept: dict[tuple[str, str], Any] = {}


@dataclass(frozen=True, eq=False)
class Desk:
    """Working arrays of one call: samples and their sums, elements and theirs."""

    P: Floats
    F: Floats
    E: Floats
    M: Floats

    @property
    def rows(self) -> tuple[Floats, Floats, Floats]:
        """Three rows of sums; the last ones stand in where the dimension has fewer."""
        return self.F[0], self.F[len(self.F) // 2], self.F[-1]


@dataclass(frozen=True, eq=False)
class PairTask:
    """Bonds between samples of one law."""

    block: Block
    law: Law | None
    start: Longs
    partner: Ints
    given: Floats | None
    reach: float
    scale: float

    @classmethod
    def of(cls, block: Block, part: PairPart) -> PairTask:
        start, partner = part.start, part.partner
        if block.which is not None:
            start = np.searchsorted(block.which, start)
            partner = partner[block.which]
        own_way = block.bonds.plain and block.which is None
        given, scale = None, block.bonds.prefactor
        if own_way and part.given is not None:
            given = part.given
        elif not block.bonds.plain or part.given is not None or block.store:
            given, scale = block.k, 1.0
        return cls(block, Law.of(block.law), start, partner, given, part.reach, scale)

    def touched(self) -> tuple[Longs, Longs]:
        """First and last sample, as intervals of one."""
        return np.array([self.block.window.start]), np.array([self.block.window.stop])

    def _view(self, desk: Desk) -> tuple[Any, ...]:
        part = self.block.part
        assert isinstance(part, PairPart)
        return (0,) * len(desk.F), self.start, self.partner, part.row, desk.P[self.block.window]

    def _sums(self, desk: Desk) -> tuple[Floats, ...]:
        return tuple(row[self.block.window] for row in desk.rows)

    def strains(self, desk: Desk) -> Floats:
        T = np.empty(len(self.partner))
        pair_loops.strains(*self._view(desk), T)
        return T

    def energy(self, desk: Desk) -> float:
        if self.law is None:
            return float(self.block.k @ self.block.law.energy(self.strains(desk)))
        measure = self.given, self.reach, self.scale
        loop = _loop(pair_loops, "energy", self.law)
        return float(loop(*self._view(desk), *measure, *self.law.energy))

    def add_force(self, desk: Desk, law: Law | None = None) -> None:
        law = law or self.law
        if law is None:
            return self.take_product(desk, _secant(self.block, self.strains(desk)))
        measure = self.given, self.reach, self.scale
        _loop(pair_loops, "force", law)(*self._view(desk), *measure, *law.gradient, self._sums(desk))
        return None

    def take_product(self, desk: Desk, weight: Floats) -> None:
        pair_loops.product(*self._view(desk), weight, self._sums(desk))


@dataclass(frozen=True, eq=False)
class BallTask:
    """Ball bonds of one law: all that start at some sites, those of another law with measure 0."""

    block: Block
    law: Law | None
    site: Ints
    reach: Floats
    element: Ints
    given: Floats
    scale: float
    chosen: Longs | None  # where the bonds of the block are among those of the sites
    way: Floats
    node: Floats
    horizon: float

    @classmethod
    def of(cls, block: Block, part: BallPart) -> BallTask:
        directions, nodes = part.fan.directions, part.fan.nodes
        way = np.zeros((3, part.per_site))
        way[: directions.shape[1]] = np.repeat(directions, nodes.shape[1], axis=0).T
        node = np.tile(nodes, len(directions))
        rows = np.arange(len(part.site))
        chosen, scale = None, 1.0
        if block.which is None:
            plain = block.bonds.plain
            given, scale = (part.weight, block.bonds.prefactor) if plain else (block.k, 1.0)
        else:
            rows, place = np.unique(block.which // part.per_site, return_inverse=True)
            chosen = place * part.per_site + block.which % part.per_site
            given = np.zeros(len(rows) * part.per_site)
            given[chosen] = block.k
        arrays = (part.site, part.reach, part.element)
        site, reach, element = arrays if block.which is None else (array[rows] for array in arrays)
        horizon = part.fan.horizon
        return cls(block, Law.of(block.law), site, reach, element, given, scale, chosen, way, node, horizon)

    def touched(self) -> tuple[Longs, Longs]:
        """Elements of the far ends, as intervals; the sites are the task's own."""
        ids = np.unique(self.element)
        breaks = np.flatnonzero(np.diff(ids) > 1)
        return ids[np.append(0, breaks + 1)], ids[np.append(breaks, len(ids) - 1)] + 1

    def _view(self, desk: Desk) -> tuple[Any, ...]:
        axes, first = (0,) * len(desk.F), self.block.part.first
        rays = self.site, first, self.reach, self.element, self.horizon, self.way, self.node
        return (axes, *rays, desk.P, desk.E)

    def strains(self, desk: Desk) -> Floats:
        T = np.empty(self.element.size)
        ball_loops.strains(*self._view(desk), T)
        return T if self.chosen is None else T[self.chosen]

    def energy(self, desk: Desk) -> float:
        if self.law is None:
            return float(self.block.k @ self.block.law.energy(self.strains(desk)))
        loop = _loop(ball_loops, "energy", self.law)
        return float(loop(*self._view(desk), self.given, self.scale, *self.law.energy))

    def add_force(self, desk: Desk, law: Law | None = None) -> None:
        law = law or self.law
        if law is None:
            return self.take_product(desk, _secant(self.block, self.strains(desk)))
        both = self.block.symmetric, desk.rows, desk.M
        _loop(ball_loops, "force", law)(*self._view(desk), self.given, self.scale, *law.gradient, *both)
        return None

    def take_product(self, desk: Desk, weight: Floats) -> None:
        if self.chosen is not None:
            whole = np.zeros(self.element.size)
            whole[self.chosen] = weight
            weight = whole
        ball_loops.product(*self._view(desk), weight, self.block.symmetric, desk.rows, desk.M)


Task = PairTask | BallTask


def _secant(block: Block, T: Floats) -> Floats:
    """Weights w of ``B^T w B u`` that make it the force of a law that only Python can evaluate."""
    weight: Floats = 2.0 * block.k * block.law.df(T * T)
    return weight


def phases(touched: Sequence[tuple[Longs, Longs]], size: int) -> list[list[int]]:
    """Sort tasks into phases, first come first served: no two of a phase touch the same of ``size`` places.

    >>> one, two, three = (np.array([0]), np.array([4])), (np.array([3]), np.array([6])), (np.array([5]), np.array([9]))
    >>> phases([one, two, three], 9)
    [[0, 2], [1]]
    """
    taken: list[Any] = []
    out: list[list[int]] = []
    for number, (low, high) in enumerate(touched):
        mark = np.zeros(size + 1, dtype=np.int32)
        np.add.at(mark, low, 1)
        np.subtract.at(mark, high, 1)
        mine = np.cumsum(mark[:-1]) > 0
        for phase, used in zip(out, taken, strict=True):
            if not (used & mine).any():
                phase.append(number)
                used |= mine
                break
        else:
            out.append([number])
            taken.append(mine)
    return out


class CompiledEngine:
    """The operators of a body by compiled loops; what they cannot do, the sparse products do."""

    def __init__(self, other: SparseEngine) -> None:
        self.other, self.bonds, self.team = other, other.bonds, other.team
        self.dim = self.bonds.dim
        self._idle: list[Desk] = []

    @cached_property
    def tasks(self) -> list[Task]:
        def make(block: Block) -> Task:
            part = block.part
            return PairTask.of(block, part) if isinstance(part, PairPart) else BallTask.of(block, part)

        return [make(block) for block in self.other.blocks]

    @cached_property
    def _corners(self) -> Ints | None:
        """Samples at the corners of the elements, where bonds end in elements."""
        balls = [task.block.part for task in self.tasks if isinstance(task, BallTask)]
        return balls[0].fan.corners if balls and isinstance(balls[0], BallPart) else None

    @cached_property
    def _gradient(self) -> Floats:
        part = self.tasks[0].block.part
        assert isinstance(part, BallPart)
        return part.fan.tracer.gradient

    @cached_property
    def _phases(self) -> list[list[Task]]:
        size = self.bonds.samples.nsamples if self._corners is None else len(self._corners)
        sorted_tasks = phases([task.touched() for task in self.tasks], size)
        return [[self.tasks[number] for number in phase] for phase in sorted_tasks]

    @cached_property
    def _pieces(self) -> list[tuple[int, int]]:
        """Elements in runs."""
        count = 0 if self._corners is None else len(self._corners)
        return [(low, min(count, low + _ELEMENTS)) for low in range(0, count, _ELEMENTS)]

    @cached_property
    def _piece_phases(self) -> list[list[tuple[int, int]]]:
        assert self._corners is not None
        spans = []
        for low, high in self._pieces:
            ids = np.unique(self._corners[low:high])
            breaks = np.flatnonzero(np.diff(ids) > 1)
            spans.append((ids[np.append(0, breaks + 1)], ids[np.append(breaks, len(ids) - 1)] + 1))
        return [[self._pieces[n] for n in phase] for phase in phases(spans, self.bonds.samples.nsamples)]

    def _new_desk(self) -> Desk:
        samples, dim = self.bonds.samples, self.dim
        n = samples.nsamples
        P = np.zeros((n, 2 * dim + 2))
        P[:, :dim] = samples.points
        if len(samples.volume) == n:
            P[:, dim], P[:, 2 * dim + 1] = samples.volume, 1.0 / samples.size
        if self._corners is None:
            return Desk(P, np.zeros((dim, n)), np.zeros((0, 0)), np.zeros((0, 0)))
        nelements = len(self._corners)
        E = np.zeros((nelements, 2 * dim + dim * dim))
        E[:, :dim] = samples.points[self._corners[:, 0]]
        return Desk(P, np.zeros((dim, n)), E, np.zeros((nelements, dim + dim * dim)))

    @contextmanager
    def _desk(self, u: Floats) -> Iterator[Desk]:
        """Lend working arrays that hold a displacement, sums at zero."""
        try:
            desk = self._idle.pop()
        except IndexError:
            desk = self._new_desk()
        samples, dim = self.bonds.samples, self.dim
        nodal = u.reshape(-1, dim)
        if samples.at_vertices:
            fill(samples.vertices, nodal, desk.P)
        else:
            desk.P[:, dim + 1 : 2 * dim + 1] = samples.take(nodal)
        desk.F.fill(0.0)
        if self._corners is not None:
            desk.M.fill(0.0)
            axes, corners = (0,) * dim, self._corners
            self._run(lambda piece: ball_loops.tabulate(axes, corners, self._gradient, desk.P, *piece, desk.E), self._pieces)
        yield desk
        self._idle.append(desk)

    def _run(self, function: Callable[[Any], Any], things: Sequence[Any]) -> None:
        for _ in self.team.map(function, things):
            pass

    def _summed(self, desk: Desk) -> Floats:
        """What all tasks have added, at the vertices."""
        if self._corners is not None:
            axes, corners = (0,) * self.dim, self._corners
            for pieces in self._piece_phases:
                self._run(
                    lambda piece: ball_loops.hand_over(axes, corners, self._gradient, desk.M, *piece, desk.F), pieces
                )
        samples = self.bonds.samples
        if samples.at_vertices:
            out = np.empty((samples.nvertices, self.dim))
            empty(samples.vertices, desk.F, out)
            return out.ravel()
        return samples.spread(desk.F.T).ravel()

    # ---- the operators
    def energy(self, u: Floats) -> float:
        with self._desk(u) as desk:
            return float(sum(self.team.map(lambda task: task.energy(desk), self.tasks)))

    def force(self, u: Floats) -> Floats:
        with self._desk(u) as desk:
            for phase in self._phases:
                self._run(lambda task: task.add_force(desk), phase)
            return self._summed(desk)

    def product(self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False) -> Floats:
        if transposed and not self.bonds.rule.symmetric:
            return self.other.product(weights, v, transposed)
        with self._desk(v) as desk:
            if weights is None:
                for phase in self._phases:
                    self._run(lambda task: task.add_force(desk, Law(LINEAR, task.block.law.slope, 0.0)), phase)
            else:
                of = {id(task): weight for task, weight in zip(self.tasks, weights, strict=True)}
                for phase in self._phases:
                    self._run(lambda task: task.take_product(desk, of[id(task)]), phase)
            out = self._summed(desk)
        return np.negative(out, out=out)

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        with self._desk(u) as desk:
            yield from self.team.map(lambda task: function(task.block, task.strains(desk)), self.tasks)


@compiled
def fill(vertices: Any, nodal: Any, P: Any) -> None:
    """Put nodal values into the table of samples that are vertices."""
    dim = nodal.shape[1]
    for i in range(len(vertices)):
        for a in range(dim):
            P[i, dim + 1 + a] = nodal[vertices[i, 0], a]


@compiled
def empty(vertices: Any, F: Any, nodal: Any) -> None:
    """Take sums at samples that are vertices to the vertices."""
    for i in range(len(vertices)):
        for a in range(len(F)):
            nodal[vertices[i, 0], a] = F[a, i]
