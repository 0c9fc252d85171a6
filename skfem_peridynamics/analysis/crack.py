"""Where a crack has got to: its tips, its branches and its length, from the damage at the vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs, Mesh
from ..geometry.slit_tips import slit_tips

CRACKED = 0.3  # of a vertex's bonds: the row beside a straight crack has lost 0.34 at eps/h = 2, 0.42 at 4, 0.46 at 8
_BRANCH = 1.5  # horizons: what leaves the crack by less is its own width
_MOST = 16  # branches followed
WINDOW = 5  # rows of a history that the speed of a tip is the slope of


@dataclass(frozen=True, eq=False)
class CrackPath:
    """A crack, seen at the vertices that have lost bonds.

    Parameters
    ----------
    tips : ndarray, (ntips, dim)
        Its ends, the one farthest along first.
    reach : ndarray, (ntips,)
        How far each is along the crack from the slit, or from the other end of a crack that begins at none.
    length : float
        Of all branches together.
    direction : ndarray, (dim,)
        In which the first tip points.

    Examples
    --------
    >>> CrackPath(tips=np.zeros((0, 2)), reach=np.zeros(0), length=0.0, direction=np.zeros(2)).found
    False
    """

    tips: Floats
    reach: Floats
    length: float
    direction: Floats

    @property
    def found(self) -> bool:
        """Whether there is a crack at all."""
        return len(self.tips) > 0


def crack_path(mesh: Mesh, intact: Floats, horizon: float, cracked: float = CRACKED) -> CrackPath:
    """Follow the crack along the vertices that have lost the part ``cracked`` of their bonds.

    They are joined within a horizon, so that lengths are those of the crack and not of the edges of the mesh; tips are
    ends that are more than one and a half horizons off the rest. Of several cracks it is the one that begins at the
    slit, or the longest. A tip seen so lags behind by up to half a horizon, always the same.

    Parameters
    ----------
    mesh : skfem.Mesh
        Lines, triangles or tetrahedra.
    intact : ndarray, (nvertices,)
        Fraction of the bonds that each vertex still has, see :func:`damage`.
    horizon : float
        The horizon of the bonds.
    cracked : float, optional
        The part of its bonds that a vertex of the crack has lost.

    Returns
    -------
    CrackPath
        The crack; empty where there is none.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 41), np.linspace(0, 1, 41))
    >>> hurt = (abs(mesh.p[1] - 0.5) < 0.03) & (mesh.p[0] > 0.2) & (mesh.p[0] < 0.8)
    >>> path = crack_path(mesh, 1.0 - 0.45 * hurt, horizon=0.1)
    >>> len(path.tips), bool(abs(path.length - 0.55) < 0.01), abs(path.direction).round(1).tolist()
    (1, True, [1.0, 0.0])
    """
    from scipy.sparse.csgraph import connected_components, dijkstra

    dim = int(mesh.dim())
    nothing = CrackPath(np.zeros((0, dim)), np.zeros(0), 0.0, np.zeros(dim))
    cracked_vertices = np.flatnonzero(1.0 - intact >= cracked)
    if not len(cracked_vertices):
        return nothing
    x = mesh.p[:, cracked_vertices].T
    graph = _near(x, horizon)
    far = _from_slit(mesh, x, horizon)
    _, piece = connected_components(graph, directed=False)
    if np.isfinite(far).any():
        root = np.flatnonzero(np.isfinite(far))
        return _branches(x, graph, root, far[root], horizon)
    best, start = 0.0, np.zeros(1, dtype=np.int64)
    for label in range(int(piece.max()) + 1):
        inside = np.flatnonzero(piece == label)
        distance = dijkstra(graph, indices=int(inside[0]))
        end = int(inside[np.argmax(distance[inside])])
        longest = float(dijkstra(graph, indices=end)[inside].max())
        if longest > best:
            best, start = longest, np.array([end])
    return _branches(x, graph, start, np.zeros(1), horizon) if best > 0.0 else nothing


def _near(x: Floats, horizon: float) -> Csr:
    """The lengths between points within a horizon."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(horizon * (1.0 + 1e-9), output_type="ndarray")
    i, j = pairs.T
    length = np.maximum(np.linalg.norm(x[i] - x[j], axis=1), 1e-9 * horizon)  # faces of a slit coincide: no zero edge
    return sparse.csr_matrix((length, (i, j)), shape=(len(x), len(x)))


def _from_slit(mesh: Mesh, x: Floats, horizon: float) -> Floats:
    """The distance of points to the tips of the slit, inf beyond a horizon."""
    tips = slit_tips(mesh)
    if not len(tips):
        return np.full(len(x), np.inf)
    from scipy.spatial import cKDTree

    gap, _ = cKDTree(mesh.p[:, tips].T).query(x, distance_upper_bound=horizon * (1.0 + 1e-9))
    return np.asarray(gap, dtype=float)


def _branches(x: Floats, graph: Csr, root: Longs, offset: Floats, horizon: float) -> CrackPath:
    """The longest way from the root, then the longest off that, and so on."""
    from scipy.sparse.csgraph import dijkstra

    n = len(x)
    start = sparse.csr_matrix((np.maximum(offset, 1e-9 * horizon), (np.full(len(root), n), root)), shape=(n + 1, n + 1))
    whole = sparse.csr_matrix(sparse.block_diag([graph, sparse.csr_matrix((1, 1))]) + start)
    reach, before = dijkstra(whole, directed=False, indices=n, return_predecessors=True)
    reach[~np.isfinite(reach)] = -1.0
    tips: list[int] = []
    tree = np.array([n])
    total, gap, where = 0.0, reach.copy(), before
    for _ in range(_MOST):
        tip = int(np.argmax(gap))
        if gap[tip] <= (0.0 if not tips else _BRANCH * horizon):
            break
        tips.append(tip)
        total += float(gap[tip])
        way = [tip]
        while where[way[-1]] >= 0:
            way.append(int(where[way[-1]]))
        tree = np.union1d(tree, way)
        gap, where, _ = dijkstra(whole, directed=False, indices=tree, return_predecessors=True, min_only=True)
        gap[~np.isfinite(gap)] = -1.0
    order = np.argsort(-reach[tips], kind="stable")
    chosen = np.array(tips, dtype=np.int64)[order]
    return CrackPath(x[chosen], reach[chosen], total, _pointing(x, before, int(chosen[0]), n, horizon))


def _pointing(x: Floats, before: Longs, tip: int, root: int, horizon: float) -> Floats:
    """The direction from a point of the way some three horizons behind to a tip."""
    behind = tip
    while before[behind] >= 0 and before[behind] != root and np.linalg.norm(x[tip] - x[behind]) < 3.0 * horizon:
        behind = int(before[behind])
    along = x[tip] - x[behind]
    size = float(np.linalg.norm(along))
    return np.asarray(along / size if size > 0.0 else along, dtype=float)


def speeds(t: Floats, reach: Floats, window: int = WINDOW) -> Floats:
    """Return the speed of a tip, the slope of a straight line through ``window`` values about each time.

    >>> speeds(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 0.0, 2.0, 4.0]), window=3).tolist()
    [0.0, 1.0, 2.0, 2.0]
    """
    out = np.zeros(len(t))
    for k in range(len(t)):
        low, high = max(0, k - window // 2), min(len(t), k + window // 2 + 1)
        x, y = t[low:high] - t[low:high].mean(), reach[low:high]
        spread = float(x @ x)
        out[k] = float(x @ y) / spread if spread > 0.0 else 0.0
    return out
