"""Connected pieces: of a mesh by its elements, of vertices by their bonds."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.csgraph import connected_components

from .._types import Ints


def connected(groups: Ints, n: int) -> tuple[int, Ints]:
    """Return how many connected pieces n items fall into, and the piece of each (n,).

    A column of ``groups`` (k, m) holds items that belong together: the vertices of an element, the ends of a bond.

    >>> connected(np.array([[0, 1], [1, 2]]), 4)[0]
    2
    """
    row = np.broadcast_to(groups[0], groups[1:].shape).ravel()
    links = sparse.coo_matrix((np.ones(len(row), dtype=np.int8), (row, groups[1:].ravel())), shape=(n, n))
    count, label = connected_components(links, directed=False)
    return int(count), label
