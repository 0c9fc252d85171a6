"""Where slits of a mesh end, and which way they go on."""

from __future__ import annotations

import numpy as np

from .._types import Floats, Longs, Mesh


def slit_tips(mesh: Mesh) -> Longs:
    """Return the vertices of the slit that both its faces share, where it ends inside the body, in order.

    >>> import skfem
    >>> from skfem_peridynamics import Crack, slit
    >>> mesh = slit(skfem.MeshTri().refined(3), Crack([[0.0, 0.5], [0.5, 0.5]]))
    >>> mesh.p[:, slit_tips(mesh)].T.tolist()
    [[0.5, 0.5]]
    """
    return np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *(shared for shared, _ in _faces(mesh))]))


def _faces(mesh: Mesh) -> list[tuple[Longs, Longs]]:
    """For each two facets of the slit that face each other, the vertices both have, and the others of the first."""
    slit = (mesh.boundaries or {}).get("slit")
    if slit is None or not len(slit) or mesh.dim() < 2:
        return []
    corners = mesh.facets[:, np.asarray(slit)].astype(np.int64)
    from scipy.spatial import cKDTree

    middle = mesh.p[:, corners].mean(axis=1).T
    extent = float(np.ptp(mesh.p, axis=1).max())
    pairs = cKDTree(middle).query_pairs(1e-9 * extent, output_type="ndarray")
    shared = [np.intersect1d(corners[:, a], corners[:, b]) for a, b in pairs]
    return [(node, np.setdiff1d(corners[:, a], node)) for node, (a, _) in zip(shared, pairs, strict=True)]


def slit_directions(mesh: Mesh) -> tuple[Floats, Floats]:
    """Return the tips of a slit in 2D, (ntips, 2), and the directions in which it would go on, (ntips, 2).

    >>> import skfem
    >>> from skfem_peridynamics import Crack, slit
    >>> tips, along = slit_directions(slit(skfem.MeshTri().refined(3), Crack([[0.0, 0.5], [0.5, 0.5]])))
    >>> tips.tolist(), along.tolist()
    ([[0.5, 0.5]], [[1.0, 0.0]])
    """
    ends = [(shared[0], others[0]) for shared, others in _faces(mesh) if len(shared) == 1 and len(others) == 1]
    tips = np.array([tip for tip, _ in ends], dtype=np.int64)
    order = np.argsort(tips, kind="stable")
    tips, behind = tips[order], np.array([inner for _, inner in ends], dtype=np.int64)[order]
    along = (mesh.p[:, tips] - mesh.p[:, behind]).T
    return mesh.p[:, tips].T, along / np.linalg.norm(along, axis=1, keepdims=True)
