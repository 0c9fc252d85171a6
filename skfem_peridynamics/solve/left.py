"""What is left of the stiffness of bonds at a state: what implicit schemes precondition with."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from .._types import Csr, Floats
from ..model.led_body import LedBody
from ..model.peridynamics import Peridynamics
from ..model.vertex_stiffness import vertex_stiffness

REMAINS = 1e-3  # of a softened bond, so that what it held is held


class Left(Protocol):
    """The stiffness that is left, and what vertices are held with."""

    def matrix(self) -> Csr: ...

    def vertices(self) -> Floats: ...


@dataclass(frozen=True, eq=False)
class LeftOfBonds:
    """What is left of the bonds of a body at u (None: all), of each a thousandth at least.

    What a dilatation adds is left out: it reaches two horizons, and changes eigenvalues by a bounded factor.
    """

    body: Peridynamics
    u: Floats | None

    @cached_property
    def weights(self) -> list[Floats] | None:
        """The second derivatives of the energies of the bonds, an array a block; None at rest."""
        return None if self.u is None else floored(self.body, self.body.hessians(self.u))

    def matrix(self) -> Csr:
        return self.body.assemble(self.weights or [block.rest_stiffness for block in self.body.blocks])

    def vertices(self) -> Floats:
        return vertex_stiffness(self.body, self.weights)


def floored(body: Peridynamics, hessians: list[Floats]) -> list[Floats]:
    """Return second derivatives of bonds, or what remains of them at least, an array a block."""
    rest = (block.rest_stiffness for block in body.blocks)
    return [np.maximum(h, REMAINS * k) for h, k in zip(hessians, rest, strict=True)]


def left_of(body: Peridynamics, u: Floats | None) -> Left:
    """Return what is left of a body at u, None: at rest.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.5), Exponential(slope=1.0, limit=1.0))
    >>> torn, whole = (left_of(body, u).vertices().ravel() for u in (np.array([0.0, 0.0, 9.0]), None))
    >>> (torn / whole).round(3).tolist()
    [1.0, 0.5, 0.001]
    """
    if isinstance(body, LedBody):
        led: Left = body.left(u)
        return led
    return LeftOfBonds(body, u)
