"""Whether elements fit together: each facet between two of them at most, on either side; and in how many parts."""

from __future__ import annotations

import numpy as np

from .._types import Longs, Mesh
from ..geometry.connected import connected
from ..geometry.simplices import describe_point

_AT_ONE_PLACE = 1e-9  # of the extent


def unique_rows(rows: Longs) -> tuple[Longs, Longs]:
    """The places of the first of equal rows, in the order they come in, and which of these each row equals."""
    order = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    group = np.empty(len(rows), dtype=np.int64)
    group[order] = np.cumsum(new) - 1
    first = np.full(int(new.sum()), len(rows), dtype=np.int64)
    np.minimum.at(first, group, np.arange(len(rows)))
    by_place = np.argsort(first)
    rank = np.empty_like(by_place)
    rank[by_place] = np.arange(len(by_place))
    return first[by_place], rank[group]


def check_manifold(mesh: Mesh) -> None:
    """Raise ``ValueError`` for a facet of more than two elements, and for two elements on one side of theirs."""
    dim, facets = mesh.dim(), mesh.facets
    count = np.bincount(mesh.t2f.ravel(), minlength=facets.shape[1])
    many = np.flatnonzero(count > 2)
    if len(many):
        where = describe_point(mesh.p[:, facets[:, many[0]]].mean(axis=1))
        raise ValueError(f"{count[many[0]]} elements share the facet at {where}: elements lie on top of each other")
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    corners = mesh.p[:, facets[:, inner]]
    sides = []
    for k in (0, 1):
        opposite = mesh.t[:, mesh.f2t[k, inner]].sum(axis=0) - facets[:, inner].sum(axis=0)
        rows = np.concatenate([corners[:, 1:] - corners[:, :1], (mesh.p[:, opposite] - corners[:, 0])[:, None]], axis=1)
        sides.append(np.linalg.det(np.moveaxis(rows, 2, 0)) if dim > 1 else rows[0, 0])
    folded = np.flatnonzero(sides[0] * sides[1] > 0.0)
    if len(folded):
        where = describe_point(corners[:, :, folded[0]].mean(axis=1))
        raise ValueError(
            f"the two elements at the facet at {where} lie on the same side of it: the mesh is folded over there"
        )


def facet_numbers(mesh: Mesh, facets: Longs) -> Longs:
    """The numbers of facets (n, dim) given by their vertices, -1 for those that are none."""
    own = np.sort(mesh.facets.T.astype(np.int64), axis=1)
    both = np.concatenate([own, np.sort(facets, axis=1)])
    first, same = unique_rows(both)
    numbers = first[same[len(own) :]]
    return np.where(numbers < len(own), numbers, -1)


def parts_of(mesh: Mesh) -> list[str]:
    """Say of how many parts a mesh is that share no vertex, in a sentence; nothing of one part."""
    count, piece = connected(mesh.t, int(mesh.nvertices))
    if count == 1:
        return []
    sizes = np.bincount(piece[mesh.t[0]], minlength=count)
    small = int(sizes.argmin())
    where = describe_point(mesh.p[:, mesh.t[:, piece[mesh.t[0]] == small][0, 0]])
    plural = "" if sizes[small] == 1 else "s"
    note = f"the mesh has {count} parts that share no vertex; the smallest has {sizes[small]} element{plural}, "
    note += f"one of them at {where}"
    from scipy.spatial import cKDTree

    extent = float(np.ptp(mesh.p, axis=1).max())
    here = cKDTree(mesh.p[:, piece == small].T)
    touching = here.count_neighbors(cKDTree(mesh.p[:, piece != small].T), _AT_ONE_PLACE * extent)
    if touching:
        note += f"; {touching} of its vertices are where others are: join = true makes them one"
    return [note]
