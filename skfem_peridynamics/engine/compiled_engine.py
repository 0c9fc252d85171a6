"""The operators of a body by compiled loops, in threads.

A task is a block of bonds, or a part of one, with its arrays in the form the loops want. Tasks write straight into the
sums of the whole body, in the order of a schedule. Working arrays are lent to one call at a time, so that calls from
several threads do not meet.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any, TypeVar

import numpy as np

from .._types import Floats, Longs
from ..bonds.ball_bonds import BallPart
from .ball_tasks import BallField
from .block import Block
from .compiled_law import linear
from .pair_tasks import PairField
from .schedule import Schedule
from .sparse_engine import SparseEngine

_T = TypeVar("_T")


class CompiledEngine:
    """The operators of a body by compiled loops; what they cannot do, the sparse products do."""

    def __init__(self, other: SparseEngine) -> None:
        self.other, self.team = other, other.team
        blocks = list(other.blocks)
        balls = bool(blocks) and isinstance(blocks[0].part, BallPart)
        self.field: Any = BallField(other.bonds, blocks) if balls else PairField(other.bonds, blocks)
        self._idle: list[Any] = []

    @cached_property
    def schedule(self) -> Schedule:
        """The tasks in a fixed order of what they add to."""
        made: Schedule = self.field.schedule()
        return made

    @contextmanager
    def _desk(self, u: Floats) -> Iterator[Any]:
        """Lend working arrays that hold a displacement; after a failure they are not used again."""
        try:
            desk = self._idle.pop()
        except IndexError:
            desk = self.field.desk()
        self.field.load(desk, np.ascontiguousarray(u), self.team)
        yield desk
        self._idle.append(desk)

    def energy(self, u: Floats) -> float:
        with self._desk(u) as desk:
            return float(sum(self.team.map(lambda task: task.energy(desk), self.schedule.tasks)))

    def force(self, u: Floats) -> Floats:
        with self._desk(u) as desk:
            self.schedule.run(lambda task: task.add_force(desk, task.law), self.team)
            out: Floats = self.field.collect(desk, self.team)
        return out

    def break_and_force(self, u: Floats, at: float) -> tuple[Floats, list[tuple[Block, Longs]]]:
        """Break the bonds beyond ``at`` times their critical strain; return the others' force, and which broke."""
        hit: list[Any] = []
        with self._desk(u) as desk:

            def take(task: Any) -> None:
                if task.break_and_add_force(desk, at):
                    hit.append(task)

            self.schedule.run(take, self.team)
            number = {id(block): k for k, block in enumerate(self.other.blocks)}
            hit.sort(key=lambda task: (number[id(task.block)], task.bonds.start))
            out: Floats = self.field.collect(desk, self.team)
        found = []
        for task in hit:
            which = task.bonds.start + np.flatnonzero(task.block.k[task.bonds] < 0.0)
            task.block.k[which] = 0.0
            found.append((task.block, which))
        return out, found

    def product(self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False) -> Floats:
        if transposed and not self.other.bonds.rule.symmetric:
            return self.other.product(weights, v, transposed)
        with self._desk(v) as desk:
            if weights is None:
                self.schedule.run(lambda task: task.add_force(desk, linear(task.block)), self.team)
            else:
                of = {id(block): weight for block, weight in zip(self.other.blocks, weights, strict=True)}
                self.schedule.run(lambda task: task.take_product(desk, of[id(task.block)]), self.team)
            out: Floats = self.field.collect(desk, self.team)
        return np.negative(out, out=out)

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        with self._desk(u) as desk:

            def look(group: Sequence[Any]) -> _T:
                T = [task.strains(desk) for task in group]
                return function(group[0].block, T[0] if len(T) == 1 else np.concatenate(T))

            yield from self.team.map(look, self.field.groups)
