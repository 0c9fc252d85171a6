"""Quadrature rules of the double integral: which bonds, with what weights.

A rule turns a mesh into a :class:`BondList`. Any rule may list bonds between points of elements; the pair rule's
points are the vertices themselves.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from .._types import Floats, Ints, Longs, Mesh
from ..geometry.simplices import describe_point, vertex_sizes, vertex_volumes
from ..geometry.visibility import sight
from .neighbours import RIM, estimate_pairs, pairs_within


@dataclass(frozen=True)
class BondList:
    """Unordered bonds between vertices: ends ``i < j`` (sorted by i) and quadrature weights, each (nbonds,).

    ``weight`` integrates the double integral over D x D, each unordered pair standing for both orders.
    """

    i: Ints
    j: Ints
    weight: Floats

    @property
    def nbonds(self) -> int:
        return len(self.i)


def _pieces(groups: Ints, n: int | None = None) -> int:
    """Number of connected pieces of vertices, given which of them belong together (one group per column)."""
    n = int(groups.max()) + 1 if n is None else n
    row = np.broadcast_to(groups[0], groups[1:].shape).ravel()
    links = sparse.coo_matrix((np.ones(len(row), dtype=np.int8), (row, groups[1:].ravel())), shape=(n, n))
    return int(connected_components(links, directed=False, return_labels=False))


@dataclass(frozen=True)
class PairRule:
    """All pairs of vertices within the horizon, each vertex standing for its share of the elements.

    ``partial_volume`` scales the weight of a pair near the rim by the part of the neighbour's cell that lies in the
    ball, ``clip((horizon + h/2 - r)/h, 0, 1)`` with h the neighbour's size, averaged over the two ends so that the
    form stays symmetric. Without it a pair counts fully up to the horizon, rim included.

    >>> import skfem
    >>> mesh = skfem.MeshLine(np.linspace(0, 1, 5))
    >>> PairRule().bonds(mesh, 0.25, order=np.arange(5)).weight.tolist()  # half of each neighbour is in the ball
    [0.03125, 0.0625, 0.0625, 0.03125]
    """

    partial_volume: bool = True

    @property
    def name(self) -> str:
        return "vertex pairs, partial volume" if self.partial_volume else "vertex pairs"

    def reach(self, mesh: Mesh, horizon: float) -> float:
        """Return the length of the longest bond that can carry weight."""
        return horizon + (0.5 * float(vertex_sizes(mesh).max()) if self.partial_volume else 0.0)

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        """Return about how many bonds there will be, before any is made."""
        return estimate_pairs(mesh.p, self.reach(mesh, horizon))

    def bonds(self, mesh: Mesh, horizon: float, order: Longs) -> BondList:
        """Return the bonds; their ends are places in ``order``, which lists the vertices.

        Raises ``ValueError`` for a vertex that is left without a bond, or when the bonds fall into more pieces than the
        mesh.
        """
        i, j, weight = (np.concatenate(part) for part in zip(*self._chunks(mesh, horizon, order), strict=True))
        degree = np.bincount(i, minlength=mesh.nvertices) + np.bincount(j, minlength=mesh.nvertices)
        lonely = order[degree == 0]
        if len(lonely):
            raise ValueError(
                f"horizon = {horizon:g} leaves vertex {lonely[0]} at {describe_point(mesh.p[:, lonely[0]])} without a "
                f"bond ({len(lonely)} of {mesh.nvertices} vertices); the mesh size there is "
                f"{vertex_sizes(mesh)[lonely[0]]:.3g}: take a larger horizon or a finer mesh"
            )
        pieces, bonded = _pieces(mesh.t), _pieces(np.stack([i, j]), mesh.nvertices)
        if bonded > pieces:
            raise ValueError(
                f"horizon = {horizon:g} leaves the bonds in {bonded} separate pieces, the mesh has {pieces}: in some "
                "direction the mesh is coarser than the horizon; take a larger horizon or a finer mesh"
            )
        return BondList(i, j, weight)

    def _chunks(self, mesh: Mesh, horizon: float, order: Longs) -> Iterator[tuple[Ints, Ints, Floats]]:
        volume, size = vertex_volumes(mesh)[order], vertex_sizes(mesh)[order]
        reach = self.reach(mesh, horizon)
        see = sight(mesh, reach)
        for i, j, r in pairs_within(np.ascontiguousarray(mesh.p[:, order]), reach):
            part = self._part(r, size, i, j, horizon)
            keep = np.flatnonzero(part > RIM)
            keep = keep[~see.blocked(order[i[keep]], order[j[keep]])]
            i, j = i[keep], j[keep]
            yield i.astype(np.int32), j.astype(np.int32), 2.0 * volume[i] * volume[j] * part[keep]

    def _part(self, r: Floats, size: Floats, i: Longs, j: Longs, horizon: float) -> Floats:
        if not self.partial_volume:
            return np.ones_like(r)
        part = np.zeros_like(r)
        for end in (i, j):
            h = size[end]
            part += 0.5 * np.clip((horizon + 0.5 * h - r) / h, 0.0, 1.0)
        return part
