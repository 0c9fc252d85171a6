"""A mesh that is dealt out over ranks, and the vectors on it: exchanged, gathered, scattered."""

from __future__ import annotations

import atexit
import weakref
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .._types import Floats, Longs
from .halo import Halo
from .share import Share


@dataclass(frozen=True, eq=False)
class DealtMesh:
    """A rank's share of a mesh and what brings numbers to and from the other ranks.

    Methods are called by all ranks at once.
    """

    comm: Any
    share: Share
    _halos: dict[int, Halo] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        _OPEN.add(self)

    def halo(self, width: int) -> Halo:
        """Return the exchange of so many numbers a vertex, made once. Raises ``ValueError`` after the end."""
        if self not in _OPEN:
            raise ValueError("the body is closed: what it had of PETSc has been given back")
        if width not in self._halos:
            self._halos[width] = Halo(self.comm, self.share, width)
        return self._halos[width]

    def total(self, part: float) -> float:
        """Return the sum of what the ranks have."""
        return float(self.comm.allreduce(part))

    def gather(self, own: Floats) -> Floats | None:
        """Return a vector of the whole mesh on the first rank, None on the others."""
        from mpi4py import MPI

        width, (places, counts) = len(own) // self.share.own, self._everyone
        if self.share.rank:
            self.comm.Gatherv(own, None, root=0)
            return None
        found = np.empty(self.share.nvertices * width)
        self.comm.Gatherv(own, (found, [count * width for count in counts], None, MPI.DOUBLE), root=0)
        return found.reshape(-1, width)[places].ravel()

    def scatter(self, whole: Floats | None, width: int) -> Floats:
        """Return the rank's own part of a vector that the first rank has of the whole mesh."""
        from mpi4py import MPI

        own, (places, counts) = np.empty(self.share.own * width), self._everyone
        if self.share.rank:
            self.comm.Scatterv(None, own, root=0)
            return own
        assert whole is not None
        ordered = np.empty((self.share.nvertices, width))
        ordered[places] = whole.reshape(self.share.nvertices, -1)
        self.comm.Scatterv((ordered, [count * width for count in counts], None, MPI.DOUBLE), own, root=0)
        return own

    def close(self) -> None:
        """Give back what PETSc holds."""
        _OPEN.discard(self)
        while self._halos:
            self._halos.popitem()[1].close()

    @cached_property
    def _everyone(self) -> tuple[Longs, list[int]]:
        """On the first rank the place of each vertex in the order of the ranks, and how many each owns."""
        found = self.comm.gather(self.share.number[: self.share.own], root=0)
        if found is None:
            return np.zeros(0, dtype=np.int64), []
        places = np.empty(self.share.nvertices, dtype=np.int64)
        places[np.concatenate(found)] = np.arange(self.share.nvertices)
        return places, [len(numbers) for numbers in found]


_OPEN: weakref.WeakSet[DealtMesh] = weakref.WeakSet()


@atexit.register
def _close_all() -> None:
    """Give back what is left of PETSc's memory before PETSc ends: later it is too late, and the process would crash."""
    for mesh in list(_OPEN):
        mesh.close()
