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
from ..bonds.ball_bonds import BallBonds
from .ball_tasks import BallLoops
from .block import Beside, Block, Pressure
from .compiled_law import linear
from .pair_tasks import PairLoops
from .schedule import Schedule
from .sparse_engine import SparseEngine

_T = TypeVar("_T")


class CompiledEngine:
    """The operators of a body by compiled loops; what they cannot do, the sparse products do."""

    def __init__(self, sparse_engine: SparseEngine) -> None:
        self.sparse, self.pool = sparse_engine, sparse_engine.pool
        blocks = list(sparse_engine.blocks)
        balls = bool(blocks) and isinstance(blocks[0].part, BallBonds)
        self.loops: Any = BallLoops(sparse_engine.bonds, blocks) if balls else PairLoops(sparse_engine.bonds, blocks)
        self._idle: list[Any] = []

    @cached_property
    def schedule(self) -> Schedule:
        """The tasks in a fixed order of what they add to."""
        schedule: Schedule = self.loops.schedule()
        return schedule

    @contextmanager
    def _arrays(self, u: Floats) -> Iterator[Any]:
        """Lend working arrays that hold a displacement; after a failure they are not used again."""
        try:
            arrays = self._idle.pop()
        except IndexError:
            arrays = self.loops.arrays()
        self.loops.load(arrays, np.ascontiguousarray(u), self.pool)
        yield arrays
        self._idle.append(arrays)

    def energy(self, u: Floats) -> float:
        with self._arrays(u) as arrays:
            return float(sum(self.pool.map(lambda task: task.energy(arrays), self.schedule.tasks)))

    def force(self, u: Floats, pressure: Pressure | None = None) -> Floats:
        if pressure is not None and not self._dilates:
            return self.sparse.force(u, pressure)
        with self._arrays(u) as arrays:
            if pressure is None:
                self.schedule.run(lambda task: task.add_force(arrays, task.law), self.pool)
            else:
                self.schedule.run(lambda task: task.add_virial(arrays, task.law), self.pool)
                self.loops.press(arrays, pressure(self.loops.take_virial(arrays, self.pool)), self.pool)
                self.schedule.run(lambda task: task.add_pressed_force(arrays, task.law), self.pool)
            out: Floats = self.loops.collect(arrays, self.pool)
        return out

    def virial(self, u: Floats) -> Floats:
        if not self._dilates:
            return self.sparse.virial(u)
        with self._arrays(u) as arrays:
            self.schedule.run(lambda task: task.add_virial(arrays, task.law), self.pool)
            out: Floats = self.loops.take_virial(arrays, self.pool)
        return out

    @cached_property
    def _dilates(self) -> bool:
        """Whether there are loops for a dilatation: for laws that need no Python."""
        return all(task.law is not None for group in self.loops.groups for task in group)

    def break_and_force(
        self, u: Floats, at: float, pressure: Pressure | None = None
    ) -> tuple[Floats, list[tuple[Block, Longs]], Floats | None]:
        """Break the bonds beyond ``at`` times their critical strain; return the others' force, which broke, virial."""
        if pressure is not None and not self._dilates:
            return self.sparse.break_and_force(u, at, pressure)
        hit: list[Any] = []
        virial: Floats | None = None
        with self._arrays(u) as arrays:

            def take(task: Any) -> None:
                count = (
                    task.break_and_add_force(arrays, at) if pressure is None else task.break_and_add_virial(arrays, at)
                )
                if count:
                    hit.append(task)

            self.schedule.run(take, self.pool)
            number = {id(block): k for k, block in enumerate(self.sparse.blocks)}
            # tasks end in any order: the list of broken bonds, and so a checkpoint, must not depend on it
            hit.sort(key=lambda task: (number[id(task.block)], task.bonds.start))
            broken = []
            for task in hit:
                which = task.bonds.start + np.flatnonzero(task.block.k[task.bonds] < 0.0)
                task.block.k[which] = 0.0
                broken.append((task.block, which))
            if pressure is not None:
                virial = self.loops.take_virial(arrays, self.pool)
                self.loops.press(arrays, pressure(virial), self.pool)
                self.schedule.run(lambda task: task.add_pressed_force(arrays, task.law), self.pool)
            out: Floats = self.loops.collect(arrays, self.pool)
        return out, broken, virial

    def product(
        self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False, beside: Beside | None = None
    ) -> Floats:
        if (transposed and not self.sparse.bonds.rule.symmetric) or (beside is not None and not self._dilates):
            return self.sparse.product(weights, v, transposed, beside)
        of = {} if weights is None else {id(b): w for b, w in zip(self.sparse.blocks, weights, strict=True)}
        with self._arrays(v) as arrays:
            if beside is not None:
                self._beside(arrays, beside)
            if weights is not None:
                self.schedule.run(lambda task: task.take_product(arrays, of[id(task.block)]), self.pool)
            elif beside is None:
                # the linear law at rest needs no weights: they are made in the loop
                self.schedule.run(lambda task: task.add_force(arrays, linear(task.block)), self.pool)
            out: Floats = self.loops.collect(arrays, self.pool)
        # the loops take off: a product is minus what they have summed
        return np.negative(out, out=out)

    def _beside(self, arrays: Any, beside: Beside) -> None:
        """Add the force of the dilatation, linear in what the arrays hold; at rest that of the bonds, too."""
        if beside.rates is None:
            self.schedule.run(lambda task: task.add_virial(arrays, linear(task.block)), self.pool)
            self.loops.press(arrays, beside.pressure(self.loops.take_virial(arrays, self.pool)), self.pool)
            self.schedule.run(lambda task: task.add_pressed_force(arrays, linear(task.block)), self.pool)
            return
        of = {id(block): rates for block, rates in zip(self.sparse.blocks, beside.rates, strict=True)}
        self.schedule.run(lambda task: task.dilate(arrays, of[id(task.block)]), self.pool)
        self.loops.press(arrays, beside.pressure(self.loops.take_virial(arrays, self.pool)), self.pool)
        self.schedule.run(lambda task: task.squeeze(arrays, of[id(task.block)]), self.pool)

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        with self._arrays(u) as arrays:

            def of_group(group: Sequence[Any]) -> _T:
                T = [task.strains(arrays) for task in group]
                return function(group[0].block, T[0] if len(T) == 1 else np.concatenate(T))

            yield from self.pool.map(of_group, self.loops.groups)
