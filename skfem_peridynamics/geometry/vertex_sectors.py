"""Fans: which elements at a vertex hang together through facets at that vertex."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from .._types import Bools, Longs, Mesh


def vertex_sectors(mesh: Mesh, marked: Bools, cut: Longs) -> tuple[Longs, Longs, Longs]:
    """Return the fans of marked vertices: corners of elements there, the fan of each corner, the vertex of each fan.

    Two elements at a vertex are in one fan when a chain of interior facets at that vertex, none of them in ``cut``,
    joins them. A corner is numbered ``local vertex * nelements + element``. Fans are sorted by vertex; a vertex with
    more than one is where parts of a body touch, or where a cut goes through.

    >>> import skfem
    >>> m = skfem.MeshTri()                                            # two triangles share the diagonal
    >>> vertex_sectors(m, np.ones(4, dtype=bool), np.array([], dtype=int))[2].tolist()
    [0, 1, 2, 3]
    >>> vertex_sectors(m, np.ones(4, dtype=bool), np.flatnonzero(m.f2t[1] >= 0))[2].tolist()
    [0, 1, 1, 2, 2, 3]
    """
    inner = np.flatnonzero(mesh.f2t[1] >= 0)
    inner = inner[~np.isin(inner, cut)]
    rows, cols = [], []
    for vertex in mesh.facets[:, inner]:
        pick = marked[vertex]
        sides = []
        for element in mesh.f2t[:, inner[pick]]:
            local = (mesh.t[:, element] == vertex[pick]).argmax(axis=0)
            sides.append(local * mesh.nelements + element)
        rows.append(sides[0])
        cols.append(sides[1])
    row, col = np.concatenate(rows), np.concatenate(cols)
    graph = sparse.coo_matrix((np.ones(len(row), dtype=np.int8), (row, col)), shape=(mesh.t.size, mesh.t.size))
    _, component = connected_components(graph, directed=False)
    vertex = mesh.t.reshape(-1).astype(np.int64)
    corners = np.flatnonzero(marked[vertex])
    pairs, fan = np.unique(np.stack([vertex[corners], component[corners]]), axis=1, return_inverse=True)
    return corners, fan.ravel(), pairs[0]
