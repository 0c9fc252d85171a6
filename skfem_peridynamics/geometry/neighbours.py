"""All pairs of points within a reach, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .._compile import available
from .._types import Floats, Longs

RIM = 1e-9  # relative: pairs this little beyond the reach are on its rim, and count
_POINTS = 2048  # searched at a time
_MANY = 50_000  # points from which compiled loops search; before that they take longer to load
_STATIONS = 0.25  # of the points: fewer different coordinates along an axis make a lattice
_BITS = 20  # of a coordinate on the curve


def sweep_order(x: Floats) -> Longs:
    """Return an ordering of points (dim, n) along their longest axis: near points get near numbers.

    The kernels work on runs of consecutive points, so the ordering decides how local their memory is.

    >>> sweep_order(np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 2.0]])).tolist()
    [1, 2, 0]
    """
    axes = np.argsort(np.ptp(x, axis=1))
    # coordinates that differ by round-off only are the same station
    scale = max(float(np.ptp(x, axis=1).max()), np.finfo(float).tiny)
    return np.lexsort(np.round((x[axes] - x[axes].min(axis=1, keepdims=True)) / scale, 9)).astype(np.int64)


def curve_order(x: Floats) -> Longs:
    """Return an ordering of points (n, dim) along Morton's space-filling curve: runs of it are compact in every axis.

    >>> curve_order(np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.1, 0.1]])).tolist()
    [0, 4, 2, 1, 3]
    """
    dim = x.shape[1]
    extent = max(float(np.ptp(x, axis=0).max()), np.finfo(float).tiny)
    cell = ((x - x.min(axis=0)) / extent * ((1 << _BITS) - 1)).astype(np.int64)
    key = np.zeros(len(x), dtype=np.int64)
    # interleave the bits of the coordinates, the first axis highest
    for bit in range(_BITS):
        for axis in range(dim):
            key |= ((cell[:, axis] >> bit) & 1) << (bit * dim + dim - 1 - axis)
    return np.argsort(key, kind="stable")


def local_order(x: Floats) -> Longs:
    """Return an ordering of points (dim, n) in which near points have near numbers, as the kernels like it.

    Along the longest axis on lattices, whose rows then have far ends that follow one another, and on lines; along the
    curve elsewhere, where that is a quarter faster (docs/evidence/performance.md).

    >>> x = np.random.default_rng(0).random((2, 100))
    >>> np.array_equal(local_order(x), curve_order(x.T)), np.array_equal(local_order(x[:1]), sweep_order(x[:1]))
    (True, True)
    """
    longest = x[np.ptp(x, axis=1).argmax()]
    stations = len(
        np.unique(np.round((longest - longest.min()) / max(float(np.ptp(longest)), np.finfo(float).tiny), 9))
    )
    return sweep_order(x) if len(x) == 1 or stations <= _STATIONS * x.shape[1] else curve_order(x.T)


def pairs_within(x: Floats, reach: float) -> Iterator[tuple[Longs, Longs, Floats]]:
    """Yield ``(i, j, distance)`` of all pairs i < j of points (dim, n) with ``distance <= reach``, sorted, in chunks.

    Pairs at the reach to a relative 1e-9 are included: structured meshes put many of them there. Pairs of
    coincident points are left out. Every i is complete within its chunk.

    >>> [[a.tolist() for a in chunk] for chunk in pairs_within(np.array([[0.0, 1.0, 2.0, 2.0]]), 1.0)]
    [[[0, 1, 1], [1, 2, 3], [1.0, 1.0, 1.0]]]
    """
    n = x.shape[1]
    if n >= _MANY and available():
        from .neighbour_loops import pairs

        yield from pairs(x, reach * (1.0 + RIM))
        return
    from scipy.spatial import cKDTree

    tree = cKDTree(x.T)
    for start in range(0, n, _POINTS):
        # a tree of some points against that of all: the memory is that of their pairs, not of all
        near_tree = cKDTree(x.T[start : start + _POINTS])
        distances = near_tree.sparse_distance_matrix(tree, reach * (1.0 + RIM), output_type="ndarray")
        distances = distances[(distances["j"] > distances["i"] + start) & (distances["v"] > 0.0)]
        distances = distances[np.argsort(distances["i"] * n + distances["j"], kind="stable")]
        yield distances["i"] + start, distances["j"], distances["v"]


def estimate_pairs(x: Floats, reach: float, samples: int = 500) -> int:
    """Return about how many pairs there are within ``reach``, from an evenly spread sample of the points.

    >>> estimate_pairs(np.linspace(0, 1, 101)[None], 0.0301)
    297
    """
    from scipy.spatial import cKDTree

    n = x.shape[1]
    pick = np.unique(np.linspace(0, n - 1, min(n, samples)).astype(np.int64))
    tree = cKDTree(x.T)
    count = tree.query_ball_point(x.T[pick], reach * (1.0 + RIM), return_length=True)
    return int(float(np.mean(count - 1)) * n / 2 + 0.5)
