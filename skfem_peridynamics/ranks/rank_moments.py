"""Moments of bonds that are dealt out over ranks: what balancing asks of them, at a rank's own vertices."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._types import Floats, Longs
from ..bonds.balance import balance_of, enough_for_four, kind_of_moments
from ..bonds.bond_basis import BondBasis
from ..bonds.moments import Moments, summed
from .dealt_mesh import DealtMesh


@dataclass(frozen=True, eq=False)
class RankMoments(Moments):
    """The moments of the ``pieces`` of a rank's bonds: rows are its own vertices, to which other ranks add theirs.

    Every method is called by all ranks at once.
    """

    mesh: DealtMesh
    pieces: list[BondBasis]

    def alone(self) -> RankMoments:
        return dataclasses.replace(self, four=False)

    def dot(self, a: Floats, b: Floats) -> float:
        return self.total(super().dot(a, b))

    def total(self, x: float) -> float:
        return self.mesh.total(x)

    def largest(self, x: float) -> float:
        return float(max(self.mesh.comm.allgather(x)))

    @property
    def vertex(self) -> Longs:
        return np.arange(self.mesh.share.own)

    def own_weights(self) -> list[Floats]:
        return [w for one in self._each for w in one.own_weights()]

    def moments(self, w: list[Floats]) -> Floats:
        return self._added([one.moments(x) for one, x in self._dealt(w)])

    def degree(self, w: list[Floats]) -> Floats:
        return self._added([one.degree(x)[:, None] for one, x in self._dealt(w)])[:, 0]

    def gathered(self, y: Floats) -> list[Floats]:
        rows = self._rows(y)
        return [s for one in self._each for s in one.gathered(rows)]

    def normal(self, w: list[Floats]) -> Callable[[Floats], Floats]:
        maps = [one.normal(x) for one, x in self._dealt(w)]

        def apply(y: Floats) -> Floats:
            rows = self._rows(y)
            return self._added([one(rows) for one in maps])

        return apply

    # ---- how
    @cached_property
    def _each(self) -> list[Moments]:
        return [kind_of_moments(piece)(piece, self.four) for piece in self.pieces]

    def _dealt(self, w: list[Floats]) -> list[tuple[Moments, list[Floats]]]:
        """Each piece with its weights."""
        out, at = [], 0
        for one in self._each:
            count = len(one.bonds.parts)
            out.append((one, w[at : at + count]))
            at += count
        return out

    @cached_property
    def _order(self) -> Longs:
        """The vertex of the rank's mesh of each row of a piece."""
        return self._each[0].vertex

    def _rows(self, y: Floats) -> Floats:
        """Rows of a piece from those of the rank's own vertices."""
        width = y.shape[1]
        return self.mesh.halo(width).extended(y.ravel()).reshape(-1, width)[self._order]

    def _added(self, of_pieces: list[Floats]) -> Floats:
        """Rows of the rank's own vertices from those of its pieces, with what other ranks have for them."""
        local = summed(of_pieces)
        width = local.shape[1]
        at_vertices = np.zeros((self.mesh.share.mesh.nvertices, width))
        at_vertices[self._order] = local
        return self.mesh.halo(width).summed(at_vertices.ravel()).reshape(-1, width)


def balanced_over_ranks(mesh: DealtMesh, pieces: list[BondBasis]) -> list[BondBasis]:
    """Return the pieces of a rank's bonds with balanced weights; the figures of their balance are of the whole body."""
    nbonds = mesh.comm.allreduce(sum(piece.nbonds for piece in pieces))
    four = enough_for_four(pieces[0], nbonds, mesh.share.nvertices)
    found = balance_of(RankMoments(pieces[0], four, mesh, pieces))
    out, at = [], 0
    for piece in pieces:
        count = len(piece.parts)
        out.append(piece.with_balance(dataclasses.replace(found, weights=found.weights[at : at + count])))
        at += count
    return out
