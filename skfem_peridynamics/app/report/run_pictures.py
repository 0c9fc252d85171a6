"""Which pictures a run gets, and under which names: drawn by the run itself, and again from its files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..files.results import Results, Snapshot
from ..scene.reading import SceneError
from ..scene.shown import named
from .body_pictures import plot_course, plot_damage
from .deformed_pictures import animate, plot_deformed, plot_stress
from .figure import own_style
from .headline import known
from .history_pictures import groups, plot_crack, plot_energies, plot_measures

_COURSE = 4  # times shown side by side


def draw(
    results: Results,
    out: Path | None = None,
    last: Snapshot | None = None,
    *,
    course: bool = False,
    phone: bool = False,
) -> list[str]:
    """Draw what there is to be drawn of a run into a folder (its own); return the names.

    ``last`` is its last state, by default the last frame. The ``course`` takes several frames, and what only frames
    have; for a ``phone`` letters are larger.
    """
    with own_style(phone):
        return _drawn(results, results.folder if out is None else out, last, course)


def _drawn(results: Results, out: Path, last: Snapshot | None, course: bool) -> list[str]:
    units, history, title = results.units, results.history, results.title
    last = results.last if last is None else last
    dim = 2 if last is None else int(last.mesh.dim())
    names = []
    if last is not None:
        plot_damage(out / "damage.png", last, title, units)
        names.append("damage.png")
        if course and dim == 2:
            tips = [history.get(name, np.array([np.nan]))[-1] for name in ("tip_x", "tip_y")]
            plot_deformed(out / "deformed.png", last, (float(tips[0]), float(tips[1])), units)
            names.append("deformed.png")
    if course and dim == 2 and results.last is not None and "stress" in results.last.fields:
        plot_stress(out / "stress.png", results.last, units)
        names.append("stress.png")
    chosen = _spread(len(results.frames)) if course else []
    if dim == 2 and len(chosen) > 1:
        plot_course(out / "course.png", [results.snapshot(k) for k in chosen], units)
        names.append("course.png")
    if len(history.get("t", ())) > 1:
        plot_energies(out / "energies.png", history, title, units, dim)
        names.append("energies.png")
        if "crack_reach" in history and history["crack_reach"].max() > 0.0:
            plot_crack(out / "crack.png", history, known(results, "rayleigh_speed"), units)
            names.append("crack.png")
        if groups(history):
            plot_measures(out / "measures.png", history, known(results, "toughness"), units, dim)
            names.append("measures.png")
    return names


def _spread(count: int) -> list[int]:
    """Frames spread over a run; the first shows nothing yet."""
    return (
        [round(k * (count - 1) / _COURSE) for k in range(1, _COURSE + 1)] if count > _COURSE else list(range(1, count))
    )


@own_style()
def draw_animation(results: Results) -> str:
    """Write ``animation.gif`` from the frames; return its name. Raises :class:`SceneError` where there are none."""
    if len(results.frames) < 2:
        raise SceneError(f"{named(results.folder)} has {len(results.frames)} frames; an animation needs two or more")
    bodies = [results.snapshot(k) for k in range(len(results.frames))]
    if bodies[0].mesh.dim() != 2:
        raise SceneError(f"the run in {named(results.folder)} is in {bodies[0].mesh.dim()}D; animations are of 2D")
    animate(results.folder / "animation.gif", bodies, results.title, results.units)
    return "animation.gif"
