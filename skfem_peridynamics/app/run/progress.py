"""What a run says while it goes on."""

from __future__ import annotations

import sys
import time
from typing import Any, Protocol

_APART, _KEPT = 0.5, 9  # seconds between two marks, and how many are kept: the pace is that of the last five seconds
_REFRESHED, _SMOOTHED = 0.1, 10.0  # seconds between two pictures of a bar, and those that its pace is the mean of
_TITLE = 24  # characters of a title beside a bar


class Progress(Protocol):
    """Hears of a run while it goes on; energies are in ``unit``."""

    def begin(self, what: str, steps: int, unit: str = "") -> None: ...

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None: ...

    def end(self) -> None: ...


class Silent:
    """A progress that says nothing."""

    def begin(self, what: str, steps: int, unit: str = "") -> None:
        pass

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        pass

    def end(self) -> None:
        pass


def strain_in_words(Z: float) -> str:
    """Say how far the most strained bond is.

    >>> strain_in_words(0.25), strain_in_words(3.1)
    ('strains to 0.25 of critical', 'bonds break, at 3.1 times critical')
    """
    return f"strains to {Z:.2f} of critical" if Z < 1.0 else f"bonds break, at {Z:.3g} times critical"


class Line:
    """A line every tenth of the run, for files and pipes."""

    def begin(self, what: str, steps: int, unit: str = "") -> None:
        self.what, self.steps, self.shown, self.unit = what, steps, -1, unit
        self.message, self.first = "", steps
        self.marks: list[tuple[float, int]] = []  # when which step was done, a few of the last seconds

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        if energy is not None and largest_Z is not None:
            self.message = f", energy {energy:.4g}{self.unit}, {strain_in_words(largest_Z)}"
        now = time.perf_counter()
        # not from the beginning: the first step loads what it calls, and a continued run has not done the others
        if step > self.first and (not self.marks or now - self.marks[-1][0] > _APART):
            self.marks = [*self.marks[-_KEPT:], (now, step)]
        self.first = min(self.first, step)
        tenth = step * 10 // self.steps
        if step and (tenth > self.shown or step == self.steps):
            self.shown = tenth
            began, first = self.marks[0] if self.marks else (now, step)
            rate = (step - first) / (now - began) if step > first and now > began else 0.0
            pace = f", {rate:.1f} steps/s, {(self.steps - step) / rate:.0f} s left" if rate else ""
            print(f"step {step}/{self.steps}{pace}{self.message}", flush=True)

    def end(self) -> None:
        pass


class Bar:
    """A bar that moves, on a terminal or in a notebook, by rich: pace, time left, energy, strain."""

    def begin(self, what: str, steps: int, unit: str = "") -> None:
        from rich import progress
        from rich.console import Console
        from rich.text import Text

        class Pace(progress.ProgressColumn):
            def render(self, task: progress.Task) -> Text:
                speed = task.finished_speed or task.speed
                return Text("" if speed is None else f"{speed:.1f}/s" if speed < 100 else f"{speed:.0f}/s")

        # below the guard of the command, which would write out what moves the cursor; titles are plain text here
        console = Console(file=getattr(sys.stdout, "stream", sys.stdout))
        said = progress.TextColumn("{task.fields[said]}", markup=False)
        title = progress.TextColumn("{task.description}", markup=False)
        columns = (
            title,
            progress.BarColumn(24),
            progress.MofNCompleteColumn(),
            Pace(),
            progress.TimeRemainingColumn(),
            said,
        )
        self.bar = progress.Progress(
            *columns, console=console, auto_refresh=False, speed_estimate_period=_SMOOTHED, redirect_stdout=False
        )
        printable = "".join(c for c in what if c.isprintable())
        self.title = printable if len(printable) <= _TITLE else printable[: _TITLE - 1] + "\u2026"
        self.steps, self.unit, self.shown, self.task, self.said = steps, unit, 0.0, None, ""
        self.bar.start()

    task: Any = None

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        if self.task is None:  # a continued run begins in the midst
            self.task = self.bar.add_task(self.title, total=self.steps, completed=step, said=self.said)
        if energy is not None and largest_Z is not None:
            self.said = f"energy {energy:.4g}{self.unit}, {strain_in_words(largest_Z)}"
        self.bar.update(self.task, completed=step, said=self.said)
        now = time.perf_counter()
        if now - self.shown > _REFRESHED or step == self.steps:
            self.shown = now
            self.bar.refresh()

    def end(self) -> None:
        self.bar.refresh()
        self.bar.stop()


def shown() -> Progress:
    """Return a bar on a terminal and in a notebook, lines elsewhere."""
    shell = sys.modules.get("IPython")
    in_notebook = shell is not None and "IPKernelApp" in getattr(shell.get_ipython(), "config", {})
    return Bar() if in_notebook or sys.stdout.isatty() else Line()
