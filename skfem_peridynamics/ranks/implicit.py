"""What implicit schemes ask of a body over ranks besides forces: tangents, and what is left of stiffnesses.

Every function is called by all ranks at once, with vectors that are their own parts.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs
from ..model.peridynamics import Peridynamics
from ..model.rigidity import connected_parts
from ..model.vertex_stiffness import vertex_stiffness
from ..solve import newton
from ..solve.left import floored
from .body import RankBody


def tangent(body: RankBody, u: Floats) -> Callable[[Floats], Floats]:
    """Return products with the tangent at u."""
    x = body.dealt.halo(body.dim).extended(u)
    if body.dilatation is not None:
        return body.dilatation.tangent(x)
    products = {id(piece): piece.tangent_operator(x).matvec for piece in body.pieces}
    return lambda v: body.applied(v, lambda piece, y: products[id(piece)](y))


def linear(body: RankBody) -> bool:
    """Return whether no bond of any rank ever softens, and the dilatation is quadratic."""
    return all(body.comm.allgather(all(piece.linear for piece in (*body.pieces, body.any_piece))))


def largest_move(body: RankBody, u: Floats, d: Floats, below: float) -> float:
    """Return the largest ``|S| / S_c`` by d of the bonds whose own at u is ``below``."""
    halo = body.dealt.halo(body.dim)
    x, y = halo.extended(u), halo.extended(d)
    most = max(newton.largest_move(piece, x, y, below) for piece in body.pieces)
    return float(max(body.comm.allgather(most)))


def left_of_vertices(body: RankBody, u: Floats | None) -> Floats:
    """Return what is left at u (None: at rest) of what bonds hold the rank's own vertices with, (nown, dim, dim)."""
    local = np.asarray(sum(vertex_stiffness(piece, w) for piece, w in _left(body, u)))
    return body.dealt.halo(body.dim**2).summed(local.ravel()).reshape(-1, body.dim, body.dim)


def left_matrix(body: RankBody, u: Floats | None) -> Csr | None:
    """Return what is left of the stiffness at u (None: at rest), of the whole body on the first rank."""
    dim, size = body.dim, body.share.nvertices * body.dim
    number = (body.share.number[:, None] * dim + np.arange(dim)).ravel()
    found = []
    for piece, weights in _left(body, u):
        rest = [block.rest_stiffness for block in piece.blocks]
        K = sparse.coo_matrix(piece.assemble(weights if weights is not None else rest))
        found.append((K.data, number[K.row], number[K.col]))
    every = body.comm.gather(found, root=0)
    if every is None:
        return None
    # rank by rank, so that a number of ranks has its bits
    whole = sparse.csr_matrix((size, size))
    for data, row, column in (one for of_rank in every for one in of_rank):
        whole = whole + sparse.csr_matrix((data, (row, column)), shape=(size, size))
    return whole


def connected_over_ranks(body: RankBody) -> Longs | None:
    """Return the part of the body that each vertex of the whole mesh is in, on the first rank: what bonds connect."""
    from scipy.sparse.csgraph import connected_components

    number = body.share.number
    every = body.comm.gather([(number, connected_parts(piece)) for piece in body.pieces], root=0)
    if every is None:
        return None
    vertex, part, n = [], [], body.share.nvertices
    for vertices, parts in (one for of_rank in every for one in of_rank):
        vertex.append(vertices)
        part.append(parts + n)
        n += int(parts.max()) + 1
    ends = np.concatenate(vertex), np.concatenate(part)
    graph = sparse.csr_matrix((np.ones(len(ends[0])), ends), shape=(n, n))
    labels = connected_components(graph, directed=False)[1][: body.share.nvertices]
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def _left(body: RankBody, u: Floats | None) -> list[tuple[Peridynamics, list[Floats] | None]]:
    """The pieces of a rank, and what is left of their bonds, an array a block; None at rest."""
    if u is None:
        return [(piece, None) for piece in body.pieces]
    x = body.dealt.halo(body.dim).extended(u)
    if body.dilatation is None:
        return [(piece, floored(piece, piece.hessians(x))) for piece in body.pieces]
    p = body.dilatation.pressure_at_samples(x)
    (piece,) = body.pieces
    return [(piece, floored(piece, list(piece.each_block(x, lambda block, T: block.pressed_hessian(T, p)))))]
