"""Balanced weights of vertex pairs for the price of some forces.

The new weights are ``w ratio(s)``, positive whatever s, and s is what the bonds gather of multipliers at their ends.
Conjugate gradients find these from the normal equations, with one constant matrix over the weight at a vertex as the
preconditioner: six iterations do nearly all that can be done. Near the boundary, where positive weights cannot meet
all moments, the equations are damped.
"""

from __future__ import annotations

import numpy as np

from .._types import Bools, Floats
from .bond_list import Balance, BondList
from .facet_targets import facet_targets
from .moment_fit import ratio_of
from .moment_targets import Targets, moment_targets
from .pair_moments import PairMoments

_ITERATIONS = 6  # of conjugate gradients; twelve change no error of the study by more than a tenth in 2D
_ROUNDS = {2: 1, 3: 2}
_DAMP = 0.03  # of the weight at a vertex near the boundary
_FAR = 50.0  # factor by which a weight may change at all
_ENOUGH = 2.75  # bonds for each moment of order three and four
_COLUMNS = {2: 9, 3: 25}  # moments of order three and four
_MET = 0.05  # of the largest moment: above this a vertex counts as unbalanced
_EXACT, _ROUNDS_EXACT, _MOST = 1e-10, 8, 100  # of the largest moment; Newton steps, iterations of a step
_LOOSE = 1e-3  # relative accuracy of a Newton step


def balance_pairs(bonds: BondList, exact: bool) -> Balance:
    """Return balanced weights of vertex pairs; ``exact`` has moments of order three met to round-off inside."""
    four = bonds.dim < 3 and bonds.nbonds >= _ENOUGH * bonds.mesh.nvertices * _COLUMNS[bonds.dim]
    targets = facet_targets(bonds, four) if bonds.vertex_weight is None else moment_targets(bonds)
    moments = PairMoments(bonds, four)
    weights = moments.own_weights()
    order = bonds.samples.vertices[:, 0]
    target = targets.values[order][:, : moments.columns] * moments.roots
    near = targets.near_boundary[order]
    now = moments.moments(weights)
    largest = float(np.abs(now / moments.roots).max(initial=0.0))
    if not largest > 0.0:
        raise ValueError("no bond has any measure: there is nothing to balance")
    sampled = moments.degree(weights) > 0.0
    rows = np.repeat(sampled[:, None], moments.columns, axis=1)
    rows[:, moments.three :] &= _four_known(targets)[order][:, None]
    new, count = weights, 0
    for _ in range(getattr(bonds.rule, "rounds", _ROUNDS[bonds.dim])):
        y, taken = _solve(moments, new, (target - now) * rows, rows, np.where(near, _DAMP, 0.0), _ITERATIONS)
        count += taken
        new = [w * ratio_of(s) for w, s in zip(new, moments.gathered(y), strict=True)]
        now = moments.moments(new)
    ratios = _ratios(new, weights)
    if exact or not _within(ratios):
        new = new if _within(ratios) else weights
        new, taken = _exactly(moments, new, target, rows & ~near[:, None], largest)
        count += taken
        ratios = _ratios(new, weights)
    if not _within(ratios):  # no positive weights near the rule's do it: leave them alone
        new, ratios = weights, [np.ones_like(w) for w in weights]
    left = np.abs((target - moments.moments(new)) * sampled[:, None] / moments.roots)[:, : moments.three].max(axis=1)
    left /= largest
    ratio = np.concatenate(ratios)
    return Balance(
        new,
        np.sort(order[np.flatnonzero(left > _MET)]).astype(np.int64),
        float(left[~near].max(initial=0.0)),
        float(left.max()),
        float(ratio.min()),
        float(np.sqrt(np.mean((ratio - 1.0) ** 2))),
        count,
    )


def _four_known(targets: Targets) -> Bools:
    """Where moments of order four are known: everywhere by facets, inside by rays."""
    known: Bools = (targets.values[:, -1] != 0.0) if targets.four_everywhere else targets.exact_four
    return known


def _solve(
    moments: PairMoments, w: list[Floats], right: Floats, rows: Bools, damp: Floats, most: int, close: float = 0.0
) -> tuple[Floats, int]:
    """Solve ``(C W C^T + damp) y = right`` by conjugate gradients; return y and the iterations."""
    weight = moments.degree(w)
    scale = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)[:, None]
    damping = (damp * weight)[:, None]

    def preconditioned(r: Floats) -> Floats:
        z: Floats = np.einsum("ni,ij->nj", r, moments.inverse) * scale * rows
        return z

    y, r = np.zeros_like(right), right * rows
    z = preconditioned(r)
    p, size = z, _dot(r, z)
    first, taken = size, 0
    while taken < most and size > close**2 * first:
        q = moments.moments([a * s for a, s in zip(w, moments.gathered(p), strict=True)]) * rows + damping * p
        length = size / _dot(p, q)
        y, r = y + length * p, r - length * q
        z = preconditioned(r)
        before, size = size, _dot(r, z)
        p = z + (size / before) * p
        taken += 1
    return y, taken


def _dot(a: Floats, b: Floats) -> float:
    """By NumPy: BLAS would wake threads for it, whose sums depend on how many there are."""
    return float((a * b).sum())


def _exactly(
    moments: PairMoments, w: list[Floats], target: Floats, rows: Bools, largest: float
) -> tuple[list[Floats], int]:
    """Newton's method for the moments of order three alone; return the weights and the iterations."""
    alone = PairMoments(moments.bonds, False)
    rows, target, count = rows[:, : alone.columns], target[:, : alone.columns], 0
    missed = (target - alone.moments(w)) * rows
    for _ in range(_ROUNDS_EXACT):
        worst = float(np.abs(missed).max(initial=0.0)) / largest
        if worst <= _EXACT:
            break
        close = max(_LOOSE, 0.1 * _EXACT / worst)
        y, taken = _solve(alone, w, missed, rows, np.zeros(len(rows)), _MOST, close)
        count += taken
        step, length = alone.gathered(y), 1.0
        while length > 0.01:  # halve the step until it gains
            trial = [a * ratio_of(length * s) for a, s in zip(w, step, strict=True)]
            left = (target - alone.moments(trial)) * rows
            if np.linalg.norm(left) < (1.0 - 0.1 * length) * np.linalg.norm(missed):
                break
            length *= 0.5
        else:
            break
        w, missed = trial, left
    return w, count


def _ratios(new: list[Floats], old: list[Floats]) -> list[Floats]:
    return [np.divide(v, w, out=np.ones_like(w), where=w > 0.0) for v, w in zip(new, old, strict=True)]


def _within(ratios: list[Floats]) -> bool:
    return all(x.min(initial=1.0) > 1.0 / _FAR and x.max(initial=1.0) < _FAR for x in ratios)
