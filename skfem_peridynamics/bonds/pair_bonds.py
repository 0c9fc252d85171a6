"""Parts of a bond list: some bonds in a few numbers each, and what can be made of them.

A bond joins a sample x to a point y, another sample or a point in an element. Both kinds answer the same questions:
the bond vectors, P1 values at both ends, and the sparse incidence from which every operator is built.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Ints, Longs
from .samples import Samples


@dataclass(frozen=True, eq=False)
class PairBonds:
    """Bonds between samples, by rows: sample ``first + row + i`` has the far ends ``partner[start[i] : start[i + 1]]``.

    Numbers in ``partner`` are less ``first``. ``given`` holds the weights where they are none of the rule's own; the
    rule's are made when asked for, ``volume volume`` times the share of the ends within ``reach``, 2 where that is 0.
    4 bytes a bond, and 8 for a given weight.
    """

    samples: Samples
    first: int
    width: int
    row: int
    start: Longs
    partner: Ints
    reach: float
    given: Floats | None = None

    @property
    def nbonds(self) -> int:
        return len(self.partner)

    @property
    def weight(self) -> Floats:
        """Weights of the plain double integral, (nbonds,)."""
        return self.own_weight() if self.given is None else self.given

    def own_weight(self) -> Floats:
        """Return the rule's own weights: both orders of the ends, the rim shared out (see :func:`rim_share`)."""
        ends = self.ends + np.int32(self.first)
        i, j = ends[:, 0], ends[:, 1]
        if self.reach > 0.0:
            return pair_weights(self.samples, i, j, np.linalg.norm(self.vectors(), axis=1), self.reach)
        # a pair stands for both orders of its ends
        volume = self.samples.volume
        weight: Floats = volume[i] * volume[j] * np.full(len(i), 2.0)
        return weight

    def with_weight(self, weight: Floats) -> PairBonds:
        return dataclasses.replace(self, given=weight)

    def pick(self, which: Longs) -> PairBonds:
        """Return the part with only some of its bonds, listed in order."""
        given = None if self.given is None else self.given[which]
        # rows that lose their bonds stay, with none: near ends are counted by rows
        start = np.searchsorted(which, self.start)
        return dataclasses.replace(self, start=start, partner=self.partner[which], given=given)

    @property
    def ends(self) -> Ints:
        """Both ends, sample numbers less ``first``, (nbonds, 2)."""
        near = np.repeat(np.arange(self.row, self.row + len(self.start) - 1, dtype=np.int32), np.diff(self.start))
        return np.stack([near, self.partner], axis=1)

    @property
    def nbytes(self) -> int:
        """Memory of the list."""
        return self.start.nbytes + self.partner.nbytes + (0 if self.given is None else self.given.nbytes)

    def vectors(self) -> Floats:
        """Return ``xi = y - x``, (nbonds, dim)."""
        points = self.samples.points[self.first : self.first + self.width]
        near = points[self.row : self.row + len(self.start) - 1]
        return points.take(self.partner, axis=0) - near.repeat(np.diff(self.start), axis=0)

    def incidence(self, sign: float = -1.0) -> Csr:
        """Return the matrix that takes samples of the window to ``v(y) + sign v(x)``, csr (nbonds, width)."""
        n = self.nbonds
        values = np.empty((n, 2))
        values[:, 0], values[:, 1] = sign, 1.0
        rows = np.arange(n + 1, dtype=np.int32) * 2
        return sparse.csr_matrix((values.ravel(), self.ends.ravel(), rows), shape=(n, self.width))

    def sides(self) -> tuple[Ints, Floats, Ints, Floats]:
        """Return vertices of the mesh and P1 values at x and at y, each (nbonds, k)."""
        ends = self.ends + np.int32(self.first)
        i, j = ends[:, 0], ends[:, 1]
        s = self.samples
        return s.vertices[i], s.values[i], s.vertices[j], s.values[j]

    def near(self, field: Floats) -> Floats:
        """Return a field of samples at x, (nbonds,)."""
        return field[self.first + self.ends[:, 0]]

    def far(self, field: Floats) -> Floats:
        """Return a field of samples at y, (nbonds,)."""
        return field[self.first + self.ends[:, 1]]

    def holders(self, at_samples: Longs, in_elements: Longs) -> tuple[Longs, Longs]:
        """Return marks at x and at y, each (nbonds,): of samples, and where an end is none, of its element."""
        ends = self.ends + np.int32(self.first)
        return at_samples[ends[:, 0]], at_samples[ends[:, 1]]


def pair_weights(samples: Samples, i: Longs | Ints, j: Longs | Ints, r: Floats, reach: float) -> Floats:
    """Return the weights of pairs of samples at distances r: both orders of their ends, the rim shared out."""
    weight: Floats = samples.volume[i] * samples.volume[j] * rim_share(r, reach, samples.size, i, j)
    return weight


def rim_share(r: Floats, reach: float, size: Floats, i: Longs | Ints, j: Longs | Ints) -> Floats:
    """Return which part of each end's cell is within ``reach`` of the other, both added: 2 well inside, 0 outside.

    A cell of size h at distance r counts ``clip((reach - r) / h + 1/2, 0, 1)``.

    >>> near, far, size = np.array([0, 0, 0]), np.array([1, 1, 1]), np.array([0.5, 1.0])
    >>> rim_share(np.array([0.5, 1.0, 1.25]), 1.0, size, near, far).tolist()
    [2.0, 1.0, 0.25]
    """
    share = np.zeros(len(r))
    for end in (i, j):
        share += np.clip((reach - r) / size[end] + 0.5, 0.0, 1.0)
    return share
