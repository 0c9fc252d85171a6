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


class Line:
    """One line that is rewritten on a terminal; a line every tenth of the run elsewhere."""

    def begin(self, what: str, steps: int) -> None:
        self.what, self.steps, self.start, self.shown = what, steps, time.perf_counter(), -1.0
        self.message, self.first = "", 0
        self.live = sys.stdout.isatty()
        self.begun = False

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        if energy is not None:
            self.message = f", energy {energy:.4g}, largest Z {largest_Z:.3g}"
        now = time.perf_counter()
        if not self.begun:  # the first step of a run that is continued is none of the first
            self.begun, self.first = True, max(0, step - 1)
        due = abs(now - self.shown) > 0.2 if self.live else step * 10 // self.steps > int(self.shown)
        if step and (due or step == self.steps):
            self.shown = now if self.live else float(step * 10 // self.steps)
            rate = (step - self.first) / max(now - self.start, 1e-9)
            left = (self.steps - step) / rate
            line = f"step {step}/{self.steps}, {rate:.1f} steps/s, {left:.0f} s left{self.message}"
            print(f"\r\x1b[K{line}" if self.live else line, end="" if self.live else "\n", flush=True)

    def end(self) -> None:
        if self.live:
            print(flush=True)
