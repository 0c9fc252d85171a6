"""Rows of numbers as a run goes on, and its summary at the end."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..._files import handle_of, write_all
from ..._types import Floats
from ...solve.cfl import StepLimit
from .whole_files import OutputError, aside, write_whole


class History:
    """Write rows of numbers to ``history.csv``, row by row; keep them for the pictures. ``rows`` are continued.

    A row that cannot be written whole is taken back. Raises ``OutputError``, also when the file has vanished.
    """

    def __init__(self, path: Path, columns: Sequence[str], rows: Sequence[tuple[float, ...]] = ()) -> None:
        self.path, self.columns, self.rows = path, tuple(columns), list(rows)
        with aside(path, keep_open=True) as self._file:  # closed by close
            write_all(self._file, "".join(self._lines([self.columns, *self.rows])).encode())
        self._size = os.fstat(self._file.fileno()).st_size

    @staticmethod
    def _lines(rows: Sequence[Sequence[float | str]]) -> Iterator[str]:
        text = io.StringIO()
        writer = csv.writer(text)
        for row in rows:
            writer.writerow([value if isinstance(value, str) else repr(value) for value in row])
        yield text.getvalue()

    def add(self, *row: float) -> None:
        content = "".join(self._lines([row])).encode()
        try:
            with handle_of(self.path.parent) as folder:
                name = self.path if folder is None else self.path.name
                there = os.stat(name, dir_fd=folder, follow_symlinks=False)
            if not os.path.samestat(there, os.fstat(self._file.fileno())):
                raise FileNotFoundError(2, "another file has taken its place")
            write_all(self._file, content)
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._size)
            raise OutputError(self.path, error) from error
        self._size += len(content)
        self.rows.append(row)

    def column(self, name: str) -> Floats:
        """All values of a column so far."""
        k = self.columns.index(name)
        return np.array([row[k] for row in self.rows])

    def close(self) -> None:
        self._file.close()


def write_summary(path: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json``; what is not a number becomes null."""
    write_whole(path, json.dumps(plain(summary), indent=2, allow_nan=False) + "\n")


def step_limits(limit: StepLimit) -> dict[str, float]:
    """Return the step that each estimate alone allows, under names that say so: in Python these are eigenvalues.

    >>> step_limits(StepLimit(4.0, 0.0, 16.0, 16.0, 64.0, products=0))["by_nodal_bound"]
    0.5
    """
    return {f"by_{name}": step for name, step in limit.steps().items()}


def plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: plain(entry) for name, entry in value.items()}
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value
