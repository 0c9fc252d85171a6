"""What a rank holds of a mesh: its own vertices, and all elements within reach of these."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .._types import Bools, Floats, Longs, Mesh


@dataclass(frozen=True, eq=False)
class Share:
    """A mesh of a rank's own vertices, first, and of ghosts, which others own; each in the order of the whole mesh.

    ``number`` and ``owner`` (nvertices,): their numbers in the whole mesh and the ranks that own them. ``place`` are
    numbers in the order of the ranks, as PETSc counts. ``nvertices`` are those of the whole. ``along`` (nvertices,) are
    their numbers along it, where a rule asks for these.
    """

    mesh: Mesh
    number: Longs
    owner: Longs
    place: Longs
    own: int
    rank: int
    nvertices: int
    along: Longs | None = None

    def part(self, values: Floats) -> Floats:
        """Return of values at the whole mesh, (nvertices,) or (nvertices, m), those of the rank's mesh."""
        return np.ascontiguousarray(values[self.number])


def divided(x: Floats, weight: Floats, parts: int) -> Longs:
    """Return the part of each point (dim, n): halved along the longest axis so that weights are shared out.

    PETSc's partitioners take no weights from Python, and parts of equal weight are what counts for bonds.

    >>> divided(np.array([[0.0, 1.0, 2.0, 3.0]]), np.array([3.0, 1.0, 1.0, 1.0]), 2).tolist()
    [0, 1, 1, 1]
    """
    out = np.zeros(x.shape[1], dtype=np.int64)

    def cut(which: Longs, first: int, count: int) -> None:
        if count == 1:
            out[which] = first
            return
        left = count // 2
        axis = int(np.ptp(x[:, which], axis=1).argmax())
        order = which[np.argsort(x[axis, which], kind="stable")]
        running = np.cumsum(weight[order])
        edge = int(np.searchsorted(running, running[-1] * left / count * (1.0 + 1e-12), side="right"))
        edge = min(max(edge, left), len(order) - (count - left))  # none goes without
        cut(np.sort(order[:edge]), first, left)
        cut(np.sort(order[edge:]), first + left, count - left)

    cut(np.arange(x.shape[1]), 0, parts)
    return out


def shares(mesh: Mesh, owner: Longs, reach: float, along: Longs | None = None) -> Iterator[Share]:
    """Yield the shares of all ranks: elements with a corner within ``reach`` of one of their own vertices.

    One after the other, so that no more than one of them is held beside the whole.
    """
    place = np.empty(mesh.nvertices, dtype=np.int64)
    order = np.argsort(owner, kind="stable")
    place[order] = np.arange(mesh.nvertices)
    ends = np.searchsorted(owner[order], np.arange(int(owner.max()) + 2))
    for rank, (low, high) in enumerate(pairwise(ends.tolist())):
        yield _share(mesh, owner, place, rank, order[low:high], reach, along)


def _share(mesh: Mesh, owner: Longs, place: Longs, rank: int, own: Longs, reach: float, along: Longs | None) -> Share:
    """The share of a rank with its ``own`` vertices."""
    near = _near(mesh.p, own, reach)
    elements = np.flatnonzero(near[mesh.t].any(axis=0))
    used = np.unique(mesh.t[:, elements])
    number = np.concatenate([own, used[owner[used] != rank]])
    local = np.full(mesh.nvertices, -1, dtype=np.int64)
    local[number] = np.arange(len(number))
    t = np.ascontiguousarray(local[mesh.t[:, elements]].astype(mesh.t.dtype))
    part = type(mesh)(np.ascontiguousarray(mesh.p[:, number]), t)
    names = mesh.subdomains or {}
    if names:
        found = np.full(mesh.nelements, -1, dtype=np.int64)
        found[elements] = np.arange(len(elements))
        part = part.with_subdomains({name: found[which][found[which] >= 0] for name, which in names.items()})
    there = None if along is None else along[number]
    return Share(part, number, owner[number], place[number], len(own), rank, int(mesh.nvertices), there)


def _near(p: Floats, own: Longs, reach: float) -> Bools:
    """Which points (dim, n) are within reach of some of them; those far off all are told by a box."""
    from scipy.spatial import cKDTree

    mine = p[:, own]
    low, high = mine.min(axis=1, keepdims=True) - reach, mine.max(axis=1, keepdims=True) + reach
    near: Bools = np.asarray(((p >= low) & (p <= high)).all(axis=0))
    box = np.flatnonzero(near)
    near[box] = np.isfinite(cKDTree(mine.T).query(p[:, box].T, distance_upper_bound=reach)[0])
    near[own] = True
    return near
