"""Tasks that add to shared sums, in threads: two that meet run one after the other, always in the same order.

What each sum receives, and in which order, is thereby fixed at set-up: the same bits for any number of threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from threading import Event
from typing import Any

import numpy as np

from .._threads import Threads
from .._types import Bools, Ints

_LEAST, _MOST = 1 << 14, 1 << 17  # bonds: handing out a task costs some ten microseconds, a bond some nanoseconds
_FEW, _MANY = 64, 1024  # tasks: enough for all threads, and so many that who meets whom is soon found out
_PLACES = 4096  # told apart; where there are more, neighbours by number count as one


def task_size(nbonds: int) -> int:
    """Return of how many bonds to make a task.

    >>> task_size(10**4), task_size(3 * 10**6), task_size(10**7), task_size(2**28)
    (16384, 46875, 131072, 262144)
    """
    return max(_LEAST, min(_MOST, nbonds // _FEW), nbonds // _MANY)


def overlaps(touched: Iterable[Ints], size: int) -> Bools:
    """Return which tasks meet, (n, n): those that touch the same of ``size`` places, or ones next to each other.

    Where there are many places, neighbours by number count as one. What tasks touch is looked at one by one.

    >>> overlaps([np.array([0, 1]), np.array([1, 2]), np.array([2])], size=3).astype(int).tolist()
    [[1, 1, 0], [1, 1, 1], [0, 1, 1]]
    """
    width = -(-size // _PLACES)
    rows = []
    for places in touched:
        mark = np.zeros(-(-size // width), dtype=np.float32)
        # a place is an interval of numbers: cheaper to compare, and at worst two tasks wait that need not
        mark[places // width] = 1.0
        rows.append(mark)
    if not rows:
        return np.zeros((0, 0), dtype=bool)
    marks = np.array(rows)
    meet: Bools = marks @ marks.T > 0.0
    return meet


def groups(meet: Bools) -> list[list[int]]:
    """Sort tasks into groups, first come first served: no two of a group meet.

    >>> groups(overlaps([np.array([0, 1]), np.array([1, 2]), np.array([2])], size=3))
    [[0, 2], [1]]
    """
    out: list[list[int]] = []
    for number, row in enumerate(meet):
        for group in out:
            if not row[group].any():
                group.append(number)
                break
        else:
            out.append([number])
    return out


@dataclass(frozen=True, eq=False)
class Schedule:
    """Tasks in the order of their groups, and for each the earlier ones that it has to wait for.

    These touch what it touches; those that another of them waits for already are left out.
    """

    tasks: Sequence[Any]
    waits: Sequence[Sequence[int]]

    @classmethod
    def from_tasks(cls, tasks: Sequence[Any], touched: Iterable[Ints], size: int) -> Schedule:
        """Order tasks by the places, of ``size``, that they touch."""
        meet = overlaps(touched, size)
        order = [number for group in groups(meet) for number in group]
        meet = meet[np.ix_(order, order)]
        waits: list[list[int]] = []
        before: list[int] = []  # all that come before each task, a bit for each
        for n in range(len(order)):
            waited, known = [], 0
            # from the latest on: what an awaited task has itself waited for is done by then
            for k in reversed(np.flatnonzero(meet[n, :n]).tolist()):
                if not known >> k & 1:
                    waited.append(k)
                    known |= before[k] | 1 << k
            waits.append(waited)
            before.append(known)
        return cls([tasks[number] for number in order], waits)

    def run(self, function: Callable[[Any], Any], pool: Threads) -> None:
        """Run a function on every task."""
        if pool.threads == 1 or len(self.tasks) < 2:
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

        for _ in pool.map(work, range(pool.threads)):
            pass
