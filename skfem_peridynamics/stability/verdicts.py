"""What a case must do, what it did, and whether that holds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from .._types import Floats


@dataclass(frozen=True)
class Verdict:
    """One line of the report: ``figure`` must lie between ``low`` and ``high``.

    >>> Verdict("units", "mm", "the same run", figure=1e-12, low=0.0, high=1e-10, seconds=0.0).holds
    True
    """

    case: str
    setting: str
    must: str
    figure: float
    low: float
    high: float
    seconds: float
    note: str = ""

    @property
    def holds(self) -> bool:
        return bool(self.low <= self.figure <= self.high)


@dataclass(frozen=True, eq=False)
class Curve:
    """A line of a picture."""

    picture: str
    label: str
    x: Floats
    y: Floats
    axes: tuple[str, str]
    logarithmic: tuple[bool, bool] = (False, False)


@dataclass
class Verdicts:
    """Collects verdicts and curves; tells each verdict as it comes."""

    report: Callable[[Verdict], None] = lambda verdict: None
    entries: list[Verdict] = field(default_factory=list)
    curves: list[Curve] = field(default_factory=list)
    _begin: float = field(default_factory=time.perf_counter, repr=False)

    def add(
        self,
        case: str,
        setting: str,
        must: str,
        figure: float,
        high: float = np.inf,
        low: float = -np.inf,
        note: str = "",
    ) -> bool:
        """Write a verdict down; seconds are those since the last one."""
        now = time.perf_counter()
        verdict = Verdict(case, setting, must, float(figure), low, high, now - self._begin, note)
        self._begin = now
        self.entries.append(verdict)
        self.report(verdict)
        return verdict.holds

    def draw(
        self,
        picture: str,
        label: str,
        x: Sequence[float] | Floats,
        y: Sequence[float] | Floats,
        axes: tuple[str, str],
        logarithmic: tuple[bool, bool] = (False, False),
    ) -> None:
        """Add a line to a picture."""
        self.curves.append(Curve(picture, label, np.array(x, dtype=float), np.array(y, dtype=float), axes, logarithmic))

    @property
    def holds(self) -> bool:
        return all(verdict.holds for verdict in self.entries)


@contextmanager
def reported(verdicts: Verdicts, case: str, setting: str, must: str) -> Iterator[None]:
    """Turn an exception of a case into a verdict that does not hold."""
    try:
        yield
    except Exception as error:
        verdicts.add(case, setting, must, float("nan"), 0.0, 0.0, f"{type(error).__name__}: {error}")
