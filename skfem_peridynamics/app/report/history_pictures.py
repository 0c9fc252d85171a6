"""Pictures of the history: energies, the crack and the speed of its tip, and what else was measured."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..._types import Floats
from ...analysis.crack import WINDOW, speeds
from ..scene.units import UnitsTable
from .figure import new_figure, save

History = Mapping[str, Floats]
_WIDTH = 5.6  # inches: the letters are still read on a phone


def plot_energies(path: Path, history: History, title: str, units: UnitsTable, dim: int) -> None:
    """Draw kinetic, elastic and total energy, external work, and what bonds have taken with them over time."""
    figure = new_figure(_WIDTH, 3.6)
    axes = figure.add_subplot()
    names = {
        "kinetic": ("kinetic", "-"),
        "intact": ("elastic, intact bonds", "-"),
        "softened": ("elastic, softened bonds", "-"),
        "dissipated": ("of broken bonds", "-"),
        "total": ("total", "k-"),
        "work": ("external work", "k:"),
    }
    t, label_of_t = _time(history, units)
    largest = max(float(abs(history[name]).max()) for name in names if name in history)
    factor, unit = units.reading("energy", largest, dim)
    for name, (label, style) in names.items():
        if name in history:
            axes.plot(t, factor * history[name], style, label=label, linewidth=1.5)
    axes.set_xlabel(label_of_t)
    axes.set_ylabel(_in("energy", unit))
    axes.set_title(title, parse_math=False)
    axes.legend(frameon=False, fontsize="small")
    _plain(axes)
    save(figure, path)


def plot_crack(path: Path, history: History, speed: float | None, units: UnitsTable, *, moving: bool = True) -> None:
    """Draw length, reach and area of the crack, and where it is ``moving`` the speed of its tip against ``speed``."""
    figure = new_figure(_WIDTH, 6.2 if moving else 3.3)
    upper, *rest = figure.subplots(2 if moving else 1, 1, squeeze=False).ravel()
    t, label_of_t = _time(history, units)
    shown = {"crack_reach": ("way of the first tip", "-")}
    if "crack_length" in history:
        shown |= {"crack_length": ("all branches", "-"), "crack_area": ("by the bonds it has cut", ":")}
    factor, unit = units.reading("length", max(float(history[name].max()) for name in shown))
    for name, (label, style) in shown.items():
        upper.plot(t, factor * history[name], style, label=label)
    upper.set_ylabel(_in("crack length", unit))
    upper.legend(frameon=False, fontsize="small")
    for lower in rest:
        _plot_speed(lower, t, history, speed, units)
    for axes in (upper, *rest):
        axes.set_xlabel(label_of_t)
        _plain(axes)
    save(figure, path)


def _plot_speed(lower: Any, t: Floats, history: History, speed: float | None, units: UnitsTable) -> None:
    lower.plot(t, speeds(history["t"], history["crack_reach"], WINDOW), color="tab:red", label="tip")
    if speed is not None:
        lower.axhline(speed, color="0.3", linestyle="--", linewidth=1, label="Rayleigh speed")
    lower.set_ylabel(_in("tip speed", units.after("velocity").strip()))
    lower.set_ylim(bottom=0.0)
    lower.legend(frameon=False, fontsize="small")


_PANELS = 24  # of one picture; the history has all columns


def groups(history: History) -> dict[str, list[str]]:
    """Return the columns of reactions, probes and J by what they are of, in the order of their names.

    >>> groups(dict.fromkeys(["t", "reaction_top_x", "reaction_top_y"]))
    {'reaction, top': ['reaction_top_x', 'reaction_top_y']}
    """
    panels: dict[str, list[str]] = {}
    for name in history:
        kind, _, rest = name.partition("_")
        quantity = rest.rpartition("_")
        if kind == "reaction":
            panels.setdefault(f"reaction, {quantity[0]}", []).append(name)
        elif kind == "probe":
            label = "displacement" if quantity[2].startswith("u") else "velocity"
            panels.setdefault(f"{label}, {quantity[0]}", []).append(name)
        elif name == "j_integral":
            panels["J"] = [name]
    return panels


def plot_measures(path: Path, history: History, toughness: float | None, units: UnitsTable, dim: int) -> None:
    """Draw reactions, probes and the J-integral over time, a panel each; J against the ``toughness``."""
    panels = dict(list(groups(history).items())[:_PANELS])
    figure = new_figure(_WIDTH, 2.8 * len(panels) + 0.2)
    every = figure.subplots(len(panels), 1, squeeze=False).ravel()
    t, label_of_t = _time(history, units)
    for axes, (heading, names) in zip(every, panels.items(), strict=True):
        quantity = "J" if heading == "J" else {"reaction": "force"}.get(heading.split(",")[0], heading.split(",")[0])
        factor, unit = units.reading(quantity, max(float(abs(history[name]).max()) for name in names), dim)
        for name in names:
            label = name.rpartition("_")[2].lstrip("uv") if heading != "J" else "J"
            axes.plot(t, factor * history[name], label=label, linewidth=1.4)
        if heading == "J" and toughness is not None:
            axes.axhline(factor * toughness, color="0.3", linestyle="--", linewidth=1, label="G_c")
        axes.set_title(heading, parse_math=False, fontsize="medium")
        axes.set_ylabel(_in(quantity, unit), parse_math=False)
        axes.set_xlabel(label_of_t)
        axes.legend(frameon=False, fontsize="small")
        _plain(axes)
    save(figure, path)


def _in(quantity: str, unit: str) -> str:
    return f"{quantity} in {unit}" if unit else quantity


def _time(history: History, units: UnitsTable) -> tuple[Floats, str]:
    """Times in the unit they are read in, and what to write beside them."""
    factor, unit = units.reading("time", float(history["t"][-1]))
    return factor * history["t"], _in("t", unit)


def _plain(axes: Any) -> None:
    """Ticks that do not meet, and no frame."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.ticklabel_format(style="sci", scilimits=(-3, 5))
    axes.locator_params(axis="x", nbins=6)
