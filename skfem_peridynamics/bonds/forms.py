"""Bonds as scikit-fem sees them: each bond an element with one quadrature point and the functions of both its ends.

A form gets every displacement twice, ``u1`` at x and ``u2`` at y. Values are made as they are asked for: a form over
all bonds at once holds ``Nbfun^2`` numbers a bond while it assembles, this is the slow and general path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._types import Bools, Floats, Ints
from .bond_list import BondList


@dataclass(frozen=True, eq=False)
class Sides:
    """Vertices and P1 values at both ends of the bonds: (nelems, k) at x, then at y.

    Bonds on rays that leave the body at once have no length and no weight; forms, which divide by r, do not see them.
    """

    live: Bools  # (nbonds,)
    vertices: tuple[Ints, Ints]
    values: tuple[Floats, Floats]
    dim: int

    @classmethod
    def from_bonds(cls, bonds: BondList) -> Sides:
        x, at_x, y, at_y = (np.concatenate(columns) for columns in zip(*(p.sides() for p in bonds.parts), strict=True))
        live = bonds.weight > 0.0
        return cls(live, (x[live], y[live]), (at_x[live], at_y[live]), bonds.dim)

    @cached_property
    def functions(self) -> list[tuple[int, int, int]]:
        """Side, place among its vertices, and component of each local function."""
        return [(side, k, a) for side in (0, 1) for k in range(self.vertices[side].shape[1]) for a in range(self.dim)]

    @cached_property
    def dofs(self) -> Ints:
        """Degrees of freedom of the vector P1 basis, (Nbfun, nelems)."""
        return np.stack([self.vertices[s][:, k] * self.dim + a for s, k, a in self.functions]).astype(np.int32)

    def at(self, side: int, u: Floats) -> Floats:
        """Return a displacement (N,) at one end of each bond, (dim, nelems, 1)."""
        nodal = u.reshape(-1, self.dim)[self.vertices[side]]
        value: Floats = np.einsum("nk,nka->an", self.values[side], nodal)[..., None]
        return value


@dataclass(frozen=True, eq=False)
class Functions(Sequence[Any]):
    """The local functions as scikit-fem's forms read them: ``basis[j]`` is the pair of fields (at x, at y)."""

    sides: Sides

    def __len__(self) -> int:
        return len(self.sides.functions)

    def __getitem__(self, j: Any) -> Any:
        from skfem.element import DiscreteField

        side, k, a = self.sides.functions[j]
        values = self.sides.values[side]
        here = np.zeros((self.sides.dim, len(values), 1))
        there = np.zeros_like(here)
        here[a, :, 0] = values[:, k]
        pair = (here, there) if side == 0 else (there, here)
        return tuple(DiscreteField(field) for field in pair)

    def __iter__(self) -> Iterator[Any]:
        return (self[j] for j in range(len(self)))
