"""The bonds of a body: horizon, influence function, rule and the numbering that the engines like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .._scaling import whole_power
from .._types import Basis, Floats, Longs, Mesh
from ..geometry.layers import boundary_function
from ..geometry.simplices import check_simplices
from ..material.influence import Influence, as_influence, constant
from ..material.material import UNIT_BALL
from .pair_bonds import PairBonds
from .pair_rule import PairRule
from .rule import Part, Rule
from .samples import Samples


@dataclass(frozen=True, eq=False)
class Balance:
    """Balanced weights and how they came out.

    ``weights`` by part. ``unbalanced`` lists the vertices (mesh numbers) whose moments of order three are not met to
    5 % of the largest; of exact weights to 1e-8, inside. ``residual`` and
    ``residual_near`` are the largest there. ``smallest`` and ``rms``: ratio of new to old weights, its least (positive
    always) and its deviation from 1.
    """

    weights: list[Floats]
    unbalanced: Longs
    residual: float
    residual_near: float
    smallest: float
    rms: float
    iterations: int


@dataclass(frozen=True, eq=False)
class BondList:
    """Everything about the double integral that does not depend on the material: the data of a :class:`BondBasis`."""

    space: Basis
    horizon: float
    influence: Influence | str | Callable[[Floats], Floats] = "constant"
    rule: Rule = field(default_factory=PairRule)
    boundary_function: str | npt.ArrayLike | None = None
    balance: Balance | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if (
            isinstance(self.horizon, str)
            or np.ndim(self.horizon)
            or not (np.isfinite(self.horizon) and self.horizon > 0)
        ):
            raise ValueError(f"horizon = {self.horizon} must be a positive length")
        if not callable(getattr(self.rule, "parts", None)):
            raise ValueError(f"rule = {self.rule!r} must be a rule, such as PairRule() or BallRule()")
        object.__setattr__(self, "influence", as_influence(self.influence))
        mesh = self.space.mesh
        check_simplices(mesh)
        # vertex k has the unknowns dim k ... dim k + dim - 1: the engines count on it
        components = 1 if self.scalar else mesh.dim()
        expected = np.arange(components * mesh.nvertices).reshape(-1, components).T
        if expected.size != self.space.N or not np.array_equal(self.space.nodal_dofs, expected):
            raise ValueError(
                f"basis has {self.space.N} degrees of freedom; bonds need the vector P1 basis of the mesh "
                f"({mesh.dim() * mesh.nvertices}), skfem.Basis(mesh, ElementVector(P1 element of the mesh)), or for "
                "scalar forms the P1 basis"
            )
        if not getattr(self.space, "numbers_only", False) and self.space.nelems != mesh.nelements:
            raise ValueError(
                f"basis is of {self.space.nelems} elements or facets of a mesh of {mesh.nelements} elements: bonds are "
                "of the whole body; take a basis without elements= or facets=, of mesh.restrict(elements) for a part"
            )

    @property
    def scalar(self) -> bool:
        """Whether the space is scalar: it serves forms, and no body."""
        from skfem.element import ElementVector

        return not isinstance(self.space.elem, ElementVector)

    @property
    def mesh(self) -> Mesh:
        return self.space.mesh

    @property
    def dim(self) -> int:
        return int(self.space.mesh.dim())

    @property
    def nbonds(self) -> int:
        return sum(part.nbonds for part in self.parts)

    @property
    def prefactor(self) -> float:
        """``c = 1 / (horizon^(d+1) omega_d)`` in front of the double integral."""
        return float(1.0 / (whole_power(self.horizon, self.dim + 1) * UNIT_BALL[self.dim]))

    @cached_property
    def samples(self) -> Samples:
        """The points where the rule reads the displacement, numbered along the body."""
        return self.rule.samples(self.mesh)

    @cached_property
    def parts(self) -> list[Part]:
        """The bonds, a part of them at a time."""
        assert isinstance(self.influence, Influence)
        own = self.rule.parts(self.mesh, self.samples, self.horizon, self.influence)
        if self.balance is None:
            return own
        return [part.with_weight(w) for part, w in zip(own, self.balance.weights, strict=True)]

    @cached_property
    def vertex_weight(self) -> Floats | None:
        """The boundary function w at the vertices, or None where it is 1 everywhere."""
        if self.boundary_function is None:
            return None
        if isinstance(self.boundary_function, str):
            if self.boundary_function != "smooth":
                raise ValueError(f'boundary_function = {self.boundary_function!r} must be "smooth", an array or None')
            return boundary_function(self.mesh, self.horizon)
        w = np.asarray(self.boundary_function, dtype=float)
        wanted = f"boundary_function must give one value between 0 and 1 for each of the {self.mesh.nvertices} vertices"
        if w.shape != (self.mesh.nvertices,):
            raise ValueError(f"{wanted}; its shape is {w.shape}")
        wrong = np.flatnonzero(~((w >= 0.0) & (w <= 1.0)))
        if len(wrong):
            raise ValueError(f"{wanted}; at vertex {wrong[0]} it is {w[wrong[0]]}")
        return w

    @cached_property
    def sample_weight(self) -> Floats | None:
        """The boundary function w at the samples, or None where it is 1 everywhere."""
        return None if self.vertex_weight is None else self.samples.take(self.vertex_weight)

    @property
    def may_vanish(self) -> bool:
        """Whether bonds within the horizon can have measure zero."""
        return not self.plain

    @property
    def plain(self) -> bool:
        """Whether nothing but weights is in the measure of a bond: no w, and J 1 or in the weights."""
        return self.vertex_weight is None and (self._held or as_influence(self.influence) is constant)

    @property
    def _held(self) -> bool:
        """Whether the rule's weights hold the influence function."""
        return bool(getattr(self.rule, "holds_influence", False))

    def measure_of(self, part: Part) -> Floats:
        """Return ``k = c weight w(x) w(y) J(r / horizon)`` of a part: ``PD = sum k f(r S^2)``, (nbonds,)."""
        return self.prefactor * self.share_of(part)

    def share_of(self, part: Part) -> Floats:
        """Return ``weight w(x) w(y) J(r / horizon)`` of a part, (nbonds,)."""
        return part.weight * self.influence_of(part) * self.boundary_share_of(part)

    def boundary_share_of(self, part: Part) -> Floats | float:
        """Return ``w(x) w(y)`` of a part, (nbonds,); 1 where w is 1 everywhere."""
        w = self.sample_weight
        # at a point in an element w is interpolated, and round-off may leave [0, 1]
        return 1.0 if w is None else part.near(w) * np.clip(part.far(w), 0.0, 1.0)

    def influence_of(self, part: Part) -> Floats:
        """Return ``J(r / horizon)`` of a part, (nbonds,); 1 where the weights of the rule hold it."""
        if self._held:
            return np.ones(part.nbonds)
        return as_influence(self.influence)(np.linalg.norm(part.vectors(), axis=1) / self.horizon)

    def vectors(self) -> Floats:
        """Return ``xi = y - x`` of all bonds, (dim, nbonds)."""
        return np.concatenate([part.vectors() for part in self.parts]).T

    @property
    def weight(self) -> Floats:
        """Weights of the plain double integral, (nbonds,)."""
        return np.concatenate([part.weight for part in self.parts])

    def measure(self) -> Floats:
        """Return ``k`` of all bonds, see :meth:`measure_of`."""
        return np.concatenate([self.measure_of(part) for part in self.parts])

    @property
    def ends(self) -> Longs:
        """The vertices (mesh numbers) at the ends of each bond of vertex pairs, (2, nbonds).

        Raises ``ValueError`` for other rules: their ends are points in elements, see :meth:`Part.sides`.
        """
        if not self.samples.at_vertices or not all(isinstance(part, PairBonds) for part in self.parts):
            raise ValueError(f"rule = {self.rule.name}: its bonds do not end at vertices")
        ends = np.concatenate([part.ends + part.first for part in self.parts if isinstance(part, PairBonds)])
        vertices: Longs = self.samples.vertices[ends.T, 0].astype(np.int64)
        return vertices

    @property
    def nbytes(self) -> int:
        """Memory of the bond list."""
        return sum(part.nbytes for part in self.parts)

    @cached_property
    def moment(self) -> float:
        """``M_d = int_0^1 J(s) s^d ds`` of the exact integral."""
        return as_influence(self.influence).moment(self.dim)
