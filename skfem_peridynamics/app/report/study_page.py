"""What a study writes: study.json, study.csv, study.md, and a picture of error against seconds."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
from collections.abc import Callable, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from ..._files import remove
from ..._version import __version__
from ...study.measure import Row, as_dict
from ...study.rates import pareto, seconds_to
from ...study.result import Level, Result, rates
from ..files.history import plain
from ..files.whole_files import write_whole
from .figure import new_figure, save

TARGETS = {1: (1e-2, 1e-3, 1e-4), 2: (1e-2, 1e-3, 1e-4), 3: (1e-2, 3e-3)}
_NOT = "not reached"
FILES = ("study.json", "study.csv", "study.md", "study.png")


def write_rows(folder: Path, outcome: Result) -> None:
    """Write ``study.csv`` alone, with the rows so far."""
    write_whole(folder / "study.csv", as_csv(outcome))


def write_study(folder: Path, outcome: Result, pictures: bool) -> list[str]:
    """Write the files of a study into a folder that exists; return their names."""
    for old in FILES:
        remove(folder / old)
    names = ["study.json", "study.csv", "study.md"]
    write_rows(folder, outcome)
    write_whole(folder / "study.md", as_markdown(outcome))
    if pictures and (outcome.rows or outcome.levels):
        if outcome.rows:
            plot_work_precision(folder / "study.png", outcome.rows, outcome.what)
        else:
            plot_levels(folder / "study.png", outcome.levels, f"{outcome.name}: {outcome.what}")
        names.append("study.png")
    write_whole(folder / "study.json", as_json(outcome))
    return names


def read_rows(folder: Path, name: str) -> list[Row]:
    """Return the rows that a study which was stopped left in ``study.csv``; none where there is no such file.

    Raises ``ValueError`` for a file of another study, or of another version.
    """
    path = folder / "study.csv"
    if not path.exists():
        return []
    kinds = {field.name: {"str": str, "int": int, "float": float}[str(field.type)] for field in dataclasses.fields(Row)}
    rows = []
    with open(path, newline="") as file:
        for number, line in enumerate(csv.DictReader(file), 2):
            try:
                rows.append(Row(**{key: kind(line[key]) for key, kind in kinds.items()}))
                found = rows[-1].problem, line["version"]
            except (KeyError, TypeError, ValueError) as error:
                raise ValueError(f"{path}, line {number}: not a row of a study of this version ({error})") from error
            if found != (name, __version__):
                raise ValueError(f"{path}, line {number}: a row of {found[0]} by version {found[1]}")
    return rows


def is_whole(folder: Path, name: str, quick: bool) -> bool:
    """Return whether a study of this version has been run to its end in a folder, with as many sizes."""
    try:
        content = json.loads((folder / "study.json").read_text())
        found = [content[key] for key in ("study", "quick", "version")]
    except (OSError, ValueError, KeyError, TypeError):
        return False
    return found == [name, quick, __version__]


def as_json(outcome: Result) -> str:
    """Return all of a study as JSON."""
    content = {
        "study": outcome.name,
        "what": outcome.what,
        "quick": outcome.quick,
        "version": __version__,
        "rows": [plain(as_dict(row)) for row in outcome.rows],
        "tables": [
            {"heading": heading, "columns": list(columns), "rows": [[plain(x) for x in row] for row in rows]}
            for heading, columns, rows in outcome.tables
        ],
        "levels": [dataclasses.asdict(level) for level in outcome.levels],
        "notes": outcome.notes,
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def as_csv(outcome: Result) -> str:
    """Return the rows of the runs, or of the tables where there are no runs, as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    if outcome.rows:
        writer.writerow([*as_dict(outcome.rows[0]), "version"])
        for row in outcome.rows:
            writer.writerow([*as_dict(row).values(), __version__])
    for heading, columns, rows in outcome.tables:
        writer.writerow(("table", *columns))
        writer.writerows((heading, *row) for row in rows)
    return out.getvalue()


def as_markdown(outcome: Result) -> str:
    """Return the whole study as Markdown."""
    lines = [f"# {outcome.name}: {outcome.what}", ""]
    if outcome.quick:
        lines += ["Quick run: fewer sizes.", ""]
    lines += [line for note in outcome.notes for line in (note, "")]
    for heading, columns, rows in [*race_tables(outcome.rows), *outcome.tables]:
        lines += [f"## {heading}", "", "| " + " | ".join(columns) + " |", "|" + "---|" * len(columns)]
        lines += ["| " + " | ".join(shown(x) for x in row) + " |" for row in rows]
        lines.append("")
    return "\n".join(lines)


def shown(value: Any) -> str:
    """A number with three digits, an absent one as a dash."""
    if isinstance(value, bool) or not isinstance(value, (float, np.floating)):
        return str(value)
    number = float(value)
    if np.isnan(number):
        return "-"
    return f"{number:.2e}" if number and not 1e-2 <= abs(number) < 1e4 else f"{number:.3g}"


def by_scheme(rows: Sequence[Row]) -> list[tuple[str, list[Row]]]:
    """Group rows by scheme, in the order of their first run."""
    names = list(dict.fromkeys(row.scheme for row in rows))
    return [(name, [row for row in rows if row.scheme == name]) for name in names]


def race_tables(rows: Sequence[Row]) -> list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]]:
    """Tables of a race: errors and rates by mesh, seconds to an error by family."""
    out: list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]] = []
    for kind, group in groupby(rows, key=lambda row: row.mesh):
        rows_of_mesh = list(group)
        best = {
            id(rows_of_mesh[k])
            for k in pareto([row.seconds for row in rows_of_mesh], [row.error_l2 for row in rows_of_mesh])
        }
        table: list[tuple[Any, ...]] = []
        for name, rows_of_scheme in by_scheme(rows_of_mesh):
            orders, slopes = [float("nan"), *rates(rows_of_scheme)], [float("nan"), *rates(rows_of_scheme, "error_h1")]
            for row, l2, h1 in zip(rows_of_scheme, orders, slopes, strict=True):
                front = "*" if id(row) in best else ""
                table.append(
                    (
                        *(name, f"{row.per_horizon:.3g}", f"{row.bonds / row.nodes:.0f}", row.steps),
                        *(row.error_l2, l2, row.interpolation, row.error_h1, h1, row.error_velocity, row.time_error),
                        *(row.seconds_setup, row.seconds_steps, front),
                    )
                )
        columns = (
            *(
                "scheme",
                "eps/h",
                "bonds a node",
                "steps",
                "L2 error",
                "rate",
                "interpolation",
                "H1 error",
                "rate",
                "velocity",
            ),
            *("of it time", "set-up s", "steps s", "front"),
        )
        out.append((f"{kind} meshes: errors at the end, relative", columns, table))
        out.append((f"{kind} meshes: seconds to an error", *reach_table(rows_of_mesh)))
    return out


def reach_table(rows: Sequence[Row]) -> tuple[tuple[str, ...], list[tuple[Any, ...]]]:
    """Seconds to each target: classical pairs, the best other pairs, the best ball, and how many times cheaper."""
    table: list[tuple[Any, ...]] = []
    costs: dict[str, Callable[[Row], float]] = {
        "steps": lambda row: row.seconds_steps,
        "set-up and steps": lambda row: row.seconds,
    }
    for heading, cost in costs.items():
        for target in TARGETS[rows[0].dim]:
            best: dict[str, tuple[float, str]] = {}
            for name, rows_of_scheme in by_scheme(rows):
                seconds = seconds_to(rows_of_scheme, target, cost)
                family = rows_of_scheme[0].family
                if np.isfinite(seconds) and seconds < best.get(family, (np.inf, ""))[0]:
                    best[family] = seconds, name
            classical, pairs, ball = (best.get(family, (_NOT, "-")) for family in ("classical", "pairs", "ball"))
            others = [seconds for family, (seconds, _) in best.items() if family != "classical"]
            gain = best["classical"][0] / min(others) if others and "classical" in best else float("nan")
            table.append((heading, f"{target:g}", classical[0], *pairs, *ball, gain))
    columns = ("seconds of", "error", "classical", "pairs", "which", "ball", "which", "times cheaper")
    return columns, table


def plot_levels(path: Path, levels: Sequence[Level], title: str) -> None:
    """Draw the estimated errors of a scene on its meshes against seconds, log-log."""
    figure = new_figure(6.4, 4.8)
    axes = figure.subplots()
    seconds, error = [level.seconds for level in levels], [level.error for level in levels]
    axes.loglog(error, seconds, "o-", ms=5, lw=1.3)
    for level in levels:
        text = f"{level.nodes:,} vertices\n{level.seconds:.3g} s, {level.error:.1e}"
        axes.annotate(text, (level.error, level.seconds), (8, -4), textcoords="offset points", fontsize=9)
    axes.set_xlabel("estimated relative L2 error of u")
    axes.set_ylabel("seconds, set-up and steps")
    axes.set_xlim(max(error) * 1.6, min(error) / 5.0)
    axes.set_ylim(min(seconds) / 1.6, max(seconds) * 1.6)
    axes.grid(True, which="both", alpha=0.3)
    axes.set_title(title, fontsize=10, wrap=True)
    save(figure, path)


def plot_work_precision(path: Path, rows: Sequence[Row], title: str) -> None:
    """Draw error against seconds, log-log, a panel for each mesh, a line for each scheme; the Pareto front in black."""
    import matplotlib

    from ...study.rates import pareto

    kinds = list(dict.fromkeys(row.mesh for row in rows))
    names = list(dict.fromkeys(row.scheme for row in rows))
    figure = new_figure(4.6 * len(kinds) + 0.5, 4.6 + 0.19 * len(names))
    panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    shapes = {"classical": "s", "pairs": "o", "ball": "^"}
    for axes, kind in zip(panels, kinds, strict=True):
        rows_of_mesh = [row for row in rows if row.mesh == kind]
        for k, name in enumerate(names):
            rows_of_scheme = sorted((row for row in rows_of_mesh if row.scheme == name), key=lambda row: row.n)
            if not rows_of_scheme:
                continue
            error, seconds = [row.error_l2 for row in rows_of_scheme], [row.seconds for row in rows_of_scheme]
            label = name
            if len(rows_of_scheme) > 1:
                label += (
                    f" (rate {np.log(error[-2] / error[-1]) / np.log(rows_of_scheme[-1].n / rows_of_scheme[-2].n):.1f})"
                )
            colour = matplotlib.colormaps["tab20"](k % 20)
            axes.loglog(error, seconds, f"{shapes[rows_of_scheme[0].family]}-", color=colour, ms=4, lw=1.2, label=label)
        front = [
            rows_of_mesh[k]
            for k in pareto([row.seconds for row in rows_of_mesh], [row.error_l2 for row in rows_of_mesh])
        ]
        axes.loglog(
            [row.error_l2 for row in front],
            [row.seconds for row in front],
            "k*",
            ms=9,
            mfc="none",
            label="Pareto front",
        )
        axes.set_title(f"{kind} meshes", fontsize=10)
        axes.set_xlabel("relative L2 error of u")
        axes.invert_xaxis()
        axes.grid(True, which="major", alpha=0.3)
        axes.legend(fontsize=6.2, loc="upper center", bbox_to_anchor=(0.5, -0.14), frameon=False)
    panels[0].set_ylabel("seconds, set-up and steps")
    figure.suptitle(title, fontsize=11)
    save(figure, path)
