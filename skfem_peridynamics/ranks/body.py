"""A body over ranks: what explicit steppers ask of one, of vectors that are a rank's own part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from .._types import Floats, Longs
from ..analysis.damage import Census, Damage, Tally, census_and_tally
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_rule import PairRule
from ..material.composite import Composite
from ..material.influence import Influence
from ..material.material import Material
from ..material.potential import Potential
from ..model.peridynamics import Peridynamics
from ..model.space import numbering_basis
from ..model.vertex_stiffness import vertex_stiffness
from .dealt_rule import DealtPairs
from .halo import Halo
from .rank_moments import balanced_over_ranks
from .share import Share


@dataclass(frozen=True, eq=False)
class RankBody:
    """The bonds that a rank computes, those that need no ghost (``inside``) and the others (``across``).

    Forces are those of the whole body at the rank's own vertices. Energies are the rank's part; :meth:`total` adds
    parts up. Methods are called by all ranks at once.
    """

    comm: Any
    share: Share
    inside: Peridynamics | None
    across: Peridynamics | None
    _halos: dict[int, Halo] = field(default_factory=dict, repr=False)

    @classmethod
    def of(
        cls,
        comm: Any,
        share: Share,
        horizon: float,
        influence: Influence | str,
        rule: PairRule,
        material: Material | Potential | Composite,
        no_fail: Longs | None = None,
        balanced: bool = False,
        w: Floats | None = None,
        **options: Any,
    ) -> RankBody:
        """Return the body of a share; ``no_fail`` and ``w`` are of vertices of the rank's mesh, ghosts among them."""
        basis, halos = numbering_basis(share.mesh), dict[int, Halo]()
        rules = [DealtPairs(rule, share, inside) for inside in (True, False)]
        made = [BondBasis(basis, horizon, influence, one, w) for one in rules]
        there = [bonds for bonds in made if bonds.parts]
        if min(comm.allgather(sum(bonds.nbonds for bonds in there))) == 0:
            raise ValueError(f"{comm.size} processes are too many: one of them would have no bond to compute")
        if balanced:
            there = balanced_over_ranks(comm, share, there, lambda width: _halo(halos, comm, share, width))
        bodies = iter([Peridynamics(bonds, material, no_fail, **options) for bonds in there])
        inside, across = (next(bodies) if bonds.parts else None for bonds in made)
        return cls(comm, share, inside, across, halos)

    # ---- what a stepper asks
    symmetric = True

    def force(self, u: Floats) -> Floats:
        """Return the forces at the rank's own vertices; ghosts are on their way while bonds inside are computed."""
        return self._applied(u, lambda piece, x: piece.force(x))

    def energy(self, u: Floats) -> float:
        """Return the energy of the rank's bonds."""
        x = self._halo(self.dim).extended(u)
        return sum(piece.energy(x) for piece in self._pieces)

    def total(self, part: float) -> float:
        """Return the sum of what the ranks have."""
        return float(self.comm.allreduce(part))

    # ---- what a run asks besides
    @property
    def dim(self) -> int:
        return int(self.share.mesh.dim())

    @property
    def any_piece(self) -> Peridynamics:
        """Some of the bonds, for what all have in common: laws and moments."""
        return self._pieces[0]

    @property
    def nbonds(self) -> int:
        """Bonds of this rank."""
        return sum(piece.bonds.nbonds for piece in self._pieces)

    def stiffness(self, x: Floats) -> Floats:
        """Return the product of the stiffness at rest."""
        products = self._products
        return self._applied(x, lambda piece, y: products[id(piece)](y))

    def vertex_stiffness(self) -> Floats:
        """Return what all bonds hold the rank's own vertices with, (nown, dim, dim)."""
        dim = self.dim
        local = sum(vertex_stiffness(piece) for piece in self._pieces)
        return self._halo(dim * dim).summed(np.asarray(local).ravel()).reshape(-1, dim, dim)

    def look(self, u: Floats) -> tuple[Census, Damage]:
        """Return the census of the whole body, and the damage at the rank's own vertices."""
        x, one = self._halo(self.dim).extended(u), self._halo(1)
        found = [census_and_tally(piece, x) for piece in self._pieces]
        counts, tallies = [count for count, _ in found], [tally for _, tally in found]
        sums = np.array([[c.softened, c.energy_intact, c.energy_softened, c.area] for c in counts]).sum(axis=0)
        softened, intact, lost, area = self.comm.allreduce(sums)
        Z = max(self.comm.allgather(max(count.Z for count in counts)))
        whole = Census(float(Z), round(softened), float(intact), float(lost), float(area))
        largest = one.largest(np.max([tally.Z for tally in tallies], axis=0))
        every, gone = (one.summed(np.sum([getattr(t, name) for t in tallies], axis=0)) for name in ("every", "gone"))
        return whole, Tally(largest, every, gone, whole.softened).damage()

    def gather(self, own: Floats) -> Floats | None:
        """Return a vector of the whole mesh on the first rank, None on the others."""
        from mpi4py import MPI

        width, (places, counts) = len(own) // self.share.own, self._everyone
        if self.share.rank:
            self.comm.Gatherv(own, None, root=0)
            return None
        found = np.empty(self.share.nvertices * width)
        self.comm.Gatherv(own, (found, [count * width for count in counts], None, MPI.DOUBLE), root=0)
        return found.reshape(-1, width)[places].ravel()

    def scatter(self, whole: Floats | None) -> Floats:
        """Return the rank's own part of a vector that the first rank has of the whole mesh."""
        from mpi4py import MPI

        own, (places, counts) = np.empty(self.share.own * self.dim), self._everyone
        if self.share.rank:
            self.comm.Scatterv(None, own, root=0)
            return own
        assert whole is not None
        ordered = np.empty((self.share.nvertices, self.dim))
        ordered[places] = whole.reshape(self.share.nvertices, -1)
        self.comm.Scatterv((ordered, [count * self.dim for count in counts], None, MPI.DOUBLE), own, root=0)
        return own

    def close(self) -> None:
        """Give back what PETSc holds."""
        while self._halos:
            self._halos.popitem()[1].close()

    # ---- how
    @cached_property
    def _pieces(self) -> list[Peridynamics]:
        return [piece for piece in (self.inside, self.across) if piece is not None]

    @cached_property
    def _products(self) -> dict[int, Callable[[Floats], Floats]]:
        return {id(piece): piece.stiffness_operator().matvec for piece in self._pieces}

    def _applied(self, own: Floats, act: Callable[[Peridynamics, Floats], Floats]) -> Floats:
        halo = self._halo(self.dim)
        x = halo.begin(own)
        local = act(self.inside, x) if self.inside is not None else np.zeros(len(x))
        x = halo.end()
        if self.across is not None:
            local = local + act(self.across, x)
        return halo.summed(local)

    def _halo(self, width: int) -> Halo:
        return _halo(self._halos, self.comm, self.share, width)

    @cached_property
    def _everyone(self) -> tuple[Longs, list[int]]:
        """On the first rank the place of each vertex in the order of the ranks, and how many each owns."""
        found = self.comm.gather(self.share.number[: self.share.own], root=0)
        if found is None:
            return np.zeros(0, dtype=np.int64), []
        places = np.empty(self.share.nvertices, dtype=np.int64)
        places[np.concatenate(found)] = np.arange(self.share.nvertices)
        return places, [len(numbers) for numbers in found]


def _halo(halos: dict[int, Halo], comm: Any, share: Share, width: int) -> Halo:
    """The exchange of so many numbers a vertex, made once."""
    if width not in halos:
        halos[width] = Halo(comm, share, width)
    return halos[width]
