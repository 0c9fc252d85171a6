"""The largest eigenvalue of ``K x = lam M x``, K symmetric and only applied: SciPy's Lanczos, and its residual."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from .._types import Floats
from .mass_solver import Lumped, MassSolver


def largest_mode(apply: Callable[[Floats], Floats], mass: MassSolver, **options: Any) -> tuple[float, Floats, float]:
    """Return the largest Ritz value, its vector, and the norm of its residual; ``options`` are those of eigsh.

    With a lumped mass the vector is that of ``M^-1/2 K M^-1/2``, of the same eigenvalues, whose product is cheaper.
    Raises SciPy's ``ArpackNoConvergence`` or ``ArpackError``.

    >>> x, lam = np.array([3.0, 1.0, 2.0]), np.array([6.0, 4.0, 2.0])
    >>> value, _, residual = largest_mode(lambda x: lam * x, Lumped(np.array([3.0, 1.0, 2.0])), k=1, v0=x, ncv=3)
    >>> round(value, 12), residual < 1e-12
    (4.0, True)
    """
    shape = (mass.size, mass.size)

    def operator(product: Callable[[Floats], Floats]) -> LinearOperator:
        return LinearOperator(shape, matvec=product, dtype=np.dtype(float))

    if isinstance(mass, Lumped):
        scale = np.sqrt(mass.inverse)
        S = operator(lambda x: scale * apply(scale * x))
        values, vectors = eigsh(S, which="LA", **options)
        x = vectors[:, 0]
        return float(values[0]), x, float(np.linalg.norm(S @ x - values[0] * x))
    M, inverse = operator(mass.times), operator(mass.solve)
    values, vectors = eigsh(operator(apply), M=M, Minv=inverse, which="LA", **options)
    x = vectors[:, 0]
    gap = apply(x) - values[0] * mass.times(x)
    norm = float(np.sqrt(gap @ mass.solve(gap)))  # in the norm of M^-1, for x of unit norm in M
    return float(values[0]), x, norm / float(np.sqrt(x @ mass.times(x)))
