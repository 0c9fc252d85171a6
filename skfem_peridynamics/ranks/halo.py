"""Ghost values of a rank: brought from their owners, and sums and maxima brought back; PETSc does it."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._types import Floats
from .share import Share


class Halo:
    """Exchange of ``width`` numbers a vertex. A rank's vector is that of its own vertices; with ghosts it is longer."""

    def __init__(self, comm: Any, share: Share, width: int) -> None:
        from petsc4py import PETSc

        self._insert, self._modes = PETSc.InsertMode, PETSc.ScatterMode
        self.own = share.own * width
        ghosts = share.place[share.own :].astype(PETSc.IntType)
        sizes = (self.own, share.nvertices * width)
        self._vector = PETSc.Vec().createGhost(ghosts, size=sizes, bsize=width, comm=comm)
        self._form = self._vector.localForm()
        self.array: Floats = self._form.__enter__().array  # own values, then ghosts; PETSc's own memory

    def begin(self, own: Floats) -> Floats:
        """Start to bring ghosts; return the vector with them, of which only what is one's own is there yet."""
        self.array[: self.own] = own
        self._vector.ghostUpdateBegin(self._insert.INSERT, self._modes.FORWARD)
        return self.array

    def end(self) -> Floats:
        """Wait for the ghosts; return the vector with them, valid until the next exchange."""
        self._vector.ghostUpdateEnd(self._insert.INSERT, self._modes.FORWARD)
        return self.array

    def extended(self, own: Floats) -> Floats:
        """Return a vector with its ghosts."""
        self.begin(own)
        return self.end().copy()

    def summed(self, local: Floats) -> Floats:
        """Return one's own values and what other ranks have for them, added."""
        return self._back(local, self._insert.ADD)

    def largest(self, local: Floats) -> Floats:
        """Return the largest of one's own values and of what other ranks have for them."""
        return self._back(local, self._insert.MAX_VALUES)

    def _back(self, local: Floats, mode: Any) -> Floats:
        self.array[:] = local
        self._vector.ghostUpdate(mode, self._modes.REVERSE)
        return np.array(self.array[: self.own])

    def close(self) -> None:
        """Give PETSc's memory back: at the end of a process it is too late."""
        self.array = np.zeros(0)
        self._form.__exit__(None, None, None)
        self._vector.destroy()
