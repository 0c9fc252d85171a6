"""Bonds as scikit-fem sees them: each bond an element with one quadrature point and the functions of both its ends.

A form gets every displacement twice, ``u1`` at x and ``u2`` at y. Values are made as they are asked for: a form over
all bonds at once holds ``Nbfun^2`` numbers a bond while it assembles, this is the slow and general path.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._types import Basis, Bools, Floats, Ints, Mesh
from .parts import Part


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
    def of(cls, bonds: FormBasis) -> Sides:
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
        other = np.zeros_like(here)
        here[a, :, 0] = values[:, k]
        pair = (here, other) if side == 0 else (other, here)
        return tuple(DiscreteField(field) for field in pair)

    def __iter__(self) -> Iterator[Any]:
        return (self[j] for j in range(len(self)))


class FormBasis:
    """What scikit-fem's forms read from a basis, for a class that has bonds."""

    space: Basis

    if TYPE_CHECKING:

        @cached_property
        def parts(self) -> list[Part]: ...

        @property
        def mesh(self) -> Mesh: ...

        @property
        def dim(self) -> int: ...

        @property
        def weight(self) -> Floats: ...

        def vectors(self) -> Floats: ...

    @cached_property
    def sides(self) -> Sides:
        """Vertices and P1 values at both ends of all bonds; made for forms only."""
        return Sides.of(self)

    @property
    def N(self) -> int:
        """Degrees of freedom: those of the vector P1 basis."""
        return int(self.space.N)

    @property
    def nelems(self) -> int:
        """A bond is an element to scikit-fem's forms; those without length are left out."""
        return int(self.sides.live.sum())

    @property
    def X(self) -> Floats:
        """The one quadrature point of a bond, (dim, 1)."""
        return np.zeros((self.dim, 1))

    @property
    def dx(self) -> Floats:
        """Weights of the plain double integral over D x D, (nelems, 1); a bond of a symmetric rule has both orders."""
        return self.weight[self.sides.live, None]

    @property
    def Nbfun(self) -> int:
        """Local functions of a bond: one per component and vertex at x and at y."""
        return len(self.sides.functions)

    @property
    def element_dofs(self) -> Ints:
        """Degrees of freedom of the local functions, (Nbfun, nelems)."""
        return self.sides.dofs

    @property
    def basis(self) -> Functions:
        """The local functions, each a pair of fields ``(u1, u2)``: values at x and at y."""
        return Functions(self.sides)

    def default_parameters(self) -> dict[str, Any]:
        """Return what a form finds in ``w``: ``x, y, xi = y - x`` (dim, nelems, 1) and ``r = |xi|`` (nelems, 1)."""
        from skfem.element import DiscreteField

        xi = self.vectors()[:, self.sides.live, None]
        x = self.sides.at(0, self.mesh.p.T.ravel())
        fields = {"x": x, "y": x + xi, "xi": xi, "r": np.linalg.norm(xi, axis=0)}
        return {name: DiscreteField(field) for name, field in fields.items()}

    def interpolate(self, u: Floats) -> tuple[Any, Any]:
        """Return a displacement (N,) at x and at y, two fields (dim, nelems, 1); in a form ``w.u[0], w.u[1]``.

        Raises ``ValueError`` for a vector of another length.
        """
        from skfem.element import DiscreteField

        u = np.asarray(u, dtype=float)
        if u.shape != (self.N,):
            raise ValueError(f"u has shape {u.shape}; the basis has {self.N} degrees of freedom")
        at_x, at_y = (DiscreteField(self.sides.at(side, u)) for side in (0, 1))
        return at_x, at_y
