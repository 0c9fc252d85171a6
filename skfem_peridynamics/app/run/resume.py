"""What a folder holds already: a finished run, one to go on with, or one that is not to be lost."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..._clock import Clock
from ..._files import open_regular, read_regular
from ...solve.cfl import StepLimit
from ...solve.instability import Watch
from ..files.checkpoint import NAME, OLDER, Checkpoint, DamagedCheckpoint, latest
from ..files.frames import files_of_runs
from ..files.identity import differences
from ..files.results import SUMMARY_MOST, read_summary
from ..problem.problem import Problem
from ..scene.reading import SceneError
from ..scene.shown import named
from .checked import check_checkpoint
from .record import HISTORY_BEGINS

_log = logging.getLogger("skfem_peridynamics")
CHECKPOINTS = (NAME, OLDER)
TOLD = ("nodes", "bonds", "steps", "step", "softened_bonds", "largest_Z", "energy_drift", "peak_memory_mb")
WORTH_KEEPING = 60.0  # seconds of a run that another does not throw away unasked


def earlier_run(out: Path, identity: Mapping[str, Any], resume: bool | None) -> Checkpoint | dict[str, Any] | None:
    """Return the checkpoint to go on with, the summary where the run is finished, or None for a fresh start.

    ``identity`` is that of the run that is to be made there. Raises :class:`SceneError` for the checkpoint of
    another run, and, where nothing is said of ``resume``, before a finished run, more than a minute of an unfinished
    one, or a file that no run has written is lost.
    """
    if resume is False:
        return None
    finished = _finished(out)
    if finished is not None:
        _check_same(out, finished["run"], identity, "a finished run of another scene", (), resume)
        _log.warning(
            "the run in %r is finished: there is nothing to go on with%s",
            str(out),
            "" if resume else "; --overwrite makes it anew",
        )
        return finished
    _check_strangers(out)
    try:
        checkpoint = latest(out, _log.warning if resume else _ignore)
    except DamagedCheckpoint as error:
        if resume:
            raise SceneError(str(error)) from None
        return None
    if checkpoint is None:
        return None
    known = checkpoint.facts.get("run")
    known = known if isinstance(known, dict) else {}
    if resume:
        _check_same(out, known, identity, "the checkpoint of another run", ("versions",), resume)
        return checkpoint
    try:
        spent = sum(float(value) for value in checkpoint.facts["seconds"].values())
    except (KeyError, TypeError, ValueError, AttributeError):
        spent = 0.0
    if spent > WORTH_KEEPING and isinstance(known.get("scene"), Mapping):
        other = differences(known, identity)
        whose, cure = (
            ("this very run", "go on with --resume")
            if not other
            else (
                f"another run ({'; '.join(other[:3])})",
                "give this one another folder",
            )
        )
        raise SceneError(
            f"output folder {named(out)} holds {spent:.0f} s of {whose}, "
            f"stopped at step {checkpoint.state.step}: {cure}, or start over with --overwrite"
        )
    return None


def _check_same(
    out: Path,
    known: Mapping[str, Any],
    identity: Mapping[str, Any],
    holds: str,
    compared: tuple[str, ...],
    resume: bool | None,
) -> None:
    """Raise :class:`SceneError` where what the folder ``holds`` is of another run."""
    different = differences(known, identity, compared)
    if different:
        more = f", and {len(different) - 3} more" if len(different) > 3 else ""
        cure = "" if resume else "; give this one another folder, or say --overwrite"
        raise SceneError(f"output folder {named(out)} holds {holds}: {'; '.join(different[:3])}{more}{cure}")


def _check_strangers(out: Path) -> None:
    """Raise :class:`SceneError` where files have the names that runs use, and there is no sign of a run."""
    found = files_of_runs(out)
    if not found or any((out / name).is_file() for name in CHECKPOINTS):
        return
    try:
        with open_regular(out / "history.csv") as file:
            is_run = file.read(len(HISTORY_BEGINS)) == HISTORY_BEGINS.encode()
    except OSError:
        is_run = False
    try:
        summary = json.loads(read_regular(out / "summary.json", SUMMARY_MOST))
        is_run |= isinstance(summary, dict) and isinstance(summary.get("run"), dict)
    except (OSError, ValueError, RecursionError):
        pass
    if not is_run:
        raise SceneError(
            f"output folder {named(out)} holds {found[0]}, which no run has written: give the run another folder, or "
            "say --overwrite"
        )


def _ignore(note: str) -> None:
    """What is about to be overwritten may be damaged."""


def _finished(out: Path) -> dict[str, Any] | None:
    """The summary of a run that is finished, or None."""
    try:
        summary = read_summary(out / "summary.json")
    except (OSError, ValueError, RecursionError):
        return None
    # all that is told of a run at its end is there, or none of it is believed
    whole = summary.get("status") == "finished" and isinstance(summary.get("run"), dict)
    whole = whole and all(isinstance(summary.get(name), (int, float)) for name in TOLD)
    return summary if whole and isinstance(summary.get("seconds"), dict) else None


def restore(checkpoint: Checkpoint, problem: Problem, clock: Clock, watch: Watch) -> Problem:
    """Bring back what a run had computed, spent and seen; return the problem with its known step limit.

    Raises :class:`SceneError` for what no run has written, whatever its checksum.
    """
    facts = checkpoint.facts
    try:
        check_checkpoint(checkpoint, problem)
    except (TypeError, ValueError, ArithmeticError) as error:
        raise SceneError(f"the checkpoint cannot be gone on with, it is none that a run wrote: {error}") from None
    if facts["limit"] is not None:
        problem = replace(problem, known_limit=StepLimit(**facts["limit"]))
    clock.add({name: float(value) for name, value in facts["seconds"].items()})
    watch.peak = float(facts["peak"])
    for name, value in facts["effort"].items():
        setattr(problem.effort, name, value)
    return problem
