"""Files of a run: frames for ParaView, the history, the summary. A file under its final name is complete."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any
from xml.sax.saxutils import quoteattr

import numpy as np

from .._types import Basis, Floats
from .reading import SceneError

_FRAME = "frame_[0-9][0-9][0-9][0-9].vtu"
_CELLS = {1: "line", 2: "triangle", 3: "tetra"}


def write_whole(path: Path, content: str) -> None:
    """Write a text file aside and rename it, so that it is never seen half written."""
    aside = path.with_name(path.name + ".part")
    aside.write_text(content)
    os.replace(aside, path)


def make_folder(folder: Path) -> None:
    """Make an output folder. Raises :class:`SceneError` where that is not possible."""
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"output folder {str(folder)!r} exists and is not a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r} cannot be written: {error.strerror}") from None


def clear(folder: Path) -> None:
    """Remove what an earlier run left in a folder, by the names that runs use; other files stay."""
    for old in folder.glob(_FRAME):
        old.unlink()
    for name in ("frames.pvd", "history.csv", "summary.json", "damage.png", "energies.png"):
        (folder / name).unlink(missing_ok=True)


@dataclass(eq=False)
class Frames:
    """Write fields at vertices as ``frame_0000.vtu, ...`` and ``frames.pvd`` into a folder.

    Vectors (N,) of the basis get three components, as ParaView likes them; scalars are (nvertices,). Fields are in
    single precision, compressed. Frames that an earlier run left there are removed first.

    >>> import tempfile, skfem
    >>> basis = skfem.Basis(skfem.MeshTri(), skfem.ElementVector(skfem.ElementTriP1()))
    >>> frames = Frames(tempfile.mkdtemp(), basis)
    >>> frames.write(0.0, displacement=np.zeros(8), Z=np.zeros(4)).name
    'frame_0000.vtu'
    """

    folder: str | Path
    basis: Basis
    times: list[tuple[float, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.folder = Path(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        for old in self.folder.glob(_FRAME):
            old.unlink()

    def write(self, t: float, **fields: Floats) -> Path:
        """Write one frame and return its path. Raises ``ValueError`` for a field of another length."""
        import meshio

        mesh = self.basis.mesh
        n, dim = mesh.nvertices, mesh.dim()
        data = {}
        for name, values in fields.items():
            values = np.asarray(values)
            if values.shape == (n * dim,) and (dim > 1 or name in ("displacement", "velocity")):
                values = np.pad(values.reshape(n, dim), ((0, 0), (0, 3 - dim)))
            elif values.shape != (n,):
                raise ValueError(f"field {name!r} has shape {values.shape}; it needs ({n},) or ({n * dim},)")
            data[name] = values.astype(np.float32)
        points = np.pad(mesh.p.T, ((0, 0), (0, 3 - dim)))
        name = f"frame_{len(self.times):04d}.vtu"
        path = Path(self.folder) / name
        aside = path.with_name(name + ".part")
        cells = [(_CELLS[dim], np.ascontiguousarray(mesh.t.T, dtype=np.int32))]
        meshio.Mesh(points, cells, point_data=data).write(aside, file_format="vtu")
        os.replace(aside, path)
        self.times.append((t, name))
        rows = "".join(f'    <DataSet timestep="{t!r}" file={quoteattr(name)}/>\n' for t, name in self.times)
        write_whole(
            Path(self.folder) / "frames.pvd",
            '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
            f"{rows}  </Collection>\n</VTKFile>\n",
        )
        return path


class History:
    """Write rows of numbers to ``history.csv``, flushed row by row; keep them for the pictures."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.columns = tuple(columns)
        self.rows: list[tuple[float, ...]] = []
        self._file: IO[str] = open(path, "w", newline="")  # noqa: SIM115 (closed by close)
        self._writer = csv.writer(self._file)
        self._writer.writerow(columns)

    def add(self, *row: float) -> None:
        self.rows.append(row)
        self._writer.writerow([repr(value) for value in row])
        self._file.flush()

    def column(self, name: str) -> Floats:
        """All values of a column so far."""
        k = self.columns.index(name)
        return np.array([row[k] for row in self.rows])

    def close(self) -> None:
        self._file.close()


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json``; what is not a number becomes null."""
    write_whole(path, json.dumps(_plain(summary), indent=2, allow_nan=False) + "\n")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _plain(entry) for name, entry in value.items()}
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
