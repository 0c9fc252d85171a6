"""Operators of a body over ranks at vectors of the whole, which the first rank has."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .._types import Csr, Floats, Longs
from ..analysis.damage import Census, Damage
from . import implicit
from .body import RankBody


@dataclass(eq=False)
class Operators:
    """A rank's part of the operators. Every method is called by all ranks at once: by the first, which then gets what
    comes out of it for the whole body, through :meth:`order`, and by the others in :meth:`follow`. ``given`` are, on
    the first one, the vectors that they act on.
    """

    comm: Any
    body: RankBody
    busy: bool = field(default=False, init=False)
    given: tuple[Floats | None, ...] = field(default=(None, None, None), init=False)
    _tangent: Callable[[Floats], Floats] | None = field(default=None, init=False)

    def order(self, name: str, *arguments: Any) -> Any:
        """Have all ranks do something; return what came out, on the first."""
        self.busy = True  # and stays so where something is raised in the midst of it
        self.comm.bcast((name, arguments), root=0)
        found = getattr(self, name)(*arguments)
        self.busy = False
        return found

    def follow(self, until: str = "close") -> Any:
        """Do what the first rank says, until it says this; return what came out of that."""
        name, found = "", None
        while name != until:
            name, arguments = self.comm.bcast(None, root=0)
            found = getattr(self, name)(*arguments)
        return found

    # ---- what can be ordered
    def look(self) -> tuple[Census, Damage | None]:
        """The census and the damage."""
        count, hurt = self.body.look(self._own(0))
        Z, intact = self.body.gather(hurt.Z), self.body.gather(hurt.intact)
        return count, None if Z is None or intact is None else Damage(Z, intact, hurt.softened)

    def force(self) -> Floats | None:
        """The forces."""
        return self.body.gather(self.body.force(self._own(0)))

    def stress(self) -> Floats | None:
        """The stress at the vertices, (nvertices, dim, dim)."""
        return self._tensors(self.body.stress(self._own(0)))

    def energy(self) -> float:
        """The energy."""
        return self.body.total(self.body.energy(self._own(0)))

    def vertex_stiffness(self) -> Floats | None:
        """What vertices are held with, (nvertices, dim, dim)."""
        return self._tensors(self.body.vertex_stiffness())

    def product(self) -> Floats | None:
        """The product of the stiffness."""
        return self.body.gather(self.body.stiffness(self._own(0)))

    # ---- of implicit schemes
    def linear(self) -> bool:
        """Whether no bond ever softens."""
        return implicit.linear(self.body)

    def take_tangent(self) -> None:
        """Make the tangent, for products."""
        self._tangent = implicit.tangent(self.body, self._own(0))

    def tangent_product(self) -> Floats | None:
        """The product of the tangent that was made last."""
        assert self._tangent is not None
        return self.body.gather(self._tangent(self._own(0)))

    def largest_move(self, below: float) -> float:
        """The largest severity by the second vector of the bonds whose own by the first is below."""
        return implicit.largest_move(self.body, self._own(0), self._own(1), below)

    def left_vertices(self, torn: bool) -> Floats | None:
        """What is left of what vertices are held with, of a torn body or at rest."""
        return self._tensors(implicit.left_of_vertices(self.body, self._own(0) if torn else None))

    def left_matrix(self, torn: bool) -> Csr | None:
        """What is left of the stiffness."""
        return implicit.left_matrix(self.body, self._own(0) if torn else None)

    def connected_parts(self) -> Longs | None:
        """The part of the body that each vertex is in."""
        return implicit.connected_over_ranks(self.body)

    def _own(self, k: int) -> Floats:
        return self.body.dealt.scatter(self.given[k], self.body.dim)

    def _tensors(self, own: Floats) -> Floats | None:
        found = self.body.gather(own.ravel())
        return None if found is None else found.reshape(-1, self.body.dim, self.body.dim)
