"""What the bonds of each vertex hold it with: the blocks that bound, scale and check the stiffness."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats
from ..engine.block import Block
from .led_body import LedBody
from .peridynamics import Peridynamics


def vertex_stiffness(body: Peridynamics, weights: Sequence[Floats] | None = None) -> Floats:
    """Return the stiffness ``A_i`` that all bonds of vertex i hang on it, by P1 values, (nvertices, dim, dim).

    Of vertex pairs it is the diagonal block of the stiffness. For any list of bonds whose force is a gradient,
    ``2 diag(A_i)`` is at least the stiffness. For a one-sided force only the end x counts, twice. ``weights`` are those
    of another state, one array a block; they must not be negative for the bound to hold.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.5), Linear(slope=1.0))
    >>> vertex_stiffness(body).ravel().tolist() == body.stiffness().diagonal().tolist()
    True
    """
    if isinstance(body, LedBody):
        return body.vertex_stiffness()
    samples, dim = body.bonds.samples, body.bonds.dim
    A = np.zeros((samples.nsamples, dim * dim))
    given = [None] * len(body.blocks) if weights is None else list(weights)

    def of_block(job: tuple[Block, Floats | None]) -> Floats:
        block, weight = job
        p = block.directions()
        if weight is None:
            weight = block.rest_stiffness
        C = block.incidence(1.0)
        if not body.symmetric:
            C, weight = _only_x(C), 2.0 * weight
        spread: Floats = C.T @ (weight[:, None] * np.einsum("na,nb->nab", p, p).reshape(len(p), -1))
        return spread

    jobs = list(zip(body.blocks, given, strict=True))
    for block, part in zip(body.blocks, body.pool.map(of_block, jobs), strict=True):
        A[block.window] += part
    return samples.spread(A).reshape(-1, dim, dim)


def vertex_stiffness_scale(body: Peridynamics) -> Floats:
    """Return one positive number for each degree of freedom: the stiffness that bonds hold its vertex with, (N,).

    Where there is none it is the smallest that there is.
    """
    of_vertex = np.trace(vertex_stiffness(body), axis1=1, axis2=2)
    stiff = of_vertex > 0.0
    of_vertex[~stiff] = of_vertex[stiff].min(initial=1.0)
    return np.repeat(of_vertex, body.bonds.dim)


def _only_x(C: Csr) -> Csr:
    """The first entry of each row of an incidence matrix: the end x."""
    first = C.indptr[:-1]
    return sparse.csr_matrix((C.data[first], C.indices[first], np.arange(C.shape[0] + 1)), shape=C.shape)
