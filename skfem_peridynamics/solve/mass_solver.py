"""Accelerations from forces: dividing by a lumped mass, or solving with a consistent one.

The consistent P1 mass is well conditioned on any mesh: scaled by its diagonal its eigenvalues lie between 1/2 and
(d + 2)/2, at most 5/2 (Wathen 1987). Small systems keep a sparse factor; large ones take a fixed number of Chebyshev
steps on that interval, no inner products, a linear map, the same bits every time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs

# Unknowns up to which a factor is kept. Measured: in 2D its solve is 0.3 to 0.7 of the Chebyshev steps up to 320,000,
# but it takes seconds to make there; in 3D, where rows have 15 entries and factors fill in, they cross at 20,000.
FACTOR_UP_TO, FACTOR_UP_TO_3D, _ROW_3D = 300_000, 20_000, 10
_LOW, _HIGH = 0.5, 2.5  # Wathen's bounds
_REDUCTION = 1e-14  # of the error: what the number of steps is chosen for
_CHECK = 1e-10  # relative residual above which a mass is not that of P1, and is factored


class MassSolver(Protocol):
    """The mass of a scheme: products, and accelerations of the degrees of freedom that are not prescribed.

    ``out`` is an array that the accelerations may go to.
    """

    size: int

    def times(self, x: Floats) -> Floats: ...

    def solve(self, force: Floats, out: Floats | None = None) -> Floats: ...


@runtime_checkable
class MassOverRanks(Protocol):
    """A mass that is dealt out over ranks, and makes its own solver; ``fixed`` are the rank's own unknowns."""

    shape: tuple[int, int]

    def solver(self, fixed: Longs) -> MassSolver: ...


class Lumped:
    """A diagonal mass."""

    def __init__(self, m: Floats) -> None:
        self.m, self.inverse, self.size = m, 1.0 / m, len(m)

    def times(self, x: Floats) -> Floats:
        return self.m * x

    def solve(self, force: Floats, out: Floats | None = None) -> Floats:
        return np.multiply(force, self.inverse, out=out)


class Factored:
    """A sparse mass with its factor, on the free degrees of freedom; the others are left at 0."""

    def __init__(self, M: Csr, free: Longs) -> None:
        from scipy.sparse.linalg import splu

        self.M, self.free, self.size = M, free, M.shape[0]
        inner = sparse.csc_matrix(M[free][:, free])
        self.factor = splu(inner, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def times(self, x: Floats) -> Floats:
        out: Floats = self.M @ x
        return out

    def solve(self, force: Floats, out: Floats | None = None) -> Floats:
        out = np.zeros(self.size)
        out[self.free] = self.factor.solve(force[self.free])
        return out


class Chebyshev:
    """A sparse mass solved by Chebyshev's semi-iteration on the known bounds of a P1 mass.

    ``inner`` (nfree,) -> (nfree,) is its product among the ``free`` unknowns, where M has none that can be made of it.
    """

    def __init__(self, M: Csr, free: Longs, inner: Callable[[Floats], Floats] | None = None) -> None:
        self.M, self.free, self.size = M, free, M.shape[0]
        self.inner = inner if inner is not None else sparse.csr_matrix(M[free][:, free]).__matmul__
        self.diagonal = M.diagonal()[free]
        self.middle, self.half = 0.5 * (_HIGH + _LOW), 0.5 * (_HIGH - _LOW)
        root = np.sqrt(_HIGH / _LOW)
        self.steps = int(np.ceil(np.log(2.0 / _REDUCTION) / np.log((root + 1.0) / (root - 1.0))))

    def times(self, x: Floats) -> Floats:
        out: Floats = self.M @ x
        return out

    def solve(self, force: Floats, out: Floats | None = None) -> Floats:
        r = force[self.free]
        z = r / self.diagonal
        d = z / self.middle
        x = d.copy()
        ratio = self.half / self.middle
        rho = ratio
        for _ in range(self.steps):
            r = r - self.inner(d)
            after = 1.0 / (2.0 / ratio - rho)
            d = after * rho * d + (2.0 * after / self.half) * (r / self.diagonal)
            x += d
            rho = after
        out = np.zeros(self.size)
        out[self.free] = x
        return out


def mass_solver(M: sparse.spmatrix | Floats | MassOverRanks, fixed: Longs) -> MassSolver:
    """Return the solver of a mass: a diagonal (N,), or a matrix (N, N); ``fixed`` lists prescribed unknowns.

    Raises ``ValueError`` unless the diagonal is positive and finite.

    >>> import skfem
    >>> from skfem_peridynamics import mass_matrix
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> M = mass_matrix(basis, kind="consistent")
    >>> mass_solver(M, np.array([], dtype=int)).solve(M @ np.array([1.0, 2.0, 3.0])).round(12).tolist()
    [1.0, 2.0, 3.0]
    """
    if isinstance(M, MassOverRanks):
        return M.solver(fixed)
    if isinstance(M, np.ndarray):
        diagonal: Floats = M.astype(float, copy=False)
    else:
        diagonal = M.diagonal()
    if diagonal.ndim != 1 or not np.isfinite(diagonal).all() or not (diagonal > 0.0).all():
        raise ValueError("M must have a positive, finite diagonal")
    if isinstance(M, np.ndarray) or is_diagonal(M):
        return Lumped(diagonal)
    free = np.setdiff1d(np.arange(len(diagonal)), fixed)
    M = sparse.csr_matrix(M)
    M.eliminate_zeros()
    if len(free) <= (FACTOR_UP_TO_3D if M.nnz > _ROW_3D * len(diagonal) else FACTOR_UP_TO):
        return Factored(M, free)
    iterated = Chebyshev(M, free)
    probe = np.zeros(len(diagonal))
    probe[free] = np.random.default_rng(0).standard_normal(len(free))
    missed = (M @ iterated.solve(probe) - probe)[free]
    good = np.linalg.norm(missed) <= _CHECK * np.linalg.norm(probe)
    return iterated if good else Factored(M, free)


def is_diagonal(M: sparse.spmatrix) -> bool:
    """Return whether a sparse matrix has nothing off its diagonal.

    >>> is_diagonal(sparse.identity(3, format="csr"))
    True
    """
    if M.nnz == np.count_nonzero(M.diagonal()):
        return True
    return not sparse.coo_matrix(M - sparse.diags(M.diagonal())).count_nonzero()
