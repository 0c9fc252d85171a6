"""Blocks of bonds, the unit in which the model computes.

With ``T = B U`` the scaled strains of the bonds (``T = sqrt(r) S``, linear in the sampled values), every operator is

    energy   sum k F1(T)          force  -B^T (k F1'(T))          tangent  B^T diag(k F1''(T)) B

so a block is a part of the bond list with its measures k and a law. For a directed rule the force acts on x only, and
twice the rows of x stand in for B^T. The matrix B takes several times the memory of the list; it is kept where that is
allowed, and remade from the list at every use where it is not: the same formulas, the same bits.

Blocks are fixed at set-up, each writes to a window of its own and the windows are added in order: the result has the
same bits for any number of threads. SciPy's products and NumPy's loops release the interpreter lock, so blocks run in
threads.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs
from ..bonds.ball_bonds import BallBonds
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_bonds import PairBonds
from ..bonds.rule import Part
from ..material.potential import Potential

_T = TypeVar("_T")

Pressure: TypeAlias = Callable[[Floats], Floats]  # of the virial, (nvertices,) both


class Beside(NamedTuple):
    """What stands beside the bonds in a tangent, ``R^T diag(stiffness) R``; R is by ``rates`` (None: at rest).

    Over ranks ``whole`` adds up what all have of a virial, and brings the product to ghosts, too.
    """

    rates: Sequence[Floats] | None
    stiffness: Floats
    whole: Pressure | None = None

    def pressure(self, virial: Floats) -> Floats:
        """Return the stiffness times a virial."""
        return self.stiffness * virial if self.whole is None else self.whole(virial)


@dataclass(frozen=True, eq=False)
class Block:
    """Some bonds of one law: those of a part, or the ones that ``which`` lists.

    It may ``keep`` its matrices and ``store`` its measures; those that are its ``own`` may change.
    """

    law: Potential
    part: Part
    bonds: BondBasis
    which: Longs | None
    keep: bool
    store: bool
    own: bool = False

    @property
    def symmetric(self) -> bool:
        return self.bonds.rule.symmetric

    @property
    def k(self) -> Floats:
        """The measures of the bonds."""
        measures: Floats | None = self.__dict__.get("_k")
        if measures is None:
            measures = self.bonds.measure_of(self.part)
            measures = measures if self.which is None else measures[self.which]
            if self.store:
                self.__dict__["_k"] = measures
        return measures

    @property
    def rest_stiffness(self) -> Floats:
        """``2 f'(0) k``, the second derivative of each bond's energy by T at rest, (nbonds,)."""
        return 2.0 * self.law.slope * self.k

    def owned(self) -> Block:
        """Return the same block with measures of its own, which may be changed."""
        copy = dataclasses.replace(self, store=True, own=True)
        copy.__dict__["_k"] = np.array(self.k)
        return copy

    def some(self, which: Longs) -> Block:
        """Return a block of some of the bonds, with the measures they have while they are whole."""
        inside = which if self.which is None else self.which[which]
        if isinstance(self.part, PairBonds):
            # pairs are listed by rows: a part of them must be in that order
            order = np.argsort(inside, kind="stable")
            return Block(self.law, self.part.pick(inside[order]), self.bonds, None, keep=False, store=False)
        return Block(self.law, self.part, self.bonds, inside, keep=False, store=False)

    def beyond(self, T: Floats, at: float, bonds: slice = slice(None)) -> Longs:
        """Return which bonds, of those that are there, are beyond ``at`` times their critical strain.

        T is that of all bonds, or of some in a row.
        """
        numbers = np.flatnonzero((self.law.severity(T) > at) & (self.k[bonds] > 0.0))
        return np.asarray(numbers + (bonds.start or 0), dtype=np.int64)

    @property
    def window(self) -> slice:
        """The samples that the block reads and writes."""
        return slice(self.part.first, self.part.first + self.part.width)

    def incidence(self, sign: float = -1.0) -> Csr:
        """Return the matrix of ``v(y) + sign v(x)`` on the window, csr (nbonds, width)."""
        C = self.part.incidence(sign)
        return C if self.which is None else C[self.which]

    def directions(self) -> Floats:
        """``e / sqrt(r)`` of each bond, (nbonds, dim); 0 where a ray left the body at once."""
        xi = self.part.vectors() if self.which is None else self.part.vectors()[self.which]
        r2 = np.einsum("nd,nd->n", xi, xi)
        # T = sqrt(r) S = xi.(u_y - u_x) / r^(3/2)
        root = np.sqrt(r2)
        root *= np.sqrt(root)
        xi /= np.where(root > 0.0, root, 1.0)[:, None]
        return xi

    def roots(self) -> Floats:
        """``sqrt(r)`` of each bond, (nbonds,)."""
        xi = self.part.vectors() if self.which is None else self.part.vectors()[self.which]
        squared: Floats = np.einsum("nd,nd->n", xi, xi)
        return np.sqrt(np.sqrt(squared, out=squared), out=squared)

    def both_ends(self) -> tuple[Csr, Floats]:
        """The matrix of ``p(x) + p(y)`` on the window and ``sqrt(r)``: what the energy beside the bonds needs."""
        if not self.keep:
            return self.incidence(1.0), self.roots()
        kept: tuple[Csr, Floats] | None = self.__dict__.get("_both")
        if kept is None:
            kept = self.incidence(1.0), self.roots()
            self.__dict__["_both"] = kept
        return kept

    def _make(self) -> tuple[Csr, sparse.csc_matrix]:
        """B, and the matrix that spreads bond forces: its transpose, or that of twice its columns of x."""
        C, p = self.incidence(), self.directions()
        n, dim = p.shape
        columns = C.indices.reshape(n, -1)
        B = _times(C.data.reshape(n, -1), columns, p, self.part.width * dim)
        if self.symmetric:
            return B, B.T
        return B, _times(np.full((n, 1), -2.0), columns[:, :1], p, self.part.width * dim).T

    def matrices(self) -> tuple[Csr, sparse.csc_matrix]:
        """Return B and X^T: strains are ``B u``, forces ``-X^T g``; X is B for a symmetric rule."""
        if not self.keep:
            return self._make()
        kept: tuple[Csr, sparse.csc_matrix] | None = self.__dict__.get("_kept")
        if kept is None:
            kept = self._make()
            self.__dict__["_kept"] = kept
        return kept

    def strains(self, u: Floats) -> Floats:
        """Scaled strains T of the bonds for all samples u, (nsamples, dim)."""
        T: Floats = self.matrices()[0] @ u[self.window].ravel()
        return T

    def energy(self, u: Floats) -> float:
        return float(self.k @ self.law.energy(self.strains(u)))

    def force(self, u: Floats) -> Floats:
        """Minus the force on the samples of the window, (width, dim)."""
        B, XT = self.matrices()
        g = self.law.gradient(B @ u[self.window].ravel())
        g *= self.k
        F: Floats = XT @ g
        return F.reshape(self.part.width, -1)

    def virial(self, u: Floats) -> Floats:
        """``sum k sqrt(r) F1'(T) / 2`` over the bonds that end in each sample of the window, (width,)."""
        C, root = self.both_ends()
        pull = self.law.gradient(self.strains(u))
        pull *= self.k * root
        out: Floats = C.T @ pull
        out *= 0.5
        return out

    def pressed_force(self, u: Floats, p: Floats) -> Floats:
        """Minus the force on the samples of the window with the pressure of the dilatation, (width, dim)."""
        B, XT = self.matrices()
        T = B @ u[self.window].ravel()
        g = self.tension(T, p)
        F: Floats = XT @ g
        return F.reshape(self.part.width, -1)

    def tension(self, T: Floats, p: Floats | None = None) -> Floats:
        """``k (F1' + sqrt(r) F1'' (p_x + p_y) / 2)``: what each bond pulls with, by T; p is that of all samples."""
        g = self.law.gradient(T)
        if p is not None:
            g += self.rates(T, measured=False) * self.pressures(p)
        g *= self.k
        return g

    def pressed_hessian(self, T: Floats, p: Floats) -> Floats:
        """The derivative of :meth:`tension` by T, the pressure held."""
        h = self.law.third(T)
        h *= 0.5 * self.both_ends()[1]
        h *= self.pressures(p)
        h += self.law.hessian(T)
        h *= self.k
        return h

    def pressures(self, p: Floats) -> Floats:
        """``p_x + p_y`` of each bond."""
        pressed: Floats = self.both_ends()[0] @ p[self.window]
        return pressed

    def rates(self, T: Floats | None, measured: bool = True) -> Floats:
        """``k sqrt(r) F1''(T) / 2``: what a bond adds to the virial of its ends by its T; at rest without one."""
        rate = 0.5 * self.both_ends()[1]
        rate *= 2.0 * self.law.slope if T is None else self.law.hessian(T)
        if measured:
            rate *= self.k
        return rate

    def dilate(self, rate: Floats, v: Floats) -> Floats:
        """``sum rate T`` over the bonds that end in each sample of the window, (width,)."""
        out: Floats = self.both_ends()[0].T @ (rate * self.strains(v))
        return out

    def squeeze(self, rate: Floats, q: Floats) -> Floats:
        """The transpose of :meth:`dilate`, (width, dim)."""
        out: Floats = self.matrices()[1] @ (rate * self.pressures(q))
        return out.reshape(self.part.width, -1)

    def product(self, weight: Floats, v: Floats, transposed: bool = False) -> Floats:
        """``X^T diag(weight) B v`` on the window, or its transpose."""
        B, XT = self.matrices()
        if transposed:
            B, XT = XT.T, B.T
        T = B @ v[self.window].ravel()
        T *= weight
        out: Floats = XT @ T
        return out.reshape(self.part.width, -1)


def _times(value: Floats, columns: Floats, p: Floats, width: int) -> Csr:
    """Rows ``value_k p_a`` at the degrees of freedom ``(column_k, a)``."""
    n, dim = p.shape
    # component by component, -x before y: a translation of vertices then cancels exactly, not to round-off
    products = p[:, :, None] * value[:, None, :]
    place = columns[:, None, :] * np.int32(dim) + np.arange(dim, dtype=np.int32)[:, None]
    rows = np.arange(n + 1, dtype=np.int32) * np.int32(products[0].size)
    return sparse.csr_matrix((products.ravel(), place.ravel(), rows), shape=(n, width))


def make_blocks(
    bonds: BondBasis, laws: Sequence[tuple[Potential, Callable[[Part], Longs | None]]], keep: bool, store: bool
) -> Iterator[Block]:
    """Yield blocks, law by law: each law comes with the function that picks its bonds of a part (None: all).

    Where pairs can have measure zero, as the boundary function and influences that end early make them, these are left
    out.
    """
    for law, pick in laws:
        for part in bonds.parts:
            which = pick(part)
            if isinstance(part, PairBonds) and bonds.may_vanish:
                dead = bonds.measure_of(part) == 0.0
                if dead.any():
                    which = np.flatnonzero(~dead) if which is None else which[~dead[which]]
            if which is None or len(which):
                yield Block(law, part, bonds, which, keep, store)


def matrix_bytes(nbonds: int, dim: int, kind: type[Part], dilated: bool = False) -> int:
    """Return the memory that the matrices B of so many bonds take, and those that sum both ends for a dilatation.

    >>> matrix_bytes(1000, dim=2, kind=PairBonds), matrix_bytes(1000, dim=2, kind=BallBonds)
    (52000, 100000)
    >>> matrix_bytes(1000, dim=2, kind=PairBonds, dilated=True)
    88000
    """
    ends = dim + 2 if kind is BallBonds else 2
    both = (8 + 4) * ends + 4 + 8 if dilated else 0
    return nbonds * (dim * ends * (8 + 4) + 4 + both)
