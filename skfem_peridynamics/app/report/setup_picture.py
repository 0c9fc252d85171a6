"""The set-up of a run as a drawing: outline, slits, materials, loads, supports, no-fail regions, probes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..._types import Floats, Ints, Longs, Mesh
from ..problem.domain import tag, vertices
from ..scene.formula import Formula
from ..scene.scene import LoadTable, Scene, Where
from .body_pictures import draw_box, inner_faces
from .figure import new_figure, own_style, save

_WIDE = 6.0  # inches
_MARKS = 400  # of a set at most: beyond they run into each other
_ARROW = 0.12  # of the body's extent


@dataclass(frozen=True, eq=False)
class SetUp:
    """What is drawn of a scene on its mesh: sets of vertices with their names and marks, facets (dim, n) of its rim
    and of its slits.
    """

    scene: Scene
    mesh: Mesh
    sets: list[tuple[str, Longs, dict[str, Any]]]
    rim: Ints
    slit: Ints

    @classmethod
    def of(cls, scene: Scene, mesh: Mesh) -> SetUp:
        """Look for what a scene says; slits and named groups are in the mesh."""
        rim, slit = (mesh.facets[:, facets] for facets in (mesh.boundary_facets(), inner_faces(mesh)))
        return cls(scene, mesh, list(_sets(scene, mesh)), rim, slit)


def plot_setup(path: Path, setup: SetUp, *, phone: bool = False) -> None:
    """Draw a set-up; for a ``phone`` with larger letters."""
    with own_style(phone):
        _plot(path, setup, 1 if phone else 2)


def _plot(path: Path, setup: SetUp, columns: int) -> None:
    from matplotlib.ticker import MaxNLocator

    scene, mesh = setup.scene, setup.mesh
    dim = int(mesh.dim())
    factor, unit = scene.units.reading("length", float(np.abs(mesh.p).max()))
    p = factor * mesh.p
    extent = np.ptp(p, axis=1)
    flat = np.zeros((2, p.shape[1]))
    flat[: min(dim, 2)] = p[:2]
    high = _WIDE * float(extent[1] / extent[0]) if dim > 1 else 0.6
    figure = new_figure(_WIDE + 0.6, min(max(high, 1.0), 8.0) + 1.5) if dim < 3 else new_figure(6.6, 5.4)
    axes = figure.add_subplot(projection="3d") if dim == 3 else figure.add_subplot()
    places = p if dim == 3 else flat
    _body(axes, setup, places)
    for name, chosen, style in setup.sets:
        some = chosen[:: max(1, len(chosen) // _MARKS)]
        axes.plot(*places[:, some], linestyle="none", label=name, **style)
    if dim < 3:
        acted = [chosen for name, chosen, _ in setup.sets if name.startswith("traction")]
        for table in scene.load:
            on = np.arange(mesh.nvertices) if table.on is None else acted.pop(0)
            _arrow(axes, scene.time.until * np.linspace(0.0, 1.0, 5), table, mesh, on, places, float(extent.max()))
    for k, probe in enumerate(scene.probe):
        at = np.zeros(len(places))
        at[: len(probe.at)] = factor * np.asarray(probe.at)
        axes.plot(*at[:, None], "D", color="tab:green", ms=6, label=f"probe {probe.name or k}")
    if dim == 3:
        axes.set_box_aspect(extent / extent.max(), zoom=0.9)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_major_locator(MaxNLocator(2))
            axis.set_tick_params(labelsize="x-small")
        axes.set_zlabel(f"z in {unit}" if unit else "z")
    axes.set_xlabel(f"x in {unit}" if unit else "x")
    if dim > 1:
        axes.set_ylabel(f"y in {unit}" if unit else "y")
        if dim == 2:
            axes.set_aspect("equal")
    else:
        axes.set_yticks([])
        axes.set_ylim(-1.0, 1.0)
    if dim < 3:
        axes.spines[:].set_visible(False)
    if axes.get_legend_handles_labels()[1]:
        figure.legend(loc="outside lower center", ncols=columns, frameon=False, fontsize="small")
    save(figure, path)


def _body(axes: Any, setup: SetUp, p: Floats) -> None:
    """Outline, slits and materials."""
    scene, mesh = setup.scene, setup.mesh
    dim = int(mesh.dim())
    if dim == 1:
        axes.plot(p[0], p[1], color="0.3", linewidth=6, solid_capstyle="butt", alpha=0.5)
        return
    names = [tag(table, k) for k, table in enumerate(scene.inclusion)]
    if dim == 2:
        from matplotlib.collections import LineCollection

        axes.tripcolor(
            p[0], p[1], mesh.t.T, np.zeros(mesh.nelements), cmap="Greys", vmin=-0.1, vmax=1.0, rasterized=True
        )
        for k, name in enumerate(names):
            which = mesh.t[:, (mesh.subdomains or {})[name]]
            colour = f"C{k + 4}"
            one = {"cmap": _one_colour(colour), "shading": "gouraud", "rasterized": True}
            axes.tripcolor(p[0], p[1], which.T, np.zeros(mesh.nvertices), **one).set_in_layout(False)
            axes.fill([], [], color=colour, alpha=0.6, label=f"material {name}")
        for facets, colour, width in ((setup.rim, "0.3", 0.8), (setup.slit, "k", 2.4)):
            ends: Any = np.moveaxis(p[:, facets], 0, 2).swapaxes(0, 1)
            axes.add_collection(LineCollection(ends, color=colour, lw=width))
        if setup.slit.size:
            axes.plot([], [], color="k", lw=2.4, label="slit")
        return
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    draw_box(axes, p.min(axis=1), p.max(axis=1))
    if setup.slit.size:
        faces = np.moveaxis(p[:, setup.slit], 0, 2).swapaxes(0, 1)
        axes.add_collection3d(Poly3DCollection(faces, facecolor="0.3", edgecolor="none", alpha=0.7))
        axes.plot([], [], [], color="0.3", lw=5, label="slit")


def _one_colour(colour: str) -> Any:
    from matplotlib.colors import ListedColormap, to_rgba

    return ListedColormap([(*to_rgba(colour)[:3], 0.6)])


def _sets(scene: Scene, mesh: Mesh) -> Iterator[tuple[str, Longs, dict[str, Any]]]:
    """Names of sets of vertices, the vertices, and how they are marked."""
    for k, no_fail in enumerate(scene.no_fail):
        yield (
            f"no-fail {_where(no_fail)}",
            vertices(mesh, no_fail, f"no_fail[{k}]"),
            {"marker": "x", "color": "0.55", "ms": 4},
        )
    for k, held in enumerate(scene.fixed):
        motion = held.displacement if held.displacement is not None else held.velocity
        assert motion is not None
        how = "velocity" if held.displacement is None else "displacement"
        said = "held" if _told(motion) == "0" else f"{how} {_told(motion)}"
        component = "" if held.component == "all" else f", {held.component}"
        style = {"marker": "s", "color": f"C{k % 3}", "ms": 4, "markerfacecolor": "none"}
        yield f"{said}{component}: {_where(held)}", vertices(mesh, held, f"fixed[{k}]"), style
    for k, load in enumerate(scene.load):
        if load.on is not None:
            chosen = vertices(mesh, Where(on=load.on, width=load.layer), f"load[{k}]")
            text = ", ".join(_told(entry) for entry in load.traction or ())
            yield f"traction ({text}) on {load.on}", chosen, {"marker": ".", "color": "tab:red", "ms": 4}


def _told(formula: Formula) -> str:
    """A number as it is read, a formula as it is."""
    try:
        return f"{float(formula.text):g}"
    except ValueError:
        return str(formula.text)


def _where(table: Where) -> str:
    if table.on is not None:
        return table.on
    return f"region {table.region}" if table.region is not None else "where a formula says"


def _arrow(axes: Any, times: Floats, table: LoadTable, mesh: Mesh, chosen: Longs, p: Floats, extent: float) -> None:
    """An arrow along the mean of a load, in the midst of where it acts, at the time when it is the largest of some."""
    vector = table.body if table.body is not None else table.traction
    assert vector is not None
    x = mesh.p[:, chosen]
    means = np.array([[float(np.mean(np.broadcast_to(f(x, t), x.shape[1:]))) for f in vector] for t in times])
    mean = np.zeros(2)
    mean[: min(2, len(vector))] = means[np.linalg.norm(means, axis=1).argmax()][:2]
    size = float(np.linalg.norm(mean))
    if size > 0.0:
        middle, step = p[:2, chosen].mean(axis=1), _ARROW * extent * mean / size
        axes.annotate("", middle + step, middle, arrowprops={"arrowstyle": "-|>", "color": "tab:red", "lw": 2.5})
        axes.plot(*(middle + 1.1 * step), alpha=0.0)  # so that it is within the axes
