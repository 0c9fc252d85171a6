"""What a run gives back: its summary, and the way to its files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any, overload

from ..._types import Floats
from ..files.results import Results, Snapshot
from ..report.headline import verdict
from ..scene.reading import SceneError
from ..scene.shown import named


@dataclass(frozen=True)
class FrameList(Sequence[Snapshot]):
    """The frames of a run, each read when it is asked for."""

    results: Results

    def __len__(self) -> int:
        return len(self.results.frames)

    @overload
    def __getitem__(self, number: int) -> Snapshot: ...
    @overload
    def __getitem__(self, number: slice) -> list[Snapshot]: ...
    def __getitem__(self, number: int | slice) -> Snapshot | list[Snapshot]:
        if isinstance(number, slice):
            return [self.results.snapshot(k) for k in range(len(self))[number]]
        if not -len(self) <= number < len(self):
            raise IndexError(f"frame {number} of {len(self)}")
        return self.results.snapshot(range(len(self))[number])

    def __iter__(self) -> Iterator[Snapshot]:
        return (self.results.snapshot(k) for k in range(len(self)))

    def __repr__(self) -> str:
        return f"{len(self)} frames in {self.results.folder}"


class FinishedRun(dict[str, Any]):
    """The summary of a run, with its history, frames, pictures and report.

    Parameters
    ----------
    folder : str or Path
        Where the run wrote its files.
    summary : mapping, optional
        The summary; read from the folder where it is not given.

    Raises
    ------
    SceneError
        Where the folder holds no run.

    Examples
    --------
    >>> import tempfile
    >>> import skfem_peridynamics as peri
    >>> scene = peri.Scene.parse('''
    ... mesh = {box = [[0, 1]], divisions = [10]}
    ... material = {young = 1.0, toughness = 1.0, density = 1.0}
    ... bonds = {horizon = 0.2}
    ... initial = {velocity = ["1e-3*x"]}
    ... time = {until = 1.0}
    ... output = {frames = 2, pictures = false}
    ... ''')
    >>> done = peri.run(scene, tempfile.mkdtemp())
    >>> done["status"], len(done.frames), done.frames[-1].t, float(done.history["t"][-1])
    ('finished', 2, 1.0, 1.0)
    """

    def __init__(self, folder: str | Path, summary: dict[str, Any] | None = None) -> None:
        self.folder = Path(folder).absolute()
        super().__init__(Results.read(self.folder).summary if summary is None else summary)
        self._made = self._stamp()

    def _stamp(self) -> int:
        """When the summary in the folder was written; 0 where there is none."""
        path = self.folder / "summary.json"
        return path.stat().st_mtime_ns if path.is_file() else 0

    @property
    def results(self) -> Results:
        """The files, read back. Raises :class:`SceneError` where another run has written them since."""
        if self._stamp() != self._made:
            raise SceneError(f"{named(self.folder)} has another run by now: take what that gave back")
        return self._results

    @cached_property
    def _results(self) -> Results:
        return Results.read(self.folder)

    @property
    def history(self) -> dict[str, Floats]:
        """The columns of ``history.csv`` by name, each an array (rows,)."""
        return self.results.history

    @property
    def frames(self) -> FrameList:
        """The frames: ``.mesh``, ``.t``, ``.fields`` and ``.broken`` of each."""
        return FrameList(self.results)

    @property
    def headline(self) -> str:
        """What came out, in a sentence."""
        return verdict(Results(self.folder, dict(self), {}, (), self.get("run", {}).get("scene", {})))

    def plot(self, of: str = "damage", frame: int = -1, **options: Any) -> Any:
        """Draw a frame with :func:`skfem_peridynamics.plot`; return matplotlib's axes.

        Parameters
        ----------
        of : str, optional
            What colours show.
        frame : int, optional
            Which frame, the last by default.
        **options
            ``ax``, ``scale`` and more of :func:`skfem_peridynamics.plot`.

        Returns
        -------
        matplotlib.axes.Axes
            Where it was drawn.
        """
        from ..report.plot import plot

        shot = self.frames[frame]
        return plot(
            shot.mesh, shot.fields["displacement"][:, : shot.mesh.dim()].ravel(), of, fields=shot.fields, **options
        )

    def report(self) -> Path:
        """Write ``report.html``.

        Returns
        -------
        Path
            The file.
        """
        from ..report.run_page import write_report

        return write_report(self.folder)

    def _repr_html_(self) -> str:
        """A table for notebooks, under what came out."""
        rows = [("nodes, bonds", f"{self.get('nodes')}, {self.get('bonds')}"), ("status", self.get("status"))]
        rows += [("energy drift", f"{self['energy_drift']:.1e} of the peak energy")] if self.get("energy_drift") else []
        seconds = self.get("seconds") or {}
        rows += [("seconds", ", ".join(f"{name} {value:.1f}" for name, value in seconds.items()))]
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(str(value))}</td></tr>" for name, value in rows)
        return f"<p>{escape(self.headline)}</p><table>{cells}</table>"
