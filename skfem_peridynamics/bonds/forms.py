"""Bonds as scikit-fem sees them: each bond an element with one quadrature point and the functions of both its ends.

A form gets every displacement twice, ``u1`` at x and ``u2`` at y. Values are made as they are asked for: a form over
all bonds at once holds ``Nbfun^2`` numbers a bond while it assembles, this is the slow and general path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
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
    components: int  # of the fields
    scalar: bool

    @classmethod
    def from_bonds(cls, bonds: BondList) -> Sides:
        x, at_x, y, at_y = (np.concatenate(columns) for columns in zip(*(p.sides() for p in bonds.parts), strict=True))
        live = bonds.weight > 0.0
        components = 1 if bonds.scalar else bonds.dim
        return cls(live, (x[live], y[live]), (at_x[live], at_y[live]), components, bonds.scalar)

    @cached_property
    def functions(self) -> list[tuple[int, int, int]]:
        """Side, place among its vertices, and component of each local function."""
        return [
            (side, k, a) for side in (0, 1) for k in range(self.vertices[side].shape[1]) for a in range(self.components)
        ]

    @cached_property
    def dofs(self) -> Ints:
        """Degrees of freedom of the P1 basis, (Nbfun, nelems)."""
        return np.stack([self.vertices[s][:, k] * self.components + a for s, k, a in self.functions]).astype(np.int32)

    def at(self, side: int, u: Floats) -> Floats:
        """Return a vector (N,) at one end of each bond, (dim, nelems, 1), of a scalar basis (nelems, 1)."""
        value = self.interpolated(side, u.reshape(-1, self.components))
        return value[0] if self.scalar else value

    def interpolated(self, side: int, nodal: Floats) -> Floats:
        """Return values at the vertices (nvertices, m) at one end of each bond, (m, nelems, 1)."""
        value: Floats = np.einsum("nk,nka->an", self.values[side], nodal[self.vertices[side]])[..., None]
        return value


@dataclass(frozen=True, eq=False)
class Functions(Sequence[Any]):
    """The local functions as scikit-fem's forms read them: ``basis[j]`` is the pair of fields (at x, at y)."""

    sides: Sides

    def __len__(self) -> int:
        return len(self.sides.functions)

    def __getitem__(self, j: Any) -> Any:
        side, k, a = self.sides.functions[j]
        values = self.sides.values[side]
        here = np.zeros((self.sides.components, len(values), 1))
        here[a, :, 0] = values[:, k]
        here = here[0] if self.sides.scalar else here
        there = np.zeros_like(here)
        pair = (here, there) if side == 0 else (there, here)
        return tuple(field_class()(field) for field in pair)

    def __iter__(self) -> Iterator[Any]:
        return (self[j] for j in range(len(self)))


@cache
def field_class() -> Any:
    """Return scikit-fem's field, with a sentence in place of the gradient that a value at the end of a bond has not."""
    from skfem.element import DiscreteField

    class BondField(DiscreteField):  # type: ignore[misc]
        """A field at one end of the bonds."""

        @property
        def grad(self) -> None:
            raise AttributeError(
                "a field at the end of a bond has no gradient: differences take its place, such as (u2 - u1) / w.r"
            )

        @grad.setter
        def grad(self, value: Any) -> None:
            """scikit-fem sets it to None."""

    return BondField
