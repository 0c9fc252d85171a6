"""The stable step of the tangent, again and again along a run."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence

from .._types import Floats
from ..model.peridynamics import Peridynamics
from .cfl import DENSE, largest_eigenvalue, nodal_bounds
from .lanczos import largest_mode
from .mass_solver import Lumped, mass_solver


class TangentLimit:
    """The stable step of the tangent, again and again along a run: each time from the mode found the last time.

    It costs some ten products where the body has changed little; ``products`` counts them. Lanczos in a small space is
    less sure than :func:`stable_time_step`: its residual and 2 % are added to what it finds.
    """

    def __init__(self, body: Peridynamics, M: sparse.spmatrix | Floats) -> None:
        self.body, self.products = body, 0
        self.mass = mass_solver(M, np.empty(0, dtype=np.int64))
        self._lumped = np.asarray(M.sum(axis=1)).ravel() if not isinstance(M, np.ndarray) else M
        self._mode = np.random.default_rng(0).standard_normal(len(self._lumped))

    def at(self, u: Floats) -> float:
        """Return the largest stable step at u (infinite where nothing is stiff any more)."""
        K, mass = self.body.tangent_operator(u), self.mass
        size = mass.size
        if size <= DENSE:
            lam, _, _ = largest_eigenvalue(self.body, mass, 0.0, u)
            return inf if lam <= 0.0 else 2.0 / sqrt(lam)

        def apply(x: Floats) -> Floats:
            self.products += 1
            product: Floats = K @ x
            return product

        options = {"k": 1, "ncv": min(size - 1, 10), "tol": 2e-2, "maxiter": 30, "v0": self._mode}
        try:
            value, self._mode, residual = largest_mode(apply, mass, **options)
        except (ArpackNoConvergence, ArpackError):  # then the guaranteed bound
            weights = self.body.bounding_weights(u)
            consistent = 1.0 if isinstance(mass, Lumped) else self.body.bonds.dim + 2.0
            return 2.0 / sqrt(consistent * nodal_bounds(self.body, self._lumped, weights)[0])
        # 2 %: what a space of ten vectors can miss, started from the mode of the last time
        lam = (value + residual) * 1.02
        return inf if lam <= 0.0 else 2.0 / sqrt(lam)
