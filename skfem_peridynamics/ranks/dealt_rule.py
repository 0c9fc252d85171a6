"""Bonds dealt out among ranks: each is computed by one of them."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._types import Bools, Longs, Mesh
from ..bonds.ball_bonds import BallBonds
from ..bonds.ball_rule import BallRule
from ..bonds.pair_bonds import PairBonds
from ..bonds.rule import Part, Rule
from ..bonds.samples import Samples
from ..material.influence import Influence
from .share import Share


@dataclass(frozen=True, eq=False)
class DealtRule:
    """A rule whose bonds, some of those that a rank computes, are made already: it hands them out.

    For all else it is the ``rule`` that they are of.
    """

    rule: Rule
    made: Samples
    bonds: list[Part]

    @property
    def name(self) -> str:
        return self.rule.name

    @property
    def symmetric(self) -> bool:
        return self.rule.symmetric

    def samples(self, mesh: Mesh) -> Samples:
        return self.made

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        return self.rule.estimate(mesh, horizon)

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        return self.bonds

    def __getattr__(self, name: str) -> Any:
        return getattr(self.rule, name)


def dealt(rule: Rule, share: Share, horizon: float, influence: Influence, apart: bool) -> list[DealtRule]:
    """Return the bonds that a rank computes: those that need no ghost, and the others; where not ``apart``, all in one.

    A bond of two samples across ranks goes to the owner of the lower or of the higher one, in turn; a ball to the owner
    of its middle. A sample in an element is that of the element's lowest vertex.
    """
    samples = rule.samples(share.mesh)
    if share.along is not None:
        samples = dataclasses.replace(samples, along=share.along[samples.vertices[:, 0]])
    stands_for = _vertices(samples, share)
    if isinstance(rule, BallRule):
        mine = share.owner[stands_for[samples.sites]] == share.rank
        of_sites = (samples.sites, samples.volume, samples.size, samples.element)
        sites, volume, size, element = (of_site[mine] for of_site in of_sites)
        samples = dataclasses.replace(samples, sites=sites, volume=volume, size=size, element=element)
        made = rule.made(share.mesh, samples, horizon, influence)
        chosen = [np.arange(len(part.site)) for part in made if isinstance(part, BallBonds)]
    else:
        made = rule.parts(share.mesh, samples, horizon, influence)
        chosen = [_mine(part, stands_for, share) for part in made if isinstance(part, PairBonds)]
    if not apart:
        return [DealtRule(rule, samples, _some(made, chosen))]
    halves = [(which, _needs_no_ghost(part, which, samples, share)) for part, which in zip(made, chosen, strict=True)]
    return [
        DealtRule(rule, samples, _some(made, [which[none == inside] for which, none in halves]))
        for inside in (True, False)
    ]


def _vertices(samples: Samples, share: Share) -> Longs:
    """The vertex of the rank's mesh that each sample stands for: the lowest, by its number in the whole mesh."""
    if samples.at_vertices:
        return samples.vertices[:, 0].astype(np.int64)
    lowest = share.number[samples.vertices].argmin(axis=1)
    found: Longs = samples.vertices[np.arange(samples.nsamples), lowest].astype(np.int64)
    return found


def _mine(part: PairBonds, stands_for: Longs, share: Share) -> Longs:
    """Which bonds of a part the rank computes."""
    x, y = stands_for[(part.ends + np.int32(part.first)).T]
    first, second = share.number[x], share.number[y]
    lower = np.where(first < second, x, y)
    taken = np.where((first + second) % 2 == 0, lower, x + y - lower)
    return np.flatnonzero(share.owner[taken] == share.rank)


def _needs_no_ghost(part: Part, which: Longs, samples: Samples, share: Share) -> Bools:
    """Which of some bonds, or of some balls, have nothing but the rank's own vertices at their ends."""
    own: Bools = np.asarray((samples.vertices < share.own).all(axis=1))
    if isinstance(part, PairBonds):
        ends: Bools = own[part.ends[which] + np.int32(part.first)].all(axis=1)
        return ends
    held: Bools = np.asarray((share.mesh.t < share.own).all(axis=0))
    found: Bools = own[part.first + part.site[which]] & held[part.element[which]].all(axis=(1, 2))
    return found


def _some(made: list[Part], chosen: list[Longs]) -> list[Part]:
    """The parts with some of their bonds, of their balls; those with none are left out."""
    out: list[Part] = []
    for part, which in zip(made, chosen, strict=True):
        if not len(which):
            continue
        if isinstance(part, PairBonds):
            out.append(part if len(which) == part.nbonds else part.pick(which))
        else:
            out.append(part if len(which) == len(part.site) else part.pick(which))
    return out
