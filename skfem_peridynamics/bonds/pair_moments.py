"""Moments of vertex pairs, bond by bond and matrix-free, in compiled loops and threads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from .._threads import all_threads
from .._types import Floats, Longs
from .moments import Moments
from .pair_bonds import PairBonds

_TASKS = 2  # of a part of the bonds: their sums are added in order, so that bits do not depend on threads


@dataclass(frozen=True, eq=False)
class PairMoments(Moments):
    """The same of vertex pairs; a row a sample. In three dimensions of order three alone."""

    @property
    def vertex(self) -> Longs:
        return self.bonds.samples.vertices[:, 0].astype(np.int64)

    def moments(self, w: list[Floats]) -> Floats:
        shared = self._shared(w, 1)

        def act(task: _Task) -> Floats:
            out = np.zeros((task.part.width, self.columns))
            _loops().SPREAD[self.bonds.dim](*task.rows, self._scale, shared[task.number], self.four, out)
            return out

        return self._added(act) * self.roots

    def gathered(self, y: Floats) -> list[Floats]:
        y = np.ascontiguousarray(y * self.roots)
        out = [np.empty(part.nbonds) for part in self._parts]

        def act(task: _Task) -> None:
            _loops().GATHER[self.bonds.dim](*task.rows, self._scale, task.own(y), self.four, out[task.number])

        self._run(act)
        for s, share in zip(out, self._shares, strict=True):
            if share is not None:
                s *= share
        return out

    def normal(self, w: list[Floats]) -> Callable[[Floats], Floats]:
        shared = self._shared(w, 2)
        room = [np.empty(part.nbonds) for part in self._parts]
        loops = _loops()

        def apply(y: Floats) -> Floats:
            y = np.ascontiguousarray(y * self.roots)

            def act(task: _Task) -> Floats:
                out, s, bonds = np.zeros((task.part.width, self.columns)), room[task.number], task.bonds
                loops.GATHER[self.bonds.dim](*task.rows, self._scale, task.own(y), self.four, s)
                # what the task has just written is still near the processor
                s[bonds] *= shared[task.number][bonds]
                loops.SPREAD[self.bonds.dim](*task.rows, self._scale, s, self.four, out)
                return out

            return self._added(act) * self.roots

        return apply

    def own_weights(self) -> list[Floats]:
        parts = self._parts
        if any(part.given is not None for part in parts):
            return [part.weight for part in parts]
        out = [np.empty(part.nbonds) for part in parts]

        def act(task: _Task) -> None:
            part, window = task.part, slice(task.part.first, task.part.first + task.part.width)
            samples = part.samples
            start, far, x, row = task.rows
            size, volume = samples.size[window], samples.volume[window]
            _loops().own_weights(start, far, x, row, part.reach, size, volume, out[task.number])

        self._run(act)
        return out

    def degree(self, w: list[Floats]) -> Floats:
        shared = self._shared(w, 2)

        def act(task: _Task) -> Floats:
            out = np.zeros(task.part.width)
            start, far, _, row = task.rows
            _loops().degree(start, far, row, shared[task.number], out)
            return out

        return self._added(act)

    # ---- how
    @property
    def _scale(self) -> float:
        return 1.0 / self.bonds.horizon

    @cached_property
    def _parts(self) -> list[PairBonds]:
        return [part for part in self.bonds.parts if isinstance(part, PairBonds)]

    @cached_property
    def _shares(self) -> list[Floats | None]:
        """``J w(x) w(y)`` by part; None where they are 1."""
        bonds = self.bonds
        if bonds.plain:
            return [None] * len(bonds.parts)
        return [bonds.influence_of(part) * bonds.boundary_share_of(part) for part in bonds.parts]

    def _shared(self, w: list[Floats], power: int) -> list[Floats]:
        """Weights times ``J w(x) w(y)``, or its square."""
        shares = zip(w, self._shares, strict=True)
        return [x if share is None else x * (share if power == 1 else share * share) for x, share in shares]

    @cached_property
    def _tasks(self) -> list[_Task]:
        points, tasks = self.bonds.samples.points, []
        for number, part in enumerate(self._parts):
            x = np.ascontiguousarray(points[part.first : part.first + part.width])
            cuts = np.searchsorted(part.start, np.linspace(0, part.nbonds, _TASKS + 1)[1:-1])
            edges = np.unique([0, *cuts, len(part.start) - 1])
            for low, high in pairwise(edges):
                rows = (part.start[low : high + 1], part.partner, x, part.row + int(low))
                tasks.append(_Task(number, part, rows, slice(int(part.start[low]), int(part.start[high]))))
        return tasks

    def _added(self, act: Callable[[_Task], Floats]) -> Floats:
        """The sum over the tasks, in order; as many at a time as there are threads."""
        total: Floats | None = None
        for task, out in zip(self._tasks, self._run(act), strict=True):
            if total is None:
                total = np.zeros((self.bonds.samples.nsamples, *out.shape[1:]))
            total[task.part.first : task.part.first + task.part.width] += out
        assert total is not None
        return total

    def _run(self, act: Callable[[_Task], Any]) -> list[Any]:
        return list(all_threads().map(act, self._tasks))


@dataclass(frozen=True, eq=False)
class _Task:
    """Some rows of a part, as the loops take them, and which of its bonds these are."""

    number: int
    part: PairBonds
    rows: tuple[Any, ...]
    bonds: slice

    def own(self, y: Floats) -> Floats:
        """Of values at samples those that the part uses."""
        return y[self.part.first : self.part.first + self.part.width]


def _loops() -> Any:
    from . import moment_loops

    return moment_loops
