"""What makes the linear systems of an implicit step easy: blocks of vertices, a multigrid cycle or a factor.

The system is ``K + shift M`` on the degrees of freedom that are not prescribed, K the stiffness at rest or, when the
body has changed, what is left of the tangent. Measured in docs/evidence/stability.md: a factor makes the next step
ten times cheaper than the others can, and takes seconds to make from some 15,000 unknowns on in 2D; beyond, a
multigrid cycle pays where a step is long; the blocks of vertices need no matrix, and do for steps of some ten times the
explicit one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import LinearOperator

from .._types import Csr, Floats, Longs
from ..model.peridynamics import Peridynamics
from ..model.rigidity import rigid_modes
from .left import left_of

NAMES = ("auto", "blocks", "amg", "direct")
_SLOW = 40  # products of a solve that could be faster
# What it takes to make one, in products with the Hessian.
_PRICE = {"blocks": 40, "amg": 250, "direct": 400}
# Where nothing is said (docs/evidence/stability.md): entries of the stiffness up to which a factor is made, the length
# of a step over the explicit one from which a multigrid cycle pays, and the bytes that an entry takes meanwhile.
FACTOR_ENTRIES, LONG_STEP, _BYTES = 2e6, 30.0, 40.0


@dataclass(frozen=True, eq=False)
class SolverMemory:
    """What a preconditioner has learnt: with it a run that is continued takes the same steps, to the last bit.

    ``spent`` is what slow solves have cost, in products; ``tangent`` where it was made of the tangent (None: at rest).
    """

    spent: int = 0
    tangent: Floats | None = None


class Preconditioner:
    """Approximate inverses of ``K + shift M`` on the free degrees of freedom, made when first asked for.

    ``kind`` is one of :data:`NAMES`.
    """

    def __init__(self, body: Peridynamics, M: sparse.spmatrix | None, free: Longs, kind: str = "auto") -> None:
        if kind not in NAMES:
            raise ValueError(f"linear = {kind!r} must be one of {', '.join(NAMES)}")
        self.body, self.free, self.made = body, free, 0
        self.M = None if M is None else sparse.csr_matrix(sparse.diags(M) if isinstance(M, np.ndarray) else M)
        self.kind, self._price, self._spent = kind, 0, 0
        self._left = left_of(body, None)
        self._tangent: Floats | None = None
        self._vertex_stiffness: Floats | None = None
        self._K: Csr | None = None
        self._known: dict[float, tuple[LinearOperator, int]] = {}

    def learn(self, products: int, u: Floats) -> None:
        """Have the next one made of the tangent at u once solves are slow, and have cost what that takes."""
        self._spent += products
        if products > _SLOW and self._spent > self._price:
            self._renew(u)

    @property
    def memory(self) -> SolverMemory:
        """What it has learnt so far."""
        return SolverMemory(self._spent, self._tangent)

    def recall(self, memory: SolverMemory | None) -> None:
        """Go on with what another has learnt of the same body."""
        if memory is None:
            return
        if memory.tangent is not None:
            self._renew(memory.tangent)
        self._spent = memory.spent

    def _renew(self, u: Floats) -> None:
        self._tangent = u.copy()
        self._left = left_of(self.body, self._tangent)
        self._vertex_stiffness, self._K, self._spent = None, None, 0
        self._known.clear()

    def at(self, shift: float) -> LinearOperator:
        """Return the approximate inverse for a shift (0: no mass)."""
        if shift not in self._known:
            if len(self._known) > 3:  # steps cut again and again
                self._known.clear()
            self._known[shift] = self._make(shift)
            self.made += 1
        operator, self._price = self._known[shift]
        return operator

    def _make(self, shift: float) -> tuple[LinearOperator, int]:
        """Return the inverse and its price."""
        kind = self._chosen(shift) if self.kind == "auto" else self.kind
        price = _PRICE[kind]
        if kind == "blocks":
            return self._blocks(shift), price
        if self._K is None:
            self._K = self._left.matrix()
        A = self._K if self.M is None or shift == 0.0 else sparse.csr_matrix(self._K + shift * self.M)
        inner = A[self.free][:, self.free]
        empty = inner.diagonal() == 0.0  # where a boundary function leaves no bond, nothing is to be solved for
        if empty.any():
            inner = sparse.csr_matrix(inner + sparse.diags(empty.astype(float)))
        return (_factor(inner) if kind == "direct" else self._cycle(inner)), price

    def _chosen(self, shift: float) -> str:
        """What the measurements advise for this body and shift."""
        entries = self._entries()
        if entries <= FACTOR_ENTRIES:
            return "direct"
        if entries * _BYTES > self.body.matrix_memory:
            return "blocks"
        if shift == 0.0 or self.M is None:
            return "amg"
        stiffest = np.trace(self._diagonal(), axis1=1, axis2=2) / self.M.diagonal()[:: self.body.bonds.dim]
        return "amg" if float(stiffest.max()) > LONG_STEP**2 * shift else "blocks"

    def _diagonal(self) -> Floats:
        if self._vertex_stiffness is None:
            self._vertex_stiffness = self._left.vertices()
        return self._vertex_stiffness

    def _entries(self) -> float:
        """About how many entries the stiffness has: a dim x dim block for both ends of each bond."""
        dim = self.body.bonds.dim
        per_bond = 2 if self.body.bonds.samples.at_vertices else 2 * (dim + 1)
        return float(dim * dim * per_bond * self.body.bonds.nbonds)

    def _blocks(self, shift: float) -> LinearOperator:
        dim = self.body.bonds.dim
        A = self._diagonal().copy()
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
