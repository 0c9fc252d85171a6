"""What a validation case hands over: figures with what they must be, seconds, a picture, and a page of all that."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Figure:
    """A number, the range it must be in, and the source of that range."""

    what: str
    value: float
    low: float
    high: float
    source: str = ""

    @property
    def holds(self) -> bool:
        return self.low <= self.value <= self.high


@dataclass
class Page:
    """A case: ``judge`` its figures, add ``rows`` of tables and ``notes``, then ``write`` it as Markdown."""

    name: str
    title: str
    intro: str
    figures: list[Figure] = field(default_factory=list)
    tables: list[tuple[str, tuple[str, ...], list[tuple[object, ...]]]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    pictures: list[tuple[str, str]] = field(default_factory=list)
    runs: list[tuple[str, float, int, float]] = field(default_factory=list)

    def judge(self, what: str, value: float, low: float, high: float, source: str = "") -> Figure:
        """Add a figure that must lie in a range; print and return it."""
        one = Figure(what, float(value), low, high, source)
        self.figures.append(one)
        print(
            f"  {'holds' if one.holds else 'DOES NOT HOLD'}: {what}: {value:.4g} in [{low:.4g}, {high:.4g}]", flush=True
        )
        return one

    @contextmanager
    def timed(self, what: str) -> Iterator[dict[str, float]]:
        """Count the seconds of a run; ``steps`` and ``error`` are what its dictionary says."""
        said: dict[str, float] = {"steps": 0, "error": float("nan")}
        start = time.perf_counter()
        yield said
        self.runs.append((what, time.perf_counter() - start, int(said["steps"]), said["error"]))
        error = _cell(said["error"]) or "none"
        print(f"  {what}: {self.runs[-1][1]:.1f} s, {self.runs[-1][2]} steps, error estimate {error}", flush=True)

    @property
    def holds(self) -> bool:
        return all(one.holds for one in self.figures)

    @property
    def seconds(self) -> float:
        return sum(one[1] for one in self.runs)

    def markdown(self) -> str:
        """Return the page."""
        lines = [f"## {self.title}", "", self.intro, ""]
        lines += ["| figure | measured | must be | source | |", "|---|---|---|---|---|"]
        for one in self.figures:
            mark = "holds" if one.holds else "**does not hold**"
            lines.append(f"| {one.what} | {one.value:.4g} | {_range(one)} | {one.source} | {mark} |")
        for title, columns, rows in self.tables:
            lines += ["", title, "", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
            lines += ["| " + " | ".join(_cell(value) for value in row) + " |" for row in rows]
        for file, caption in self.pictures:
            lines += ["", f"![{caption}]({file})"]
        for note in self.notes:
            lines += ["", note]
        lines += ["", "| run | seconds | steps | error estimate |", "|---|---|---|---|"]
        lines += [f"| {what} | {s:.1f} | {steps or ''} | {_cell(error)} |" for what, s, steps, error in self.runs]
        return "\n".join(lines) + "\n"

    def picture(self, folder: Path, caption: str) -> Path:
        """Return where a picture is to go."""
        file = f"{self.name}{len(self.pictures) or ''}.png"
        self.pictures.append((f"validation/{file}", caption))
        folder.mkdir(parents=True, exist_ok=True)
        return folder / file


def draw_lines(
    path: Path,
    series: dict[str, tuple[Sequence[float], Sequence[float]]],
    labels: tuple[str, str],
    wanted: float | None = None,
) -> None:
    """Draw lines through points, and a dashed one where they should be."""
    from skfem_peridynamics.app.report.figure import new_figure, save

    figure = new_figure(5.6, 3.6)
    axes = figure.add_subplot()
    for name, (x, y) in series.items():
        axes.plot(x, y, "o-", label=name, markersize=4)
    if wanted is not None:
        axes.axhline(wanted, color="0.3", linestyle="--", linewidth=1)
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize=8)
    save(figure, path)


def _range(one: Figure) -> str:
    if one.high == float("inf"):
        return f"at least {one.low:.4g}"
    return f"at most {one.high:.4g}" if one.low == -float("inf") else f"{one.low:.4g} to {one.high:.4g}"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if value != value else f"{value:.4g}"
    return str(value)
