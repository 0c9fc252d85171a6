"""Cells of any mesher to simplices: quadratic ones lose their middle nodes, other polyhedra are pulled apart.

A polyhedron is cut into the simplices that its vertex of the smallest number spans with the faces that do not hold it,
and a face likewise. Two cells that share a face then cut it alike, whatever they are.
"""

from __future__ import annotations

import re

import numpy as np

from .._types import Longs

# cells by their names in meshio: dimension, corners (which come first), and for a polyhedron the corners of its faces
_TETRA = ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3))
_KINDS: dict[str, tuple[int, int, tuple[tuple[int, ...], ...]]] = {
    "vertex": (0, 1, ()),
    "line": (1, 2, ((0,), (1,))),
    "triangle": (2, 3, ((0, 1), (1, 2), (2, 0))),
    "quad": (2, 4, ((0, 1), (1, 2), (2, 3), (3, 0))),
    "tetra": (3, 4, _TETRA),
    "pyramid": (3, 5, ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4))),
    "wedge": (3, 6, ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5))),
    "hexahedron": (
        3,
        8,
        ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    ),
}


def kind_of(name: str) -> tuple[str, int, bool]:
    """Return the kind of a cell without its order, its dimension, and whether it has middle nodes.

    Raises ``ValueError`` for cells that are none of points, lines, triangles, quadrilaterals, tetrahedra, pyramids,
    wedges and hexahedra.

    >>> kind_of("tetra10"), kind_of("quad")
    (('tetra', 3, True), ('quad', 2, False))
    """
    kind = re.sub(r"\d+$", "", name)
    if kind not in _KINDS:
        raise ValueError(f"it has elements of the kind {name!r}; those that can be used are {', '.join(_KINDS)}")
    return kind, _KINDS[kind][0], kind != name


def to_simplices(name: str, cells: Longs) -> tuple[Longs, Longs]:
    """Return the simplices of cells (n, k): vertices (m, dimension + 1), and the cell that each comes from (m,).

    >>> simplices, cell = to_simplices("quad", np.array([[7, 3, 5, 4]]))     # pulled from vertex 3
    >>> simplices.tolist(), cell.tolist()
    ([[3, 5, 4], [3, 4, 7]], [0, 0])
    """
    kind, _, _ = kind_of(name)
    dim, corners, faces = _KINDS[kind]
    return _pulled(np.asarray(cells, dtype=np.int64)[:, :corners], dim, faces)


def _pulled(cells: Longs, dim: int, faces: tuple[tuple[int, ...], ...]) -> tuple[Longs, Longs]:
    if cells.shape[1] == dim + 1:
        return cells, np.arange(len(cells))
    pieces, owners = [np.empty((0, dim + 1), dtype=np.int64)], [np.empty(0, dtype=np.int64)]
    first = cells.argmin(axis=1)
    for corner in range(cells.shape[1]):
        chosen = np.flatnonzero(first == corner)
        for face in faces:
            if corner in face:
                continue
            rim = () if len(face) < 3 else tuple((k, (k + 1) % len(face)) for k in range(len(face)))
            parts, which = _pulled(cells[chosen][:, face], dim - 1, rim)
            apex = cells[chosen[which], corner]
            pieces.append(np.column_stack([apex, parts]))
            owners.append(chosen[which])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(pieces)[order], owner[order]
