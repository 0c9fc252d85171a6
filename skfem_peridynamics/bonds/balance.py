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

import numpy as np

from .._types import Bools, Floats
from ..geometry.connected import connected
from ..geometry.tensors import killing_tensors, monomials
from .bond_list import Balance, BondList
from .moment_fit import MomentFit, moment_map, ratio_of, summed
from .moment_targets import moment_targets
from .pair_balance import balance_pairs
from .pair_bonds import PairBonds

_REACHED = 1e-10  # of the largest moment: what Newton's method goes for inside
_MISSED = 1e-8  # of the largest moment: above this a vertex inside counts as unbalanced
_MISSED_NEAR = 2e-2  # the same near the boundary, where targets are integrals over clipped rays
_FITS, _FIT_ROUNDS = 1e-3, 3  # of the fit near the boundary: accuracy, Newton steps
_DAMPS, _MILD = (0.05, 0.2, 0.8), 5.0  # its damping: the first that changes no weight by a larger factor
_FAR = 50.0  # factor by which a weight may change at all
_ENOUGH = 2.75  # bonds for each moment of order three and four


def balance(bonds: BondList, exact: bool = False) -> Balance:
    """Return balanced weights of a symmetric rule; see ``BondBasis.balanced``."""
    if not bonds.rule.symmetric:
        raise ValueError(f"rule = {bonds.rule.name}: a one-sided rule needs no balance, and its weights have none")
    # in one dimension what is missed near an end travels along the whole line, and a fit costs nothing
    if bonds.dim > 1 and bonds.samples.at_vertices and all(isinstance(part, PairBonds) for part in bonds.parts):
        return balance_pairs(bonds, exact)
    targets = moment_targets(bonds)
    n3, n4 = (len(monomials(bonds.dim, order)) for order in (3, 4))
    pieces, weights = [moment_map(bonds, part) for part in bonds.parts], [part.weight for part in bonds.parts]
    now = summed(piece.moments(w) for piece, w in zip(pieces, weights, strict=True))
    used = summed(piece.plus.T @ w for piece, w in zip(pieces, weights, strict=True)) > 0.0
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
    fit = MomentFit(pieces, weights, target, rows(np.ones_like(inner), inner & enough), largest)
    iterations, new = 0, weights
    for damp in _DAMPS:
        s, _, count = fit.solve(_FITS, damp, rounds=_FIT_ROUNDS)
        iterations += count
        ratios = [ratio_of(x) for x in s]
        if _within(ratios, _MILD):
            break
    if _within(ratios, _FAR):
        new = [w * x for w, x in zip(weights, ratios, strict=True)]
    # then order three exactly inside; order four stays as the fit left it
    inside = MomentFit(pieces, new, target, rows(inner, np.zeros_like(inner)), largest)
    s, _, count = inside.solve(_REACHED)
    iterations += count
    changed = [w * ratio_of(x) for w, x in zip(new, s, strict=True)]
    ratios = [np.divide(v, w, out=np.ones_like(w), where=w > 0.0) for v, w in zip(changed, weights, strict=True)]
    if not _within(ratios, _FAR):  # no positive weights near the rule's do it: leave them alone
        changed, ratios = weights, [np.ones_like(w) for w in weights]
    met = summed(piece.moments(w) for piece, w in zip(pieces, changed, strict=True))
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


def _incompatible(bonds: BondList, gap: Floats, layer: Bools) -> Floats:
    """The part of ``target - moments`` that no weights can mend, spread over the layer near the boundary."""
    mesh = bonds.mesh
    Y = killing_tensors(mesh.p.T)
    pieces, label = connected(mesh.t, mesh.nvertices)
    out = np.zeros_like(gap)
    for piece in range(pieces):
        in_piece = label == piece
        edge = in_piece & layer
        left = np.einsum("vak,va->k", Y[in_piece], gap[in_piece])
        basis = Y[edge].reshape(-1, Y.shape[2])
        amount = np.linalg.lstsq(basis.T @ basis, left, rcond=1e-10)[0]
        out[edge] = (basis @ amount).reshape(-1, gap.shape[1])
    return out
