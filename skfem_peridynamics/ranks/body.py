"""A body over ranks: what explicit steppers ask of one, of vectors that are a rank's own part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from .._types import Floats
from ..analysis.damage import Census, Damage, Tally, census_and_tally
from ..analysis.stress import vertex_virials
from ..geometry.simplices import vertex_volumes
from ..model.peridynamics import Peridynamics
from ..model.vertex_stiffness import vertex_stiffness
from .dealt_mesh import DealtMesh
from .dilated_ranks import DilatedRanks
from .share import Share


@dataclass(frozen=True, eq=False)
class RankBody:
    """The bonds that a rank computes: all of them ``across``, or those that need no ghost ``inside``.

    Forces are those of the whole body at the rank's own vertices. Energies are the rank's part; :meth:`total` adds
    parts up. Methods are called by all ranks at once.
    """

    dealt: DealtMesh
    inside: Peridynamics | None
    across: Peridynamics | None
    dilatation: DilatedRanks | None = None

    # ---- what a stepper asks
    @property
    def symmetric(self) -> bool:
        """Whether the force is the gradient of the energy."""
        return self.any_piece.symmetric

    def force(self, u: Floats) -> Floats:
        """Return the forces at the rank's own vertices; ghosts are on their way while bonds ``inside`` are computed."""
        if self.dilatation is not None:
            return self.dilatation.force(u)
        return self.applied(u, lambda piece, x: piece.force(x))

    def energy(self, u: Floats) -> float:
        """Return the energy of the rank's bonds, and of the dilatation of its own vertices."""
        x = self.dealt.halo(self.dim).extended(u)
        beside = 0.0 if self.dilatation is None else self.dilatation.energy(x)
        return sum(piece.energy(x) for piece in self.pieces) + beside

    def total(self, part: float) -> float:
        """Return the sum of what the ranks have."""
        return self.dealt.total(part)

    # ---- what a run asks besides
    @property
    def comm(self) -> Any:
        return self.dealt.comm

    @property
    def share(self) -> Share:
        return self.dealt.share

    @property
    def dim(self) -> int:
        return int(self.share.mesh.dim())

    @property
    def any_piece(self) -> Peridynamics:
        """Some of the bonds, for what all have in common: laws, moments, and constants of a dilatation."""
        return self.pieces[0] if self.dilatation is None else self.dilatation.body

    @property
    def nbonds(self) -> int:
        """Bonds of this rank."""
        return sum(piece.bonds.nbonds for piece in self.pieces)

    def stiffness(self, x: Floats) -> Floats:
        """Return the product of the stiffness at rest."""
        return self.bond_stiffness(x) if self.dilatation is None else self.dilatation.stiffness(x)

    def bond_stiffness(self, x: Floats) -> Floats:
        """Return the product of the stiffness that bonds alone have at rest."""
        products = self._products
        return self.applied(x, lambda piece, y: products[id(piece)](y))

    def vertex_stiffness(self, bounding: bool = False) -> Floats:
        """Return what all bonds hold the rank's own vertices with, (nown, dim, dim); to bound the stiffness or not."""
        dim = self.dim
        if self.dilatation is not None and bounding:
            local = vertex_stiffness(self.dilatation.body, self.dilatation.body.bounding_weights())
        else:
            local = np.asarray(sum(vertex_stiffness(piece) for piece in self.pieces))
        return self.dealt.halo(dim * dim).summed(local.ravel()).reshape(-1, dim, dim)

    def stress(self, u: Floats) -> Floats:
        """Return the stress at the rank's own vertices, (nown, dim, dim)."""
        dim, x = self.dim, self.dealt.halo(self.dim).extended(u)
        p = None if self.dilatation is None else self.dilatation.pressure_at_samples(x)
        local = np.asarray(sum(vertex_virials(piece, x, p) for piece in self.pieces))
        found = self.dealt.halo(dim * dim).summed(local.ravel()).reshape(-1, dim, dim)
        return found / vertex_volumes(self.share.mesh)[: self.share.own, None, None]

    def look(self, u: Floats) -> tuple[Census, Damage]:
        """Return the census of the whole body, and the damage at the rank's own vertices."""
        x, one = self.dealt.halo(self.dim).extended(u), self.dealt.halo(1)
        found = [census_and_tally(piece, x) for piece in self.pieces]
        counts, tallies = [count for count, _ in found], [tally for _, tally in found]
        names = ("softened", "energy_intact", "energy_softened", "area", "broken")
        sums = np.array([sum(getattr(c, name) for c in counts) for name in names], dtype=float)
        sums[1] += 0.0 if self.dilatation is None else self.dilatation.energy(x)
        softened, intact, lost, area, broken = self.comm.allreduce(sums)
        Z = max(self.comm.allgather(max(count.Z for count in counts)))
        whole = Census(float(Z), round(softened), float(intact), float(lost), float(area), round(broken))
        largest = one.largest(np.max([tally.Z for tally in tallies], axis=0))
        every, gone = (one.summed(np.sum([getattr(t, name) for t in tallies], axis=0)) for name in ("every", "gone"))
        return whole, Tally(largest, every, gone, whole.softened).damage()

    def worst(self, size: Floats) -> tuple[int, Floats]:
        """Return the vertex of the whole mesh, and its place, where a size of the unknowns is largest on any rank."""
        at = int(np.argmax(size))
        vertex = at // self.dim
        mine = float(size[at]), -int(self.share.number[vertex]), self.share.mesh.p[:, vertex]
        _, number, point = max(self.comm.allgather(mine), key=lambda found: found[:2])
        return -number, point

    def gather(self, own: Floats) -> Floats | None:
        """Return a vector of the whole mesh on the first rank, None on the others."""
        return self.dealt.gather(own)

    def scatter(self, whole: Floats | None) -> Floats:
        """Return the rank's own part of a vector that the first rank has of the whole mesh."""
        said, size, shape = "", self.share.nvertices * self.dim, () if whole is None else whole.shape
        if self.share.rank == 0 and shape != (size,):
            said = f"a vector of shape {shape} is none of the whole mesh: the first rank gives one of ({size},)"
        said = self.comm.bcast(said, root=0)
        if said:
            raise ValueError(said)
        return self.dealt.scatter(whole, self.dim)

    def close(self) -> None:
        """Give back what PETSc holds."""
        self.dealt.close()

    # ---- how
    @cached_property
    def pieces(self) -> list[Peridynamics]:
        """The bonds of the rank, without a dilatation."""
        return [piece for piece in (self.inside, self.across) if piece is not None]

    @cached_property
    def _products(self) -> dict[int, Callable[[Floats], Floats]]:
        return {id(piece): piece.stiffness_operator().matvec for piece in self.pieces}

    def applied(self, own: Floats, act: Callable[[Peridynamics, Floats], Floats]) -> Floats:
        """Return what the pieces of all ranks make of a vector, added up."""
        halo = self.dealt.halo(self.dim)
        x = halo.begin(own)
        first = act(self.inside, x) if self.inside is not None else None
        x = halo.end()
        then = act(self.across, x) if self.across is not None else None
        if first is None or then is None:
            only = first if then is None else then
            assert only is not None
            return halo.summed(only)
        return halo.summed(first + then)
