"""The body: nonlocal energy, its gradient (the force) and its Hessian (stiffness and tangent)."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse
from scipy.sparse.linalg import LinearOperator

from .._compile import available
from .._threads import Threads
from .._types import Csr, Floats, Longs
from .._vectors import real_vector
from ..bonds.bond_basis import BondBasis
from ..engine.block import Block, make_blocks, matrix_bytes
from ..engine.engine import Engine, make_engine
from ..material.composite import Composite
from ..material.material import Elastic, Material, crossing
from ..material.own_law import check_law
from ..material.potential import Linear, Potential
from .bond_laws import laws_of_bonds

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
    def linear(self) -> bool:
        """Whether no bond ever softens."""
        return all(isinstance(block.law, Linear) for block in self.blocks)

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
        return sum(matrix_bytes(part.nbonds, bonds.dim, type(part)) for part in bonds.parts) <= self.matrix_memory

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
        return self.engine.energy(self._vector(u))

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
        return self.engine.force(self._vector(u))

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
        return self.assemble([block.rest_stiffness for block in self.blocks])

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
        return self.assemble(self.hessians(u))

    def stiffness_operator(self) -> LinearOperator:
        """Return ``a_l`` as a matrix-free operator.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator, (N, N)
            Products with the stiffness at rest.
        """
        return self._operator(None)

    def tangent_operator(self, u: Floats) -> LinearOperator:
        """Return minus the gradient of the force at u as a matrix-free operator; it stores one number per bond.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        scipy.sparse.linalg.LinearOperator, (N, N)
            Products with the tangent.
        """
        return self._operator(self.hessians(u))

    def hessians(self, u: Floats) -> list[Floats]:
        """Return the second derivatives of the energies of all bonds by their scaled strain T.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        list of ndarray
            An array a block.
        """
        return list(self.each_block(u, lambda block, T: block.k * block.law.hessian(T)))

    def _operator(self, weights: Sequence[Floats] | None) -> LinearOperator:
        def apply(x: Floats, transposed: bool = False) -> Floats:
            return self.engine.product(weights, real_vector(x, "x").ravel(), transposed)

        size = self.basis.N
        return LinearOperator(
            (size, size), matvec=apply, rmatvec=lambda x: apply(x, transposed=True), dtype=np.dtype(float)
        )

    def assemble(self, weights: Sequence[Floats]) -> Csr:
        """Return the matrix of ``sum weight T(u) T(v)`` over the bonds.

        Parameters
        ----------
        weights : sequence of ndarray
            A number a bond, an array a block; from :meth:`hessians` it is the tangent.

        Returns
        -------
        scipy.sparse.csr_matrix, (N, N)
            Exactly symmetric when the rule is.
        """
        size = self.basis.N
        total = sparse.csr_matrix((size, size))
        rows, cols, values, entries = [], [], [], 0
        for block, weight in zip(self.blocks, weights, strict=True):
            number, B, XT = self._at_vertices(block)
            local = (XT @ sparse.csr_matrix(B.multiply(weight[:, None]))).tocoo()
            rows.append(number[local.row])
            cols.append(number[local.col])
            values.append(local.data)
            entries += local.nnz
            if entries > max(8_000_000, total.nnz):  # merge before the parts outgrow what they merge into
                total = total + _csr(rows, cols, values, size)
                rows, cols, values, entries = [], [], [], 0
        K = total + _csr(rows, cols, values, size) if rows else total
        if self.symmetric:  # round-off of the summation order, so that K equals its transpose
            K = sparse.csr_matrix((K + K.T) * 0.5)
        return K

    def _at_vertices(self, block: Block) -> tuple[Longs, Csr, sparse.csc_matrix]:
        """B and X^T of a block with vertex degrees of freedom in place of samples, and the numbers of those."""
        dim, samples = self.bonds.dim, self.bonds.samples
        B, XT = block.matrices()
        if samples.at_vertices:
            vertices = samples.vertices[block.window, 0]
        else:
            P = samples.matrix[block.window]
            vertices = np.unique(P.indices)
            P = sparse.kron(P[:, vertices], sparse.identity(dim), format="csr")
            B, XT = B @ P, P.T @ XT
        return (vertices[:, None].astype(np.int64) * dim + np.arange(dim)).ravel(), B, XT


def _csr(rows: list[Longs], cols: list[Longs], values: list[Floats], size: int) -> Csr:
    triple = (np.concatenate(values), (np.concatenate(rows), np.concatenate(cols)))
    return sparse.coo_matrix(triple, shape=(size, size)).tocsr()
