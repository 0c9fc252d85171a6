"""The dilatation of a body whose lambda is not its mu: an energy of the volumetric strain beside that of the bonds.

The volumetric strain of vertex i is what its bonds pull with, over what they would under a strain of unit trace:

    e_i      = virial_i / unit_i,   Phi_ib = phi_i(x_b) + phi_i(y_b)   (P1 values at the ends of bond b),
    virial_i = sum_b k_b sqrt(r_b) F1_b'(T_b) / 2 Phi_ib,   unit_i = sum_b k_b f_b'(0) r_b Phi_ib / d

and the energy is ``sum_i N_i G(e_i)``, with the volume ``N_i = unit_i / ((d + 2) mu_i)`` (docs/theory/dilatation.md).
A torn bond pulls with nothing: an open crack carries no dilatation. ``unit`` is that of all bonds, broken ones too.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from .._types import Floats
from ..bonds.bond_basis import BondBasis
from ..bonds.samples import Samples
from ..engine.block import Block
from ..geometry.simplices import element_volumes
from ..material.composite import Composite
from ..material.material import FACTOR
from ..material.potential import Potential
from ..material.volumetric import Volumetric


@dataclass(frozen=True, eq=False)
class Dilatation:
    """The energy of the volumetric strains of the vertices.

    Parameters
    ----------
    unit : ndarray, (nvertices,)
        The virial of a strain of unit trace.
    shear : ndarray, (nvertices,)
        ``(d + 2) mu`` of each vertex.
    energies : tuple of (ndarray, Volumetric)
        Energies per volume and the share of the volume of each vertex, (nvertices,), that has them.
    dim : int
        Dimension of the body.
    """

    unit: Floats
    shear: Floats
    energies: tuple[tuple[Floats, Volumetric], ...]
    dim: int

    @property
    def volume(self) -> Floats:
        """``N_i``, close to the volume of the vertex; 0 where there are no bonds."""
        return self.unit / self.shear

    def strain(self, virial: Floats) -> Floats:
        """Return the volumetric strains of a virial, both (nvertices,); 0 at a vertex without bonds."""
        return np.divide(virial, self.unit, out=np.zeros_like(virial), where=self.unit > 0.0)

    def energy(self, virial: Floats) -> float:
        """Return the energy of a virial."""
        return float(self.volume @ self.density(virial))

    def density(self, virial: Floats) -> Floats:
        """Return the energy per volume at each vertex."""
        e = self.strain(virial)
        return np.asarray(sum(share * law.energy(e) for share, law in self.energies))

    def pressure(self, virial: Floats) -> Floats:
        """Return ``p = G'(e) / ((d + 2) mu)``: half of what a bond is the longer for to what it pulls with."""
        e = self.strain(virial)
        return np.asarray(sum(share * law.gradient(e) for share, law in self.energies)) / self.shear

    def curvature(self, virial: Floats | None = None) -> Floats:
        """Return ``G''(e) / ((d + 2) mu)``, at rest without a virial."""
        e = np.zeros_like(self.unit) if virial is None else self.strain(virial)
        return np.asarray(sum(share * law.hessian(e) for share, law in self.energies)) / self.shear

    def stiffness(self, virial: Floats | None = None) -> Floats:
        """Return what stands between the rates of the virial in the tangent, (nvertices,)."""
        return np.divide(self.curvature(virial), self.unit, out=np.zeros_like(self.unit), where=self.unit > 0.0)

    @property
    def quadratic(self) -> bool:
        """Whether the pressure is linear in the strain."""
        return all(law.quadratic for _, law in self.energies)


def make_dilatation(
    bonds: BondBasis,
    blocks: Sequence[Block],
    laws: Sequence[Potential],
    energies: Sequence[Volumetric | None],
    composite: Composite | None,
    moment: float,
) -> Dilatation:
    """Return the dilatation of a body with these laws and energies, those of each material in their order."""
    dim, samples = bonds.dim, bonds.samples
    total = np.zeros(samples.nsamples)
    for block in blocks:
        # of all bonds, as they were before any broke
        k = bonds.measure_of(block.part)
        k = k if block.which is None else k[block.which]
        C, root = block.both_ends()
        total[block.window] += C.T @ (k * root**2) * (block.law.slope / dim)
    shares = _shares(bonds, composite)
    mu = np.array([FACTOR["physical"][dim] * law.slope * moment for law in laws])
    kept = tuple((share, law) for share, law in zip(shares, energies, strict=True) if law is not None)
    return Dilatation(samples.spread(total), (dim + 2.0) * (mu @ shares), kept, dim)


def _shares(bonds: BondBasis, composite: Composite | None) -> Floats:
    """The share of each material in the volume of each vertex, (nmaterials, nvertices)."""
    mesh = bonds.mesh
    if composite is None:
        return np.ones((1, int(mesh.nvertices)))
    volumes, member = element_volumes(mesh), composite.member_of(mesh)
    out = np.zeros((len(composite.materials), int(mesh.nvertices)))
    for corner in mesh.t:
        np.add.at(out, (member, corner), volumes)
    out /= out.sum(axis=0)
    return out


def bounding_weights(
    dilatation: Dilatation,
    samples: Samples,
    blocks: Sequence[Block],
    weights: Sequence[Floats] | None = None,
    bends: Iterable[Floats] = (),
    virial: Floats | None = None,
) -> list[Floats]:
    """Return weights of bonds whose matrix is at least that of bonds and dilatation.

    At rest, or at a state with these ``weights`` and second derivatives F1'' of the bonds, ``bends``, and that virial.
    By Cauchy and Schwarz ``R_i^2 <= d unit_i sum_b k (F1'')^2 / (4 f'(0)) T_b^2 Phi_ib``: each bond takes
    ``d (chi_x + chi_y) k (F1'')^2 / (4 f'(0))`` more, with chi the curvature of the energy where it is positive.
    """
    chi = samples.take(dilatation.dim * np.maximum(dilatation.curvature(virial), 0.0))
    if weights is None:
        return [block.rest_stiffness * (1.0 + 0.5 * block.pressures(chi)) for block in blocks]
    return [
        weight + block.k * bend**2 * block.pressures(chi) / (4.0 * block.law.slope)
        for weight, block, bend in zip(weights, blocks, bends, strict=True)
    ]
