"""A parameter study over a scene: a run for each combination, one table, to be gone on with."""

from __future__ import annotations

import csv
import hashlib
import io
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from ..files.whole_files import write_whole
from ..scene.changes import changed
from ..scene.reading import SceneError
from ..scene.scene import Scene
from .run import run

COLUMNS = ("status", "steps", "softened_bonds", "largest_Z", "energy_drift")


def sweep(
    scene: str | Path | Mapping[str, Any],
    out: str | Path,
    over: Mapping[str, Sequence[Any]],
    *,
    columns: Sequence[str] = COLUMNS,
    processes: int = 1,
) -> list[dict[str, Any]]:
    """Run a scene for all combinations of some values of its keys; return the table, a row a run.

    Each run has a folder of its own under ``out``, named by its values, and ``out/sweep.csv`` is the table. Called
    again, it goes on: runs that have finished are not made again. A run that fails has a row that says why, and the
    others go on.

    Parameters
    ----------
    scene : str, Path or mapping
        A scene file, or the tables of one.
    out : str or Path
        The folder.
    over : mapping of str to sequence
        Values by the keys that they are for, as in ``{"bonds.horizon": [1e-3, 2e-3]}``.
    columns : sequence of str, optional
        Keys of the summary that the table has beside the values.
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
    if not over or not all(len(values) for values in over.values()):
        raise SceneError(f"over = {dict(over)} must have a key of the scene, and a value or more for it")
    if not processes >= 1:
        raise SceneError(f"processes = {processes} must be 1 or more")
    out, jobs = Path(out), []
    for values in itertools.product(*over.values()):
        changes = [(key, _plain(value)) for key, value in zip(over, values, strict=True)]
        _ = _scene(scene, changes)
        jobs.append((scene, changes, out / _name(changes)))
    out.mkdir(parents=True, exist_ok=True)
    if processes == 1:
        ends = [_one(job) for job in jobs]
    else:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            ends = list(pool.map(_one, jobs))
    rows = []
    for (_, _, folder), values, (summary, mistake) in zip(jobs, itertools.product(*over.values()), ends, strict=True):
        row = dict(zip(over, values, strict=True)) | {name: summary.get(name) for name in columns}
        rows.append(row | {"folder": str(folder), "mistake": mistake})
    _write(out / "sweep.csv", rows)
    return rows


def _scene(scene: Any, changes: list[tuple[str, Any]]) -> Scene:
    return Scene.of(changed(scene, changes)) if isinstance(scene, Mapping) else Scene.read(scene, changes)


def _one(job: tuple[Any, list[tuple[str, Any]], Path]) -> tuple[dict[str, Any], str]:
    scene, changes, folder = job
    try:
        return dict(run(_scene(scene, changes), folder)), ""
    except (ValueError, RuntimeError) as error:  # mistakes, and runs that have become unstable or found no equilibrium
        return {}, " ".join(str(error).split())


def _name(changes: list[tuple[str, Any]]) -> str:
    """The name of a folder: the values, as far as they can be read in one, and what tells them from all others."""
    said = "_".join(f"{path.rpartition('.')[2]}={value}" for path, value in changes)
    mark = hashlib.sha256(json.dumps(changes, default=str).encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9.=_+-]+', '', said)[:60]}_{mark}".lstrip(".")


def _plain(value: Any) -> Any:
    """A value as TOML has it: NumPy's numbers and arrays are Python's."""
    return value.tolist() if hasattr(value, "tolist") else value


def _write(path: Path, rows: list[dict[str, Any]]) -> None:
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_whole(path, text.getvalue())
