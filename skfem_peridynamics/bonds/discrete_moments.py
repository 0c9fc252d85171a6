"""What a bond list makes of the moment ``M_d``: the figures of a discrete calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Bools, Floats
from ..geometry.layers import distance_to_facets
from ..geometry.simplices import facet_directions, vertex_sizes
from ..material.material import UNIT_BALL
from .bond_list import BondList
from .pair_bonds import PairBonds
from .rule import Part

_USED = 1e-9  # P1 values below this are round-off: the vertex is not used
_MANY = 16  # directions that stand for all of them


def deep_points(bonds: BondList, points: Floats) -> Bools:
    """Return which points (n, dim) have their whole ball inside the body, and half an element more."""
    mesh = bonds.mesh
    reach = bonds.horizon + 0.5 * float(vertex_sizes(mesh).max())
    gap = distance_to_facets(mesh, mesh.boundary_facets(), reach, points.T)
    deep: Bools = gap >= reach * (1.0 - 1e-9)
    return deep


@dataclass(frozen=True)
class DeepSums:
    """Sums over the bonds of points deep inside: weight times length, times extent along facets; and their volume."""

    strain: float
    crack: float
    volume: float

    @classmethod
    def of(cls, bonds: BondList, deep: Bools, mine: Bools, facets: tuple[Floats, Floats]) -> DeepSums:
        """Sum over bonds with deep samples; the volume is that of deep sites that are ``mine`` (nsites,).

        ``facets`` are the directions of those of the mesh and their shares.
        """
        samples = bonds.samples
        volume = float(samples.volume[deep[samples.sites] & mine].sum())
        normals, share = _directions(bonds, facets)
        strain = crack = 0.0
        for part in bonds.parts:
            # the share of points deep inside: both ends where both are outer points, else twice the one that is
            inside = part.near(deep.astype(float))
            inside = inside + part.far(deep.astype(float)) if isinstance(part, PairBonds) else 2.0 * inside
            weight = inside * part.weight * bonds.influence_of(part)
            strain += float(weight @ np.linalg.norm(part.vectors(), axis=1))
            if len(share):
                crack += sum(
                    float(weight @ length) * s for length, s in zip(_extents(bonds, part, normals), share, strict=True)
                )
        return cls(strain, crack, volume)

    def moments(self, bonds: BondList, facets: tuple[Floats, Floats]) -> tuple[float, float]:
        """Return the moments for strains and for cracks. Raises ``ValueError`` where nothing is deep inside."""
        dim = bonds.dim
        if not self.volume > 0.0:
            raise ValueError(
                f"horizon = {bonds.horizon:g}: no vertex lies deeper than it inside the body, so the moment of the "
                "bonds cannot be measured; use the continuum calibration"
            )
        scale = bonds.prefactor / (2.0 * dim * self.volume)
        if not len(_directions(bonds, facets)[1]):
            return scale * self.strain, scale * self.strain
        # the mean of |e.n| over the sphere is 2 omega_{d-1} / (d omega_d)
        return scale * self.strain, scale * self.crack * dim * UNIT_BALL[dim] / (2.0 * UNIT_BALL[dim - 1])


def discrete_moments(bonds: BondList) -> tuple[float, float]:
    """Return the moments for strains and for cracks; see ``BondBasis.discrete_moments``."""
    facets, samples = facet_directions(bonds.mesh), bonds.samples
    every = np.ones(len(samples.sites), dtype=bool)
    return DeepSums.of(bonds, deep_points(bonds, samples.points), every, facets).moments(bonds, facets)


def _directions(bonds: BondList, facets: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """Normals along which cracks run, and their shares; none where all are as good, of vertex pairs."""
    pairs = all(isinstance(part, PairBonds) for part in bonds.parts) and bonds.samples.at_vertices
    return facets if len(facets[1]) or pairs else _all_directions(bonds.dim)


def _extents(bonds: BondList, part: Part, normals: Floats) -> Floats:
    """Extent along each normal of the vertices that each bond uses, (nnormals, nbonds)."""
    if isinstance(part, PairBonds) and bonds.samples.at_vertices:
        return np.abs(normals.T @ part.vectors().T)
    x, at_x, y, at_y = part.sides()
    vertices, unused = np.hstack([x, y]), np.hstack([at_x, at_y]) <= _USED
    out = np.empty((normals.shape[1], part.nbonds))
    for row, n in zip(out, normals.T, strict=True):
        height = (n @ bonds.mesh.p)[vertices]
        row[:] = np.where(unused, -np.inf, height).max(axis=1) - np.where(unused, np.inf, height).min(axis=1)
    return out


def _all_directions(dim: int) -> tuple[Floats, Floats]:
    """Normals (dim, n) that stand for all directions, and their shares."""
    from .quadrature import half_sphere

    e, w = half_sphere(dim, _MANY)
    return e.T, w * (2.0 / (dim * UNIT_BALL[dim]))
