"""Bonds that break for good over ranks: each remembers its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._types import Floats, Longs
from ..model.breaking import Breaking, sorted_pairs
from .body import RankBody

_FOREIGN = "the broken bonds of the state to start from are not bonds of this body"


@dataclass(eq=False)
class RankState:
    """What has happened to the bonds of a rank: those of its ``pieces`` together, as a :class:`BondState` has it."""

    pieces: list[Breaking]

    @property
    def last(self) -> list[Any]:
        return [group for piece in self.pieces for group in piece.state.last]

    @property
    def energy(self) -> float:
        return sum(piece.state.energy for piece in self.pieces)

    @property
    def broken(self) -> list[Longs]:
        return [numbers for piece in self.pieces for numbers in piece.state.broken]


@dataclass(frozen=True, eq=False)
class BreakingRanks(RankBody):
    """The bonds that a rank computes, which break for good as those of a :class:`Breaking` body do.

    Broken bonds are told and recalled by pairs of vertices of the whole mesh, whatever the number of ranks.
    """

    _places: list[Floats] = field(default_factory=list, repr=False)

    @property
    def breaking(self) -> list[Breaking]:
        """The bodies of the rank."""
        return [piece for piece in self.pieces if isinstance(piece, Breaking)]

    @property
    def state(self) -> RankState:
        """What has happened to the rank's bonds."""
        return RankState(self.breaking)

    def force_and_break(self, u: Floats) -> Floats:
        """Break the bonds that are beyond their limit at u; return the force of the others."""

        halo = self.dealt.halo(self.dim)
        x = halo.extended(u)
        # with the ghosts of the step before, for the work along this one
        self._places[:] = [*self._places[-1:], x]
        return halo.summed(np.asarray(sum(piece.force_and_break(x) for piece in self.breaking)))

    def work_of_last(self, du: Floats) -> float:
        """Return the work that what broke last would have done against a displacement since the step before."""
        moved = self._places[-1] - self._places[0]
        moved[: len(du)] = du
        return sum(piece.work_of_last(moved) for piece in self.breaking)

    def broken_pairs(self) -> Longs:
        """Return the rank's broken bonds as pairs of vertices of the whole mesh, (n, 2)."""
        pairs = [piece.kept(piece.state.broken)[0] for piece in self.breaking]
        return sorted_pairs(self.share.number[np.concatenate(pairs)])

    def recall(self, broken: Sequence[Longs] | None) -> None:
        """Break the listed bonds, pairs of vertices of the whole mesh; None makes all whole."""
        if broken is not None and any(len(x) and x.ndim != 2 for x in broken):
            raise ValueError(
                "the broken bonds of the state to start from are listed by number, as runs of one process did before: "
                "go on with it once without --mpi, to a new checkpoint"
            )
        every = (
            np.zeros((0, 2), dtype=np.int64) if broken is None else np.concatenate([x.reshape(-1, 2) for x in broken])
        )
        outside = len(every) > 0 and not 0 <= every.min() <= every.max() < self.share.nvertices
        if outside:
            raise ValueError(_FOREIGN)
        local = np.full(self.share.nvertices, -1, dtype=np.int64)
        local[self.share.number] = np.arange(len(self.share.number))
        pairs = local[every]
        here, count = pairs[(pairs >= 0).all(axis=1)], 0
        for piece in self.breaking:
            numbers = piece.numbers_of(here)
            count += sum(map(len, numbers))
            piece.recall(numbers)
        if self.total(count) != len(every):
            raise ValueError(_FOREIGN)
