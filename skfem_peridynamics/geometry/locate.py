"""Which element a point is in."""

from __future__ import annotations

import numpy as np

from .._types import Floats, Longs, Mesh
from .simplices import describe_point

_ON = 1e-9  # barycentric coordinates below minus this are outside


def locate(mesh: Mesh, point: Floats) -> tuple[Longs, Floats]:
    """Return the vertices of the element that holds a point (dim,), and its barycentric coordinates there.

    Raises ``ValueError`` for a point outside of the body.

    >>> import skfem
    >>> vertices, share = locate(skfem.MeshTri(), np.array([0.25, 0.25]))
    >>> vertices.tolist(), share.tolist()
    ([0, 1, 2], [0.5, 0.25, 0.25])
    """
    corners = mesh.p[:, mesh.t]
    slack = 1e-9 * float(np.ptp(mesh.p, axis=1).max())
    inside = (corners.min(axis=1) <= point[:, None] + slack) & (corners.max(axis=1) >= point[:, None] - slack)
    near = np.flatnonzero(inside.all(axis=0))
    if len(near):
        edges = np.moveaxis(corners[:, 1:, near] - corners[:, :1, near], 2, 0)
        away = np.broadcast_to(point, (len(near), len(point))) - corners[:, 0, near].T
        rest = np.linalg.solve(edges, away[..., None])[..., 0]
        share = np.column_stack([1.0 - rest.sum(axis=1), rest])
        best = int(share.min(axis=1).argmax())
        if share[best].min() >= -_ON:
            return mesh.t[:, near[best]].astype(np.int64), np.asarray(share[best], dtype=float)
    closest = mesh.p[:, np.linalg.norm(mesh.p - point[:, None], axis=0).argmin()]
    raise ValueError(
        f"{describe_point(point)} is outside of the body; its nearest vertex is at {describe_point(closest)}"
    )
