"""Moments of bonds at the vertices, and what conjugate gradients ask of them: by sparse products, for any rule.

Columns are the monomials of order three, then four, each times the root of its multinomial coefficient, so that
nothing depends on the axes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, reduce
from math import factorial, prod

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs
from ..geometry.tensors import monomials, powers
from .bond_list import BondList
from .facet_targets import facet_targets
from .moment_targets import Targets, moment_targets
from .quadrature import sphere
from .rule import Part

_NOTHING = 1e-10  # of the largest eigenvalue of the mean over the sphere: combinations of moments that are none


@dataclass(frozen=True, eq=False)
class Moments:
    """The moments of order three, and with ``four`` of order four, of a list of bonds.

    Weights and what bonds gather are arrays by part; moments and multipliers (rows, columns), a row a vertex.
    """

    bonds: BondList
    four: bool

    @property
    def columns(self) -> int:
        return len(self.roots)

    @cached_property
    def three(self) -> int:
        return len(monomials(self.bonds.dim, 3))

    @cached_property
    def roots(self) -> Floats:
        """The root of the multinomial coefficient of each column."""
        return _roots(self.bonds.dim, self.four)

    @cached_property
    def inverse(self) -> Floats:
        """The inverse of the mean of products of the columns over all bonds of a ball, (columns, columns)."""
        dim, n3 = self.bonds.dim, self.three
        e, share = sphere(dim)
        out = np.zeros((self.columns, self.columns))
        for order, part, size in ((3, slice(0, n3), 1.0), (4, slice(n3, None), dim / (dim + 2))):
            m = powers(e, order)[:, : 0 if order == 4 and not self.four else None] * self.roots[part]
            if m.shape[1]:
                out[part, part] = np.linalg.pinv(size * (m * share[:, None]).T @ m, rcond=_NOTHING, hermitian=True)
        return out

    # ---- over the whole body
    def alone(self) -> Moments:
        """Return the same of order three alone."""
        return type(self)(self.bonds, False)

    def targets(self, by_facets: bool) -> Targets:
        """Return the exact moments at all vertices of the mesh."""
        return facet_targets(self.bonds, self.four) if by_facets else moment_targets(self.bonds)

    def dot(self, a: Floats, b: Floats) -> float:
        """Return the sum of products of rows. By NumPy: BLAS would wake threads for it, whose bits depend on them."""
        return float((a * b).sum())

    def total(self, x: float) -> float:
        """Return the sum of a number over what the body is dealt out to: here it is alone."""
        return x

    def largest(self, x: float) -> float:
        """Return the largest of a number over the same."""
        return x

    # ---- by sparse products
    @property
    def vertex(self) -> Longs:
        """The vertex of each row."""
        return np.arange(self.bonds.mesh.nvertices)

    def own_weights(self) -> list[Floats]:
        """Return the weights of the bonds as they are."""
        return [part.weight for part in self.bonds.parts]

    def moments(self, w: list[Floats]) -> Floats:
        """Return the moments of weights, (rows, columns)."""
        return summed(p.moments(x, self.four) for p, x in zip(self._pieces, w, strict=True)) * self.roots

    def gathered(self, y: Floats) -> list[Floats]:
        """Return what each bond gathers of multipliers: the transpose of :meth:`moments`."""
        scaled = y * self.roots
        return [piece.gathered(scaled, self.four) for piece in self._pieces]

    def normal(self, w: list[Floats]) -> Callable[[Floats], Floats]:
        """Return the map of the normal equations, ``y -> moments(w gathered(y))``."""
        return lambda y: self.moments([x * s for x, s in zip(w, self.gathered(y), strict=True)])

    def degree(self, w: list[Floats]) -> Floats:
        """Return ``sum w (J w(x) w(y) phi)^2`` over the bonds at each row, (rows,): the normal equations' scale."""
        roots = self.roots[: self.three]
        # the squares of the columns of order three add up to one
        shares = [((piece.three * roots) ** 2).sum(axis=1) for piece in self._pieces]
        return summed(
            p.plus.multiply(p.plus).T @ (x * share) for p, x, share in zip(self._pieces, w, shares, strict=True)
        )

    @cached_property
    def _pieces(self) -> list[_Piece]:
        return [_Piece.of(self.bonds, part) for part in self.bonds.parts]


@dataclass(frozen=True, eq=False)
class _Piece:
    """A part of the bonds: hats at x minus hats at y and their sum, (nbonds, nvertices); factors of the moments."""

    minus: Csr
    plus: Csr
    three: Floats
    fourth: Floats

    @classmethod
    def of(cls, bonds: BondList, part: Part) -> _Piece:
        P = bonds.samples.matrix[part.first : part.first + part.width]
        minus, plus = (sparse.csr_matrix(part.incidence(sign) @ P) for sign in (-1.0, 1.0))
        xi = part.vectors()
        r = np.linalg.norm(xi, axis=1)
        e = xi / np.where(r > 0.0, r, 1.0)[:, None]
        share = bonds.influence_of(part) * bonds.boundary_share_of(part)
        return cls(-minus, plus, powers(e, 3) * share[:, None], powers(e, 4) * (share * r / bonds.horizon)[:, None])

    def moments(self, w: Floats, four: bool) -> Floats:
        three: Floats = self.minus.T @ (self.three * w[:, None])
        return np.hstack([three, self.plus.T @ (self.fourth * w[:, None])]) if four else three

    def gathered(self, y: Floats, four: bool) -> Floats:
        n3 = self.three.shape[1]
        total: Floats = np.einsum("nk,nk->n", self.minus @ y[:, :n3], self.three)
        if four:
            total += np.einsum("nk,nk->n", self.plus @ y[:, n3:], self.fourth)
        return total


def summed(parts: Iterable[Floats]) -> Floats:
    return reduce(np.add, parts)


def _roots(dim: int, four: bool) -> Floats:
    """Roots of the multinomial coefficients.

    >>> _roots(2, False).round(6).tolist()
    [1.0, 1.732051, 1.732051, 1.0]
    """
    indices = monomials(dim, 3) + (monomials(dim, 4) if four else [])
    return np.sqrt([factorial(len(i)) / prod(map(factorial, Counter(i).values())) for i in indices])
