"""Bonds over a scikit-fem basis, as a basis that its forms assemble on."""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import Any

import numpy as np

from .._types import Floats, Ints
from .._vectors import real_vector
from ..geometry.simplices import vertex_sizes
from ..material.influence import Influence
from .bond_list import Balance, BondList
from .corner_rule import CornerRule
from .forms import Functions, Sides, field_class
from .pair_rule import PairRule
from .rule import Rule

_log = logging.getLogger("skfem_peridynamics")
_OF_SPACE = ("get_dofs", "complement_dofs", "zeros", "ones", "project", "doflocs", "probes", "elem", "nodal_dofs")
_DRAWN = 20_000  # elements of a mesh that is drawn in a notebook
_REFUSED = {
    "with_element": "their ends are read by P1 values; make a BondBasis over another basis of P1 elements",
    "quadrature": "their points are those of the rule; give BondBasis another rule",
    "refinterp": "an end of a bond is a point; use bonds.space.refinterp",
}


def gives_way(rule: Rule, found: Balance, say: bool = True) -> bool:
    """Return whether corner pairs are not balanced well enough, and all vertex pairs take their place; the log says so.

    >>> gives_way(PairRule(), Balance([], np.zeros(0, dtype=int), 0.9, 0.9, 0.01, 0.5, 6))
    False
    """
    if not isinstance(rule, CornerRule) or rule.suffices(found):
        return False
    if say:
        _log.warning(
            "rule = %s: balanced, its moments are off by up to %.1e of the largest, and a weight is %.2f times "
            "what it was: not good enough, all vertex pairs take their place",
            rule.name,
            max(found.residual, found.residual_near),
            found.smallest,
        )
    return True


@dataclass(frozen=True, eq=False)
class BondBasis(BondList):
    """The bonds of a body: everything about the double integral that does not depend on the material.

    It is itself a basis that scikit-fem's forms assemble on: in a form a bond is an element, displacements come in
    pairs ``u1, u2`` (at x and at y), and ``w`` holds ``x, y, xi, r``.

    Parameters
    ----------
    space : skfem.Basis
        A vector P1 basis: ``skfem.Basis(mesh, ElementVector(ElementTriP1()))`` or its line and tetrahedron forms.
    horizon : float
        A length, in the units of the mesh.
    influence : Influence, str or callable
        ``J(s)``, or its name.
    rule : PairRule or BallRule
        The quadrature of the double integral.
    boundary_function : None, "smooth" or array_like, (nvertices,)
        None for a free body (w = 1), ``"smooth"`` for the paper's w (:func:`boundary_function`), or values at the
        vertices.
    balance : Balance, optional
        Weights that :meth:`balanced` has made.

    Raises
    ------
    ValueError
        For another element, a horizon that is not positive, or a vertex without a bond.

    References
    ----------
    Paper, eqs. 2.4, 2.6 and 2.11.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 9)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> bonds = BondBasis(basis, horizon=0.25)
    >>> bonds.nbonds, round(bonds.discrete_moments[0], 12)            # M_1 = 1/2, met exactly in 1D
    (15, 0.5)
    >>> dot = skfem.BilinearForm(lambda u1, u2, v1, v2, w: (u2 - u1)[0] * (v2 - v1)[0] / w.r)
    >>> dot.assemble(bonds).shape
    (9, 9)
    """

    def __repr__(self) -> str:
        made = "bonds not made yet"
        if "parts" in self.__dict__:
            made = f"{self.nbonds:,} bonds, {self.nbonds / self.mesh.nvertices:.0f} a vertex"
        per = self.horizon / float(np.median(vertex_sizes(self.mesh)))
        balanced = ", balanced" if self.balance is not None else ""
        assert isinstance(self.influence, Influence)
        return f"BondBasis: {made}, horizon/h {per:.1f}, {self.rule.name}{balanced}, J {self.influence.name}"

    def _repr_html_(self) -> str:
        """What notebooks show: the same, with scikit-fem's picture of the mesh."""
        draw = getattr(self.mesh, "_repr_svg_", None)
        picture = draw() if draw is not None and self.mesh.nelements <= _DRAWN else ""
        return f"<p>{escape(repr(self))}</p>{picture}"

    def with_(self, **changes: Any) -> BondBasis:
        """Return a copy with another horizon, influence, rule or boundary function, and the rule's own weights.

        Parameters
        ----------
        **changes
            Fields by their names.

        Returns
        -------
        BondBasis
            The copy, with the rule's own weights.
        """
        return dataclasses.replace(self, **({"balance": None} | changes))

    def balanced(self, exact: bool = False) -> BondBasis:
        """Return a copy whose weights pass the linear patch test at every vertex, or nearly so, on any mesh.

        The weights of a symmetric rule are changed as little as possible, and stay positive, so that uniform strains
        leave no net force at a vertex, and near boundaries the exact one; and so that the elastic constants are right
        at every vertex. ``balance`` of the copy tells how it went, and names the vertices that could not be balanced.
        The step limit of a balanced body is another one: ask for it again.

        A few iterations do: of vertex pairs for the price of some 50 forces in 2D and 130 in 3D
        (`docs/benchmarks/balancing.py`), which leaves about a hundredth of the largest moment at four vertices per
        horizon; of balls a thousandth, for more forces.

        Corner pairs that cannot be balanced well enough give way to all vertex pairs, and the log says so.

        No weight changes by more than a factor of 50. Where that is not enough (vertex pairs with less than 2.5
        vertices per horizon on a random mesh) the rule's own weights stay, and the vertices are named all the same.

        Parameters
        ----------
        exact : bool, optional
            Go on until the patch test passes to round-off, deeper than the horizon: four times the price, and no
            smaller errors. In 1D it always does.

        Returns
        -------
        BondBasis
            The copy.

        Raises
        ------
        ValueError
            For a one-sided rule.

        Examples
        --------
        >>> import skfem
        >>> x = np.array([0.0, 0.08, 0.2, 0.33, 0.4, 0.52, 0.63, 0.7, 0.82, 0.9, 1.0])
        >>> basis = skfem.Basis(skfem.MeshLine(x), skfem.ElementVector(skfem.ElementLineP1()))
        >>> bonds = BondBasis(basis, horizon=0.25).balanced()
        >>> len(bonds.balance.unbalanced), bonds.balance.smallest > 0.5
        (0, True)
        """
        from .balance import balance

        if self.balance is not None:
            return self
        found = balance(self, exact)
        if gives_way(self.rule, found):
            return self.with_(rule=PairRule()).balanced(exact)
        return self.with_balance(found)

    def with_balance(self, found: Balance) -> BondBasis:
        """Return a copy with the weights of a balance; bonds are the same, and not made again.

        Parameters
        ----------
        found : Balance
            Weights by part, and how it went.

        Returns
        -------
        BondBasis
            The copy.
        """
        copy = dataclasses.replace(self, balance=found)
        copy.__dict__["samples"] = self.samples
        copy.__dict__["parts"] = [part.with_weight(w) for part, w in zip(self.parts, found.weights, strict=True)]
        return copy

    @cached_property
    def discrete_moments(self) -> tuple[float, float]:
        """What these bonds make of ``M_d``, for strains and for cracks: means over points deeper than the horizon.

        The elastic energy, averaged over directions, is proportional to ``sum weight J r``. A plane crack with normal
        n, at any level, opens a P1 field across one row of elements: it breaks the bonds whose ends use vertices on
        both sides. Averaged over the level that is ``sum weight J L``, L the extent along n of the vertices that a
        bond uses; for vertex pairs ``L = |xi.n|``. A ball rule breaks bonds that merely end in the row, and costs more.
        The mean over all n is not enough on a lattice, which is not isotropic, and cracks run along facets: it is
        averaged over the facets of the mesh, by area, where the mesh has few directions of them.

        Raises ``ValueError`` when no point is deep enough.
        """
        from .discrete_moments import discrete_moments

        return discrete_moments(self)

    def __getattr__(self, name: str) -> Any:
        """What is asked of a basis and concerns its unknowns alone is that of the space."""
        if name in _OF_SPACE and "space" in self.__dict__:
            return getattr(self.space, name)
        if name in _REFUSED:
            raise AttributeError(f"bonds have no {name}: {_REFUSED[name]}")
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    # ---- what scikit-fem's forms read from a basis
    @cached_property
    def sides(self) -> Sides:
        """Vertices and P1 values at both ends of all bonds; made for forms only."""
        return Sides.from_bonds(self)

    @property
    def N(self) -> int:
        """Degrees of freedom: those of the vector P1 basis."""
        return int(self.space.N)

    @property
    def nelems(self) -> int:
        """A bond is an element to scikit-fem's forms; those without length are left out."""
        return int(self.sides.live.sum())

    @property
    def X(self) -> Floats:
        """The one quadrature point of a bond, (dim, 1)."""
        return np.zeros((self.dim, 1))

    @property
    def dx(self) -> Floats:
        """Weights of the plain double integral over D x D, (nelems, 1); a bond of a symmetric rule has both orders."""
        return self.weight[self.sides.live, None]

    @property
    def Nbfun(self) -> int:
        """Local functions of a bond: one per component and vertex at x and at y."""
        return len(self.sides.functions)

    @property
    def element_dofs(self) -> Ints:
        """Degrees of freedom of the local functions, (Nbfun, nelems)."""
        return self.sides.dofs

    @property
    def basis(self) -> Functions:
        """The local functions, each a pair of fields ``(u1, u2)``: values at x and at y."""
        return Functions(self.sides)

    def default_parameters(self) -> dict[str, Any]:
        """Return what a form finds in ``w``.

        Returns
        -------
        dict
            ``x, y, xi = y - x``, fields (dim, nelems, 1), and ``r = |xi|`` and the mesh size ``h`` at x, (nelems, 1).
        """
        from skfem.element import DiscreteField

        xi = self.vectors()[:, self.sides.live, None]
        x = self.sides.interpolated(0, self.mesh.p.T)
        h = self.sides.interpolated(0, vertex_sizes(self.mesh)[:, None])[0]
        fields = {"x": x, "y": x + xi, "xi": xi, "r": np.linalg.norm(xi, axis=0), "h": h}
        return {name: DiscreteField(field) for name, field in fields.items()}

    def interpolate(self, u: Floats) -> tuple[Any, Any]:
        """Return a displacement at both ends of the bonds; in a form ``w.u[0], w.u[1]``.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        tuple of two DiscreteField, (dim, nelems, 1)
            At x and at y.

        Raises
        ------
        ValueError
            For a vector of another length.
        """
        u = real_vector(u)
        if u.shape != (self.N,):
            raise ValueError(f"u has shape {u.shape}; the basis has {self.N} degrees of freedom")
        at_x, at_y = (field_class()(self.sides.at(side, u)) for side in (0, 1))
        return at_x, at_y
