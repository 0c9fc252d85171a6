"""Tasks that add to shared sums, in threads: two that meet run one after the other, always in the same order.

What each sum receives, and in which order, is thereby fixed at set-up: the same bits for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np

from .._types import Bools, Ints
from .kernels import Team

_LEAST, _MOST, _TASKS = 1 << 14, 1 << 16, 64  # handing out a task costs some ten microseconds, a bond some nanoseconds


def piece(nbonds: int) -> int:
    """Return of how many bonds to make a task: enough tasks for all threads, none too small.

    >>> piece(10**4), piece(4 * 10**6), piece(10**9)
    (16384, 62500, 65536)
    """
    return min(_MOST, max(_LEAST, nbonds // _TASKS))


def marked(places: Ints, size: int) -> Bools:
    """Return which of ``size`` places are among some numbers.

    >>> marked(np.array([0, 2, 2]), 3).tolist()
    [True, False, True]
    """
    marks = np.zeros(size, dtype=bool)
    marks[places] = True
    return marks


def phases(marks: Sequence[Bools]) -> list[list[int]]:
    """Sort tasks into phases, first come first served: no two of a phase touch the same place.

    >>> phases([np.array([True, False, False]), np.array([True, True, False]), np.array([False, False, True])])
    [[0, 2], [1]]
    """
    taken: list[Bools] = []
    out: list[list[int]] = []
    for number, mine in enumerate(marks):
        for phase, used in zip(out, taken, strict=True):
            if not (used & mine).any():
                phase.append(number)
                used |= mine
                break
        else:
            out.append([number])
            taken.append(mine.copy())
    return out


@dataclass(frozen=True, eq=False)
class Schedule:
    """Tasks in the order of their phases, and for each the earlier ones that it has to wait for.

    These touch what it touches; those that another of them waits for already are left out.
    """

    tasks: Sequence[Any]
    waits: Sequence[Sequence[int]]

    @classmethod
    def of(cls, tasks: Sequence[Any], marks: Sequence[Bools]) -> Schedule:
        """Order tasks by the places that they touch."""
        order = [number for phase in phases(marks) for number in phase]
        waits: list[list[int]] = []
        before: list[int] = []  # all that come before each task, a bit for each
        for n, number in enumerate(order):
            mine, known = [], 0
            for k in reversed(range(n)):
                if not known >> k & 1 and (marks[order[k]] & marks[number]).any():
                    mine.append(k)
                    known |= before[k] | 1 << k
            waits.append(mine)
            before.append(known)
        return cls([tasks[number] for number in order], waits)

    def run(self, function: Callable[[Any], Any], team: Team) -> None:
        """Run a function on every task."""
        if team.threads == 1 or len(self.tasks) < 2:
            for task in self.tasks:
                function(task)
            return
        done = [Event() for _ in self.tasks]
        turn = iter(range(len(self.tasks)))  # next() on it is one step: no two workers get the same number

        def work(_: int) -> None:
            for n in turn:
                try:
                    for k in self.waits[n]:  # taken before this one, so a worker is at it
                        done[k].wait()
                    function(self.tasks[n])
                finally:
                    done[n].set()

        for _ in team.map(work, range(team.threads)):
            pass
