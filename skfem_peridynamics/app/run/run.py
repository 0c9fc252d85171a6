"""Run a scene into a folder, or go on with a run that was stopped."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..._clock import Clock
from ...model.breaking import Breaking
from ...solve.instability import UnstableRun, Watch
from ...solve.newton import NotConverged
from ..files import checkpoint
from ..files.checkpoint import Checkpoint
from ..files.frames import files_of_runs
from ..files.history import write_summary
from ..files.identity import identity
from ..files.results import Results, Snapshot
from ..files.whole_files import OutputError, check_name, hold, make_folder
from ..problem.measures import Measure, measures
from ..problem.problem import Problem
from ..problem.states import remarks, states
from ..report import figure
from ..report.run_page import pictures_of, write_report
from ..report.run_pictures import draw
from ..scene.formula import FormulaError
from ..scene.reading import Mistakes, SceneError
from ..scene.scene import Scene
from ..scene.shown import named
from .finished import FinishedRun
from .logged import logged_warnings
from .progress import Progress, Silent, shown
from .record import Record
from .resume import earlier_run, restore
from .signals import Signals
from .summary import summary_after, summary_before

_log = logging.getLogger("skfem_peridynamics")
_CHECKED = 100  # steps between two checks of the energy balance


def run(
    scene: Scene,
    out: str | Path,
    progress: Progress | bool | None = None,
    *,
    with_estimate: bool = False,
    resume: bool | None = None,
    with_report: bool = False,
    problem: Problem | None = None,
) -> FinishedRun:
    """Run a scene, write its files into a folder and return the summary.

    Everything the scene says is checked before the folder is made. The files: ``frame_*.vtu`` and ``frames.pvd``,
    ``history.csv``, ``damage.png`` and ``energies.png``, and last ``summary.json``; while it goes on also
    checkpoints. What an unfinished run left there under these names is removed first, unless that is more than a
    minute of this very run. A finished run of this very scene stays as it is and is returned; one of another scene,
    and files of these names that no run has written, are not overwritten unasked. Going on gives the same bytes as
    one run would have; without a checkpoint it starts afresh.

    SIGINT, SIGTERM and SIGHUP, where the host does not handle them, end the run with a checkpoint after the step at
    hand (``Interrupted``, a ``KeyboardInterrupt``).

    Parameters
    ----------
    scene : Scene
        What to run.
    out : str or Path
        The folder.
    progress : Progress or bool, optional
        Hears of each step; silent by default, True shows a bar.
    with_estimate : bool, optional
        Run the scene again on a refined mesh: its error.
    resume : bool, optional
        True goes on with what is there, False starts over, whatever is there; by default what is worth keeping stays.
    with_report : bool, optional
        Write ``report.html`` from the files at the end, also where the run breaks down.
    problem : Problem, optional
        What the scene has been made into, where that has been done already.

    Returns
    -------
    FinishedRun
        A dict of what ``summary.json`` holds: seconds by phase, energy drift, and what came out; with ``history``,
        ``frames``, ``plot()`` and ``report()``.

    Raises
    ------
    SceneError
        For a scene that makes no sense, a folder in use, or a checkpoint of another run.
    OutputError
        For a file that cannot be written.
    UnstableRun
        When the energy balance breaks: the last state whose balance held is then the checkpoint. What was written
        until then stays, and the summary says why the run stopped.

    Examples
    --------
    >>> import tempfile
    >>> scene = Scene.parse('''
    ... mesh = {box = [[0, 1]], divisions = [10]}
    ... material = {young = 1.0, toughness = 1.0, density = 1.0}
    ... bonds = {horizon = 0.2}
    ... initial = {velocity = ["1e-3*x"]}
    ... time = {until = 1.0}
    ... output = {frames = 0, pictures = false}
    ... ''')
    >>> summary = run(scene, tempfile.mkdtemp())
    >>> summary["status"], summary["nodes"], summary["softened_bonds"]
    ('finished', 11, 0)
    """
    out = Path(out)
    check_name(out)
    progress = shown() if progress is True else progress or Silent()
    with contextlib.ExitStack() as stack:
        signals = stack.enter_context(Signals())
        existed = out.is_dir()
        if existed:
            stack.enter_context(hold(out))
        notes = stack.enter_context(logged_warnings())
        notes += getattr(problem, "notes", [])
        pictures = _with_pictures(scene, with_report)
        clock, watch, problem = (
            Clock("setup", "cfl", "steps", "output"),
            Watch(_CHECKED, None),
            problem or Problem(scene),
        )
        with clock.phase("setup"):
            run_identity = identity(scene, problem.mesh)
        earlier = earlier_run(out, run_identity, resume) if existed else None
        if isinstance(earlier, dict):  # the summary of a finished run
            if with_estimate and "error_estimate" not in earlier:
                earlier |= _estimated(problem, clock)
                write_summary(out / "summary.json", earlier)
            if with_report or (with_estimate and (out / "report.html").is_file()):
                write_report(out)
            return FinishedRun(out, earlier)
        if earlier is not None:
            problem = restore(earlier, problem, clock, watch)
        prepared = _prepare(problem, earlier, clock, watch)
        if not existed:
            make_folder(out)
            stack.enter_context(hold(out))
            if found := files_of_runs(out):
                raise SceneError(
                    f"output folder {named(out)} has come to hold {found[0]} meanwhile: another run wrote it"
                )
        if earlier is None:
            checkpoint.remove(out)  # first: it is of no use without the frames that are cleared next
        facts = {
            "run": run_identity,
            "limit": dataclasses.asdict(problem.limit) if problem.explicit else None,
            "resumed": prepared.resumed,
        }
        record = Record(problem, prepared.measured, out, prepared.steps, clock, watch, progress, facts, earlier)
        summary = summary_before(problem, prepared.dt, prepared.steps, prepared.blocks)
        try:
            try:
                _step(prepared, record, signals, clock, progress)
                summary["status"] = "finished"
            except FormulaError as error:  # a load or a motion that is no number at some later time
                summary["status"] = f"stopped: {error}"
                raise SceneError(str(error)) from None
            except BaseException as error:
                summary["status"] = f"stopped: {str(error) or type(error).__name__}"
                raise
            finally:
                record.history.close()
                progress.end()
                summary |= summary_after(record, clock, prepared.resumed)
                _write_summary(out, summary | {"notes": notes, "run": run_identity})
                signals.patient = False
            # the run is whole; what comes now can be made from its files at any time
            signals.when = "after its last step: it is whole, and the command plot draws what is missing"
            checkpoint.remove(out)
            if signals.asked:
                raise signals.stop(signals.when)
            there: list[str] = []
            if pictures:
                with clock.phase("output"):
                    there = draw(_results(record, summary, run_identity["scene"]), last=_snapshot(record))
            of_report = None
            if with_report:
                with clock.phase("output"):
                    of_report = pictures_of(Results.read(out), _snapshot(record), (scene, problem.mesh), there)
            if with_estimate:
                summary |= _estimated(problem, clock)
            if pictures or with_estimate or with_report:
                summary |= summary_after(record, clock, prepared.resumed)
                _write_summary(out, summary | {"notes": notes, "run": run_identity})
        except (UnstableRun, NotConverged):  # a run that has come to an end of its own has something to report
            if with_report:
                write_report(out, pictures_of(Results.read(out), _snapshot(record), (scene, problem.mesh)))
            raise
        if with_report:
            write_report(out, of_report)
        return FinishedRun(out, summary | {"notes": notes, "run": run_identity})


@dataclass(frozen=True, eq=False)
class _Prepared:
    """A problem that is ready to step: all that a scene can get wrong has been looked at."""

    states: Iterator[Any]
    dt: float
    steps: int
    explicit: bool
    blocks: int
    measured: list[Measure]
    resumed: list[int]  # the steps that the run was gone on with


def _with_pictures(scene: Scene, with_report: bool) -> bool:
    """Whether pictures are drawn. Raises :class:`SceneError` where they are asked for and cannot be."""
    if with_report and not figure.available():
        raise SceneError('a report needs matplotlib: install the extra "plot"')
    if scene.output.pictures and not figure.available():
        raise SceneError('output.pictures = true needs matplotlib: install the extra "plot", or set it to false')
    return figure.available() if scene.output.pictures is None else scene.output.pictures


def _prepare(problem: Problem, earlier: Checkpoint | None, clock: Clock, watch: Watch) -> _Prepared:
    """Build what the run needs, from the start of the scene or from a checkpoint."""
    time = problem.scene.time
    with clock.phase("setup"):
        _ = problem.mesh  # what is wrong with it is told once
        needed = ("load", "fixed", "u0", "v0") + (() if time.scheme == "static" else ("mass",))
        mistakes = Mistakes()
        for name in needed:
            with mistakes.noted():
                getattr(problem, name)
        mistakes.tell()
        measured = measures(problem)
        blocks = len(problem.body_at_rest.blocks)
        problem.check_rigid()
    with clock.phase("cfl"):
        if problem.explicit:
            _ = problem.limit
        dt = problem.dt
    steps = round(time.until / dt)
    start = None if earlier is None else earlier.state
    if start is not None and isinstance(problem.body, Breaking):
        try:
            problem.body.recall(start.broken)
        except ValueError as error:
            raise SceneError(f"the checkpoint cannot be gone on with: {error}") from None
    with clock.phase("setup"):
        stepped = problem.states(dt, start, watch) if hasattr(problem, "states") else states(problem, dt, start, watch)
    for remark in remarks(problem):
        _log.warning(remark)
    resumed = []
    if earlier is not None:
        resumed = [*earlier.facts.get("resumed", []), earlier.state.step]
        _log.warning("the run goes on from step %d of %d", earlier.state.step, steps)
    return _Prepared(stepped, dt, steps, problem.explicit, blocks, measured, resumed)


def _step(prepared: _Prepared, record: Record, signals: Signals, clock: Clock, progress: Progress) -> None:
    """Step to the end; a run that is asked to stop, or must, leaves a checkpoint."""
    scene = record.problem.scene
    progress.begin(scene.title, prepared.steps, scene.units.after("energy", int(record.problem.mesh.dim())))
    signals.patient = True
    try:
        with clock.phase("steps"):
            for state in prepared.states:
                # an implicit step may be cut: whole ones are counted, and others written nowhere
                record.take(state, state.step if prepared.explicit else _whole(state.t / prepared.dt))
                if signals.asked:
                    kept = "a checkpoint was written, --resume goes on" if record.save(state) else "nothing was kept"
                    raise signals.stop(f"at step {state.step}; {kept}")
    except (UnstableRun, NotConverged) as error:
        if error.state is not None:
            record.save(error.state)
        raise


def _estimated(problem: Problem, clock: Clock) -> dict[str, Any]:
    from .estimate import estimate

    try:
        with clock.phase("estimate"):
            return estimate(problem)
    except FormulaError as error:  # no number at a place or a time of the refined mesh
        raise SceneError(f"the run is whole, its error is not known: {error}") from None


def _snapshot(record: Record) -> Snapshot | None:
    """The body as it is now, None where it was not stepped."""
    state, problem = record.state, record.problem
    if state is None:
        return None
    u = state.u.reshape(-1, int(problem.mesh.dim()))
    _, hurt = problem.look(state, False, True)
    assert hurt is not None
    return Snapshot(problem.mesh, state.t, {"displacement": u, "intact": hurt.intact})


def _results(record: Record, summary: dict[str, Any], scene: dict[str, Any]) -> Results:
    """What pictures are drawn of, without a way through the files."""
    history = record.history
    known = {"title": record.problem.scene.title, "elastic": summary.get("elastic")}
    return Results(record.out, known, {name: history.column(name) for name in history.columns}, (), scene)


def _write_summary(out: Path, summary: dict[str, Any]) -> None:
    """Write the summary; of a run that has failed already, its failure is what counts."""
    try:
        write_summary(out / "summary.json", summary)
    except OutputError:
        if summary["status"] == "finished":
            raise
        _log.warning("the summary could not be written either")


def _whole(number: float) -> int | None:
    """The integer that a number is, or None."""
    return round(number) if abs(number - round(number)) < 1e-6 else None
