"""Weights that give a bond list wanted moments at the vertices: a constrained fit, sparse and matrix-free.

New weights are ``w0 ratio(s)`` with ``ratio(s) = s + sqrt(1 + s^2)``, positive whatever s. With ``s = C^T y``, C the
map from weights to moments, meeting the moments makes y the stationary point of a convex function; Newton goes
there, each step one least-squares problem.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import LinearOperator, lsmr

from .._types import Bools, Csr, Floats
from ..geometry.tensors import powers
from .bond_list import BondList
from .rule import Part

_LOOSE = 1e-3  # relative accuracy of a Newton step
_FLAT = 1e-10  # of the largest eigenvalue of a vertex's block: directions without bonds
_SWEEPS = 300  # LSMR iterations of a step


@dataclass(frozen=True, eq=False)
class MomentMap:
    """A part of the bonds: hats at x minus hats at y and their sum, (nbonds, nvertices); factors of the moments."""

    minus: Csr
    plus: Csr
    three: Floats
    four: Floats

    def moments(self, w: Floats) -> Floats:
        return np.hstack([self.minus.T @ (self.three * w[:, None]), self.plus.T @ (self.four * w[:, None])])

    def gathered(self, y: Floats) -> Floats:
        """The transpose: what each bond gathers of multipliers (nvertices, n3 + n4)."""
        n3 = self.three.shape[1]
        total: Floats = np.einsum("nk,nk->n", self.minus @ y[:, :n3], self.three)
        total += np.einsum("nk,nk->n", self.plus @ y[:, n3:], self.four)
        return total

    def blocks(self, w: Floats) -> Floats:
        """``sum w a a^T`` over the bonds for the rows a of each vertex, (nvertices, n3 + n4, n3 + n4)."""
        n3, n4 = self.three.shape[1], self.four.shape[1]
        out = np.zeros((self.minus.shape[1], n3 + n4, n3 + n4))
        rows = (self.minus, self.three, slice(0, n3)), (self.plus, self.four, slice(n3, n3 + n4))
        for C, f, at in rows:
            for D, g, to in rows:
                if at.start > to.start:
                    continue
                # only the diagonal block of each vertex: products of its own hat functions
                product = sparse.csr_matrix(C.multiply(D))
                for k in range(f.shape[1]):
                    out[:, at.start + k, to] += product.T @ (g * (w * f[:, k])[:, None])
        out[:, n3:, :n3] = np.swapaxes(out[:, :n3, n3:], 1, 2)
        return out


def moment_map(bonds: BondList, part: Part) -> MomentMap:
    P = bonds.samples.matrix[part.first : part.first + part.width]
    minus, plus = (sparse.csr_matrix(part.incidence(sign) @ P) for sign in (-1.0, 1.0))
    xi = part.vectors()
    r = np.linalg.norm(xi, axis=1)
    e = xi / np.where(r > 0.0, r, 1.0)[:, None]
    share = bonds.influence_of(part) * bonds.boundary_share_of(part)
    return MomentMap(-minus, plus, powers(e, 3) * share[:, None], powers(e, 4) * (share * r / bonds.horizon)[:, None])


@dataclass(frozen=True, eq=False)
class MomentFit:
    """Find ratios of new to old weights that give all bonds together the target moments at the active rows."""

    pieces: list[MomentMap]
    weights: list[Floats]
    target: Floats
    active: Bools
    largest: float

    def missed(self, s: list[Floats]) -> Floats:
        """What the weights ``w0 ratio(s)`` miss, (nvertices, n3 + n4)."""
        total = summed(p.moments(w * ratio_of(x)) for p, w, x in zip(self.pieces, self.weights, s, strict=True))
        return (self.target - total) * self.active

    def solve(self, reached: float, damp: float = 0.0, rounds: int = 15) -> tuple[list[Floats], Floats, int]:
        """Newton's method. Return s, what is missed and the iterations."""
        s = [np.zeros(len(w)) for w in self.weights]
        missed, iterations = self.missed(s), 0
        for _ in range(rounds):
            worst = float(np.abs(missed).max(initial=0.0)) / self.largest
            if worst <= reached:
                break
            # an inexact step: as close as the next one can make use of
            step, count = self._step(s, missed, max(0.1 * reached / worst, _LOOSE), damp)
            iterations += count
            length = 1.0
            # halve the step until it gains at least a tenth of what a linear problem would
            while length > 0.01:
                trial = [x + length * d for x, d in zip(s, step, strict=True)]
                left = self.missed(trial)
                if np.linalg.norm(left) < (1.0 - 0.1 * length) * np.linalg.norm(missed):
                    break
                length *= 0.5
            else:
                break
            s, missed = trial, left
        return s, missed, iterations

    def _step(self, s: list[Floats], missed: Floats, close: float, damp: float) -> tuple[list[Floats], int]:
        slopes = [w * slope_of_ratio(x) for w, x in zip(self.weights, s, strict=True)]
        # in z = step / sqrt(slope) the smallest change of the weights, relative to them, is the least-squares solution
        roots = [np.sqrt(w) for w in slopes]
        ends = np.cumsum([len(w) for w in slopes])[:-1]
        # scaled from the left by the inverse roots of their blocks, the rows of a vertex are orthonormal: LSMR works on
        # what couples vertices alone
        half = self._half_inverse(slopes)

        def forward(z: Floats) -> Floats:
            parts = np.split(z.ravel(), ends)
            total = summed(p.moments(r * x) for p, r, x in zip(self.pieces, roots, parts, strict=True))
            scaled: Floats = np.einsum("nij,nj->ni", half, total).ravel()
            return scaled

        def backward(y: Floats) -> Floats:
            spread = np.einsum("nji,nj->ni", half, y.reshape(missed.shape))
            return np.concatenate([r * p.gathered(spread) for p, r in zip(self.pieces, roots, strict=True)])

        A = LinearOperator((missed.size, sum(map(len, roots))), matvec=forward, rmatvec=backward, dtype=float)
        right = np.einsum("nij,nj->ni", half, missed).ravel()
        # a damped problem is not solved to nothing: there the gradient tells when it is done
        z, _, count, *_ = lsmr(
            A, right, damp=damp, atol=_LOOSE if damp else 0.0, btol=close, conlim=0.0, maxiter=_SWEEPS
        )
        step = [x / np.where(r > 0.0, r, 1.0) for x, r in zip(np.split(z, ends), roots, strict=True)]
        return step, count

    def _half_inverse(self, slopes: list[Floats]) -> Floats:
        """Of each vertex the inverse square root of its own block, on its active rows."""
        blocks = summed(p.blocks(w) for p, w in zip(self.pieces, slopes, strict=True))
        blocks = blocks * (self.active[:, :, None] & self.active[:, None, :])
        lam, V = np.linalg.eigh(blocks)
        inverse = np.zeros_like(lam)
        np.divide(1.0, np.sqrt(np.maximum(lam, 0.0)), out=inverse, where=lam > _FLAT * lam[:, -1:])
        return np.swapaxes(V * inverse[:, None, :], 1, 2)


def summed(parts: Iterable[Floats]) -> Floats:
    return reduce(np.add, parts)


def ratio_of(s: Floats) -> Floats:
    """The ratio of new to old weights, ``s + sqrt(1 + s^2)``: positive, ``1 + s`` for small s, straight for large.

    >>> ratio_of(np.array([-0.75, 0.0, 0.75])).tolist()
    [0.5, 1.0, 2.0]
    """
    root = np.sqrt(1.0 + s * s)
    # the other form where the terms would cancel
    return np.where(s > 0.0, s + root, 1.0 / (root - np.minimum(s, 0.0)))


def slope_of_ratio(s: Floats) -> Floats:
    """The derivative of :func:`ratio_of`."""
    return ratio_of(s) / np.sqrt(1.0 + s * s)
