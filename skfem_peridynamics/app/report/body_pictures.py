"""Pictures of the body: where its bonds have softened, at one time and at several."""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from pathlib import Path
from typing import Any

import numpy as np

from ..._types import Floats, Longs, Mesh
from ..files.results import Snapshot
from ..scene.units import UnitsTable
from .figure import for_phone, new_figure, save
from .level_surface import level_surface

# fraction of softened bonds: pale where a point is whole, dark where nothing holds it
_COLOURS = "magma_r"
_LABEL = "softened bonds, fraction"
_CRACK = 0.3  # of the bonds gone: the surface drawn in space
_WIDE = 6.0  # inches of the longer side of a body in 2D
_EDGES = 60_000  # beyond which the outline alone would be the picture


def plot_damage(path: Path, body: Snapshot, title: str, units: UnitsTable) -> None:
    """Draw the fraction of softened bonds: a curve in 1D, a map in 2D, the crack's surface and slices in 3D."""
    body, unit = in_reading(body, units)
    dim = body.mesh.dim()
    if dim == 1:
        figure = _line(body, unit)
    elif dim == 2:
        wide, high = np.ptp(body.mesh.p, axis=1)
        scale = _WIDE / max(wide, high)
        figure = new_figure(max(4.0, scale * wide) + 1.4, max(2.0, scale * high) + 0.8)
        axes = figure.add_subplot()
        shades = map_of(axes, body)
        axes.set_xlabel(_axis("x", unit))
        axes.set_ylabel(_axis("y", unit))
        figure.colorbar(shades, ax=axes, label=_LABEL, shrink=0.8)
    else:
        figure = _in_space(body, unit)
    figure.suptitle(title, parse_math=False, fontsize="large")
    save(figure, path)


def in_reading(body: Snapshot, units: UnitsTable) -> tuple[Snapshot, str]:
    """Return a body whose lengths are in the unit that they are read in, and that unit."""
    mesh = body.mesh
    factor, unit = units.reading("length", float(np.abs(mesh.p).max()))
    if factor == 1.0:
        return body, unit
    fields = body.fields | {"displacement": factor * body.fields["displacement"]}
    return Snapshot(type(mesh)(factor * mesh.p, mesh.t), body.t, fields, body.outline), unit


def _axis(name: str, unit: str) -> str:
    return f"{name} in {unit}" if unit else name


def _line(body: Snapshot, unit: str) -> Any:
    figure = new_figure(5.6, 3.6)
    axes = figure.add_subplot()
    p, u = body.mesh.p, body.fields["displacement"][:, 0]
    order = np.argsort(p[0], kind="stable")
    axes.plot(p[0][order], u[order], color="tab:blue")
    axes.set_xlabel(_axis("x", unit))
    axes.set_ylabel(_axis("displacement", unit), color="tab:blue")
    twin = axes.twinx()
    twin.fill_between(p[0][order], body.broken[order], color="tab:red", alpha=0.4, linewidth=0)
    twin.set_ylabel(_LABEL, color="tab:red")
    twin.set_ylim(0, 1)
    return figure


def map_of(axes: Any, body: Snapshot) -> Any:
    """The body in 2D with its outline, the faces of slits among it."""
    from matplotlib.collections import LineCollection

    mesh, p = body.mesh, body.mesh.p
    shades = axes.tripcolor(
        p[0], p[1], mesh.t.T, body.broken, shading="gouraud", cmap=_COLOURS, vmin=0, vmax=1, rasterized=True
    )
    shades.set_in_layout(False)  # it would be made a path a triangle to be measured
    rim = body.outline
    if rim.shape[1] < _EDGES:
        axes.add_collection(LineCollection(np.moveaxis(p[:, rim], 0, 2).swapaxes(0, 1), color="0.25", lw=0.7))
    axes.set_aspect("equal")
    axes.spines[:].set_visible(False)
    low, high = p.min(axis=1), p.max(axis=1)
    margin = 0.02 * (high - low).max()
    axes.set_xlim(low[0] - margin, high[0] + margin)
    axes.set_ylim(low[1] - margin, high[1] + margin)
    return shades


def _corners(mesh: Mesh, facets: Longs) -> Floats:
    """The corners of facets, (nfacets, dim, dim)."""
    return np.asarray(np.moveaxis(mesh.p[:, mesh.facets[:, facets]], 0, 2).swapaxes(0, 1), dtype=float)


def _in_space(body: Snapshot, unit: str) -> Any:
    """The crack's surface in the body's box, and slices through where the damage is."""
    phone = for_phone()
    figure = new_figure(5.0, 9.0) if phone else new_figure(8.4, 4.4)
    upper_or_left = {"height_ratios": (1.0, 1.6)} if phone else {"width_ratios": (1.15, 1.0)}
    left, right = figure.subfigures(*((2, 1) if phone else (1, 2)), **upper_or_left)
    _surface(left.add_subplot(projection="3d"), body, unit)
    p, broken = body.mesh.p, body.broken
    weight = broken * (broken > _CRACK)
    at = (p * weight).sum(axis=1) / weight.sum() if weight.any() else 0.5 * (p.min(axis=1) + p.max(axis=1))
    shades: Any = None
    panels = right.subplots(3, 1)
    for axis, axes in enumerate(panels):
        shades = _slice(axes, body.mesh, broken, axis, float(at[axis]), unit)
    right.colorbar(shades, ax=panels, label=_LABEL, shrink=0.8)
    return figure


def _surface(axes: Any, body: Snapshot, unit: str) -> None:
    from matplotlib import colormaps
    from matplotlib.ticker import MaxNLocator
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    mesh, broken = body.mesh, body.broken
    low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
    draw_box(axes, low, high)
    slit = inner_faces(mesh)
    axes.add_collection3d(Poly3DCollection(_corners(mesh, slit), facecolor="0.85", edgecolor="0.5", linewidth=0.2))
    corners, shade = level_surface(mesh, broken, _CRACK, mesh.p[2])
    if len(corners):
        spread = max(high[2] - low[2], np.finfo(float).tiny)
        colour = colormaps["inferno"](0.25 + 0.5 * (shade.mean(axis=1) - low[2]) / spread)
        axes.add_collection3d(Poly3DCollection(corners, facecolor=colour, edgecolor="none", alpha=0.9))
    axes.set_title(f"{_CRACK:.0%} of the bonds softened", fontsize="small")
    axes.set_box_aspect((high - low) / (high - low).max(), zoom=0.95)
    axes.grid(False)
    for k, (labelled, name) in enumerate(zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True)):
        labelled.set_pane_color((1, 1, 1, 0))
        labelled.set_major_locator(MaxNLocator(2 if for_phone() else 3))
        labelled.set_tick_params(labelsize="x-small")
        labelled.set_label_text(_axis(name, unit))
        (axes.set_xlim, axes.set_ylim, axes.set_zlim)[k](low[k], high[k])


def draw_box(axes: Any, low: Floats, high: Floats) -> None:
    """Draw the edges of a box in space."""
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        for corner in np.ndindex(2, 2):
            line = np.empty((3, 2))
            line[axis] = low[axis], high[axis]
            for k, side in zip(others, corner, strict=True):
                line[k] = (low[k], high[k])[side]
            axes.plot(*line, color="0.7", linewidth=0.8)


def inner_faces(mesh: Mesh) -> Longs:
    """Facets of the boundary that lie on others: the faces of slits."""
    rim = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, rim]].mean(axis=1)
    scale = 1e6 / float(np.ptp(mesh.p, axis=1).max())
    _, which, count = np.unique(np.round(middle * scale), axis=1, return_inverse=True, return_counts=True)
    return np.asarray(rim[count[which.ravel()] > 1], dtype=np.int64)


def _slice(axes: Any, mesh: Mesh, broken: Floats, axis: int, at: float, unit: str) -> Any:
    corners, shade = level_surface(mesh, mesh.p[axis], at, broken)
    across = [k for k in range(3) if k != axis]
    x, y = (corners[:, :, k].ravel() for k in across)
    if len(x):
        shades = axes.tripcolor(
            x, y, np.arange(len(x)).reshape(-1, 3), shade.ravel(), shading="gouraud", cmap=_COLOURS, vmin=0, vmax=1
        )
    else:
        shades = axes.scatter([], [], c=[], cmap=_COLOURS, vmin=0, vmax=1)
    axes.set_aspect("equal")
    axes.set_title(f"{'xyz'[axis]} = {at:.3g}", fontsize="small")
    axes.set_xlabel(_axis("xyz"[across[0]], unit), fontsize="x-small")
    axes.set_ylabel(_axis("xyz"[across[1]], unit), fontsize="x-small")
    axes.tick_params(labelsize="x-small")
    return shades


def plot_course(path: Path, bodies: Sequence[Snapshot], units: UnitsTable) -> None:
    """Draw a body in 2D at several times, side by side."""
    wide, high = np.ptp(bodies[0].mesh.p, axis=1)
    columns = 2 if wide >= high else min(4, len(bodies))
    rows = ceil(len(bodies) / columns)
    each = 7.0 / columns
    figure = new_figure(7.0, rows * (each * high / wide + 0.45))
    for body, axes in zip(bodies, figure.subplots(rows, columns, squeeze=False).ravel(), strict=False):
        map_of(axes, body)
        axes.set_title(f"t = {units.shown('time', body.t)}", fontsize="small")
        axes.set_xticks([])
        axes.set_yticks([])
    for axes in figure.axes[len(bodies) :]:
        axes.set_axis_off()
    save(figure, path)
