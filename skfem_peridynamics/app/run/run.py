"""Run a scene into a folder, or go on with a run that was stopped."""

from __future__ import annotations

import contextlib
import dataclasses
import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ..._clock import Clock
from ..._memory import peak_memory_mb
from ...analysis.damage import damage
from ...model.breaking import Breaking
from ...model.rigidity import check_rigid
from ...solve.instability import UnstableRun, Watch
from ...solve.newton import NotConverged
from ..files import checkpoint
from ..files.checkpoint import Checkpoint
from ..files.history import write_summary
from ..files.identity import identity
from ..files.results import Results, Snapshot
from ..files.whole_files import OutputError, hold, make_folder
from ..problem.measures import measures
from ..problem.problem import Problem
from ..problem.states import march, notes
from ..report import figure as plot
from ..report.run_page import write_report
from ..report.run_pictures import draw
from ..scene.formula import FormulaError
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene
from .logged import keep_notes
from .progress import Progress, Silent
from .record import Record
from .resume import go_on, look_back
from .signals import Signals
from .summary import first_facts

_log = logging.getLogger("skfem_peridynamics")
_LOOK = 100  # steps between two looks at the energy balance


def run(
    scene: Scene,
    out: str | Path,
    progress: Progress | None = None,
    *,
    with_estimate: bool = False,
    resume: bool | None = None,
    with_report: bool = False,
) -> dict[str, Any]:
    """Run a scene, write its files into ``out`` and return the summary.

    Everything the scene says is checked before the folder is made. The files: ``frame_*.vtu`` and ``frames.pvd``,
    ``history.csv``, ``damage.png`` and ``energies.png``, and last ``summary.json``; while it goes on also checkpoints.
    What an earlier run left there under these names is removed first, unless that is more than a minute of this very
    run, not finished: then say ``resume=True`` to go on with it or ``resume=False`` to start over. Going on gives the
    same bytes as one run would have; without a checkpoint it starts afresh, and what is finished stays as it is.
    ``with_report`` writes ``report.html`` from the files at the end, also where the run breaks down.

    SIGINT, SIGTERM and SIGHUP, where the host does not handle them, end the run with a checkpoint after the step at
    hand (``Interrupted``, a ``KeyboardInterrupt``). Raises :class:`SceneError` for a scene that makes no sense, a
    folder in use, or a checkpoint of another run; ``OutputError`` for a file that cannot be written; ``UnstableRun``
    when the energy balance breaks: the last state whose balance held is then the checkpoint. What was written until
    then stays, and the summary says why the run stopped.
    """
    out = Path(out)
    if "\0" in str(out):
        raise SceneError(f"output folder {str(out)!r} is no name of a folder")
    if out.exists() and not out.is_dir():
        raise SceneError(f"output folder {str(out)!r} exists and is not a folder")
    with contextlib.ExitStack() as stack:
        signals = stack.enter_context(Signals())
        if out.is_dir():
            stack.enter_context(hold(out))
        notes = stack.enter_context(keep_notes())
        if with_report and not plot.available():
            raise SceneError('a report needs matplotlib: install the extra "plot"')
        one = _Run(scene, out, progress or Silent(), signals, stack, notes)
        try:
            return one.go(with_estimate, resume)
        finally:
            if with_report and one.ended:
                write_report(out, one.snapshot())


class _Run:
    stopped: BaseException | None

    def __init__(
        self,
        scene: Scene,
        out: Path,
        progress: Progress,
        signals: Signals,
        stack: contextlib.ExitStack,
        notes: list[str],
    ) -> None:
        self.notes = notes
        self.finished, self.stopped = False, None
        self.scene, self.out, self.progress, self.signals, self.stack = scene, out, progress, signals, stack
        self.clock = Clock("setup", "cfl", "steps", "output")
        self.problem = Problem(scene)
        self.watch = Watch(_LOOK, None)
        self.earlier: Checkpoint | None = None

    def go(self, with_estimate: bool, resume: bool | None) -> dict[str, Any]:
        output, existed = self.scene.output, self.out.is_dir()
        pictures = plot.available() if output.pictures is None else output.pictures
        if pictures and not plot.available():
            raise SceneError('output.pictures = true needs matplotlib: install the extra "plot", or set it to false')
        with self.clock.phase("setup"):
            self.who = identity(self.scene, self.problem.mesh)
        found = look_back(self.out, self.who, resume) if existed else None
        if isinstance(found, dict):
            self.finished = True
            return found
        if found is not None:
            self.earlier = found
            self.problem = go_on(found, self.problem, self.clock, self.watch)
        self._set_up()
        if not existed:
            make_folder(self.out)
            self.stack.enter_context(hold(self.out))
        problem, limit = self.problem, self.limit
        facts = {
            "run": self.who,
            "limit": None if limit is None else dataclasses.asdict(limit),
            "resumed": self.resumed,
        }
        self.record = Record(
            problem, self.measured, self.out, self.steps, self.clock, self.watch, self.progress, facts, self.earlier
        )
        if self.earlier is None:
            checkpoint.remove(self.out)
        summary = first_facts(problem, self.dt, self.steps, self.blocks)
        try:
            self._step()
            if pictures:
                with self.clock.phase("output"):
                    draw(self._results(summary), last=self.snapshot())
            if with_estimate:
                from .estimate import estimate

                with self.clock.phase("estimate"):
                    summary |= estimate(problem)
            summary["status"] = "finished"
            self.finished = True
        except FormulaError as error:  # a load or a motion that is no number at some later time
            summary["status"] = f"stopped: {error}"
            raise SceneError(str(error)) from None
        except BaseException as error:
            self.stopped = error
            summary["status"] = f"stopped: {str(error) or type(error).__name__}"
            raise
        finally:
            self.record.history.close()
            self.progress.end()
            self._close(summary)
        checkpoint.remove(self.out)
        return summary

    def _set_up(self) -> None:
        problem, clock = self.problem, self.clock
        with clock.phase("setup"):
            parts = ("load", "fixed", "u0", "v0") + (() if self.scene.time.scheme == "static" else ("mass",))
            for part in parts:
                getattr(problem, part)
            self.measured = measures(problem)
            self.blocks = len(problem.resting.blocks)
            with blame("bonds"):
                check_rigid(problem.resting)
        with clock.phase("cfl"):
            self.limit, self.dt = problem.limit if problem.explicit else None, problem.dt
        self.steps = round(self.scene.time.until / self.dt)
        start = None if self.earlier is None else self.earlier.state
        if start is not None and isinstance(problem.body, Breaking):
            try:
                problem.body.recall(start.broken)
            except ValueError as error:
                raise SceneError(f"the checkpoint cannot be gone on with: {error}") from None
        with clock.phase("setup"):
            self.states: Iterator[Any] = march(problem, self.dt, start, self.watch)
        for note in notes(problem):
            _log.warning(note)
        self.resumed = []
        if self.earlier is not None and start is not None:
            self.resumed = [*self.earlier.facts.get("resumed", []), start.step]
            _log.warning("the run goes on from step %d of %d", start.step, self.steps)
            self.state = dataclasses.replace(start, _body=problem.body)

    def _step(self) -> None:
        """Step to the end; a run that is asked to stop, or must, leaves a checkpoint."""
        problem, signals, record = self.problem, self.signals, self.record
        self.progress.begin(self.scene.title, self.steps)
        signals.patient = True
        try:
            with self.clock.phase("steps"):
                for state in self.states:
                    self.state = state
                    # an implicit step may be cut: whole ones are counted, and others written nowhere
                    record.take(state, state.step if problem.explicit else _whole(state.t / self.dt))
                    if signals.asked:
                        kept = (
                            "a checkpoint was written, --resume goes on" if record.save(state) else "nothing was kept"
                        )
                        raise signals.stop(f"at step {state.step}; {kept}")
        except (UnstableRun, NotConverged) as error:
            if error.state is not None:
                record.save(error.state)
            raise
        finally:
            signals.patient = False

    @property
    def ended(self) -> bool:
        """Whether there is anything to report: a run that is finished, or has come to an end of its own."""
        return self.finished or isinstance(self.stopped, (UnstableRun, NotConverged))

    def snapshot(self) -> Snapshot | None:
        """The body as it is now, None where it was not stepped."""
        if not hasattr(self, "state"):
            return None
        problem, u = self.problem, self.state.u
        fields = {"displacement": u.reshape(-1, int(problem.mesh.dim())), "intact": damage(problem.body, u).intact}
        return Snapshot(problem.mesh, self.state.t, fields)

    def _results(self, summary: dict[str, Any]) -> Results:
        """What pictures are drawn of, without a way through the files."""
        history = self.record.history
        known = {"title": self.scene.title, "elastic": summary.get("elastic")}
        columns = {name: history.column(name) for name in history.columns}
        return Results(self.out, known, columns, (), self.who["scene"])

    def _close(self, summary: dict[str, Any]) -> None:
        """Write the summary, with the figures of what was done."""
        problem, clock = self.problem, self.clock
        state = getattr(self, "state", None)
        if state is not None:
            effort = problem.effort
            summary["steps"] = state.step
            summary |= self.record.figures()
            if not problem.explicit:
                summary |= {"newton_iterations": effort.iterations, "hessian_products": effort.products}
            limit = self.limit
            summary |= {
                "seconds": {name: round(value, 6) for name, value in clock.seconds.items()},
                "seconds_per_step": clock.seconds["steps"] / max(1, state.step),
                "peak_memory_mb": round(peak_memory_mb(), 1),
                **({"stiffness_products_for_cfl": limit.products} if limit is not None else {}),
                "resumed_at_steps": self.resumed,
                "checkpoints": self.record.checkpoints,
            }
        summary["notes"] = self.notes
        summary["run"] = self.who
        try:
            write_summary(self.out / "summary.json", summary)
        except OutputError:
            if summary["status"] == "finished":
                raise
            _log.warning("the summary could not be written either")


def _whole(number: float) -> int | None:
    """The integer that a number is, or None."""
    return round(number) if abs(number - round(number)) < 1e-6 else None
