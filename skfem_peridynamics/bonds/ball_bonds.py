"""Bonds along the rays of balls: far ends are points in elements."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from .._scaling import whole_power
from .._types import Bools, Csr, Floats, Ints, Longs
from ..geometry.rays import Tracer
from .samples import Samples


@dataclass(frozen=True, eq=False)
class BallStencil:
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
class BallBonds:
    """Bonds from some sites along the rays of a fan: ``y = x + reach node direction`` in ``element``.

    ``site`` (nsites,) sample numbers less ``first``; ``reach`` (nsites, ndir); ``element`` (nsites, ndir, nrad) of the
    mesh. ``given`` holds the weights where they are none of the rule's own, which are made when asked for. 4 bytes a
    bond, 8 a ray, and 8 for a given weight.
    """

    samples: Samples
    stencil: BallStencil
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
        # sites are in order, and a part has a run of them: their volumes are found by bisection
        which = np.searchsorted(self.samples.sites, self.first + self.site)
        return self.stencil.weights(self.reach, self.samples.volume[which]).ravel()

    def with_weight(self, weight: Floats) -> BallBonds:
        return dataclasses.replace(self, given=weight)

    def pick(self, which: Longs) -> BallBonds:
        """Return the part with only some of its sites, listed in order."""
        given = None if self.given is None else self.given.reshape(len(self.site), -1)[which].ravel()
        site, reach, element = self.site[which], self.reach[which], self.element[which]
        return dataclasses.replace(self, site=site, reach=reach, element=element, given=given)

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
        r = self.stencil.distances(self.reach)
        return (r[..., None] * self.stencil.directions[:, None, :]).reshape(-1, self.stencil.directions.shape[1])

    def barycentric(self) -> Floats:
        """Return the barycentric coordinates of y in its element, (nbonds, dim + 1)."""
        x = np.repeat(self.samples.points[self.first + self.site], self.per_site, axis=0)
        return self.stencil.tracer.barycentric(self.element.ravel(), x + self.vectors())

    def incidence(self, sign: float = -1.0) -> Csr:
        """Return the matrix that takes samples of the window to ``v(y) + sign v(x)``, csr (nbonds, width)."""
        n, corners = self.nbonds, self.stencil.corners.shape[1]
        values = np.empty((n, corners + 1))
        values[:, 0] = sign
        values[:, 1:] = self.barycentric()
        columns = np.empty((n, corners + 1), dtype=np.int32)
        columns[:, 0] = np.repeat(self.site, self.per_site)
        columns[:, 1:] = self.stencil.corners.take(self.element.ravel(), axis=0)
        # numbers within the window that this part reads and writes
        columns[:, 1:] -= np.int32(self.first)
        rows = np.arange(n + 1, dtype=np.int32) * (corners + 1)
        return sparse.csr_matrix((values.ravel(), columns.ravel(), rows), shape=(n, self.width))

    def sides(self) -> tuple[Ints, Floats, Ints, Floats]:
        """Return vertices of the mesh and P1 values at x and at y, each (nbonds, k)."""
        s, x = self.samples, np.repeat(self.first + self.site, self.per_site)
        corners = s.vertices[self.stencil.corners.take(self.element.ravel(), axis=0), 0]
        return s.vertices[x], s.values[x], corners, self.barycentric()

    def near(self, field: Floats) -> Floats:
        """Return a field of samples at x, (nbonds,)."""
        return np.repeat(field[self.first + self.site], self.per_site)

    def far(self, field: Floats) -> Floats:
        """Return a field of samples at y, (nbonds,)."""
        corners = field[self.stencil.corners].take(self.element.ravel(), axis=0)
        value: Floats = np.einsum("nk,nk->n", corners, self.barycentric())
        return value

    def holders(self, at_samples: Longs, in_elements: Longs) -> tuple[Longs, Longs]:
        """Return marks at x and at y, each (nbonds,): of samples, and where an end is none, of its element."""
        return np.repeat(at_samples[self.first + self.site], self.per_site), in_elements[self.element.ravel()]
