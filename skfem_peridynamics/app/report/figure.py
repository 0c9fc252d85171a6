"""Pictures by matplotlib, loaded where one is drawn: what all share, and those of studies."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files.whole_files import aside, open_new

if TYPE_CHECKING:
    from ...stability.verdicts import Curve
    from ...study.measure import Row


def available() -> bool:
    """Return whether matplotlib is installed, without importing it."""
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def new_figure(width: float, height: float) -> Any:
    """Return a figure of so many inches that needs no display."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plot_work_precision(path: Path, rows: Sequence[Row], title: str) -> None:
    """Draw error against seconds, log-log, a panel for each mesh, a line for each scheme; the Pareto front in black."""
    import matplotlib

    from ...study.measure import pareto

    kinds = list(dict.fromkeys(row.mesh for row in rows))
    names = list(dict.fromkeys(row.scheme for row in rows))
    figure = new_figure(4.6 * len(kinds) + 0.5, 4.6 + 0.19 * len(names))
    panels = figure.subplots(1, len(kinds), sharey=True, squeeze=False)[0]
    shapes = {"classical": "s", "pairs": "o", "ball": "^"}
    for axes, kind in zip(panels, kinds, strict=True):
        some = [row for row in rows if row.mesh == kind]
        for k, name in enumerate(names):
            mine = sorted((row for row in some if row.scheme == name), key=lambda row: row.n)
            if not mine:
                continue
            error, seconds = [row.error_l2 for row in mine], [row.seconds for row in mine]
            label = name
            if len(mine) > 1:
                label += f" (rate {np.log(error[-2] / error[-1]) / np.log(mine[-1].n / mine[-2].n):.1f})"
            colour = matplotlib.colormaps["tab20"](k % 20)
            axes.loglog(error, seconds, f"{shapes[mine[0].family]}-", color=colour, ms=4, lw=1.2, label=label)
        front = [some[k] for k in pareto([row.seconds for row in some], [row.error_l2 for row in some])]
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


def save(figure: Any, path: Path) -> None:
    """Write a figure as PNG, aside and renamed."""
    with aside(path) as part, open_new(part) as file, warnings.catch_warnings():
        # a title may use letters that the font lacks: boxes are drawn for them
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(file, format="png")
