"""What a run says while it goes on."""

from __future__ import annotations

import sys
import time
from typing import Protocol


class Progress(Protocol):
    """Hears of a run while it goes on."""

    def begin(self, what: str, steps: int) -> None: ...

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None: ...

    def end(self) -> None: ...


class Silent:
    """A progress that says nothing."""

    def begin(self, what: str, steps: int) -> None:
        pass

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        pass

    def end(self) -> None:
        pass


_APART, _KEPT = 0.5, 9  # seconds between two marks, and how many are kept: the pace is that of the last five seconds


class Line:
    """One line that is rewritten on a terminal; a line every tenth of the run elsewhere."""

    def begin(self, what: str, steps: int) -> None:
        self.what, self.steps, self.shown = what, steps, -1.0
        self.message, self.first = "", steps
        self.marks: list[tuple[float, int]] = []  # when which step was done, a few of the last seconds
        self.live = sys.stdout.isatty()

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        if energy is not None:
            self.message = f", energy {energy:.4g}, largest Z {largest_Z:.3g}"
        now = time.perf_counter()
        # not from the beginning: the first step loads what it calls, and a continued run has not done the others
        if step > self.first and (not self.marks or now - self.marks[-1][0] > _APART):
            self.marks = [*self.marks[-_KEPT:], (now, step)]
        self.first = min(self.first, step)
        due = abs(now - self.shown) > 0.2 if self.live else step * 10 // self.steps > int(self.shown)
        if step and (due or step == self.steps):
            self.shown = now if self.live else float(step * 10 // self.steps)
            began, first = self.marks[0] if self.marks else (now, step)
            rate = (step - first) / (now - began) if step > first and now > began else 0.0
            pace = f", {rate:.1f} steps/s, {(self.steps - step) / rate:.0f} s left" if rate else ""
            line = f"step {step}/{self.steps}{pace}{self.message}"
            if self.live:
                sys.stdout.write("\r\x1b[K")  # alone: no more than this passes as what it is
            print(line, end="" if self.live else "\n", flush=True)

    def end(self) -> None:
        if self.live:
            print(flush=True)
