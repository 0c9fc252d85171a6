"""What a checkpoint says, checked whole before a run goes on from it: whatever its checksum, it may be no run's."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np

from ...solve.cfl import StepLimit
from ...solve.state import Equilibrium
from ..files.checkpoint import Checkpoint
from ..problem.measures import measures
from ..problem.problem import Problem
from ..scene.values import LARGEST
from .record import columns

_ROOM = 1e-6  # of the end of a run and of its step: they are what the same arithmetic gives


def check_checkpoint(checkpoint: Checkpoint, problem: Problem) -> None:
    """Raise ``ValueError`` where a checkpoint, its rows, times or facts are none that a run of this scene writes."""
    facts, state = checkpoint.facts, checkpoint.state
    if (problem.scene.time.scheme == "static") != isinstance(state, Equilibrium):
        raise ValueError("its state is one of another scheme")
    limit, known = facts.get("limit"), {field.name for field in fields(StepLimit)}
    if (limit is None) == problem.explicit or not (limit is None or _is_limit(limit, known)):
        raise ValueError("its step limit is none")
    if limit is not None:
        step = replace(problem, known_limit=StepLimit(**limit)).dt
        if not abs(step - checkpoint.state.dt) <= _ROOM * step:
            raise ValueError("its step is not that of its limit")
    if not _numbers(facts.get("seconds")) or not _is_number(facts.get("peak")) or facts["peak"] < 0.0:
        raise ValueError("its seconds or its peak are none")
    effort = facts.get("effort") or {}
    if not _numbers(effort, set(vars(problem.effort))) or not all(isinstance(n, int) for n in effort.values()):
        raise ValueError("its effort is none")
    resumed = facts.get("resumed", [])
    if not isinstance(resumed, list) or not all(type(step) is int and 0 <= step <= state.step for step in resumed):
        raise ValueError("the steps that it was gone on with from are none")
    _check_state(checkpoint, problem)
    width = len(columns(measures(problem)))
    if not all(len(row) == width and not any(abs(value) > LARGEST for value in row) for row in checkpoint.rows):
        raise ValueError("its rows are none of this scene")


def _check_state(checkpoint: Checkpoint, problem: Problem) -> None:
    state, size, until = checkpoint.state, problem.basis.N, problem.scene.time.until
    vectors = [getattr(state, name) for name in state.VECTORS]
    vectors += [state.memory.tangent] if state.memory is not None else []
    if not all(x is None or (x.shape == (size,) and bool((np.abs(x) <= LARGEST).all())) for x in vectors):
        raise ValueError("its vectors are none of this body")
    numbers = [getattr(state, name) for name in state.NUMBERS]
    if not all(_is_number(number) for number in numbers):
        raise ValueError("its numbers are none")
    if not (0.0 <= state.t <= until * (1.0 + _ROOM) and 0.0 < state.dt <= until * (1.0 + _ROOM) and state.step >= 0):
        raise ValueError(f"t = {state.t:.6g} at step {state.step} of {state.dt:.6g} is not on the way to {until:.6g}")
    if problem.explicit and abs(state.t - state.step * state.dt) > _ROOM * until:
        raise ValueError(f"t = {state.t:.6g} is not {state.step} steps of {state.dt:.6g}")
    times = checkpoint.frames
    if not all(0.0 <= t <= until * (1.0 + _ROOM) for t in times) or sorted(times) != times:
        raise ValueError("the times of its frames are none")
    if state.memory is not None and not 0 <= state.memory.spent < 1 << 53:
        raise ValueError("what its linear solver has spent is none")


def _is_limit(table: Any, names: set[str]) -> bool:
    """Whether it is a step limit: a bound may be infinite, an eigenvalue that was not found no number, not both."""
    if not isinstance(table, Mapping) or set(table) != names:
        return False
    if not all(isinstance(x, (int, float)) and not isinstance(x, bool) and not x < 0 for x in table.values()):
        return False
    with contextlib.suppress(ArithmeticError):
        return bool(0.0 < StepLimit(**table).dt < LARGEST)
    return False


def _numbers(table: Any, names: set[str] | None = None) -> bool:
    """Whether it is a table of finite numbers that are not negative, with just these names."""
    if not isinstance(table, Mapping) or (names is not None and set(table) != names):
        return False
    return all(_is_number(value) and value >= 0 for value in table.values())


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST
