"""Motions that cost a body no energy, beyond the rigid ones: found before they spoil an answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse as sparse

from .._types import Floats, Longs
from .led_body import LedBody
from .peridynamics import Peridynamics
from .vertex_stiffness import vertex_stiffness

_NOTHING = 1e-12  # of the largest: what round-off makes of a stiffness that is zero


def rigid_modes(p: Floats) -> Floats:
    """Return infinitesimal rigid motions of points (dim, n), columns (dim n, dim (dim + 1) / 2), about their middle.

    >>> rigid_modes(np.array([[0.0, 2.0], [0.0, 0.0]])).T.tolist()
    [[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 1.0], [0.0, -1.0, 0.0, 1.0]]
    """
    x = _centred(p)
    n, dim = x.shape
    modes = [np.tile(np.eye(dim)[a], n) for a in range(dim)]
    for a in range(dim):
        for b in range(a + 1, dim):
            turn = np.zeros((n, dim))
            turn[:, a], turn[:, b] = 0.0 - x[:, b], x[:, a]
            modes.append(turn.ravel())
    return np.stack(modes, axis=1)


def _centred(p: Floats) -> Floats:
    """Points about their middle, (n, dim), at most 1 in size."""
    x = (p - p.mean(axis=1, keepdims=True)).T
    size = np.abs(x).max(initial=0.0)
    return np.asarray(x / (size if size > 0.0 else 1.0), dtype=float)


def uniform_strains(p: Floats) -> Iterator[tuple[str, Floats]]:
    """Yield the name and the displacement (N,) of each uniform strain of points (dim, n).

    >>> [name for name, _ in uniform_strains(np.zeros((2, 1)))]
    ['stretch along x', 'shear of x and y', 'stretch along y']
    """
    x = _centred(p)
    for a, first in enumerate("xyz"[: x.shape[1]]):
        for b, second in list(enumerate("xyz"[: x.shape[1]]))[a:]:
            u = np.zeros_like(x)
            u[:, a] += x[:, b]
            u[:, b] += x[:, a]
            yield (f"stretch along {first}" if a == b else f"shear of {first} and {second}"), u.ravel()


def check_rigid(body: Peridynamics) -> None:
    """Raise ``ValueError`` when the bonds leave a vertex, or the whole body in a uniform strain, free to move.

    So they do where the horizon is so short that all bonds of a vertex lie along a line, or those of a lattice along
    its axes. It costs one pass over the bonds and ``dim (dim + 1) / 2`` products. Vertices at which a boundary function
    is zero have no stiffness by intention, and are left alone.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear, PairRule
    >>> grid = np.linspace(0, 1, 5)
    >>> basis = skfem.Basis(skfem.MeshTri.init_tensor(grid, grid), skfem.ElementVector(skfem.ElementTriP1()))
    >>> axes_only = BondBasis(basis, horizon=0.26, rule=PairRule(partial_volume=False))
    >>> check_rigid(Peridynamics(axes_only, Linear(1.0)))
    Traceback (most recent call last):
    ValueError: no bond resists a shear of x and y of the whole body: the horizon, 0.26, is too short for this mesh
    """
    bonds = body.bonds
    check_rigidity(
        bonds.mesh.p,
        bonds.horizon,
        vertex_stiffness(body),
        body.stiffness_operator().matvec,
        weighted=bonds.vertex_weight is not None,
    )


def check_rigidity(
    p: Floats, horizon: float, stiffness: Floats, product: Callable[[Floats], Floats], weighted: bool = False
) -> None:
    """Do what :func:`check_rigid` does, from what vertices are held with and products with the stiffness."""
    least, most = np.linalg.eigvalsh(stiffness)[:, [0, -1]].T
    floppy = np.flatnonzero((least <= _NOTHING * most) & (most > 0.0))
    if not weighted and len(floppy):
        where = ", ".join(f"{x:g}" for x in p[:, floppy[0]])
        raise ValueError(
            f"all bonds of vertex {floppy[0]} at ({where}) lie along a line or in a plane, and nothing holds it "
            f"across: the horizon, {horizon:g}, is too short for this mesh"
        )
    strained = {name: float(u @ product(u)) for name, u in uniform_strains(p)}
    largest = max(strained.values())
    for name, energy in strained.items():
        if energy <= _NOTHING * largest:
            raise ValueError(
                f"no bond resists a {name} of the whole body: the horizon, {horizon:g}, is too short for this mesh"
            )


def check_supported(body: Peridynamics, prescribed: Longs) -> None:
    """Raise ``ValueError`` when a part of the body can move rigidly although some degrees of freedom are prescribed.

    Parts are what bonds connect. A statics problem needs each of them held.
    """
    mesh, dim = body.bonds.mesh, body.bonds.dim
    part_of = connected_parts(body)
    fixed = np.zeros(mesh.nvertices * dim, dtype=bool)
    fixed[prescribed] = True
    for part in range(int(part_of.max()) + 1):
        vertices = np.flatnonzero(part_of == part)
        modes = rigid_modes(mesh.p[:, vertices])
        moved = modes[fixed.reshape(-1, dim)[vertices].ravel()]
        rank = int(np.linalg.matrix_rank(moved, tol=1e-9)) if moved.size else 0
        if rank < modes.shape[1]:
            where = ", ".join(f"{x:g}" for x in mesh.p[:, vertices[0]])
            raise ValueError(
                f"the part of the body with the vertex at ({where}) can move rigidly, in {modes.shape[1] - rank} of "
                f"{modes.shape[1]} ways: statics needs it held, prescribe more of its displacement"
            )


def connected_parts(body: Peridynamics) -> Longs:
    """Return the number of the part of the body that each vertex is in, (nvertices,); parts are what bonds connect."""
    from scipy.sparse.csgraph import connected_components

    if isinstance(body, LedBody):
        return body.connected_parts()
    samples = body.bonds.samples
    n = samples.nsamples
    links = sparse.csr_matrix((n, n))
    for block in body.blocks:
        C = block.incidence(1.0)
        first = np.repeat(C.indices[C.indptr[:-1]], np.diff(C.indptr)) + block.window.start
        ends = C.indices + block.window.start
        live = np.repeat(block.k > 0.0, np.diff(C.indptr)) & (C.data != 0.0)
        links = links + sparse.csr_matrix((np.ones(live.sum()), (first[live], ends[live])), shape=(n, n))
    P = (samples.matrix != 0.0).astype(float)
    graph = P.T @ links @ P + P.T @ P
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
