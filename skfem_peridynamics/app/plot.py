"""Pictures of a run: damage on the body, energies over time."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .._types import Basis, Floats
from .files import aside, open_new
from .output import History

if TYPE_CHECKING:
    from ..analysis.study import Row
    from ..stability.book import Curve

# fraction of softened bonds: pale where a point is whole, dark where nothing holds it
_COLOURS = "magma_r"


def available() -> bool:
    """Return whether matplotlib is installed, without importing it."""
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def plot_damage(path: Path, basis: Basis, u: Floats, intact: Floats, title: str) -> None:
    """Draw the fraction of softened bonds on the body: a curve in 1D, a map in 2D, the damaged vertices in 3D."""
    mesh = basis.mesh
    dim, p, broken = mesh.dim(), mesh.p, 1.0 - intact
    if dim == 1:
        figure = _figure(7, 4)
        axes = figure.add_subplot()
        order = np.argsort(p[0], kind="stable")
        axes.plot(p[0][order], u[order], color="tab:blue")
        axes.set_xlabel("x")
        axes.set_ylabel("displacement", color="tab:blue")
        other = axes.twinx()
        other.fill_between(p[0][order], broken[order], color="tab:red", alpha=0.4, linewidth=0)
        other.set_ylabel("softened bonds, fraction", color="tab:red")
        other.set_ylim(0, 1)
    elif dim == 2:
        wide, high = np.ptp(p, axis=1)
        scale = 8.0 / max(wide, high)
        figure = _figure(max(3.5, scale * wide) + 1.2, max(2.0, scale * high) + 0.8)
        axes = figure.add_subplot()
        shades = axes.tripcolor(
            p[0], p[1], mesh.t.T, broken, shading="gouraud", cmap=_COLOURS, vmin=0, vmax=1, rasterized=True
        )
        cracks = (mesh.boundaries or {}).get("slit", ())
        axes.plot(*p[:, mesh.facets[:, cracks]], color="k", linewidth=1.2)
        axes.set_aspect("equal")
        axes.set_xlabel("x")
        axes.set_ylabel("y")
        figure.colorbar(shades, ax=axes, label="softened bonds, fraction", shrink=0.8)
    else:
        from matplotlib.ticker import MaxNLocator
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        figure = _figure(8, 5)
        axes = figure.add_subplot(projection="3d")
        low, high = p.min(axis=1), p.max(axis=1)
        for axis in range(3):
            others = [k for k in range(3) if k != axis]
            for corner in np.ndindex(2, 2):
                line = np.empty((3, 2))
                line[axis] = low[axis], high[axis]
                for k, side in zip(others, corner, strict=True):
                    line[k] = (low[k], high[k])[side]
                axes.plot(*line, color="0.7", linewidth=0.8)
        cracks = mesh.facets[:, (mesh.boundaries or {}).get("slit", ())]
        axes.add_collection3d(
            Poly3DCollection(
                np.moveaxis(p[:, cracks], 0, 2).swapaxes(0, 1), facecolor="0.8", edgecolor="0.4", linewidth=0.2
            )
        )
        hurt = np.flatnonzero(broken > 0.05)
        shades = axes.scatter(*p[:, hurt], c=broken[hurt], cmap=_COLOURS, vmin=0, vmax=1, s=6, linewidths=0)
        axes.set_box_aspect((high - low) / (high - low).max(), zoom=1.1)
        axes.grid(False)
        for one in (axes.xaxis, axes.yaxis, axes.zaxis):
            one.set_pane_color((1, 1, 1, 0))
            one.set_major_locator(MaxNLocator(3))
        axes.set_xlabel("x")
        axes.set_ylabel("y")
        axes.set_zlabel("z")
        figure.colorbar(shades, ax=axes, label="softened bonds, fraction", shrink=0.6)
    axes.set_title(title, parse_math=False)
    _save(figure, path)


def plot_work_precision(path: Path, rows: Sequence[Row], title: str) -> None:
    """Draw error against seconds, log-log, a panel for each mesh, a line for each scheme; the Pareto front in black."""
    import matplotlib

    from ..analysis.study import pareto

    kinds = list(dict.fromkeys(row.mesh for row in rows))
    names = list(dict.fromkeys(row.scheme for row in rows))
    figure = _figure(4.6 * len(kinds) + 0.5, 4.6 + 0.19 * len(names))
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
    _save(figure, path)


def plot_energies(path: Path, history: History, title: str) -> None:
    """Draw kinetic, elastic and total energy, external work, and the energy of softened bonds over time."""
    figure = _figure(7, 4.2)
    axes = figure.add_subplot()
    t = history.column("t")
    for name, style in (
        ("kinetic", "-"),
        ("intact", "-"),
        ("softened", "-"),
        ("total", "k-"),
        ("work", "k:"),
    ):
        label = {
            "intact": "elastic, intact bonds",
            "softened": "elastic, softened bonds",
            "work": "external work",
        }
        axes.plot(t, history.column(name), style, label=label.get(name, name), linewidth=1.5)
    axes.set_xlabel("t")
    axes.set_ylabel("energy")
    axes.set_title(title, parse_math=False)
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    _save(figure, path)


def plot_curves(path: Path, curves: Sequence[Curve]) -> None:
    """Draw the lines of one picture of the stability report."""
    figure = _figure(8, 4.8)
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
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    with aside(path) as part, open_new(part) as file, warnings.catch_warnings():
        # a title may use letters that the font lacks: boxes are drawn for them
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        figure.savefig(file, format="png")
