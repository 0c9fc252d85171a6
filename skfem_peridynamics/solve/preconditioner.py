"""What makes the linear systems of an implicit step easy: blocks of vertices, a multigrid cycle or a factor.

The system is ``K + shift M`` on the degrees of freedom that are not prescribed, K the stiffness at rest or, when the
body has changed, what is left of the tangent. Measured in docs/stability.md: the blocks cost one pass over the bonds
and nothing more; a factor is worth its time where there are few unknowns or a line of them; a multigrid cycle where
stiffness or mass differ by orders of magnitude between vertices far apart, and unknowns are many.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import LinearOperator

from .._types import Csr, Floats, Longs
from ..model.held import held_stiffness
from ..model.peridynamics import Peridynamics
from ..model.rigidity import rigid_modes

NAMES = ("auto", "blocks", "amg", "direct")
_REMAINS = 1e-3  # of a softened bond, so that what it held is held
FACTOR_ENTRIES = 4e6  # of the stiffness, up to which a factor is made where nothing is said (docs/stability.md)


class Preconditioner:
    """Approximate inverses of ``K + shift M`` on the free degrees of freedom, made when first asked for.

    ``kind`` is one of :data:`NAMES`; ``renew(u)`` has the next one made of what is left of the tangent at u.
    """

    def __init__(self, body: Peridynamics, M: sparse.spmatrix | None, free: Longs, kind: str = "auto") -> None:
        if kind not in NAMES:
            raise ValueError(f"linear = {kind!r} must be one of {', '.join(NAMES)}")
        self.body, self.free, self.made = body, free, 0
        self.M = None if M is None else sparse.csr_matrix(sparse.diags(M) if isinstance(M, np.ndarray) else M)
        self.kind = kind
        self._weights: list[Floats] | None = None
        self._held: Floats | None = None
        self._K: Csr | None = None
        self._known: dict[float, LinearOperator] = {}

    def renew(self, u: Floats) -> None:
        """Forget what was made of an earlier state."""
        rest = [2.0 * block.law.slope * block.k for block in self.body.blocks]
        now = self.body.hessians(u)
        self._weights = [np.maximum(h, _REMAINS * k) for h, k in zip(now, rest, strict=True)]
        self._held, self._K = None, None
        self._known.clear()

    def at(self, shift: float) -> LinearOperator:
        """Return the approximate inverse for a shift (0: no mass)."""
        if shift not in self._known:
            if len(self._known) > 3:  # steps cut again and again
                self._known.clear()
            self._known[shift] = self._make(shift)
            self.made += 1
        return self._known[shift]

    def _make(self, shift: float) -> LinearOperator:
        if self.kind == "auto":
            self.kind = "direct" if self._entries() <= FACTOR_ENTRIES else "blocks"
        if self.kind == "blocks":
            return self._blocks(shift)
        if self._K is None:
            weights = self._weights
            self._K = self.body.stiffness() if weights is None else self.body.assemble(weights)
        A = self._K if self.M is None or shift == 0.0 else sparse.csr_matrix(self._K + shift * self.M)
        inner = A[self.free][:, self.free]
        return _factor(inner) if self.kind == "direct" else self._cycle(inner)

    def _entries(self) -> float:
        """About how many entries the stiffness has: a dim x dim block for both ends of each bond."""
        dim = self.body.bonds.dim
        per_bond = 2 if self.body.bonds.samples.at_vertices else 2 * (dim + 1)
        return float(dim * dim * per_bond * self.body.bonds.nbonds)

    def _blocks(self, shift: float) -> LinearOperator:
        if self._held is None:
            self._held = held_stiffness(self.body, self._weights)
        dim = self.body.bonds.dim
        A = self._held.copy()
        if self.M is not None:
            A[:, range(dim), range(dim)] += shift * self.M.diagonal().reshape(-1, dim)
        fixed = np.ones(len(A) * dim, dtype=bool)
        fixed[self.free] = False
        rows, components = np.nonzero(fixed.reshape(-1, dim))
        A[rows, components, :] = 0.0
        A[rows, :, components] = 0.0
        scale = np.trace(A, axis1=1, axis2=2)
        A[:, range(dim), range(dim)] += 1e-12 * scale[:, None]  # a vertex held in one direction only
        A[rows, components, components] = 1.0
        empty = ~(A[:, range(dim), range(dim)] > 0.0).all(axis=1)
        A[empty] = np.eye(dim)
        inverse = np.linalg.inv(A)
        size = len(A) * dim

        def apply(x: Floats) -> Floats:
            full = np.zeros(size)
            full[self.free] = x
            out: Floats = np.einsum("nab,nb->na", inverse, full.reshape(-1, dim)).ravel()[self.free]
            return out

        return _operator(len(self.free), apply)

    def _cycle(self, A: Csr) -> LinearOperator:
        import pyamg

        modes = rigid_modes(self.body.bonds.mesh.p)[self.free]
        solver: Any = pyamg.smoothed_aggregation_solver(
            A, B=modes, symmetry="symmetric", smooth="energy", max_coarse=200
        )
        return solver.aspreconditioner(cycle="V")


def _factor(A: Csr) -> LinearOperator:
    from scipy.sparse.linalg import splu

    # scaled to a unit diagonal, so that stiff and soft parts are told apart by their bonds alone
    scale = 1.0 / np.sqrt(A.diagonal())
    inner = sparse.csc_matrix(sparse.diags(scale) @ A @ sparse.diags(scale))
    factor = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    return _operator(A.shape[0], lambda x: scale * factor.solve(scale * x))


def _operator(size: int, apply: Callable[[Floats], Floats]) -> LinearOperator:
    return LinearOperator((size, size), matvec=lambda x: apply(np.asarray(x).ravel()), dtype=np.dtype(float))
