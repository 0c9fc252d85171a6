"""Parts of a bond list: some bonds in a few numbers each, and what can be made of them.

A bond joins a sample x to a point y, another sample or a point in an element. Both kinds answer the same questions:
the bond vectors, P1 values at both ends, and the sparse incidence from which every operator is built.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import scipy.sparse as sparse

from .._scaling import whole_power
from .._types import Bools, Csr, Floats, Ints, Longs
from ..geometry.rays import Tracer
from .samples import Samples

BLOCK = 1 << 17  # bonds of a part: large enough to outweigh the calls, small enough to stay in cache


@dataclass(frozen=True, eq=False)
class PairPart:
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
        volume = self.samples.volume
        both = np.full(len(i), 2.0)
        if self.reach > 0.0:
            both = rim_share(np.linalg.norm(self.vectors(), axis=1), self.reach, self.samples.size, i, j)
        weight: Floats = volume[i] * volume[j] * both
        return weight

    def with_weight(self, weight: Floats) -> PairPart:
        return dataclasses.replace(self, given=weight)

    def pick(self, which: Longs) -> PairPart:
        """Return the part with only some of its bonds, listed in order."""
        given = None if self.given is None else self.given[which]
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
        data = np.empty((n, 2))
        data[:, 0], data[:, 1] = sign, 1.0
        rows = np.arange(n + 1, dtype=np.int32) * 2
        return sparse.csr_matrix((data.ravel(), self.ends.ravel(), rows), shape=(n, self.width))

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


@dataclass(frozen=True, eq=False)
class Fan:
    """What all ball bonds share: unit ``directions`` (ndir, dim), radial ``nodes`` (2, nrad) as fractions of a ray's
    reach (rays of full length, rays cut short) with their ``shares`` (2, ndir, nrad) of ``volume reach^d``, the
    elements, and where the vertices are among the samples."""

    directions: Floats
    nodes: Floats
    shares: Floats
    horizon: float
    tracer: Tracer
    corners: Ints  # (nelements, dim + 1), samples of the vertices

    def is_cut(self, reach: Floats) -> Bools:
        """Return which rays end at the boundary."""
        return reach < self.horizon

    def distances(self, reach: Floats) -> Floats:
        """Return the lengths of the bonds on rays (n, ndir), (n, ndir, nrad)."""
        return reach[:, :, None] * self.nodes[self.is_cut(reach).astype(np.intp)]

    def weights(self, reach: Floats, volume: Floats) -> Floats:
        """Return the weights of the bonds on rays (n, ndir) from sites of some volume (n,), (n, ndir, nrad)."""
        share = self.shares[self.is_cut(reach).astype(np.intp), np.arange(len(self.directions))]
        share *= (volume[:, None] * whole_power(reach, self.directions.shape[1]))[:, :, None]
        return share


@dataclass(frozen=True, eq=False)
class BallPart:
    """Bonds from some sites along the rays of a fan: ``y = x + reach node direction`` in ``element``.

    ``site`` (nsites,) sample numbers less ``first``; ``reach`` (nsites, ndir); ``element`` (nsites, ndir, nrad) of the
    mesh. ``given`` holds the weights where they are none of the rule's own, which are made when asked for. 4 bytes a
    bond, 8 a ray, and 8 for a given weight.
    """

    samples: Samples
    fan: Fan
    first: int
    width: int
    site: Ints
    reach: Floats
    element: Ints
    given: Floats | None = None

    @property
    def nbonds(self) -> int:
        return self.element.size

    @property
    def weight(self) -> Floats:
        """Weights of the plain double integral, (nbonds,)."""
        if self.given is not None:
            return self.given
        which = np.searchsorted(self.samples.sites, self.first + self.site)
        return self.fan.weights(self.reach, self.samples.volume[which]).ravel()

    def with_weight(self, weight: Floats) -> BallPart:
        return dataclasses.replace(self, given=weight)

    @property
    def nbytes(self) -> int:
        """Memory of the list."""
        given = 0 if self.given is None else self.given.nbytes
        return self.site.nbytes + self.reach.nbytes + self.element.nbytes + given

    @property
    def per_site(self) -> int:
        return int(np.prod(self.element.shape[1:]))

    def vectors(self) -> Floats:
        """Return ``xi = y - x``, (nbonds, dim)."""
        r = self.fan.distances(self.reach)
        return (r[..., None] * self.fan.directions[:, None, :]).reshape(-1, self.fan.directions.shape[1])

    def barycentric(self) -> Floats:
        """Return the barycentric coordinates of y in its element, (nbonds, dim + 1)."""
        x = np.repeat(self.samples.points[self.first + self.site], self.per_site, axis=0)
        return self.fan.tracer.barycentric(self.element.ravel(), x + self.vectors())

    def incidence(self, sign: float = -1.0) -> Csr:
        """Return the matrix that takes samples of the window to ``v(y) + sign v(x)``, csr (nbonds, width)."""
        n, corners = self.nbonds, self.fan.corners.shape[1]
        data = np.empty((n, corners + 1))
        data[:, 0] = sign
        data[:, 1:] = self.barycentric()
        columns = np.empty((n, corners + 1), dtype=np.int32)
        columns[:, 0] = np.repeat(self.site, self.per_site)
        columns[:, 1:] = self.fan.corners.take(self.element.ravel(), axis=0)
        columns[:, 1:] -= np.int32(self.first)
        rows = np.arange(n + 1, dtype=np.int32) * (corners + 1)
        return sparse.csr_matrix((data.ravel(), columns.ravel(), rows), shape=(n, self.width))

    def sides(self) -> tuple[Ints, Floats, Ints, Floats]:
        """Return vertices of the mesh and P1 values at x and at y, each (nbonds, k)."""
        s, x = self.samples, np.repeat(self.first + self.site, self.per_site)
        corners = s.vertices[self.fan.corners.take(self.element.ravel(), axis=0), 0]
        return s.vertices[x], s.values[x], corners, self.barycentric()

    def near(self, field: Floats) -> Floats:
        """Return a field of samples at x, (nbonds,)."""
        return np.repeat(field[self.first + self.site], self.per_site)

    def far(self, field: Floats) -> Floats:
        """Return a field of samples at y, (nbonds,)."""
        corners = field[self.fan.corners].take(self.element.ravel(), axis=0)
        value: Floats = np.einsum("nk,nk->n", corners, self.barycentric())
        return value

    def holders(self, at_samples: Longs, in_elements: Longs) -> tuple[Longs, Longs]:
        """Return marks at x and at y, each (nbonds,): of samples, and where an end is none, of its element."""
        return np.repeat(at_samples[self.first + self.site], self.per_site), in_elements[self.element.ravel()]


Part: TypeAlias = PairPart | BallPart


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


def rows_of(starts: Longs, most: int = BLOCK) -> list[slice]:
    """Split items with running counts ``starts`` (n + 1,) into runs of at most ``most`` counts (at least one item).

    >>> rows_of(np.array([0, 3, 6, 9]), most=6)
    [slice(0, 2, None), slice(2, 3, None)]
    """
    out, low, n = [], 0, len(starts) - 1
    while low < n:
        high = int(np.searchsorted(starts, starts[low] + most, side="right")) - 1
        high = min(n, max(high, low + 1))
        out.append(slice(low, high))
        low = high
    return out
