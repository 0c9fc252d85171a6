"""Known motions of the unit interval, square or cube, and the meshes of studies."""

from __future__ import annotations

from abc import ABC, abstractmethod
from math import pi

import numpy as np

from .._types import Basis, Floats, Load, Mesh
from ..material.potential import Exponential, Linear, Potential
from ..model.space import vector_basis
from ..solve.constraints import Prescribed


class Motion(ABC):
    """A known motion ``g(t) field(x)`` of the unit box, and what it takes to run schemes against it."""

    dim: int
    horizon: float
    law: Potential
    influence: str
    omega: float
    until: float
    boundary: str | None = None

    def field(self, x: Floats) -> Floats:
        """Return the field at points (n, dim), (n, dim)."""
        return np.array(self.at(x.T).T)

    @abstractmethod
    def at(self, x: Floats) -> Floats:
        """Return the field at points x (dim, ...) as scikit-fem gives them, (dim, ...)."""

    @abstractmethod
    def gradient(self, x: Floats) -> Floats:
        """Return ``d u_i / d x_j``, (dim, dim, ...), of the field at points (dim, ...)."""

    def g(self, t: float, derivative: int = 0) -> float:
        """Return the amplitude ``cos(omega t)`` or one of its derivatives."""
        return float(self.omega**derivative * np.cos(self.omega * t + 0.5 * pi * derivative))

    def w(self, x: Floats) -> Floats:
        """Return the boundary function at points (n, dim), (n,)."""
        return np.ones(len(x))

    def load(self, basis: Basis, kind: str) -> Load | None:
        """Return the body force as a function of time: ``"weak"``, ``(b, phi_i)``, or ``"nodal"``, ``V_i b(x_i)``."""
        return None

    def held(self, basis: Basis) -> list[Prescribed]:
        """Return the prescribed motions."""
        return []

    def errors(self, mesh: Mesh, nodal: Floats, t: float, derivative: int = 0) -> tuple[float, float]:
        """Return L2 and H1-seminorm errors of a P1 field against the motion at t, relative to the field's own norms.

        ``derivative=1`` is for a velocity, relative to omega times the field.
        """
        basis = vector_basis(mesh, intorder=5)
        interpolated = basis.interpolate(nodal)
        x, amplitude = np.asarray(basis.global_coordinates()), self.g(t, derivative)
        scale = self.omega**derivative
        out = []
        for got, true in ((np.asarray(interpolated), self.at(x)), (np.asarray(interpolated.grad), self.gradient(x))):
            miss = np.sqrt(((got - amplitude * true) ** 2 * basis.dx).sum())
            out.append(float(miss / (scale * np.sqrt((true**2 * basis.dx).sum()))))
        return out[0], out[1]


_SOFTENING = 0.3  # b r S^2 at the largest strain: the force of the stiffest bond is a quarter below the linear one


def law_of(dim: int, horizon: float, linear: bool = False) -> Potential:
    """Return a law whose pressure waves have speed 1 at density 1, softened by the motion of the study."""
    slope = (dim + 2.0) * (dim + 1.0) / 6.0  # lambda = 1/3
    b = _SOFTENING / (dim * np.pi**2 * horizon)
    return Linear(slope) if linear else Exponential(slope, slope / b)
