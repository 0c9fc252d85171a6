"""A parameter study over a scene: a run for each combination, one table, to be gone on with."""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import itertools
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ..files.identity import as_tables
from ..files.whole_files import write_whole
from ..scene.changes import changed
from ..scene.reading import SceneError
from ..scene.scene import Scene
from .run import run

# keys that only some runs have: of cracks, of implicit steps, of estimates
_SOMETIMES = {
    *("crack_length", "crack_area", "crack_reach", "tips", "cracks", "crushed", "largest_tip_speed", "tip_x", "tip_y"),
    *("energy_lost", "error_estimate", "newton_iterations", "hessian_products", "broken_bonds", "unbalanced_vertices"),
}
COLUMNS = ("status", "steps", "softened_bonds", "largest_Z", "energy_drift")


def sweep(
    scene: str | Path | Mapping[str, Any] | Scene,
    out: str | Path,
    over: Mapping[str, Sequence[Any]],
    *,
    columns: Sequence[str] = COLUMNS,
    processes: int = 1,
) -> list[dict[str, Any]]:
    """Run a scene for all combinations of some values of its keys; return the table, a row a run.

    Each run has a folder of its own under ``out``, named by its values and its scene, and ``out/sweep.csv`` is the
    table, written after each. Called again, with these or other values, it goes on: runs that have finished are not
    made again, those that were stopped are resumed. A run that fails has a row that says why, and the others go on.

    Parameters
    ----------
    scene : str, Path, mapping or Scene
        A scene file, the tables of one, or a scene.
    out : str or Path
        The folder.
    over : mapping of str to sequence
        Values by the keys that they are for, as in ``{"bonds.horizon": [1e-3, 2e-3]}``.
    columns : sequence of str, optional
        Keys of the summary that the table has beside the values, those of its tables by a dot: ``seconds.steps``.
    processes : int, optional
        How many runs at a time.

    Returns
    -------
    list of dict
        The values, then the columns, ``folder``, and ``mistake`` where a run failed.

    Raises
    ------
    SceneError
        Where the scene makes no sense with any combination: before one is run.

    Examples
    --------
    >>> import tempfile
    >>> tables = {
    ...     "mesh": {"box": [[0, 1]], "divisions": [10]},
    ...     "material": {"young": 1.0, "toughness": 1.0, "density": 1.0},
    ...     "bonds": {"horizon": 0.2},
    ...     "time": {"until": 1.0},
    ...     "output": {"frames": 0, "pictures": False},
    ... }
    >>> rows = sweep(tables, tempfile.mkdtemp(), {"bonds.horizon": [0.2, 0.3]}, columns=["bonds"])
    >>> [(row["bonds.horizon"], row["bonds"]) for row in rows]
    [(0.2, 19), (0.3, 27)]
    """
    _check(over, columns, processes)
    out, jobs = Path(out), []
    for values in itertools.product(*over.values()):
        changes = list(zip(over, values, strict=True))
        whole = _scene(scene, changes)
        jobs.append((whole, out / _name(whole, changes)))
    out.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    with contextlib.ExitStack() as stack:
        if processes == 1:
            ends: Iterable[tuple[dict[str, Any], str]] = map(_one, jobs)
        else:
            pool = stack.enter_context(ProcessPoolExecutor(processes, mp_context=get_context("spawn")))
            ends = pool.map(_one, jobs)
        for (_, folder), values, (summary, mistake) in zip(jobs, itertools.product(*over.values()), ends, strict=True):
            row = dict(zip(over, values, strict=True))
            row |= {name: _of(summary, name) if summary else None for name in columns}
            rows.append(row | {"folder": str(folder), "mistake": mistake})
            _write(out / "sweep.csv", rows)
    return rows


def _check(over: Mapping[str, Sequence[Any]], columns: Sequence[str], processes: int) -> None:
    """Raise :class:`SceneError` for what makes no table."""
    if not isinstance(over, Mapping) or not over:
        raise SceneError(f"over = {over!r} must have a key of the scene, and values for it")
    for key, values in over.items():
        if isinstance(values, str | Mapping) or not hasattr(values, "__len__") or not len(values):
            raise SceneError(f"over[{key!r}] = {values!r} must be a list of a value or more")
    keys = sorted(over)
    for one, other in itertools.pairwise(keys):
        if other.startswith((f"{one}.", f"{one}[")):
            raise SceneError(f"over has {one!r} and {other!r}: one is a part of the other")
    if isinstance(columns, str) or set(columns) & {*over, "folder", "mistake"}:
        raise SceneError(f"columns = {columns!r} must be a list of keys of the summary, and none of those in over")
    if isinstance(processes, bool) or not isinstance(processes, int) or processes < 1:
        raise SceneError(f"processes = {processes!r} must be a whole number, 1 or more")


def _of(summary: Mapping[str, Any], name: str) -> Any:
    """A number of a summary, of a table in it by a dot; what the scene does not measure is None."""
    value: Any = summary
    for part in name.split("."):
        if not isinstance(value, Mapping) or (part not in value and part not in _SOMETIMES):
            there = ", ".join(sorted(value)) if isinstance(value, Mapping) else "nothing"
            raise SceneError(f"columns: the summary has no {name!r}; it has {there}")
        value = value.get(part)
    return value


def _scene(scene: str | Path | Mapping[str, Any] | Scene, changes: list[tuple[str, Any]]) -> Scene:
    if isinstance(scene, Scene):
        return Scene.of(changed(as_tables(scene), changes), scene.folder)
    return Scene.of(changed(scene, changes)) if isinstance(scene, Mapping) else Scene.read(scene, changes)


def _one(job: tuple[Scene, Path]) -> tuple[dict[str, Any], str]:
    scene, folder = job
    try:
        return dict(run(scene, folder, resume=True)), ""
    except (ValueError, RuntimeError) as error:  # mistakes, and runs that have become unstable or found no equilibrium
        return {}, " ".join(str(error).split())


def _name(scene: Scene, changes: list[tuple[str, Any]]) -> str:
    """The name of a folder: the values, as far as they can be read in one, and what tells the scene from all others."""
    said = "_".join(f"{path.rpartition('.')[2]}={value}" for path, value in changes)
    mark = hashlib.sha256(json.dumps([as_tables(scene), str(scene.folder)]).encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9.=_+-]+', '', said)[:60]}_{mark}".lstrip(".")


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue())
