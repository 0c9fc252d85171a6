"""Balanced weights: the least change of a symmetric rule that makes it pass the patch test on any mesh.

On an irregular mesh the far ends of bonds sample the hat functions unevenly, and a uniform strain leaves a net force at
inner vertices. At vertex i that force is a combination of the moments of order three

    sum_b weight_b g_b (phi_i(x_b) - phi_i(y_b)) = T3_i,    g_b = w(x_b) w(y_b) J e^alpha,   |alpha| = 3,

whose exact values T3 are zero where the whole ball and the elements of i lie inside, and integrals over clipped rays
near the boundary. Moments of order four with a plus sign fix the elastic constants at a vertex. Of all weights that
meet them the ones nearest to the rule's are taken, in a sense that keeps them positive:
``w = w0 (s + sqrt(1 + s^2))`` by Newton's method, each step one sparse least-squares problem (LSMR, matrix-free).

The moments of order three over all vertices are not independent: a Killing tensor Y (a product of three translations
or rotations) gives ``Y(y)[e,e,e] = Y(x)[e,e,e]`` along every bond. Targets are made compatible with them by a change
near the boundary, where they carry a quadrature error; inside they stay exact.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import LinearOperator, lsmr

from .._types import Bools, Csr, Floats, Longs
from .parts import Part
from .targets import moment_targets

if TYPE_CHECKING:
    from .bond_basis import BondBasis

_REACHED = 1e-10  # of the largest moment: what Newton's method goes for inside
_MISSED = 1e-8  # of the largest moment: above this a vertex inside counts as unbalanced
_MISSED_NEAR = 2e-2  # the same near the boundary, where targets are integrals over clipped rays
_LOOSE = 1e-3  # relative accuracy of a Newton step
_FITS, _FIT_ROUNDS = 1e-3, 3  # of the fit near the boundary: accuracy, Newton steps
_DAMPS, _MILD = (0.05, 0.2, 0.8), 5.0  # its damping: the first that changes no weight by a larger factor, if any
_FAR = 50.0  # factor by which a weight may change at all
_ENOUGH = 2.75  # bonds for each moment of order three and four
_FLAT = 1e-10  # of the largest eigenvalue of a vertex's block: directions without bonds
_SWEEPS = 300  # LSMR iterations of a step


@dataclass(frozen=True, eq=False)
class Balance:
    """Balanced weights and how they came out.

    ``weights`` by part. ``unbalanced`` lists the vertices (mesh numbers) whose moments of order three are not met: to
    1e-8 of the largest inside, to 2 % near the boundary. ``residual`` and ``residual_near`` are the largest there.
    ``smallest`` and ``rms``: ratio of new to old weights, its least (positive always) and its deviation from 1.
    """

    weights: list[Floats]
    unbalanced: Longs
    residual: float
    residual_near: float
    smallest: float
    rms: float
    iterations: int


def monomials(dim: int, order: int) -> list[tuple[int, ...]]:
    """Return the index tuples of the monomials of an order, ``e[i] e[j] ..``.

    >>> monomials(2, 3)
    [(0, 0, 0), (0, 0, 1), (0, 1, 1), (1, 1, 1)]
    """
    return list(combinations_with_replacement(range(dim), order))


def powers(e: Floats, order: int) -> Floats:
    """Return all monomials of an order of vectors (n, dim), (n, nmonomials)."""
    return np.stack([np.prod(e[:, list(index)], axis=1) for index in monomials(e.shape[1], order)], axis=1)


@dataclass(frozen=True, eq=False)
class _Piece:
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
                product = sparse.csr_matrix(C.multiply(D))
                for k in range(f.shape[1]):
                    out[:, at.start + k, to] += product.T @ (g * (w * f[:, k])[:, None])
        out[:, n3:, :n3] = np.swapaxes(out[:, :n3, n3:], 1, 2)
        return out


def _piece(bonds: BondBasis, part: Part) -> _Piece:
    P = bonds.samples.matrix[part.first : part.first + part.width]
    minus, plus = (sparse.csr_matrix(part.incidence(sign) @ P) for sign in (-1.0, 1.0))
    xi = part.vectors()
    r = np.linalg.norm(xi, axis=1)
    e = xi / np.where(r > 0.0, r, 1.0)[:, None]
    share = bonds.influence_of(part) * bonds.boundary_share_of(part)
    return _Piece(-minus, plus, powers(e, 3) * share[:, None], powers(e, 4) * (share * r / bonds.horizon)[:, None])


@dataclass(frozen=True, eq=False)
class _Problem:
    """Find ratios of new to old weights that give all bonds together the target moments at the active rows."""

    pieces: list[_Piece]
    weights: list[Floats]
    target: Floats
    active: Bools
    largest: float

    def missed(self, s: list[Floats]) -> Floats:
        """What the weights ``w0 ratio(s)`` miss, (nvertices, n3 + n4)."""
        total = _total(p.moments(w * ratio_of(x)) for p, w, x in zip(self.pieces, self.weights, s, strict=True))
        return (self.target - total) * self.active

    def solve(self, reached: float, damp: float = 0.0, rounds: int = 15) -> tuple[list[Floats], Floats, int]:
        """Newton's method. Return s, what is missed and the iterations."""
        s = [np.zeros(len(w)) for w in self.weights]
        missed, iterations = self.missed(s), 0
        for _ in range(rounds):
            worst = float(np.abs(missed).max(initial=0.0)) / self.largest
            if worst <= reached:
                break
            step, count = self._step(s, missed, max(0.1 * reached / worst, _LOOSE), damp)
            iterations += count
            length = 1.0
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
        roots = [np.sqrt(w) for w in slopes]
        ends = np.cumsum([len(w) for w in slopes])[:-1]
        half = self._half_inverse(slopes)

        def forward(z: Floats) -> Floats:
            parts = np.split(z.ravel(), ends)
            total = _total(p.moments(r * x) for p, r, x in zip(self.pieces, roots, parts, strict=True))
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
        blocks = _total(p.blocks(w) for p, w in zip(self.pieces, slopes, strict=True))
        blocks = blocks * (self.active[:, :, None] & self.active[:, None, :])
        lam, V = np.linalg.eigh(blocks)
        inverse = np.zeros_like(lam)
        np.divide(1.0, np.sqrt(np.maximum(lam, 0.0)), out=inverse, where=lam > _FLAT * lam[:, -1:])
        return np.swapaxes(V * inverse[:, None, :], 1, 2)


def _total(parts: Iterable[Floats]) -> Floats:
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


def balance(bonds: BondBasis) -> Balance:
    """Return balanced weights of a symmetric rule; see ``BondBasis.balanced``."""
    if not bonds.rule.symmetric:
        raise ValueError(f"rule = {bonds.rule.name}: a one-sided rule needs no balance, and its weights have none")
    targets = moment_targets(bonds)
    n3, n4 = (len(monomials(bonds.dim, order)) for order in (3, 4))
    pieces, weights = [_piece(bonds, part) for part in bonds.parts], [part.weight for part in bonds.parts]
    now = _total(piece.moments(w) for piece, w in zip(pieces, weights, strict=True))
    used = _total(piece.plus.T @ w for piece, w in zip(pieces, weights, strict=True)) > 0.0
    sampled = np.repeat(used[:, None], n3 + n4, axis=1)
    target = targets.values.copy()
    target[:, :n3] -= _incompatible(bonds, (target - now)[:, :n3], targets.near_boundary)
    largest, inner = float(np.abs(now).max(initial=0.0)), targets.exact_four
    if not largest > 0.0:
        raise ValueError("no bond has any measure: there is nothing to balance")
    # moments of order four only where there are bonds enough for both orders
    enough = bonds.nbonds >= _ENOUGH * target.size

    def rows(three: Bools, four: Bools) -> Bools:
        return sampled & np.hstack([np.repeat(x[:, None], k, axis=1) for x, k in ((three, n3), (four, n4))])

    # first everywhere as well as a damped fit can: near the boundary not all moments can be met by positive weights
    fit = _Problem(pieces, weights, target, rows(np.ones_like(inner), inner & enough), largest)
    iterations, new = 0, weights
    for damp in _DAMPS:
        s, _, count = fit.solve(_FITS, damp, rounds=_FIT_ROUNDS)
        iterations += count
        if _within([ratio_of(x) for x in s], _MILD):
            new = [w * ratio_of(x) for w, x in zip(weights, s, strict=True)]
            break
    # then order three exactly inside; order four stays as the fit left it
    inside = _Problem(pieces, new, target, rows(inner, np.zeros_like(inner)), largest)
    s, _, count = inside.solve(_REACHED)
    iterations += count
    changed = [w * ratio_of(x) for w, x in zip(new, s, strict=True)]
    ratios = [np.divide(v, w, out=np.ones_like(w), where=w > 0.0) for v, w in zip(changed, weights, strict=True)]
    if not _within(ratios, _FAR):  # no positive weights near the rule's do it: leave them alone
        changed, ratios = weights, [np.ones_like(w) for w in weights]
    met = _total(piece.moments(w) for piece, w in zip(pieces, changed, strict=True))
    left = np.abs((target - met) * sampled)[:, :n3].max(axis=1) / largest
    ratio = np.concatenate(ratios)
    return Balance(
        changed,
        np.flatnonzero(left > np.where(inner, _MISSED, _MISSED_NEAR)),
        float(left[inner].max(initial=0.0)),
        float(left.max()),
        float(ratio.min()),
        float(np.sqrt(np.mean((ratio - 1.0) ** 2))),
        iterations,
    )


def _within(ratios: list[Floats], factor: float) -> bool:
    return all(x.min() > 1.0 / factor and x.max() < factor for x in ratios)


def _incompatible(bonds: BondBasis, gap: Floats, layer: Bools) -> Floats:
    """The part of ``target - moments`` that no weights can mend, spread over the layer near the boundary."""
    mesh = bonds.mesh
    Y = killing_tensors(mesh.p.T)
    graph = sparse.coo_matrix(
        (np.ones(mesh.t[1:].size), (np.broadcast_to(mesh.t[0], mesh.t[1:].shape).ravel(), mesh.t[1:].ravel())),
        shape=(mesh.nvertices,) * 2,
    )
    pieces, label = connected_components(graph, directed=False)
    out = np.zeros_like(gap)
    for piece in range(pieces):
        mine = label == piece
        edge = mine & layer
        left = np.einsum("vak,va->k", Y[mine], gap[mine])
        basis = Y[edge].reshape(-1, Y.shape[2])
        amount = np.linalg.lstsq(basis.T @ basis, left, rcond=1e-10)[0]
        out[edge] = (basis @ amount).reshape(-1, gap.shape[1])
    return out


def killing_tensors(x: Floats) -> Floats:
    """Return the Killing tensors of valence three at points (n, dim), coefficients of the monomials, (n, n3, count).

    They are products of three of ``e_i`` and ``x_i e_j - x_j e_i``: 1, 10 and 50 of them in 1D, 2D and 3D (56 products
    in 3D, six of which depend on the others).
    """
    n, dim = x.shape
    x = (x - x.mean(axis=0)) / max(float(np.ptp(x, axis=0).max()), np.finfo(float).tiny)
    forms = [np.tile(unit, (n, 1)) for unit in np.eye(dim)]
    for i in range(dim):
        for j in range(i + 1, dim):
            turn = np.zeros((n, dim))
            turn[:, j], turn[:, i] = x[:, i], -x[:, j]
            forms.append(turn)
    index = monomials(dim, 3)
    place = {key: k for k, key in enumerate(index)}
    out = []
    for a, b, c in combinations_with_replacement(range(len(forms)), 3):
        tensor = np.zeros((n, len(index)))
        for i in range(dim):
            for j in range(dim):
                for k in range(dim):
                    tensor[:, place[tuple(sorted((i, j, k)))]] += forms[a][:, i] * forms[b][:, j] * forms[c][:, k]
        out.append(tensor)
    return np.stack(out, axis=2)
