"""The body: nonlocal energy, its gradient (the force) and its Hessian (stiffness and tangent)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from html import escape
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt
from scipy.sparse.linalg import LinearOperator

from .._compile import available
from .._threads import Threads
from .._types import Csr, Floats
from .._vectors import real_vector
from ..bonds.bond_basis import BondBasis
from ..engine.block import Beside, Block, Pressure, make_blocks, matrix_bytes
from ..engine.engine import Engine, make_engine
from ..material.composite import Composite
from ..material.elastic import Elastic
from ..material.material import Material, crossing
from ..material.own_law import check_law
from ..material.potential import Linear, Potential
from ..material.volumetric import Volumetric
from .assembly import assemble, with_dilatation
from .bond_laws import laws_of_bonds

if TYPE_CHECKING:
    from .dilatation import Dilatation

_T = TypeVar("_T")

MATRIX_MEMORY = 4e9  # bytes


@dataclass(frozen=True, eq=False)
class Peridynamics:
    """A body with bonds and a material: the operators of the paper on the vector P1 space.

    Arguments and results of the operators are vectors (N,) numbered as the basis numbers them. Compiled loops and
    sparse products agree to round-off.

    Parameters
    ----------
    bonds : BondBasis
        The bonds.
    material : Material, Composite or Potential
        Constants that are calibrated for these bonds, or a law as it is.
    no_fail : array_like of int, optional
        Vertices all of whose bonds stay linear for ever: a bond is no-fail when one end is.
    threads : int, optional
        How many work on the operators; all cores by default. The bits do not depend on it.
    matrix_memory : float, optional
        Bytes that may be kept for the operators: the measures of the bonds (compiled loops; made anew at every use
        where there is less, a fifth slower) or their strain matrices (sparse products; some ten times slower).
    compiled : bool, optional
        Compiled loops (the extra ``fast``, numba) or SciPy's sparse products; by default the first where they can
        be had.

    Raises
    ------
    ValueError
        From the operators, for vectors of another length and for constants that make no law with these bonds.

    References
    ----------
    Paper, eqs. 2.4, 2.6, 2.11 and section 4.3.

    Examples
    --------
    >>> import skfem
    >>> grid = np.linspace(0, 1, 17)
    >>> basis = skfem.Basis(skfem.MeshTri.init_tensor(grid, grid), skfem.ElementVector(skfem.ElementTriP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Linear(slope=1.0))
    >>> u = basis.project(lambda x: np.array([x[0], 0 * x[0]]))         # a_l(u, u) of u = (x, 0) over the square
    >>> exact = 1 / 2 - 22 * 0.25 / (15 * np.pi) + 4 * 0.25**2 / (15 * np.pi)
    >>> round(2 * body.energy(u) / exact - 1, 4)                        # four vertices per horizon
    0.0042
    """

    bonds: BondBasis
    material: Material | Potential | Composite
    no_fail: npt.ArrayLike | None = None
    threads: int | None = None
    matrix_memory: float = MATRIX_MEMORY
    compiled: bool | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.bonds, BondBasis):
            raise ValueError(f"bonds = {type(self.bonds).__name__} must be a BondBasis")
        if self.bonds.scalar:
            raise ValueError(
                "bonds are over a scalar basis: they serve forms; a body needs the vector P1 basis, "
                "skfem.Basis(mesh, ElementVector(P1 element of the mesh))"
            )
        if not isinstance(self.material, Material | Potential | Composite):
            raise ValueError(
                f"material = {self.material!r} must be a Material, a Composite or a Potential; "
                "own_potential(law) makes one of your own law"
            )
        if isinstance(self.material, Potential):
            check_law(self.material)
        elif not self.symmetric and any(self.volumetric_energies):
            raise ValueError(
                f"rule = {self.bonds.rule.name}: a Poisson ratio other than that of bonds alone needs a symmetric "
                "rule, whose force is the gradient of an energy"
            )

    def __repr__(self) -> str:
        held = "" if self.no_fail is None else f", {np.size(self.no_fail)} no-fail vertices"
        return f"Peridynamics: {self._named_material()}{held}; {self.bonds!r}"

    def _repr_html_(self) -> str:
        """What notebooks show: the same, with a picture of the mesh."""
        return f"<p>Peridynamics: {escape(self._named_material())}</p>{self.bonds._repr_html_()}"

    def _named_material(self) -> str:
        if isinstance(self.material, Material):
            known = {name: getattr(self.material, name) for name in ("young", "lame", "toughness", "density")}
            constants = ", ".join(f"{name} {value:g}" for name, value in known.items() if value is not None)
            return f"{self.material.potential} law, {constants}"
        if isinstance(self.material, Composite):
            return f"materials matrix, {', '.join(self.material.inclusions)}"
        return f"{type(self.material).__name__} law"

    def with_(self, **changes: Any) -> Peridynamics:
        """Return a copy with other bonds, another material, no-fail vertices or threads.

        Parameters
        ----------
        **changes
            Fields by their names.

        Returns
        -------
        Peridynamics
            The copy.
        """
        return dataclasses.replace(self, **changes)

    @property
    def whole(self) -> Peridynamics:
        """The body with all its bonds: itself, unless some can break for good."""
        return self

    @property
    def basis(self) -> Any:
        """The scikit-fem basis of the displacement."""
        return self.bonds.space

    @property
    def symmetric(self) -> bool:
        """Whether the force is the gradient of the energy, and the stiffness symmetric."""
        return self.bonds.rule.symmetric

    @property
    def law(self) -> Potential:
        """The calibrated potential of these bonds. Raises ``ValueError`` where there are several: see ``laws``."""
        if len(self.laws) > 1:
            raise ValueError(f"a body of {len(self.laws)} materials has as many laws: see laws")
        return self.laws[0]

    @cached_property
    def laws(self) -> tuple[Potential, ...]:
        """The calibrated potentials of the materials, in the order of a composite; one for a body of one material."""
        if isinstance(self.material, Potential):
            return (self.material,)
        if isinstance(self.material, Material):
            return (self.material.law(self.bonds.dim, *self.moments),)
        return self.material.laws(self.bonds.dim, *self.moments)

    @property
    def volumetric_energies(self) -> list[Volumetric | None]:
        """The energy beside the bonds of each material; None where bonds alone have its elastic constants."""
        if isinstance(self.material, Potential):
            return [None]
        dim, moment = self.bonds.dim, self.moments[0]
        if isinstance(self.material, Composite):
            return self.material.volumetric_energies(self.laws, dim, moment)
        return [self.material.volumetric_energy(self.law, dim, moment)]

    @cached_property
    def dilatation(self) -> Dilatation | None:
        """The energy of the volumetric strains; None where bonds alone have the elastic constants."""
        energies = self.volumetric_energies
        if not any(energies):
            return None
        from .dilatation import make_dilatation

        composite = self.material if isinstance(self.material, Composite) else None
        return make_dilatation(self.bonds, self.blocks, self.laws, energies, composite, self.moments[0])

    @property
    def bonds_alone(self) -> Peridynamics:
        """The same bonds without a dilatation: itself where there is none."""
        if self.dilatation is None:
            return self
        alone = copy(self)
        alone.__dict__["dilatation"] = None
        return alone

    @property
    def _pressure(self) -> Pressure | None:
        return None if self.dilatation is None else self.dilatation.pressure

    @property
    def linear(self) -> bool:
        """Whether the force is linear: no bond ever softens, and the dilatation is quadratic."""
        quadratic = self.dilatation is None or self.dilatation.quadratic
        return quadratic and all(isinstance(block.law, Linear) for block in self.blocks)

    @property
    def moments(self) -> tuple[float, float]:
        """The moments ``M_d`` for strains and for cracks, exact or of these bonds."""
        if not isinstance(self.material, Potential) and self.material.calibrate == "discrete":
            return self.bonds.discrete_moments
        return self.bonds.moment, self.bonds.moment

    @property
    def crossing(self) -> float:
        """What a unit area of crack cuts of the measures of bonds, which is ``G_c / f_inf``."""
        return crossing(self.bonds.dim, self.moments[1])

    @property
    def elastic(self) -> Elastic:
        """Lamé constant, Young's modulus, toughness and wave speeds that the law has; needs a ``Material``."""
        if not isinstance(self.material, Material):
            raise ValueError("material is a bare potential; elastic constants need a Material with a density")
        return self.material.elastic(self.law, self.bonds.dim, *self.moments)

    @cached_property
    def blocks(self) -> list[Block]:
        """The bonds in computing form, those that can fail first."""
        composite = self.material if isinstance(self.material, Composite) else None
        keep, store = self._fits and not self.compiles, self._fits or not self.compiles
        return list(make_blocks(self.bonds, laws_of_bonds(self.bonds, self.laws, composite, self.no_fail), keep, store))

    @property
    def _fits(self) -> bool:
        """Whether what the operators may keep, strain matrices or the measures of the bonds, fits the memory."""
        bonds = self.bonds
        if self.compiles:
            return 8.0 * bonds.nbonds <= self.matrix_memory
        dilated = any(self.volumetric_energies)
        need = (matrix_bytes(part.nbonds, bonds.dim, type(part), dilated) for part in bonds.parts)
        return sum(need) <= self.matrix_memory

    @cached_property
    def pool(self) -> Threads:
        """The threads that work on the blocks, started when first needed."""
        return Threads(self.threads)

    @cached_property
    def engine(self) -> Engine:
        """What computes the operators: compiled loops where numba is installed, else SciPy's sparse products."""
        return make_engine(self.bonds, self.blocks, self.pool, self.compiles)

    @property
    def compiles(self) -> bool:
        """Whether compiled loops compute the operators. Raises ``ValueError`` where they are asked for and cannot."""
        if self.compiled and not available():
            raise ValueError(
                "compiled = True needs numba, and it is not installed: pip install 'skfem-peridynamics[fast]'"
            )
        return available() if self.compiled is None else self.compiled

    def _vector(self, u: Floats) -> Floats:
        u = real_vector(u)
        if u.shape != (self.basis.N,):
            raise ValueError(f"u has shape {u.shape}; the basis has {self.basis.N} degrees of freedom")
        return u

    def inward(self, u: Floats) -> Floats:
        """Return what the samples of the rule read of a nodal vector.

        Parameters
        ----------
        u : ndarray, (N,)
            A nodal vector.

        Returns
        -------
        ndarray, (nsamples, dim)
            Its values at the samples.

        Raises
        ------
        ValueError
            For a vector of another length.
        """
        return self.bonds.samples.take(self._vector(u).reshape(-1, self.bonds.dim))

    def each_block(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]:
        """Run a function on every block and the scaled strains T of its bonds, in threads.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.
        function : callable
            Of a block and T, (nbonds of the block,).

        Returns
        -------
        iterator
            The results, in the order of the blocks.
        """
        return self.engine.each(self._vector(u), function)

    # ---- the operators
    def energy(self, u: Floats) -> float:
        """Return ``PD(u)``.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        float
            The energy, 0 at rest and never negative.

        References
        ----------
        Paper, eq. 2.4 with 2.6.
        """
        u = self._vector(u)
        energy = self.engine.energy(u)
        return energy if self.dilatation is None else energy + self.dilatation.energy(self.engine.virial(u))

    def force(self, u: Floats) -> Floats:
        """Return ``-a(u, phi_i)``, minus the gradient of the energy.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        ndarray, (N,)
            Forces.

        References
        ----------
        Paper, eq. 2.11.
        """
        return self.engine.force(self._vector(u), self._pressure)

    def stiffness(self) -> Csr:
        """Return the matrix of ``a_l``; symmetric when the rule is.

        Returns
        -------
        scipy.sparse.csr_matrix, (N, N)
            The stiffness at rest.

        References
        ----------
        Paper, section 4.3.
        """
        K, beside = self.assemble([block.rest_stiffness for block in self.blocks]), self._beside()
        return K if beside is None else with_dilatation(self.bonds, self.blocks, K, beside)

    def tangent(self, u: Floats) -> Csr:
        """Return minus the gradient of the force at u; indefinite once bonds soften.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        scipy.sparse.csr_matrix, (N, N)
            The tangent.
        """
        weights, beside = self._tangent(u)
        K = self.assemble(weights)
        return K if beside is None else with_dilatation(self.bonds, self.blocks, K, beside)

    def stiffness_operator(self) -> LinearOperator:
        """Return ``a_l`` as a matrix-free operator.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator, (N, N)
            Products with the stiffness at rest.
        """
        return self._operator(None, self._beside())

    def tangent_operator(self, u: Floats) -> LinearOperator:
        """Return minus the gradient of the force at u as a matrix-free operator.

        It stores one number per bond, two where there is a dilatation.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator, (N, N)
            Products with the tangent.
        """
        return self._operator(*self._tangent(u))

    def hessians(self, u: Floats) -> list[Floats]:
        """Return the second derivatives of the energies of all bonds by their scaled strain T.

        Where the body has a dilatation its pressure is held: what it changes stands beside them in the tangent.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        list of ndarray
            An array a block.
        """
        p = self.pressure(u)
        if p is None:
            return list(self.each_block(u, lambda block, T: block.k * block.law.hessian(T)))
        return list(self.each_block(u, lambda block, T: block.pressed_hessian(T, p)))

    def pressure(self, u: Floats) -> Floats | None:
        """Return the pressure of the dilatation at the samples, None where the body has none.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        ndarray, (nsamples,), or None
            ``G'(e) / ((d + 2) mu)``, without dimension.
        """
        if self.dilatation is None:
            return None
        return self.bonds.samples.take(self.dilatation.pressure(self.engine.virial(self._vector(u))))

    def bounding_weights(self, u: Floats | None = None) -> list[Floats] | None:
        """Return numbers a bond, an array a block, whose assembled matrix is at least the stiffness, or tangent at u.

        None where these are those of the bonds at rest.

        Parameters
        ----------
        u : ndarray, (N,), optional
            Displacement; at rest without one.

        Returns
        -------
        list of ndarray, or None
            None of them negative.
        """
        weights = None if u is None else [np.maximum(hessian, 0.0) for hessian in self.hessians(u)]
        if self.dilatation is None:
            return weights
        from .dilatation import bounding_weights

        if u is None:
            return bounding_weights(self.dilatation, self.bonds.samples, self.blocks)
        bends, virial = self.each_block(u, lambda block, T: block.law.hessian(T)), self.engine.virial(self._vector(u))
        return bounding_weights(self.dilatation, self.bonds.samples, self.blocks, weights, bends, virial)

    def _beside(self) -> Beside | None:
        """What the dilatation adds to the stiffness."""
        return None if self.dilatation is None else Beside(None, self.dilatation.stiffness())

    def _tangent(self, u: Floats) -> tuple[list[Floats], Beside | None]:
        """Weights of the bonds in the tangent at u and what the dilatation adds, from one virial and one pass."""
        if self.dilatation is None:
            return self.hessians(u), None
        virial = self.engine.virial(self._vector(u))
        p = self.bonds.samples.take(self.dilatation.pressure(virial))
        rows = list(self.each_block(u, lambda block, T: (block.pressed_hessian(T, p), block.rates(T))))
        weights, rates = ([row[k] for row in rows] for k in (0, 1))
        return weights, Beside(rates, self.dilatation.stiffness(virial))

    def _operator(self, weights: Sequence[Floats] | None, beside: Beside | None) -> LinearOperator:
        def apply(x: Floats, transposed: bool = False) -> Floats:
            return self.engine.product(weights, real_vector(x, "x").ravel(), transposed, beside)

        size = self.basis.N
        return LinearOperator(
            (size, size), matvec=apply, rmatvec=lambda x: apply(x, transposed=True), dtype=np.dtype(float)
        )

    def assemble(self, weights: Sequence[Floats]) -> Csr:
        """Return the matrix of ``sum weight T(u) T(v)`` over the bonds.

        Parameters
        ----------
        weights : sequence of ndarray
            A number a bond, an array a block; from :meth:`hessians` it is the tangent of the bonds.

        Returns
        -------
        scipy.sparse.csr_matrix, (N, N)
            Exactly symmetric when the rule is.
        """
        return assemble(self.bonds, self.blocks, weights)
