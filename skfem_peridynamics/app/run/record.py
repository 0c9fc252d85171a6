"""What a run writes while it goes on: rows, frames and checkpoints, each of states whose energy balance holds."""

from __future__ import annotations

import dataclasses
import logging
import time
from collections.abc import Sequence
from math import ceil, floor
from pathlib import Path
from typing import Any

import numpy as np

from ..._clock import Clock
from ...analysis.damage import Census, Damage
from ...analysis.stress import out_of_plane, strain, voigt, von_mises
from ...material.composite import Composite
from ...solve.energy import Energies
from ...solve.instability import Watch
from ...solve.state import Equilibrium, State
from ..files.checkpoint import Checkpoint, write_checkpoint
from ..files.frames import Frames, clear, frame_name
from ..files.history import History
from ..files.whole_files import OutputError
from ..problem.measures import CrackTrack, Measure
from ..problem.problem import Problem
from ..scene.reading import SceneError
from .progress import Progress

_log = logging.getLogger("skfem_peridynamics")
COLUMNS = (
    "t",
    "step",
    "kinetic",
    "intact",
    "softened",
    "total",
    "work",
    "imbalance",
    "softened_bonds",
    "largest_Z",
)

HISTORY_BEGINS = ",".join(COLUMNS[:6])


def columns(measured: Sequence[Measure]) -> tuple[str, ...]:
    """Return the columns of a history: energies, and what is measured besides."""
    return COLUMNS + tuple(name for measure in measured for name in measure.columns)


class Marks:
    """``count`` steps spread over a run, the first and the last among them: what is in it is counted, not listed.

    >>> marks = Marks(10, 4)
    >>> [step for step in range(11) if step in marks]
    [0, 3, 7, 10]
    """

    def __init__(self, steps: int, count: int) -> None:
        self.steps, self.count = steps, count

    def __contains__(self, step: object) -> bool:
        if not isinstance(step, int) or not 0 <= step <= self.steps or not self.count:
            return False
        if self.count < 2:
            return step == self.steps
        near = step * (self.count - 1) / self.steps
        near_marks = range(max(0, floor(near) - 1), min(self.count - 1, ceil(near) + 1) + 1)
        return self.count > self.steps or any(self.at(k) == step for k in near_marks)

    def at(self, k: int) -> int:
        return round(k * self.steps / (self.count - 1))


class Record:
    """The files of a run, row by row and frame by frame; ``state`` is the last one taken.

    ``earlier`` is the checkpoint that the run goes on from; without one the folder is cleared. ``facts`` are what a
    checkpoint says besides its state.
    """

    def __init__(
        self,
        problem: Problem,
        measured: Sequence[Measure],
        out: Path,
        steps: int,
        clock: Clock,
        watch: Watch,
        progress: Progress,
        facts: dict[str, Any],
        earlier: Checkpoint | None,
    ) -> None:
        self.problem, self.out, self.clock, self.watch, self.progress = problem, out, clock, watch, progress
        self.facts, self.checkpoints = facts, 0
        output = problem.scene.output
        self.frame_steps, self.row_steps = Marks(steps, output.frames), Marks(steps, max(2, output.history))
        self.every, self.saved_at = output.every, time.monotonic()
        times = [] if earlier is None else list(earlier.frames)
        for k in range(len(times)):
            if not (out / frame_name(k)).is_file():
                raise SceneError(
                    f"{str(out / frame_name(k))!r} is missing, and the run to go on with has written it: "
                    "put it back, or start over with --overwrite"
                )
        try:
            clear(out, times)
        except OSError as error:
            raise OutputError(out, error) from error
        self.measures = measured
        self.history = History(out / "history.csv", columns(self.measures), () if earlier is None else earlier.rows)
        cells = {}
        if output.frames and isinstance(problem.material, Composite):
            cells["material"] = problem.material.member_of(problem.mesh).astype(np.int32)
        self.frames = Frames(out, problem.basis, times, problem.scene.units, cells) if output.frames else None
        self.saved_step = 0 if earlier is None else earlier.state.step
        self.state: State | Equilibrium | None = None
        if earlier is not None:
            for measure in self.measures:
                if isinstance(measure, CrackTrack):
                    first = self.history.columns.index(measure.columns[0])
                    measure.resume([row[first:] for row in earlier.rows])
            self.state = dataclasses.replace(earlier.state, _body=problem.body)

    def take(self, state: State | Equilibrium, step: int | None) -> None:
        """Write what is due at a state. Raises ``UnstableRun`` instead where its energy balance is broken.

        ``step`` counts whole steps of the run: None inside a step that was cut.
        """
        self.state = state
        row = step in self.row_steps
        frame, save = step in self.frame_steps and self.frames is not None, self._due(state.step)
        if row or frame or save:
            with self.clock.phase("output"):
                self._write(state, step, row, frame)
        if not row and step is not None:
            self.progress.advance(step)
        if save:
            self.save(state)

    def _write(self, state: State | Equilibrium, step: int | None, row: bool, frame: bool) -> None:
        count, at_vertices = self.problem.look(state, row, frame)
        if isinstance(state, State):
            self.watch.check(state, None if count is None else _energies(state, count))
        if count is not None and step is not None:
            entries = row_of(state, count)
            for measure in self.measures:
                entries += measure.read(state, count)
            self.history.add(*entries)
            self.progress.advance(step, entries[5], entries[9])
        if at_vertices is not None:
            self._frame(state, at_vertices)

    def _due(self, step: int) -> bool:
        """Whether a checkpoint is due."""
        if self.every.steps:
            return step > self.saved_step and step % self.every.steps == 0
        # however the clock jumps
        return self.every.seconds > 0.0 and abs(time.monotonic() - self.saved_at) >= self.every.seconds

    def _frame(self, state: State | Equilibrium, at_vertices: Damage) -> None:
        assert self.frames is not None
        body, asked = self.problem.body, self.problem.scene.output.fields
        fields = {"displacement": state.u} | ({"velocity": state.v} if isinstance(state, State) else {})
        fields |= {"damage": 1.0 - at_vertices.intact, "intact": at_vertices.intact, "Z": at_vertices.Z}
        if "stress" in asked:
            tensors, across = self.problem.stress(state), out_of_plane(self.problem.material, body.bonds.dim)
            fields["stress"] = voigt(tensors)
            if across is not None:
                if body.bonds.dim == 2:
                    fields["stress"][:, 2] = across * np.trace(tensors, axis1=1, axis2=2)
                fields["von_mises"] = von_mises(tensors, across)
        if "strain" in asked:
            fields["strain"] = voigt(strain(self.problem.basis, state.u))
        self.frames.write(state.t, **fields)

    def save(self, state: State | Equilibrium) -> bool:
        """Write a checkpoint; where that fails the run goes on, and says so. Return whether it was written."""
        with self.clock.phase("checkpoints"):
            frames = [] if self.frames is None else self.frames.times
            facts = self.facts | {
                "seconds": self.clock.so_far(),
                "peak": self.watch.peak,
                "effort": dataclasses.asdict(self.problem.effort),
            }
            try:
                write_checkpoint(self.out, Checkpoint(state, self.history.rows, frames, facts))
            except OutputError as error:
                _log.warning("%s; the run goes on without this checkpoint", error)
                return False
            finally:
                self.saved_at = time.monotonic()
        self.checkpoints += 1
        self.saved_step = state.step
        return True


def _energies(state: State, count: Census) -> Energies:
    return Energies(state.kinetic, count.elastic, state.work, state.initial, state.dissipated)


def row_of(state: State | Equilibrium, count: Census) -> tuple[float, ...]:
    """Return a row of the history."""
    kinetic = state.kinetic
    total = kinetic + count.elastic
    imbalance = total + state.dissipated - state.work - state.initial
    return (
        *(state.t, state.step, kinetic, count.energy_intact, count.energy_softened, total, state.work, imbalance),
        *(count.softened, count.Z),
    )
