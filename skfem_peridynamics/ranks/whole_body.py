"""The body of all ranks, as the first one has it: operators on whole vectors, which it has all ranks compute."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator

from .._types import Csr, Floats, Longs
from .._vectors import real_vector
from ..material.composite import Composite
from ..material.elastic import Elastic
from ..material.material import Material
from ..material.potential import Potential
from ..model.peridynamics import MATRIX_MEMORY
from .operators import Operators


class WholeBody:
    """What schemes, measures and summaries ask of a body; implicit schemes take it for one (:class:`LedBody`)."""

    dilatation, matrix_memory = None, MATRIX_MEMORY

    def __init__(self, operators: Operators, bonds: Any, material: Material | Composite | Potential) -> None:
        self._operators, self.bonds, self.material, one = operators, bonds, material, operators.body.any_piece
        self.laws, self.moments, self.compiles, self.crossing = one.laws, one.moments, one.compiles, one.crossing
        self.blocks, self.symmetric = one.blocks, one.symmetric
        self.basis = SimpleNamespace(N=bonds.dim * int(bonds.mesh.nvertices), mesh=bonds.mesh)

    @property
    def whole(self) -> WholeBody:
        """Itself: bonds that break for good go with no implicit scheme here."""
        return self

    @property
    def elastic(self) -> Elastic:
        """The constants of the material, where there is one."""
        return self._operators.body.any_piece.elastic

    @cached_property
    def linear(self) -> bool:
        """Whether no bond ever softens."""
        return bool(self._operators.order("linear"))

    def force(self, u: Floats) -> Floats:
        """Return the forces."""
        found: Floats = self._at("force", u)
        return found

    def energy(self, u: Floats) -> float:
        """Return the energy."""
        return float(self._at("energy", u))

    def stiffness_operator(self) -> LinearOperator:
        """Return products with the stiffness at rest."""
        return self._operator("product")

    def tangent_operator(self, u: Floats) -> LinearOperator:
        """Return products with the tangent at u, until the next is made."""
        self._at("take_tangent", u)
        return self._operator("tangent_product")

    def vertex_stiffness(self) -> Floats:
        """Return what vertices are held with at rest."""
        found: Floats = self._operators.order("vertex_stiffness")
        return found

    def connected_parts(self) -> Longs:
        """Return the part of the body that each vertex is in."""
        found: Longs = self._operators.order("connected_parts")
        return found

    def largest_move(self, u: Floats, d: Floats, below: float) -> float:
        """Return the largest severity by d of the bonds whose own at u is below."""
        self._operators.given = (u, d, None)
        return float(self._operators.order("largest_move", below))

    def left(self, u: Floats | None) -> LeftOverRanks:
        """Return what is left of the stiffness at u."""
        return LeftOverRanks(self._operators, u)

    def _at(self, name: str, u: Floats) -> Any:
        self._operators.given = (np.asarray(u, dtype=float), None, None)
        return self._operators.order(name)

    def _operator(self, name: str) -> LinearOperator:
        def act(x: Floats) -> Floats:
            found: Floats = self._at(name, real_vector(x, "x").ravel())
            return found

        return LinearOperator((self.basis.N, self.basis.N), matvec=act, dtype=np.dtype(float))


@dataclass(frozen=True, eq=False)
class LeftOverRanks:
    """What is left of the stiffness of all ranks at u; None: all of it."""

    operators: Operators
    u: Floats | None

    def matrix(self) -> Csr:
        """Return it, on the first rank."""
        found: Csr = self._ordered("left_matrix")
        return found

    def vertices(self) -> Floats:
        """Return what vertices are held with."""
        found: Floats = self._ordered("left_vertices")
        return found

    def _ordered(self, name: str) -> Any:
        self.operators.given = (self.u, None, None)
        return self.operators.order(name, self.u is not None)
