"""Where a crack has got to: its tips, its branches and its length, from the damage at the vertices."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from .._types import Bools, Csr, Floats, Longs, Mesh
from ..geometry.simplices import vertex_volumes
from ..geometry.slit_tips import slit_tips

CRACKED = 0.3  # of a vertex's bonds: the row beside a straight crack has lost 0.34 at eps/h = 2, 0.42 at 4, 0.46 at 8
_BRANCH = 1.5  # horizons: what leaves the crack by less is its own width
_MOST = 16  # branches followed, and cracks
_DEEP = 0.75  # horizons: a vertex 0.32 of one from a crack has lost the 0.3 (J = 1), what is crushed reaches farther in
WINDOW = 5  # rows of a history that the speed of a tip is the slope of


@dataclass(frozen=True, eq=False)
class CrackPath:
    """The cracks of a body, seen at the vertices that have lost bonds.

    Parameters
    ----------
    tips : ndarray, (ntips, dim)
        Their ends, those of the main crack first, of these the one farthest along.
    reach : ndarray, (ntips,)
        How far each is along its crack from where that begins: at a slit, at the boundary, or at its other end.
    length : float
        Of all branches of all cracks together.
    direction : ndarray, (dim,)
        In which the first tip points.
    cracks : int, optional
        How many there are that do not touch.
    crushed : float, optional
        The part of the damaged volume that is no crack: more than 3/4 of a horizon from any vertex that is whole.

    Examples
    --------
    >>> CrackPath(tips=np.zeros((0, 2)), reach=np.zeros(0), length=0.0, direction=np.zeros(2)).found
    False
    """

    tips: Floats
    reach: Floats
    length: float
    direction: Floats
    cracks: int = 0
    crushed: float = 0.0

    @property
    def found(self) -> bool:
        """Whether there is a crack at all."""
        return len(self.tips) > 0


@dataclass(frozen=True, eq=False)
class Ground:
    """What a mesh says of all its cracks: tips of slits and points of the boundary, (dim, n), volumes of vertices."""

    tips: Floats
    rim: Floats
    volume: Floats

    @classmethod
    def of(cls, mesh: Mesh) -> Ground:
        """Look at a mesh, once for all states of its body."""
        rim = np.unique(mesh.facets[:, mesh.boundary_facets()])
        return cls(mesh.p[:, slit_tips(mesh)], mesh.p[:, rim], vertex_volumes(mesh))


def crack_path(
    mesh: Mesh, intact: Floats, horizon: float, cracked: float = CRACKED, *, ground: Ground | None = None
) -> CrackPath:
    """Follow the crack along the vertices that have lost the part ``cracked`` of their bonds.

    They are joined within a horizon, so that lengths are those of the crack and not of the edges of the mesh; tips are
    ends that are more than one and a half horizons off the rest. The main one of several cracks is the one that has
    come farthest from a slit, or the longest. A tip seen so lags behind by up to half a horizon, always the same.

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
    ground : Ground, optional
        ``Ground.of(mesh)``, where cracks of one mesh are followed often.

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
    from scipy.sparse.csgraph import connected_components

    dim = int(mesh.dim())
    damaged = 1.0 - intact >= cracked
    cracked_vertices = np.flatnonzero(damaged)
    if not len(cracked_vertices):
        return CrackPath(np.zeros((0, dim)), np.zeros(0), 0.0, np.zeros(dim))
    x = mesh.p[:, cracked_vertices].T
    graph = _near(x, horizon)
    ground = Ground.of(mesh) if ground is None else ground
    far, rim = _from(ground.tips, x, horizon), _from(ground.rim, x, horizon)
    count, piece = connected_components(graph, directed=False)
    found: list[tuple[bool, CrackPath]] = []
    for label in _largest(x, piece, count):
        inside = np.flatnonzero(piece == label)
        part = graph[inside][:, inside]
        root = np.flatnonzero(np.isfinite(far[inside]))
        of_slit = len(root) > 0
        if not of_slit and part.nnz == 0:
            continue  # a vertex is a crack of no length
        if not of_slit:
            root = _beginning(x[inside], part, rim[inside])
        offset = far[inside][root] if of_slit else np.zeros(len(root))
        path = _branches(x[inside], part, root, offset, horizon)
        if path.found:
            found.append((of_slit, path))
    if not found:
        return CrackPath(np.zeros((0, dim)), np.zeros(0), 0.0, np.zeros(dim))
    found.sort(key=lambda one: (not one[0], -one[1].reach[0]))
    main = found[0][1]
    # specks are no cracks, but for a single one
    paths = [main, *(path for _, path in found[1:] if path.length > _BRANCH * horizon)]
    return CrackPath(
        np.concatenate([path.tips for path in paths]),
        np.concatenate([path.reach for path in paths]),
        float(sum(path.length for path in paths)),
        main.direction,
        len(paths),
        _crushed(mesh, ground.volume[damaged], damaged, horizon),
    )


def _largest(x: Floats, piece: Longs, count: int) -> list[int]:
    """The pieces of the largest extent, ``_MOST`` of them."""
    low, high = np.full((count, x.shape[1]), np.inf), np.full((count, x.shape[1]), -np.inf)
    np.minimum.at(low, piece, x)
    np.maximum.at(high, piece, x)
    extent = np.linalg.norm(high - low, axis=1)
    return [int(label) for label in np.argsort(-extent, kind="stable")[:_MOST]]


def _beginning(x: Floats, graph: Csr, rim: Floats) -> Longs:
    """Where a crack that comes from no slit begins: at its end on the boundary, or the lower one in x, then y."""
    from scipy.sparse.csgraph import dijkstra

    one = int(np.argmax(dijkstra(graph, directed=False, indices=0)))
    other = int(np.argmax(dijkstra(graph, directed=False, indices=one)))
    ends = sorted((one, other), key=lambda k: (not np.isfinite(rim[k]), *x[k].tolist()))
    return np.array(ends[:1], dtype=np.int64)


def _crushed(mesh: Mesh, volume: Floats, damaged: Bools, horizon: float) -> float:
    """The part of the damaged ``volume`` that lies deep in it."""
    from scipy.spatial import cKDTree

    inside, deep = mesh.p[:, damaged], _DEEP * horizon
    low, high = inside.min(axis=1)[:, None] - 2.0 * deep, inside.max(axis=1)[:, None] + 2.0 * deep
    near = ~damaged & ((mesh.p >= low) & (mesh.p <= high)).all(axis=0)
    if not near.any():
        return 1.0
    tree = cKDTree(mesh.p[:, near].T, balanced_tree=False, compact_nodes=False)  # made anew for a single question
    gap, _ = tree.query(inside.T, distance_upper_bound=deep * (1.0 + 1e-12))  # infinite beyond
    return float(volume[gap > deep].sum() / volume.sum())


def _near(x: Floats, horizon: float) -> Csr:
    """The lengths between points within a horizon."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(x).query_pairs(horizon * (1.0 + 1e-9), output_type="ndarray")
    i, j = pairs.T
    length = np.maximum(np.linalg.norm(x[i] - x[j], axis=1), 1e-9 * horizon)  # faces of a slit coincide: no zero edge
    return sparse.csr_matrix((length, (i, j)), shape=(len(x), len(x)))


def _from(points: Floats, x: Floats, horizon: float) -> Floats:
    """The distance of x (n, dim) to the nearest of some points (dim, m), inf beyond a horizon."""
    if not points.shape[1]:
        return np.full(len(x), np.inf)
    from scipy.spatial import cKDTree

    gap, _ = cKDTree(points.T).query(x, distance_upper_bound=horizon * (1.0 + 1e-9))
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
