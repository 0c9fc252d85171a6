"""Bodies that the cases share, and their exact limits by the dense spectrum."""

from __future__ import annotations

import numpy as np
from scipy import linalg

from .._types import Csr, Floats, Mesh
from ..bonds.ball_rule import BallRule
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule
from ..material.potential import Potential
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis


def pairs() -> Rule:
    return PairRule()


def ball(dim: int, outer: str = "gauss", symmetric: bool = True) -> Rule:
    """A small ball rule of a dimension."""
    return BallRule(3, {1: 1, 2: 8, 3: 13}[dim], outer, symmetric)


def body_on(mesh: Mesh, horizon: float, law: Potential, rule: Rule | None = None) -> Peridynamics:
    """A free body on a mesh."""
    return Peridynamics(BondBasis(vector_basis(mesh), horizon, rule=rule or PairRule()), law)


def largest(body: Peridynamics, M: Csr) -> float:
    """Return the largest eigenvalue of ``K x = lam M x`` from the whole spectrum."""
    K, D = body.stiffness().toarray(), M.toarray()
    if not body.symmetric:
        return float(np.abs(linalg.eigvals(K, D)).max())
    return float(linalg.eigh(K, D, eigvals_only=True, subset_by_index=[len(K) - 1, len(K) - 1])[0])


def exact_limit(body: Peridynamics, M: Csr) -> float:
    """Return the largest stable step by the dense spectrum."""
    return 2.0 / float(np.sqrt(largest(body, M)))


def stretch(mesh: Mesh, horizon: float, softening: float, b: float) -> Floats:
    """Return the displacement ``sin(pi x)`` along x, (N,), whose largest ``b r S^2`` is about ``softening``."""
    u = np.zeros(mesh.p.T.shape)
    u[:, 0] = np.sin(np.pi * mesh.p[0]) * np.sqrt(softening / (b * np.pi**2 * horizon))
    return u.ravel()
