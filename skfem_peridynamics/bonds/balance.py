"""Balanced weights: the least change of a symmetric rule that makes it pass the patch test on any mesh.

On an irregular mesh the far ends of bonds sample the hat functions unevenly, and a uniform strain leaves a net force at
inner vertices. At vertex i that force is a combination of the moments of order three

    sum_b weight_b g_b (phi_i(x_b) - phi_i(y_b)) = T3_i,    g_b = w(x_b) w(y_b) J e^alpha,   |alpha| = 3,

whose exact values T3 are zero where the whole ball and the elements of i lie inside, and integrals over what the body
has of the ball near the boundary. Moments of order four with a plus sign fix the elastic constants at a vertex.

The new weights are ``w ratio(s)``, positive whatever s, and s is what the bonds gather of multipliers at their ends.
Conjugate gradients find these from the normal equations, with one constant matrix over the weight at a vertex as the
preconditioner: a few iterations do nearly all that can be done. Near the boundary, where positive weights cannot meet
all moments, the equations are damped.
"""

from __future__ import annotations

import numpy as np

from .._compile import available
from .._types import Bools, Floats
from .bond_list import Balance, BondList
from .moment_targets import Targets
from .moments import Moments
from .pair_bonds import PairBonds
from .pair_moments import PairMoments

# iterations of conjugate gradients, rounds of them, and the damping near the boundary over the weight at a vertex
_PAIRS = {2: (6, 1, 0.03), 3: (6, 2, 0.03)}
_BALLS = 12, 2, 0.03
_GAUSS = 24, 2, 0.003  # Gauss points outside, in one or two dimensions: many bonds a vertex, few of them at its edge
_FAR = 50.0  # factor by which a weight may change at all
_ENOUGH = 2.75  # bonds for each moment of order three and four
_COLUMNS = {1: 2, 2: 9}  # moments of order three and four
_MET, _MET_EXACTLY = 0.05, 1e-8  # of the largest moment: above this a vertex counts as unbalanced
_EXACT, _ROUNDS_EXACT, _MOST = 1e-10, 8, 100  # of the largest moment; Newton steps, iterations of a step
_LOOSE = 1e-3  # relative accuracy of a Newton step


def balance(bonds: BondList, exact: bool = False) -> Balance:
    """Return balanced weights of a symmetric rule; ``exact`` has moments of order three met to round-off inside.

    In one dimension they always are: what is missed travels along the whole line there, and it costs nothing.
    """
    if not bonds.rule.symmetric:
        raise ValueError(f"rule = {bonds.rule.name}: a one-sided rule needs no balance, and its weights have none")
    four = enough_for_four(bonds, bonds.nbonds, int(bonds.mesh.nvertices))
    return balance_of(kind_of_moments(bonds)(bonds, four), exact)


def kind_of_moments(bonds: BondList) -> type[Moments]:
    """Return compiled loops for vertex pairs, sparse products for all else."""
    return PairMoments if _are_pairs(bonds) and bonds.dim > 1 and available() else Moments


def enough_for_four(bonds: BondList, nbonds: int, nvertices: int) -> bool:
    """Return whether a body has bonds enough for moments of order four as well."""
    return bonds.dim < 3 and nbonds >= _ENOUGH * nvertices * _COLUMNS[bonds.dim]


def _are_pairs(bonds: BondList) -> bool:
    return bonds.samples.at_vertices and all(isinstance(part, PairBonds) for part in bonds.parts)


def balance_of(moments: Moments, exact: bool = False) -> Balance:
    """Return balanced weights of bonds by their moments; of a rank's bonds where the body is dealt out over ranks."""
    bonds = moments.bonds
    dim, exact, pairs = bonds.dim, exact or bonds.dim == 1, _are_pairs(bonds)
    targets = moments.targets(pairs and dim > 1 and bonds.vertex_weight is None)
    target = targets.values[moments.vertex][:, : moments.columns] * moments.roots
    near = targets.near_boundary[moments.vertex]
    weights = moments.own_weights()
    now = moments.moments(weights)
    largest = moments.largest(float(np.abs(now / moments.roots).max(initial=0.0)))
    if not largest > 0.0:
        raise ValueError("no bond has any measure: there is nothing to balance")
    sampled = moments.degree(weights) > 0.0
    rows = np.repeat(sampled[:, None], moments.columns, axis=1)
    rows[:, moments.three :] &= _four_known(targets)[moments.vertex][:, None]
    iterations, rounds, damp = _effort(bonds, pairs)
    new, count = weights, 0
    for _ in range(rounds):
        y, taken = _solve(moments, new, (target - now) * rows, rows, np.where(near, damp, 0.0), iterations)
        count += taken
        new = [w * ratio_of(s) for w, s in zip(new, moments.gathered(y), strict=True)]
        now = moments.moments(new)
    ratios = _ratios(new, weights)
    if exact or not _within(moments, ratios):
        new = new if _within(moments, ratios) else weights
        new, taken = _exactly(moments, new, target, rows & ~near[:, None], largest)
        count += taken
        ratios, now = _ratios(new, weights), moments.moments(new)
    if not _within(moments, ratios):  # no positive weights near the rule's do it: leave them alone
        new, ratios, now = weights, [np.ones_like(w) for w in weights], moments.moments(weights)
    left = np.abs((target - now) * sampled[:, None] / moments.roots)[:, : moments.three].max(axis=1) / largest
    met = np.where(near | (not exact), _MET, _MET_EXACTLY)
    square, nbonds = sum(float(((x - 1.0) ** 2).sum()) for x in ratios), sum(map(len, ratios))
    return Balance(
        new,
        np.sort(moments.vertex[left > met]),
        moments.largest(float(left[~near].max(initial=0.0))),
        moments.largest(float(left.max(initial=0.0))),
        -moments.largest(-float(min((x.min(initial=1.0) for x in ratios), default=1.0))),
        float(np.sqrt(moments.total(square) / moments.total(float(nbonds)))),
        count,
    )


def _effort(bonds: BondList, pairs: bool) -> tuple[int, int, float]:
    if pairs and bonds.dim > 1:
        iterations, rounds, damp = _PAIRS[bonds.dim]
        return iterations, getattr(bonds.rule, "rounds", rounds), damp
    return _BALLS if bonds.samples.at_vertices or bonds.dim == 3 else _GAUSS


def _four_known(targets: Targets) -> Bools:
    """Where moments of order four are known: everywhere by facets, inside by rays."""
    known: Bools = (targets.values[:, -1] != 0.0) if targets.four_everywhere else targets.exact_four
    return known


def _solve(
    moments: Moments, w: list[Floats], right: Floats, rows: Bools, damp: Floats, most: int, close: float = 0.0
) -> tuple[Floats, int]:
    """Solve ``(C W C^T + damp) y = right`` by conjugate gradients; return y and the iterations."""
    weight = moments.degree(w)
    scale = np.divide(1.0, weight, out=np.zeros_like(weight), where=weight > 0.0)[:, None]
    damping, apply = (damp * weight)[:, None], moments.normal(w)

    def preconditioned(r: Floats) -> Floats:
        z: Floats = np.einsum("ni,ij->nj", r, moments.inverse) * scale * rows
        return z

    y, r = np.zeros_like(right), right * rows
    z = preconditioned(r)
    p, size = z, moments.dot(r, z)
    first, taken = size, 0
    while taken < most and size > close**2 * first:
        q = apply(p) * rows + damping * p
        length = size / moments.dot(p, q)
        y, r = y + length * p, r - length * q
        z = preconditioned(r)
        before, size = size, moments.dot(r, z)
        p = z + (size / before) * p
        taken += 1
    return y, taken


def _exactly(
    moments: Moments, w: list[Floats], target: Floats, rows: Bools, largest: float
) -> tuple[list[Floats], int]:
    """Newton's method for the moments of order three alone; return the weights and the iterations."""
    alone = moments.alone()
    rows, target, count = rows[:, : alone.columns], target[:, : alone.columns], 0
    missed = (target - alone.moments(w)) * rows
    for _ in range(_ROUNDS_EXACT):
        worst = alone.largest(float(np.abs(missed).max(initial=0.0))) / largest
        if worst <= _EXACT:
            break
        close = max(_LOOSE, 0.1 * _EXACT / worst)
        y, taken = _solve(alone, w, missed, rows, np.zeros(len(rows)), _MOST, close)
        count += taken
        step, length = alone.gathered(y), 1.0
        while length > 0.01:  # halve the step until it gains
            trial = [a * ratio_of(length * s) for a, s in zip(w, step, strict=True)]
            left = (target - alone.moments(trial)) * rows
            if alone.dot(left, left) < (1.0 - 0.1 * length) ** 2 * alone.dot(missed, missed):
                break
            length *= 0.5
        else:
            break
        w, missed = trial, left
    return w, count


def ratio_of(s: Floats) -> Floats:
    """The ratio of new to old weights, ``s + sqrt(1 + s^2)``: positive, ``1 + s`` for small s, straight for large.

    >>> ratio_of(np.array([-0.75, 0.0, 0.75])).tolist()
    [0.5, 1.0, 2.0]
    """
    root = np.sqrt(1.0 + s * s)
    # the other form where the terms would cancel
    return np.where(s > 0.0, s + root, 1.0 / (root - np.minimum(s, 0.0)))


def _ratios(new: list[Floats], old: list[Floats]) -> list[Floats]:
    return [np.divide(v, w, out=np.ones_like(w), where=w > 0.0) for v, w in zip(new, old, strict=True)]


def _within(moments: Moments, ratios: list[Floats]) -> bool:
    beyond = any(not (x.min(initial=1.0) > 1.0 / _FAR and x.max(initial=1.0) < _FAR) for x in ratios)
    return moments.largest(float(beyond)) == 0.0
