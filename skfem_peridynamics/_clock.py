"""Seconds by phase."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager


class Clock:
    """Seconds by phase; a phase inside another is taken from it. Phases named at the start are there from the start.

    >>> clock = Clock("setup")
    >>> with clock.phase("steps"): pass
    >>> list(clock.seconds), clock.seconds["setup"]
    (['setup', 'steps'], 0.0)
    """

    def __init__(self, *names: str) -> None:
        self.seconds = dict.fromkeys(names, 0.0)
        self._open: list[tuple[str, float]] = []
        self._inner: list[float] = []

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        begin = time.perf_counter()
        self._inner.append(0.0)
        self._open.append((name, begin))
        try:
            yield
        finally:
            self._open.pop()
            whole = time.perf_counter() - begin
            self.seconds[name] = self.seconds.get(name, 0.0) + whole - self._inner.pop()
            if self._inner:
                self._inner[-1] += whole

    def so_far(self) -> dict[str, float]:
        """Return the seconds with those of the phases that are not over.

        >>> clock = Clock()
        >>> with clock.phase("steps"): spent = clock.so_far()["steps"]
        >>> spent > 0.0
        True
        """
        now, out, inside = time.perf_counter(), dict(self.seconds), 0.0
        for (name, begin), inner in zip(reversed(self._open), reversed(self._inner), strict=True):
            out[name] = out.get(name, 0.0) + now - begin - inner - inside
            inside = now - begin
        return out

    def add(self, seconds: Mapping[str, float]) -> None:
        """Add what was spent before."""
        for name, value in seconds.items():
            self.seconds[name] = self.seconds.get(name, 0.0) + value
