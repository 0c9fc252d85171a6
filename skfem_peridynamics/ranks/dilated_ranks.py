"""A dilatation over ranks: virials are added up over them, pressures brought to ghosts, in the midst of each force."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .._types import Floats
from ..engine.block import Beside
from ..model.dilatation import Dilatation
from ..model.peridynamics import Peridynamics
from .dealt_mesh import DealtMesh


@dataclass(frozen=True, eq=False)
class DilatedRanks:
    """The bonds that a rank computes, with the dilatation of the whole body: ``own`` is that of its own vertices.

    ``body`` has the dilatation of all vertices of the rank's mesh. Methods are called by all ranks at once.
    """

    mesh: DealtMesh
    body: Peridynamics
    own: Dilatation

    @classmethod
    def of(cls, mesh: DealtMesh, body: Peridynamics) -> DilatedRanks:
        """Return it of the bonds of a rank: ghosts and the unit virial are completed by the other ranks."""
        part, count, halo = body.dilatation, mesh.share.own, mesh.halo(1)
        assert part is not None
        unit, shear = halo.summed(part.unit), part.shear[:count]
        energies = tuple((share[:count], law) for share, law in part.energies)
        completed = tuple((halo.extended(share), law) for share, law in energies)
        body.__dict__["dilatation"] = Dilatation(halo.extended(unit), halo.extended(shear), completed, part.dim)
        return cls(mesh, body, Dilatation(unit, shear, energies, part.dim))

    def force(self, u: Floats) -> Floats:
        """Return the forces at the rank's own vertices."""
        halo = self.mesh.halo(self.own.dim)
        return halo.summed(self.body.engine.force(halo.extended(u), self._pressure))

    def stiffness(self, u: Floats) -> Floats:
        """Return the product of the stiffness at rest."""
        halo, beside = self.mesh.halo(self.own.dim), self._beside(None, self.own.stiffness())
        return halo.summed(self.body.engine.product(None, halo.extended(u), beside=beside))

    def tangent(self, x: Floats) -> Callable[[Floats], Floats]:
        """Return products with the tangent at x, which has its ghosts."""
        halo, one, engine = self.mesh.halo(self.own.dim), self.mesh.halo(1), self.body.engine
        virial = one.summed(engine.virial(x))
        p = self.body.bonds.samples.take(one.extended(self.own.pressure(virial)))
        rows = list(self.body.each_block(x, lambda block, T: (block.pressed_hessian(T, p), block.rates(T))))
        weights, rates = ([row[k] for row in rows] for k in (0, 1))
        beside = self._beside(rates, self.own.stiffness(virial))
        return lambda v: halo.summed(engine.product(weights, halo.extended(v), beside=beside))

    def energy(self, x: Floats) -> float:
        """Return the energy of the dilatation of the rank's own vertices; x has its ghosts."""
        return self.own.energy(self.mesh.halo(1).summed(self.body.engine.virial(x)))

    def pressure_at_samples(self, x: Floats) -> Floats:
        """Return the pressure at the samples of the rank's bonds; x has its ghosts."""
        return self.body.bonds.samples.take(self._pressure(self.body.engine.virial(x)))

    def _beside(self, rates: list[Floats] | None, between: Floats) -> Beside:
        """What stands beside the bonds in a tangent, with the stiffness of the rank's own vertices."""
        one = self.mesh.halo(1)
        return Beside(rates, between, lambda virial: one.extended(between * one.summed(virial)))

    def _pressure(self, virial: Floats) -> Floats:
        """The pressure at all vertices of the rank's mesh, of what its bonds have of the virial."""
        halo = self.mesh.halo(1)
        return halo.extended(self.own.pressure(halo.summed(virial)))
