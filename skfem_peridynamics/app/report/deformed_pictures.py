"""Pictures of the body on its deformed shape: damage, stress, and both over time as an animation."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from math import floor, log10
from pathlib import Path
from typing import Any

import numpy as np

from ..._types import Floats, Ints
from ...analysis.stress import largest_principal
from ..files.results import Snapshot
from ..files.whole_files import write_whole
from ..scene.units import UnitsTable
from .body_pictures import in_reading, map_of
from .figure import new_figure, save
from .plot import SIX

_SHOWN = 0.05  # of the body's extent: displacements are drawn about so large
_TORN = 1.0  # elements that the picture stretches by more than this are open cracks, and left out
_WIDE = 6.0  # inches


def deformation_scale(body: Snapshot) -> float:
    """Return 1, 2 or 5 times a power of ten, at least 1: by this displacements are seen.

    What has been thrown off is not looked at: the scale goes by 95 % of the vertices.
    """
    u = body.fields["displacement"][:, : body.mesh.dim()]
    size = float(np.quantile(np.linalg.norm(u - u.mean(axis=0), axis=1), 0.95))
    want = _SHOWN * float(np.ptp(body.mesh.p, axis=1).max()) / size if size > 0.0 else 1.0
    if not 1.0 < want < 1e300:
        return 1.0
    unit = 10.0 ** floor(log10(want))
    return float(max(step * unit for step in (1.0, 2.0, 5.0) if step * unit <= want))


def moved(body: Snapshot, scale: float) -> tuple[Floats, Ints]:
    """Return the places of the vertices, (dim, n), and the elements that are no open crack."""
    dim, mesh = int(body.mesh.dim()), body.mesh
    p = mesh.p + scale * body.fields["displacement"][:, :dim].T
    ends = [(i, j) for i in range(dim + 1) for j in range(i)]
    stretch = np.zeros(mesh.nelements)
    for i, j in ends:
        before = np.linalg.norm(mesh.p[:, mesh.t[i]] - mesh.p[:, mesh.t[j]], axis=0)
        after = np.linalg.norm(p[:, mesh.t[i]] - p[:, mesh.t[j]], axis=0)
        stretch = np.maximum(stretch, after / before - 1.0)
    return p, mesh.t[:, stretch <= _TORN]


def plot_deformed(path: Path, body: Snapshot, tip: tuple[float, float] | None, units: UnitsTable) -> None:
    """Draw the damage of a body in 2D, the crack's tip marked, and beside it on the deformed shape."""
    given = body
    body, unit = in_reading(body, units)
    scale = deformation_scale(body)
    figure, panels = _panels(body, 2)
    map_of(panels[0], body)
    panels[0].set_title("as it was", fontsize="medium")
    if tip is not None and np.isfinite(tip).all():
        factor = units.reading("length", float(np.abs(given.mesh.p).max()))[0]
        at = (factor * tip[0], factor * tip[1])
        panels[0].plot(*at, "o", ms=9, mfc="none", mec="tab:blue", mew=1.8)
        left = at[0] > body.mesh.p[0].mean()
        aside = {"ha": "right" if left else "left", "textcoords": "offset points", "color": "tab:blue"}
        panels[0].annotate("tip", at, (-8 if left else 8, 6), **aside)
    shades = colours(panels[1], body, body.broken, scale, cmap="magma_r", vmin=0.0, vmax=1.0)
    panels[1].set_title(f"displacements {scale:g} times", fontsize="medium")
    for axes in panels:
        axes.set_xlabel(f"x in {unit}" if unit else "x")
        axes.set_ylabel(f"y in {unit}" if unit else "y")
    figure.colorbar(shades, ax=panels, label="softened bonds, fraction", shrink=0.8, location="bottom")
    save(figure, path)


def plot_stress(path: Path, body: Snapshot, units: UnitsTable) -> None:
    """Draw the von Mises and the largest principal stress of a body in 2D on its deformed shape."""
    drawn = {"largest principal stress": largest_principal(body.fields["stress"][:, SIX].reshape(-1, 3, 3)[:, :2, :2])}
    if "von_mises" in body.fields:
        drawn = {"von Mises stress": body.fields["von_mises"]} | drawn
    body, _ = in_reading(body, units)
    figure, panels = _panels(body, len(drawn))
    scale = deformation_scale(body)
    for axes, (name, values) in zip(panels, drawn.items(), strict=True):
        # a few vertices at a tip do not take the colours of the rest
        low, high = (float(np.quantile(values, part)) for part in (0.005, 0.995))
        factor, unit = units.reading("stress", max(abs(low), abs(high)))
        shades = colours(axes, body, factor * values, scale, cmap="viridis", vmin=factor * low, vmax=factor * high)
        axes.set_title(name, fontsize="medium")
        axes.set_axis_off()
        figure.colorbar(shades, ax=axes, label=unit or "stress", shrink=0.8, extend="both")
    save(figure, path)


def _panels(body: Snapshot, count: int) -> tuple[Any, list[Any]]:
    wide, high = np.ptp(body.mesh.p, axis=1)
    beside = high > 0.8 * wide
    across = _WIDE / (count if beside else 1)
    tall = across * high / wide
    figure = new_figure(_WIDE + 1.0, (1 if beside else count) * (tall + 0.75) + 0.6)
    return figure, list(figure.subplots(*((1, count) if beside else (count, 1)), squeeze=False).ravel())


def colours(axes: Any, body: Snapshot, values: Floats, scale: float, **options: Any) -> Any:
    """Draw numbers at the vertices of a body in 2D on its deformed shape; return what a colour bar is of."""
    p, t = moved(body, scale)
    shades = axes.tripcolor(p[0], p[1], t.T, values, shading="gouraud", rasterized=True, **options)
    shades.set_in_layout(False)  # it would be made a path a triangle to be measured
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    return shades


def animate(path: Path, bodies: Sequence[Snapshot], title: str, units: UnitsTable, rate: int = 8) -> None:
    """Write the frames of a body in 2D as a GIF, deformed, with time and colours, by matplotlib's own writer."""
    from matplotlib.animation import PillowWriter

    bodies = [in_reading(body, units)[0] for body in bodies]
    scale = min(deformation_scale(body) for body in bodies[1:])
    wide, high = np.ptp(bodies[0].mesh.p, axis=1)
    size = 7.0 / max(wide, high)
    figure = new_figure(max(3.0, size * wide) + 1.4, max(1.6, size * high) + 0.7)
    figure.set_dpi(90)
    axes = figure.add_subplot()
    places = np.concatenate([moved(body, scale)[0] for body in bodies], axis=1)
    low, top = places.min(axis=1), places.max(axis=1)
    writer, bar = PillowWriter(fps=rate), None
    with tempfile.TemporaryDirectory() as room, warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        target = Path(room) / "animation.gif"  # pillow goes by the name
        with writer.saving(figure, str(target), dpi=90):
            for body in bodies:
                axes.clear()
                shades = colours(axes, body, body.broken, scale, cmap="magma_r", vmin=0.0, vmax=1.0)
                axes.set_xlim(low[0], top[0])
                axes.set_ylim(low[1], top[1])
                axes.set_axis_off()
                if bar is None:
                    bar = figure.colorbar(shades, ax=axes, label="softened bonds, fraction", shrink=0.8)
                times = f", displacements {scale:g} times" if scale > 1.0 else ""
                now = f"t = {units.shown('time', body.t)}{times}"
                axes.set_title(f"{title}, {now}", parse_math=False, fontsize="small")
                writer.grab_frame()
        write_whole(path, target.read_bytes())
