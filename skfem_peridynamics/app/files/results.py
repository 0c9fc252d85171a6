"""What a run has left in its folder, read back: summary, history, frames."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ..._files import MB, read_regular
from ..._types import Floats, Ints, Mesh
from ..scene.reading import SceneError
from ..scene.shown import MOST_OF_A_NAME, cut, named, shown
from ..scene.units import UnitsTable
from ..scene.values import LARGEST

# bytes: rows and frames of a scene have bounds, which are far below
SUMMARY_MOST, HISTORY_MOST, LIST_MOST = 8 * MB, 512 * MB, 16 * MB

_KEPT = 6  # frames that are not read again: those of a report


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The body at one time: its mesh and fields at the vertices, (nvertices,) or (nvertices, k)."""

    mesh: Mesh
    t: float
    fields: dict[str, Floats]
    rim: Ints | None = None  # vertices of the facets of the boundary, where they are known

    @property
    def outline(self) -> Ints:
        """The vertices of the facets of the boundary, (dim, n), faces of slits among them."""
        if self.rim is not None:
            return self.rim
        return np.asarray(self.mesh.facets[:, self.mesh.boundary_facets()])

    @property
    def broken(self) -> Floats:
        """The fraction of a vertex's bonds that have softened or broken."""
        return np.asarray(1.0 - self.fields["intact"], dtype=float)


@dataclass(frozen=True, eq=False)
class Results:
    """The files of one run. ``summary`` is empty where the run has not ended; ``history`` holds its columns."""

    folder: Path
    summary: dict[str, Any]
    history: dict[str, Floats]
    frames: tuple[tuple[float, Path], ...]
    scene: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def read(cls, folder: Path) -> Results:
        """Read a folder. Raises :class:`SceneError` where a run has left nothing there, or a file is damaged."""
        if not folder.is_dir():
            raise SceneError(f"{named(folder)} is not a folder; give one that run has written")
        try:
            summary = read_summary(folder / "summary.json")
            history = _history(folder / "history.csv")
            frames = _frames(folder)
        except (OSError, ValueError, KeyError, TypeError, ElementTree.ParseError, RecursionError, csv.Error) as error:
            raise SceneError(f"the run in {named(folder)} cannot be read: {error}") from None
        if not summary and not history and not frames:
            raise SceneError(f"{named(folder)} holds no run: there is neither history.csv nor summary.json")
        run = summary.get("run")
        scene = run.get("scene") if isinstance(run, dict) else None
        return cls(folder, summary, history, frames, scene if isinstance(scene, dict) else {})

    @property
    def title(self) -> str:
        title = str(self.summary.get("title") or self.scene.get("title") or self.folder.name)
        return cut(" ".join(title.encode(errors="replace").decode().split()), MOST_OF_A_NAME)

    @property
    def is_static(self) -> bool:
        """Whether t is no time, but how far loads and displacements have come."""
        time = self.scene.get("time")
        return isinstance(time, dict) and time.get("scheme") == "static"

    @property
    def units(self) -> UnitsTable:
        known = self.scene.get("units")
        known = known if isinstance(known, dict) else {}
        given = {name: str(known[name]) for name in ("length", "force", "time") if name in known}
        if self.is_static:
            given.pop("time", None)
        return UnitsTable(**given)

    @cached_property
    def _kept(self) -> dict[int, Snapshot]:
        return {}

    @cached_property
    def _outlines(self) -> dict[bytes, Ints]:
        return {}

    def _with_outline(self, mesh: Mesh, t: float, fields: dict[str, Floats]) -> Snapshot:
        """A snapshot whose outline was found once for all frames of its mesh."""
        key = mesh.t.tobytes()
        if key not in self._outlines:
            self._outlines.clear()
            self._outlines[key] = Snapshot(mesh, t, fields).outline
        return Snapshot(mesh, t, fields, self._outlines[key])

    @cached_property
    def last(self) -> Snapshot | None:
        """The last frame, or None where there is none."""
        return self.snapshot(len(self.frames) - 1) if self.frames else None

    def snapshot(self, number: int) -> Snapshot:
        """Read a frame. Raises :class:`SceneError` for a file that is none."""
        t, path = self.frames[number]
        if number in self._kept:
            return self._kept[number]
        try:
            shot = self._with_outline(*_body(path, t))
            if len(self._kept) < _KEPT:
                self._kept[number] = shot
            return shot
        except (Exception, SystemExit) as error:  # whatever a reader of a damaged file may raise
            raise SceneError(f"frame {named(path)} cannot be read: {error}") from None


_NUMBERS = {
    *("crack_length", "crack_reach", "crack_area", "tips", "largest_tip_speed", "cracks", "crushed"),
    *("energy_per_crack_length", "energy_per_crack_area", "energy_drift", "energy_lost", "error_estimate"),
    *("largest_Z", "softened_bonds", "broken_bonds", "nodes", "bonds", "steps", "step", "peak_memory_mb"),
}
_TABLES = ("seconds", "elastic", "step_limits", "run")


def _rename_old(summary: dict[str, Any]) -> None:
    """Give the keys of runs before version 0.2 the names they have now."""
    if "dt" in summary:
        summary.setdefault("step", summary.pop("dt"))
    if isinstance(summary.get("dt_limit"), dict):
        old = summary.pop("dt_limit")
        summary.setdefault("step_limits", {f"by_{name}": step for name, step in old.items()})


def read_summary(path: Path) -> dict[str, Any]:
    """Return a summary, checked; empty where there is none. Raises ``OSError`` and ``ValueError``."""
    if not path.is_file():
        return {}
    summary = json.loads(read_regular(path, SUMMARY_MOST))
    if not isinstance(summary, dict):
        raise ValueError("summary.json holds no table")
    json.dumps(summary, ensure_ascii=False).encode()  # halves of pairs of surrogates cannot be written anywhere
    _rename_old(summary)
    for name, value in summary.items():
        if value is None:
            continue
        if name in _NUMBERS and not is_number(value):
            raise ValueError(f"summary.json has {name} = {shown(value)}, which is no number")
        if name in _TABLES and not (isinstance(value, dict) and _fits(name, value)):
            raise ValueError(f"summary.json has a table {name} that no run writes")
    return summary


def _fits(name: str, table: dict[str, Any]) -> bool:
    """Whether a table of the summary holds what a run writes: seconds are known, and an eigenvalue is not 0."""
    entries = list(table.values())
    if name == "seconds":
        return all(is_number(entry) and entry >= 0 for entry in entries)
    if name == "step_limits":
        known = all(entry is None or (is_number(entry) and entry >= 0) for entry in entries)
        return known and table.get("by_eigenvalue", 1.0) != 0
    return name != "elastic" or all(entry is None or is_number(entry) for entry in entries)


def is_number(value: Any) -> bool:
    """Whether a run can have written a value as a number."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and abs(value) <= LARGEST


_HISTORY = ("t", "kinetic", "intact", "softened", "total", "work")


def _history(path: Path) -> dict[str, Floats]:
    if not path.is_file():
        return {}
    content = read_regular(path, HISTORY_MOST)
    if content and not content.startswith(b"t,"):
        raise ValueError("history.csv has no column 't' at its begin")
    rows = list(csv.reader(io.StringIO(content.decode(), newline="")))
    if not rows:
        return {}
    names, numbers = rows[0], rows[1:]
    if any(len(row) != len(names) for row in numbers):
        raise ValueError("history.csv has rows of several lengths")
    columns = {name: np.array([float(row[k]) for row in numbers]) for k, name in enumerate(names)}
    for name in _HISTORY:
        if name not in columns:
            raise ValueError(f"history.csv has no column {name!r}")
    for name, values in columns.items():
        if (np.abs(np.nan_to_num(values, nan=0.0)) > LARGEST).any():
            raise ValueError(f"history.csv has numbers in the column {name!r} that no run writes")
    return columns


def _frames(folder: Path) -> tuple[tuple[float, Path], ...]:
    if not (folder / "frames.pvd").is_file():
        return ()
    out = []
    for entry in ElementTree.fromstring(read_regular(folder / "frames.pvd", LIST_MOST)).iter("DataSet"):
        name, t = entry.attrib["file"], float(entry.attrib["timestep"])
        if not re.fullmatch(r"frame_\d{4,}\.vtu", name) or not math.isfinite(t):
            raise ValueError(f"frames.pvd lists {shown(name)}, which is no frame")
        out.append((t, folder / name))
    return tuple(out)


def _body(path: Path, t: float) -> tuple[Mesh, float, dict[str, Floats]]:

    from ...geometry.boxes import mesh_class
    from ...geometry.simplices import check_simplices
    from ...meshes.guarded_reader import read
    from ...meshes.read_mesh import check_cells, quietly

    with quietly():
        content = read(path)
    block = content.cells[0]
    dim = {"line": 1, "triangle": 2, "tetra": 3}[block.type]
    check_cells(content)
    points = np.ascontiguousarray(content.points.T[:dim])
    mesh = mesh_class(dim)(points, np.ascontiguousarray(block.data.T.astype(np.int32)))
    check_simplices(mesh)
    fields = {str(name): np.asarray(values, dtype=float) for name, values in content.point_data.items()}
    for name, shape in (("intact", (len(points.T),)), ("displacement", (len(points.T), 3))):
        if name not in fields or fields[name].shape != shape or not np.isfinite(fields[name]).all():
            raise ValueError(f"it has no field {name!r} of a run")
    if np.abs(fields["intact"] - 0.5).max(initial=0.0) > 0.501:
        raise ValueError("its field 'intact' is no fraction")
    return mesh, t, fields
