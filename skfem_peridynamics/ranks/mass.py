"""The consistent mass over ranks: a rank has the rows of its own unknowns."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs
from ..model.mass import mass_matrix
from ..model.space import vector_basis
from ..solve.mass_solver import Chebyshev
from .body import RankBody
from .dealt_mesh import DealtMesh


@dataclass(frozen=True, eq=False)
class RankMass:
    """The consistent mass, as a step or its limit asks for it; ``rows`` (nown dim, nlocal dim) are a rank's own.

    Methods are called by all ranks at once.
    """

    mesh: DealtMesh
    rows: Csr

    @classmethod
    def of(cls, body: RankBody, density: float | Floats = 1.0) -> RankMass:
        """Return the mass of a body; ``density`` is one for all, or (nelements,) of the rank's mesh."""
        share = body.share
        M = mass_matrix(vector_basis(share.mesh), density=density, kind="consistent")
        return cls(body.dealt, M[: share.own * body.dim])

    @property
    def shape(self) -> tuple[int, int]:
        """Those of the rank's own unknowns."""
        return len(self.lumped), len(self.lumped)

    @cached_property
    def lumped(self) -> Floats:
        """The row sums, (nown dim,)."""
        return np.asarray(self.rows.sum(axis=1), dtype=float).ravel()

    def diagonal(self) -> Floats:
        """Return the diagonal, (nown dim,)."""
        return np.asarray(self.rows.diagonal(), dtype=float)

    def __matmul__(self, x: Floats) -> Floats:
        out: Floats = self.rows @ self.mesh.halo(int(self.mesh.share.mesh.dim())).extended(x)
        return out

    def whole(self) -> Csr | None:
        """Return the mass of the whole body, on the first rank."""
        share, dim = self.mesh.share, int(self.mesh.share.mesh.dim())
        number = (share.number[:, None] * dim + np.arange(dim)).ravel()
        M = sparse.coo_matrix(self.rows)
        every = self.mesh.comm.gather((M.data, number[M.row], number[M.col]), root=0)
        if every is None:
            return None
        data, row, column = (np.concatenate(each) for each in zip(*every, strict=True))
        size = share.nvertices * dim
        return sparse.csr_matrix((data, (row, column)), shape=(size, size))

    def solver(self, fixed: Longs) -> Chebyshev:
        """Return the solver that steppers take: products by exchanges of ghosts, no sum over all ranks."""
        free = np.setdiff1d(np.arange(self.shape[0]), fixed)

        def inner(d: Floats) -> Floats:
            whole = np.zeros(self.shape[0])
            whole[free] = d
            product: Floats = (self @ whole)[free]
            return product

        return Chebyshev(self, free, inner)
