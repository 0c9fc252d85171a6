"""What ``skfem-peridynamics stability`` writes: every verdict as CSV, a report, and pictures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from ..._files import remove
from ..._version import __version__
from ...stability.cases import CASES
from ...stability.verdicts import Curve, Verdict, Verdicts
from ..files.whole_files import write_whole
from .figure import new_figure, save

FILES = ("stability.csv", "stability.md")


def write_report(folder: Path, verdicts: Verdicts, quick: bool, pictures: bool) -> list[str]:
    """Write the files into a folder that exists; return their names."""
    drawn = picture_names(verdicts) if pictures else {}
    for old in (*FILES, *(f"{picture_file(curve.picture)}" for curve in verdicts.curves)):
        remove(folder / old)
    write_whole(folder / "stability.csv", as_csv(verdicts))
    if drawn:
        for name, curves in drawn.items():
            plot_curves(folder / picture_file(name), curves)
    write_whole(folder / "stability.md", as_markdown(verdicts, quick, list(drawn)))
    return [*FILES, *map(picture_file, drawn)]


def picture_file(name: str) -> str:
    return f"{name.replace(' ', '_')}.png"


def picture_names(verdicts: Verdicts) -> dict[str, list[Curve]]:
    """Group curves by their picture, in the order they came."""
    out: dict[str, list[Curve]] = {}
    for curve in verdicts.curves:
        out.setdefault(curve.picture, []).append(curve)
    return out


def as_csv(verdicts: Verdicts) -> str:
    """Return one row for each verdict."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(("case", "setting", "must", "figure", "low", "high", "holds", "seconds", "note"))
    for verdict in verdicts.entries:
        row = (
            verdict.case,
            verdict.setting,
            verdict.must,
            verdict.figure,
            verdict.low,
            verdict.high,
            verdict.holds,
            round(verdict.seconds, 3),
            verdict.note,
        )
        writer.writerow(row)
    return out.getvalue()


def allowed(verdict: Verdict) -> str:
    """What a figure may be, in few words.

    >>> allowed(Verdict("c", "s", "m", 0.5, 0.0, 1e-3, 0.0)), allowed(Verdict("c", "s", "m", 0.5, 1.0, np.inf, 0.0))
    ('0 to 0.001', 'at least 1')
    """
    low, high = verdict.low, verdict.high
    if low == high:
        return f"{low:g}"
    if np.isinf(low):
        return f"at most {high:g}"
    return f"at least {low:g}" if np.isinf(high) else f"{low:.4g} to {high:.4g}"


def nearness(verdict: Verdict) -> float:
    """How near to what is not allowed a figure comes: 1 is there, more is beyond."""
    figure, low, high = verdict.figure, verdict.low, verdict.high
    if not np.isfinite(figure):
        return np.inf
    if low == high:
        return 0.0 if figure == low else np.inf
    if np.isfinite(low) and np.isfinite(high):
        return float(abs(2.0 * figure - low - high) / (high - low))
    if np.isinf(low):
        return float(figure / high) if high > 0.0 else (0.0 if figure <= high else np.inf)
    return float(low / figure) if figure > 0.0 else np.inf


def as_markdown(verdicts: Verdicts, quick: bool, pictures: list[str]) -> str:
    """Return the report: what does not hold, the nearest figure of each kind, and who won the race."""
    wrong = [verdict for verdict in verdicts.entries if not verdict.holds]
    state = "everything holds" if not wrong else f"{len(wrong)} of {len(verdicts.entries)} do not hold"
    lines = [f"# Stability report, version {__version__}: {state}", ""]
    if quick:
        lines += ["Quick run: fewer and smaller cases.", ""]
    header = ["| must hold | settings | allowed | nearest to it | there |", "|---|---|---|---|---|"]
    if wrong:
        lines += ["## What does not hold", "", *header[:0], "| case | setting | must | figure | allowed | note |"]
        lines += ["|---|---|---|---|---|---|"]
        lines += [
            f"| {entry.case} | {entry.setting} | {entry.must} | {entry.figure:.3g} | {allowed(entry)} | {entry.note} |"
            for entry in wrong
        ]
        lines.append("")
    for name, group in groupby(verdicts.entries, key=lambda verdict: verdict.case):
        of_case = list(group)
        description = next((case.what for key, case in CASES.items() if key == name.split()[0]), name)
        seconds = sum(verdict.seconds for verdict in of_case)
        lines += [f"## {name}: {description} ({seconds:.1f} s)", "", *header]
        kinds: dict[tuple[str, str], list[Verdict]] = {}
        for verdict in of_case:
            kinds.setdefault((verdict.must, allowed(verdict)), []).append(verdict)
        for (must, may), alike in kinds.items():
            worst = max(alike, key=nearness)
            holding = sum(verdict.holds for verdict in alike)
            count = f"{holding} of {len(alike)}" if holding < len(alike) else f"all {len(alike)}"
            lines.append(f"| {must} | {count} | {may} | {worst.figure:.3g} | {worst.setting} |")
        lines.append("")
        notes = [f"* {verdict.setting}: {verdict.note}" for verdict in of_case if verdict.note]
        lines += [*notes, ""] if notes else []
    lines += [f"![{name}]({picture_file(name)})" for name in pictures]
    return "\n".join(lines).rstrip() + "\n"


def plot_curves(path: Path, curves: Sequence[Curve]) -> None:
    """Draw the lines of one picture of the stability report."""
    figure = new_figure(8, 4.8)
    axes = figure.add_subplot()
    kinds = list(dict.fromkeys(curve.label.rpartition(", ")[2] for curve in curves))
    groups = list(dict.fromkeys(curve.label.rpartition(", ")[0] for curve in curves))
    for curve in curves:
        group, _, kind = curve.label.rpartition(", ")
        # one colour a scene and one marker a method, where labels are "scene, method"
        look = {"color": f"C{groups.index(group)}"} if len(groups) > 1 else {}
        marker = "osD^v"[kinds.index(kind) % 5] if len(curve.x) < 20 else ""
        axes.plot(curve.x, curve.y, marker=marker, markersize=5, linewidth=1.2, label=curve.label, **look)
    across, up = curves[0].logarithmic
    if across:
        axes.set_xscale("log")
    if up:
        axes.set_yscale("log")
    axes.set_xlabel(curves[0].axes[0])
    axes.set_ylabel(curves[0].axes[1])
    axes.set_title(curves[0].picture)
    axes.grid(alpha=0.3)
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    save(figure, path)
