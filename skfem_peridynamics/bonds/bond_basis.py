"""Bonds over a scikit-fem basis: horizon, influence function, rule and the numbering the kernels like."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from .._types import Basis, Bools, Floats, Longs, Mesh
from ..geometry.layers import boundary_function, distance_to_facets
from ..geometry.simplices import check_simplices, facet_directions, vertex_sizes, vertex_volumes
from ..material.calibration import UNIT_BALL
from ..material.influence import Influence, as_influence
from .neighbours import sweep_order
from .rules import BondList, PairRule


@dataclass(frozen=True, eq=False)
class BondBasis:
    """The bonds of a body: everything about the double integral that does not depend on the material.

    ``basis`` is a vector P1 basis, ``skfem.Basis(mesh, ElementVector(ElementTriP1()))`` or its line and tetrahedron
    forms; ``horizon`` a length in the units of the mesh; ``influence`` a function ``J(s)`` or its name;
    ``boundary_function`` is ``None`` (a free body, w = 1), ``"smooth"`` (the paper's w, see
    :func:`~skfem_peridynamics.geometry.layers.boundary_function`) or an array of values at the vertices.

    Raises ``ValueError`` for another element, a horizon that is not positive, or a vertex without a bond.

    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 9)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> bonds = BondBasis(basis, horizon=0.25)
    >>> bonds.nbonds, round(bonds.discrete_moments[0], 12)            # M_1 = 1/2, met exactly in 1D
    (15, 0.5)
    """

    basis: Basis
    horizon: float
    influence: Influence | str | Callable[[Floats], Floats] = "constant"
    rule: PairRule = field(default_factory=PairRule)
    boundary_function: str | npt.ArrayLike | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.horizon) and self.horizon > 0.0):
            raise ValueError(f"horizon = {self.horizon} must be a positive length")
        object.__setattr__(self, "influence", as_influence(self.influence))
        mesh = self.basis.mesh
        check_simplices(mesh)
        expected = np.arange(mesh.dim() * mesh.nvertices).reshape(-1, mesh.dim()).T
        if expected.size != self.basis.N or not np.array_equal(self.basis.nodal_dofs, expected):
            raise ValueError(
                f"basis has {self.basis.N} degrees of freedom; bonds need the vector P1 basis of the mesh "
                f"({expected.size}): skfem.Basis(mesh, ElementVector(P1 element of the mesh))"
            )

    def with_(self, **changes: Any) -> BondBasis:
        """Return a copy with another horizon, influence, rule or boundary function."""
        return dataclasses.replace(self, **changes)

    @property
    def mesh(self) -> Mesh:
        return self.basis.mesh

    @property
    def dim(self) -> int:
        return int(self.basis.mesh.dim())

    @property
    def nbonds(self) -> int:
        return self.bonds.nbonds

    @property
    def prefactor(self) -> float:
        """``c = 1 / (horizon^(d+1) omega_d)`` in front of the double integral."""
        return float(1.0 / (self.horizon ** (self.dim + 1) * UNIT_BALL[self.dim]))

    @cached_property
    def order(self) -> Longs:
        """The vertex at each internal place: bonds number vertices along the body, not as the mesh file does."""
        return sweep_order(self.mesh.p)

    @cached_property
    def points(self) -> Floats:
        """Vertices in internal order, (dim, n)."""
        points: Floats = np.ascontiguousarray(self.mesh.p[:, self.order])
        return points

    @cached_property
    def bonds(self) -> BondList:
        """Ends (internal numbers) and weights of all bonds."""
        return self.rule.bonds(self.mesh, self.horizon, self.order)

    @cached_property
    def vertex_weight(self) -> Floats | None:
        """The boundary function w at the vertices in internal order, or None where it is 1."""
        if self.boundary_function is None:
            return None
        if isinstance(self.boundary_function, str):
            if self.boundary_function != "smooth":
                raise ValueError(f'boundary_function = {self.boundary_function!r} must be "smooth", an array or None')
            w = boundary_function(self.mesh, self.horizon)
        else:
            w = np.asarray(self.boundary_function, dtype=float)
            if w.shape != (self.mesh.nvertices,) or not (w >= 0.0).all() or not (w <= 1.0).all():
                raise ValueError(
                    f"boundary_function must give one value between 0 and 1 for each of the {self.mesh.nvertices} "
                    f"vertices; its shape is {w.shape}"
                )
        return w[self.order]

    def vectors(self, part: slice | Longs = slice(None)) -> Floats:
        """Return ``xi = y - x`` of some bonds, (dim, nbonds)."""
        return self.points[:, self.bonds.j[part]] - self.points[:, self.bonds.i[part]]

    def measure(self, part: slice | Longs = slice(None)) -> Floats:
        """Return ``k = c weight w(x) w(y) J(r / horizon)`` of some bonds: ``PD = sum k f(r S^2)``, (nbonds,)."""
        bonds = self.bonds
        r = np.linalg.norm(self.vectors(part), axis=0)
        k: Floats = self.prefactor * bonds.weight[part] * as_influence(self.influence)(r / self.horizon)
        if self.vertex_weight is not None:
            k *= self.vertex_weight[bonds.i[part]] * self.vertex_weight[bonds.j[part]]
        return k

    @cached_property
    def interior(self) -> Bools:
        """Which vertices (mesh numbers) have their whole ball inside the body."""
        reach = self.horizon + 0.5 * float(vertex_sizes(self.mesh).max())
        gap = distance_to_facets(self.mesh, self.mesh.boundary_facets(), reach)
        deep: Bools = gap >= reach * (1.0 - 1e-9)
        return deep

    @cached_property
    def moment(self) -> float:
        """``M_d = int_0^1 J(s) s^d ds`` of the exact integral."""
        return as_influence(self.influence).moment(self.dim)

    @cached_property
    def discrete_moments(self) -> tuple[float, float]:
        """What these bonds make of ``M_d``, for strains and for cracks: means over vertices deeper than the horizon.

        The elastic energy, averaged over directions, is proportional to ``sum weight J r``. A plane crack with normal
        n costs ``sum weight J |xi.n|``; its mean over all n is the same sum, but a lattice of vertices is not
        isotropic, and cracks run along facets: it is averaged over the facets of the mesh, by area, where the mesh
        has few directions of them. Raises ``ValueError`` when no vertex is deep enough.
        """
        deep = self.interior[self.order]
        if not deep.any():
            raise ValueError(
                f"horizon = {self.horizon:g}: no vertex lies deeper than it inside the body, so the moment of the "
                "bonds cannot be measured; use the continuum calibration"
            )
        influence = as_influence(self.influence)
        normals, share = facet_directions(self.mesh)
        strain = crack = 0.0
        for start in range(0, self.nbonds, 1 << 17):
            part = slice(start, start + (1 << 17))
            xi = self.vectors(part)
            r = np.linalg.norm(xi, axis=0)
            ends = deep[self.bonds.i[part]].astype(float) + deep[self.bonds.j[part]]
            weight = ends * self.bonds.weight[part] * influence(r / self.horizon)
            strain += float(weight @ r)
            crack += sum(float(weight @ np.abs(n @ xi)) * s for n, s in zip(normals.T, share, strict=True))
        dim = self.dim
        volume = float(vertex_volumes(self.mesh)[self.order][deep].sum())
        scale = self.prefactor / (2.0 * dim * volume)
        if not len(share):
            return scale * strain, scale * strain
        # the mean of |e.n| over the sphere is 2 omega_{d-1} / (d omega_d)
        return scale * strain, scale * crack * dim * UNIT_BALL[dim] / (2.0 * UNIT_BALL[dim - 1])
