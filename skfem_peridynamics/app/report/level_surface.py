"""Surfaces on which a P1 field of a tetrahedral mesh has one value: slices of a body, and the surface of a crack."""

from __future__ import annotations

import numpy as np

from ..._types import Floats, Mesh


def level_surface(mesh: Mesh, field: Floats, level: float, values: Floats) -> tuple[Floats, Floats]:
    """Return triangles (n, 3, 3), corner by corner, where a field (nvertices,) is ``level``, and other values there.

    ``values`` (nvertices,) are carried to the corners, (n, 3). A slice is the surface of a linear field.

    >>> import skfem
    >>> mesh = skfem.MeshTet().refined(2)
    >>> corners, z = level_surface(mesh, mesh.p[0], 0.3, mesh.p[2])
    >>> edges = corners[:, 1:] - corners[:, :1]
    >>> round(float(np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum() / 2), 12), float(z.max())
    (1.0, 1.0)
    """
    above = field[mesh.t] > level
    pieces, carried = [np.zeros((0, 3, 3))], [np.zeros((0, 3))]
    order = np.argsort(above, axis=0, kind="stable")  # those below first
    t = np.take_along_axis(mesh.t, order, axis=0)
    for count, triangles in (
        (1, (((0, 3), (1, 3), (2, 3)),)),
        (3, (((0, 1), (0, 2), (0, 3)),)),
        (2, (((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2)))),
    ):
        crossed = t[:, above.sum(axis=0) == count]
        for triangle in triangles:
            points, numbers = [], []
            for a, b in triangle:
                low, high = crossed[a], crossed[b]
                share = (level - field[low]) / (field[high] - field[low])
                points.append(mesh.p[:, low] + share * (mesh.p[:, high] - mesh.p[:, low]))
                numbers.append(values[low] + share * (values[high] - values[low]))
            pieces.append(np.moveaxis(np.array(points), 2, 0))
            carried.append(np.array(numbers).T)
    return np.concatenate(pieces), np.concatenate(carried)
