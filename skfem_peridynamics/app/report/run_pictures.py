"""Which pictures a run gets, and under which names: drawn by the run itself, and again from its files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    without: Sequence[str] = (),
) -> list[str]:
    """Draw what there is to be drawn of a run into a folder (its own); return the names.

    ``last`` is its last state, by default the last frame. The ``course`` takes several frames, and what only frames
    have; for a ``phone`` letters are larger. Those ``without`` are not drawn.
    """
    with own_style(phone):
        return _drawn(results, results.folder if out is None else out, last, course, without)


def _drawn(results: Results, out: Path, last: Snapshot | None, course: bool, without: Sequence[str]) -> list[str]:
    units, history, title = results.units, results.history, results.title
    last = results.last if last is None else last
    dim = 2 if last is None else int(last.mesh.dim())
    shots: dict[str, Callable[[Path], None]] = {}
    if last is not None:
        shots["damage.png"] = lambda path: plot_damage(path, last, title, units)
        if course and dim == 2:
            tips = [history.get(name, np.array([np.nan]))[-1] for name in ("tip_x", "tip_y")]
            shots["deformed.png"] = lambda path: plot_deformed(path, last, (float(tips[0]), float(tips[1])), units)
    stressed = results.last if course and dim == 2 else None
    if stressed is not None and "stress" in stressed.fields:
        shots["stress.png"] = lambda path: plot_stress(path, stressed, units)
    chosen = _spread(len(results.frames)) if course else []
    if dim == 2 and len(chosen) > 1:
        shots["course.png"] = lambda path: plot_course(path, [results.snapshot(k) for k in chosen], units)
    if len(history.get("t", ())) > 1:
        shots["energies.png"] = lambda path: plot_energies(path, history, title, units, dim)
        if "crack_reach" in history and history["crack_reach"].max() > 0.0:
            shots["crack.png"] = lambda path: plot_crack(
                path, history, known(results, "rayleigh_speed"), units, moving=not results.is_static
            )
        if groups(history):
            toughness = known(results, "toughness")
            shots["measures.png"] = lambda path: plot_measures(path, history, toughness, units, dim)
    names = [name for name in shots if name not in without]
    for name in names:
        shots[name](out / name)
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
