"""Matrices of a body: sums over its bonds, and what a dilatation adds to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse

from .._memory import check_room
from .._types import Csr, Floats, Longs
from ..bonds.bond_basis import BondBasis
from ..engine.block import Beside, Block

_MERGED = 8_000_000  # entries that are kept as a list before they are merged


def at_vertices(bonds: BondBasis, block: Block) -> tuple[Longs, Csr, sparse.csc_matrix]:
    """Return B and X^T of a block with vertex degrees of freedom in place of samples, and the numbers of those."""
    dim, samples = bonds.dim, bonds.samples
    B, XT = block.matrices()
    if samples.at_vertices:
        vertices = samples.vertices[block.window, 0]
    else:
        P = samples.matrix[block.window]
        vertices = np.unique(P.indices)
        P = sparse.kron(P[:, vertices], sparse.identity(dim), format="csr")
        B, XT = B @ P, P.T @ XT
    return (vertices[:, None].astype(np.int64) * dim + np.arange(dim)).ravel(), B, XT


def assemble(bonds: BondBasis, blocks: Sequence[Block], weights: Sequence[Floats]) -> Csr:
    """Return the matrix of ``sum weight T(u) T(v)``, exactly symmetric when the rule is.

    >>> import skfem
    >>> from skfem_peridynamics import Linear, Peridynamics
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.5), Linear(1.0))
    >>> assemble(body.bonds, body.blocks, [2.0 * block.k for block in body.blocks]).toarray().round(12).tolist()
    [[1.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]]
    """
    size = int(bonds.space.N)
    total = sparse.csr_matrix((size, size))
    rows, cols, values, entries = [], [], [], 0
    for block, weight in zip(blocks, weights, strict=True):
        number, B, XT = at_vertices(bonds, block)
        local = (XT @ sparse.csr_matrix(B.multiply(weight[:, None]))).tocoo()
        rows.append(number[local.row])
        cols.append(number[local.col])
        values.append(local.data)
        entries += local.nnz
        if entries > max(_MERGED, total.nnz):  # merge before the parts outgrow what they merge into
            total = total + _csr(rows, cols, values, size)
            rows, cols, values, entries = [], [], [], 0
    K = total + _csr(rows, cols, values, size) if rows else total
    # round-off of the summation order, so that K equals its transpose
    return _symmetric(K) if bonds.rule.symmetric else K


def with_dilatation(bonds: BondBasis, blocks: Sequence[Block], K: Csr, beside: Beside) -> Csr:
    """Return the matrix K of the bonds with that of the dilatation; it reaches two horizons.

    Raises ``ValueError`` where there is no room for it.
    """
    entries = int(K.nnz * 2.0**bonds.dim)
    check_room(
        12.0 * 2.0 * entries,
        f"a matrix of bonds and dilatation with some {entries:,} entries",
        "stiffness_operator() and tangent_operator(u) need none of it",
    )
    R = sparse.csr_matrix((int(bonds.mesh.nvertices), K.shape[0]))
    for number, block in enumerate(blocks):
        dofs, B, _ = at_vertices(bonds, block)
        rate = block.rates(None) if beside.rates is None else beside.rates[number]
        P = bonds.samples.matrix[block.window]
        local = ((P.T @ block.both_ends()[0].T) @ B.multiply(rate[:, None])).tocoo()
        R = R + sparse.csr_matrix((local.data, (local.row, dofs[local.col])), shape=R.shape)
    return _symmetric(K + R.T @ R.multiply(beside.stiffness[:, None]))


def _symmetric(K: Csr) -> Csr:
    return sparse.csr_matrix((K + K.T) * 0.5)


def _csr(rows: list[Longs], cols: list[Longs], values: list[Floats], size: int) -> Csr:
    triple = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
    return sparse.coo_matrix(triple, shape=(size, size)).tocsr()
