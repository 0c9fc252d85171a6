"""Softened bonds, what is left of a point, and where the energy sits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Floats, Longs
from ..model.peridynamics import Peridynamics


@dataclass(frozen=True, eq=False)
class Damage:
    """The state of the bonds under one displacement.

    ``Z`` (nvertices,) is ``max |S| / S_c`` over the bonds of a vertex, 0 where no bond can fail; ``intact`` (nvertices,)
    the fraction of a vertex's bonds with ``|S| <= S_c``; ``softened`` counts the others; the two energies add up to
    the elastic one. No-fail bonds are always intact.
    """

    Z: Floats
    intact: Floats
    softened: int
    energy_intact: float
    energy_softened: float


def damage(body: Peridynamics, u: Floats) -> Damage:
    """Return the state of all bonds (paper, section 2.1), from one pass over them.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0))
    >>> d = damage(body, np.array([0.0, 0.0, 0.0, 5.0, 5.0]))          # torn between the third and fourth vertex
    >>> d.softened, d.intact.tolist(), round(float(d.Z[2]), 6)         # Z = S sqrt(2 b r), S = 20, r = 1/4
    (1, [1.0, 1.0, 0.5, 0.5, 1.0], 14.142136)
    """
    v = body.inward(u)
    n, dim = body.bonds.mesh.nvertices, body.bonds.dim
    Z, all_bonds, soft_bonds = np.zeros(n), np.zeros(n), np.zeros(n)
    energy = [0.0, 0.0]
    softened = 0
    for block in body.blocks:
        T = block.strains(v)
        ends: tuple[Longs, Longs] = block.ends(dim)
        share = block.k * block.law.energy(T)
        np.abs(T, out=T)
        T *= 1.0 / block.law.inflection
        soft = T > 1.0
        if soft.any():
            softened += int(soft.sum())
            lost = float(share[soft].sum())
            energy[1] += lost
            energy[0] += float(share[~soft].sum())
        else:
            energy[0] += float(share.sum())
        for end in ends:
            all_bonds += np.bincount(end, minlength=n)
            if np.isfinite(block.law.inflection):
                np.maximum.at(Z, end, T)
                if soft.any():
                    soft_bonds += np.bincount(end[soft], minlength=n)
    intact = 1.0 - soft_bonds / np.maximum(all_bonds, 1.0)
    back = np.empty_like(body.bonds.order)
    back[body.bonds.order] = np.arange(n)
    return Damage(Z[back], intact[back], softened, energy[0], energy[1])
