"""Pictures of the history: energies, the crack and the speed of its tip, and what else was measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._types import Floats
from ..analysis.crack import WINDOW, speeds
from .plot import new_figure, save
from .units import UnitsTable

History = Mapping[str, Floats]


def plot_energies(path: Path, history: History, title: str, units: UnitsTable, dim: int) -> None:
    """Draw kinetic, elastic and total energy, external work, and what bonds have taken with them over time."""
    figure = new_figure(7, 4.2)
    axes = figure.add_subplot()
    names = {
        "kinetic": ("kinetic", "-"),
        "intact": ("elastic, intact bonds", "-"),
        "softened": ("elastic, softened bonds", "-"),
        "dissipated": ("of broken bonds", "-"),
        "total": ("total", "k-"),
        "work": ("external work", "k:"),
    }
    for name, (label, style) in names.items():
        if name in history:
            axes.plot(history["t"], history[name], style, label=label, linewidth=1.5)
    axes.set_xlabel(_time(units))
    axes.set_ylabel(_in("energy", units.of("energy", dim)))
    axes.set_title(title, parse_math=False)
    axes.legend(frameon=False)
    _plain(axes)
    save(figure, path)


def plot_crack(path: Path, history: History, speed: float | None, units: UnitsTable) -> None:
    """Draw length, reach and area of the crack, and the speed of its tip against the Rayleigh ``speed``."""
    figure = new_figure(9, 3.8)
    left, right = figure.subplots(1, 2)
    t = history["t"]
    left.plot(t, history["crack_reach"], label="way of the first tip")
    left.plot(t, history["crack_length"], label="all branches")
    left.plot(t, history["crack_area"], ":", label="by the bonds it has cut")
    left.set_ylabel(_in("crack length", units.length))
    left.legend(frameon=False, fontsize=8)
    right.plot(t, speeds(t, history["crack_reach"], WINDOW), color="tab:red", label="tip")
    if speed is not None:
        right.axhline(speed, color="0.3", linestyle="--", linewidth=1, label="Rayleigh speed")
    right.set_ylabel(_in("tip speed", units.of("velocity")))
    right.set_ylim(bottom=0.0)
    right.legend(frameon=False, fontsize=8)
    for axes in (left, right):
        axes.set_xlabel(_time(units))
        _plain(axes)
    save(figure, path)


def groups(history: History) -> dict[str, list[str]]:
    """Return the columns of reactions, probes and J by what they are of, in the order of their names.

    >>> groups({"t": np.zeros(1), "reaction_top_x": np.zeros(1), "reaction_top_y": np.zeros(1)})
    {'reaction at top': ['reaction_top_x', 'reaction_top_y']}
    """
    found: dict[str, list[str]] = {}
    for name in history:
        kind, _, rest = name.partition("_")
        what = rest.rpartition("_")
        if kind == "reaction":
            found.setdefault(f"reaction at {what[0]}", []).append(name)
        elif kind == "probe":
            label = "displacement" if what[2].startswith("u") else "velocity"
            found.setdefault(f"{label} at {what[0]}", []).append(name)
        elif name == "j_integral":
            found["J"] = [name]
    return found


def plot_measures(path: Path, history: History, toughness: float | None, units: UnitsTable, dim: int) -> None:
    """Draw reactions, probes and the J-integral over time, a panel each; J against the ``toughness``."""
    panels = groups(history)
    rows = (len(panels) + 1) // 2
    figure = new_figure(9, 3.0 * rows + 0.2)
    every = figure.subplots(rows, 2, squeeze=False).ravel()
    t = history["t"]
    for axes, (what, names) in zip(every, panels.items(), strict=False):
        for name in names:
            label = name.rpartition("_")[2].lstrip("uv") if what != "J" else "J"
            axes.plot(t, history[name], label=label, linewidth=1.4)
        quantity = "toughness" if what == "J" else {"reaction": "force"}.get(what.split()[0], what.split()[0])
        if what == "J" and toughness is not None:
            axes.axhline(toughness, color="0.3", linestyle="--", linewidth=1, label="G_c")
        axes.set_ylabel(_in(what, units.of(quantity, dim)), fontsize=8, parse_math=False)
        axes.set_xlabel(_time(units), fontsize=8)
        axes.tick_params(labelsize=7)
        axes.legend(frameon=False, fontsize=8)
        _plain(axes)
    for axes in every[len(panels) :]:
        axes.set_axis_off()
    save(figure, path)


def _in(what: str, unit: str) -> str:
    return what if any(word in unit for word in ("length", "force", "time")) else f"{what} in {unit}"


def _time(units: UnitsTable) -> str:
    return "t" if units.time == "time" else f"t in {units.time}"


def _plain(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
