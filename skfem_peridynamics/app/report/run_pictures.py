"""Which pictures a run gets, and under which names: drawn by the run itself, and again from its files."""

from __future__ import annotations

from pathlib import Path

from ..files.results import Results, Snapshot
from ..scene.reading import SceneError
from ..scene.shown import named
from .body_pictures import animate, plot_course, plot_damage
from .figure import own_style
from .headline import known
from .history_pictures import groups, plot_crack, plot_energies, plot_measures

_COURSE = 4  # times shown side by side


@own_style()
def draw(results: Results, out: Path | None = None, last: Snapshot | None = None, *, course: bool = False) -> list[str]:
    """Draw what there is to be drawn of a run into a folder (its own); return the names.

    ``last`` is its last state, by default the last frame; the ``course`` takes several frames.
    """
    out = results.folder if out is None else out
    units, history, title = results.units, results.history, results.title
    last = results.last if last is None else last
    dim = 2 if last is None else int(last.mesh.dim())
    names = []
    if last is not None:
        plot_damage(out / "damage.png", last, title, units)
        names.append("damage.png")
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
