"""A rule whose bonds are dealt out among ranks: each is computed by one of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Bools, Mesh
from ..bonds.pair_bonds import PairBonds
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Part
from ..bonds.samples import Samples
from ..material.influence import Influence
from .share import Share


@dataclass(frozen=True, eq=False)
class DealtPairs:
    """The vertex pairs that a rank computes: those ``inside``, which need no ghost, or the others.

    A pair across ranks goes to the owner of the lower or of the higher vertex, in turn.
    """

    rule: PairRule
    share: Share
    inside: bool

    @property
    def name(self) -> str:
        return self.rule.name

    @property
    def symmetric(self) -> bool:
        return True

    def samples(self, mesh: Mesh) -> Samples:
        return self.rule.samples(mesh)

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        return self.rule.estimate(mesh, horizon)

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        out: list[Part] = []
        for part in self.rule.parts(mesh, samples, horizon, influence):
            assert isinstance(part, PairBonds)
            which = np.flatnonzero(self._taken(part, samples))
            if len(which) == part.nbonds:
                out.append(part)
            elif len(which):
                out.append(part.pick(which))
        return out

    def _taken(self, part: PairBonds, samples: Samples) -> Bools:
        share = self.share
        x, y = samples.vertices[(part.ends + np.int32(part.first)).T, 0].astype(np.int64)
        first, second = share.number[x], share.number[y]
        lower = np.where(first < second, x, y)
        chosen = np.where((first + second) % 2 == 0, lower, x + y - lower)
        mine = share.owner[chosen] == share.rank
        needs_no_ghost = (x < share.own) & (y < share.own)
        taken: Bools = mine & (needs_no_ghost == self.inside)
        return taken
