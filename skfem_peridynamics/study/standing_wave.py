"""Standing waves of the linear model: exact motions by the dispersion relation, held in a collar around the body."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from math import pi

import numpy as np

from .._types import Basis, Floats
from ..analysis.dispersion import dispersion
from ..geometry.layers import collar
from ..material.potential import Potential
from ..solve.constraints import Prescribed
from .known_motion import Motion


@dataclass(frozen=True)
class StandingWave(Motion):
    """``a sin(k.x + 1) cos(omega t)`` in the unit box, density 1, ``omega`` from the exact dispersion relation.

    Vertices within two horizons of the boundary are moved as the wave moves; beyond them the ball is whole, and the
    motion that of the infinite body. The wave runs along (1, 2, 3) and moves along k, or across for ``wave="S"``.

    >>> from skfem_peridynamics import Linear
    >>> round(StandingWave(2, 0.1, Linear(6.0), length=0.5).omega, 4)     # long waves: 2 pi / 0.5 sqrt(3) = 21.7656
    21.0612
    """

    dim: int
    horizon: float
    law: Potential
    length: float
    wave: str = "P"
    influence: str = "constant"
    until: float = 0.2

    omega: float = field(init=False)

    def __post_init__(self) -> None:
        omega = dispersion(
            2.0 * pi / self.length,
            dim=self.dim,
            horizon=self.horizon,
            slope=self.law.slope,
            density=1.0,
            influence=self.influence,
            wave=self.wave,
        )
        object.__setattr__(self, "omega", float(omega))

    @cached_property
    def _vectors(self) -> tuple[Floats, Floats]:
        """Wave vector and polarisation."""
        way = np.arange(1.0, self.dim + 1.0)
        way /= np.linalg.norm(way)
        across = np.zeros(self.dim)
        if self.wave == "S":
            across[:2] = -way[1], way[0]
            across /= np.linalg.norm(across)
        return 2.0 * pi / self.length * way, way if self.wave == "P" else across

    def at(self, x: Floats) -> Floats:
        k, a = self._vectors
        phase = np.tensordot(k, x, axes=1) + 1.0
        return np.multiply.outer(a, np.sin(phase))

    def gradient(self, x: Floats) -> Floats:
        k, a = self._vectors
        phase = np.tensordot(k, x, axes=1) + 1.0
        return np.multiply.outer(np.outer(a, k), np.cos(phase))

    def held(self, basis: Basis) -> list[Prescribed]:
        mesh = basis.mesh
        layer = collar(mesh, mesh.boundary_facets(), 2.0 * self.horizon)
        shape = self.at(mesh.p[:, layer]).T.ravel()
        dofs = (layer[:, None] * self.dim + np.arange(self.dim)).ravel()
        return [Prescribed(dofs, displacement=lambda t: self.g(t) * shape)]
