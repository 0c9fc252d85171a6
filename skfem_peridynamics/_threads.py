"""Threads that work on blocks and tasks."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import TypeVar

import numpy as np

_T = TypeVar("_T")
_X = TypeVar("_X")


def usable_cores() -> int:
    """Return how many processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return max(1, len(os.sched_getaffinity(0)))
    return os.cpu_count() or 1


class Threads:
    """Run a function over things, in threads where there are several, results in order.

    A process that was forked off starts threads of its own.
    """

    def __init__(self, threads: int | None) -> None:
        if threads is not None and threads < 1:
            raise ValueError(f"threads = {threads} must be at least 1")
        self.threads = usable_cores() if threads is None else threads
        self._pool: ThreadPoolExecutor | None = None
        self._process = 0

    def map(self, function: Callable[[_X], _T], things: Sequence[_X]) -> Iterator[_T]:
        def quiet(argument: _X) -> _T:
            # a run that has become unstable overflows; who steps it looks at the numbers, and says so in words
            with np.errstate(over="ignore", invalid="ignore"):
                return function(argument)

        if self.threads == 1 or len(things) < 2:
            return map(quiet, things)
        if self._pool is None or self._process != os.getpid():
            self._pool, self._process = ThreadPoolExecutor(self.threads), os.getpid()
        return self._pool.map(quiet, things)


@cache
def all_threads() -> Threads:
    """Return the threads of this process, one a usable core, for work that is not a body's own."""
    return Threads(None)
