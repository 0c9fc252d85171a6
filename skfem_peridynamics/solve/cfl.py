"""The largest stable step of the central difference method, four ways (docs/theory/model.md, section 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, inf, isfinite, nan, sqrt
from typing import Any

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import ArpackError, ArpackNoConvergence, LinearOperator, eigs

from .._types import Floats
from ..geometry.simplices import vertex_volumes
from ..material.influence import as_influence
from ..model.led_body import offered
from ..model.peridynamics import Peridynamics
from ..model.vertex_stiffness import vertex_stiffness
from .lanczos import largest_mode
from .mass_solver import Lumped, MassSolver, mass_solver
from .state import State

SAFETY = 0.9  # part of the stable limit that a run takes where nothing is said (docs/evidence/stability.md)
DENSE = 128  # unknowns up to which the whole spectrum is computed
# Lanczos from one random vector can settle on a neighbour of the largest eigenvalue with a small residual. In a space
# of 20 vectors it was 0.11 % low at worst over the meshes of tests/solve/test_cfl.py and four starts each, and 1.4 % in
# one of 5,600 random bodies; in one of 38 that body's is found. The margin is four times the 0.11 %.
_KRYLOV = 38  # 40 products in all; 59 in one of a hundred bodies
_MISSED = 5e-3


@dataclass(frozen=True)
class StepLimit:
    """Bounds and estimates of ``lam = sup a_l(u, u) / (rho (u, u))``, each in 1 / time^2; a step is ``2 / sqrt(lam)``.

    Parameters
    ----------
    eigenvalue : float
        Ritz value of Lanczos; nan when it did not converge.
    residual : float
        Norm of its residual.
    nodal_bound : float
        Guaranteed for these bonds.
    row_sum : float
        What other codes use.
    closed_form : float
        A bound for the exact integrals, infinite in 1D; a sampled energy can exceed it.
    products : int
        Applications of the stiffness; 0 where the whole spectrum was computed.
    bonds : float, optional
        What bonds alone have, margins included, where a dilatation makes a body at rest softer than they are (below
        their Poisson ratio): as bonds tear, the largest eigenvalue goes there. 0 elsewhere.

    Examples
    --------
    >>> limit = StepLimit(4.0, 0.1, 8.0, 8.0, 8.0, products=40)
    >>> round(limit.dt, 6)                                       # 2 / sqrt(4.1 * 1.005)
    0.985269
    """

    eigenvalue: float
    residual: float
    nodal_bound: float
    row_sum: float
    closed_form: float
    products: int
    bonds: float = 0.0

    @property
    def dt(self) -> float:
        """The step from ``min(nodal bound, Ritz value + residual + 0.5 %)``: Lanczos approaches from the unsafe side.

        The half per cent is left out where the whole spectrum was computed (``products == 0``).
        """
        ritz = max(with_margins(self.eigenvalue, self.residual, self.products), self.bonds)
        return 2.0 / sqrt(ritz if ritz < self.nodal_bound else self.nodal_bound)

    def exceeded(self, dt: float) -> bool:
        """Return whether a step is too long for certain: a Ritz value is never above the largest eigenvalue.

        Parameters
        ----------
        dt : float
            A step.

        Returns
        -------
        bool
            True where the step is unstable; False says nothing for certain.

        Examples
        --------
        >>> StepLimit(4.0, 0.1, 8.0, 8.0, 8.0, products=40).exceeded(1.001)
        True
        """
        return bool(dt * dt * self.eigenvalue > 4.0)

    def step_for(self, until: float, safety: float = SAFETY) -> float:
        """Return the largest step of at most ``safety`` times the limit that ends a run at ``until`` exactly.

        Parameters
        ----------
        until : float
            The end of the run.
        safety : float, optional
            Part of the limit, 0.9 by default.

        Returns
        -------
        float
            The step.

        Raises
        ------
        ValueError
            For a time or a safety that is not positive.

        Examples
        --------
        >>> StepLimit(4.0, 0.0, 8.0, 8.0, 8.0, products=0).step_for(2.0)        # the limit is 1
        0.6666666666666666
        """
        if not (np.isfinite(until) and until > 0.0 and safety > 0.0):
            raise ValueError(f"until = {until} and safety = {safety} must be positive numbers")
        return until / max(1, ceil(until / (safety * self.dt) - 1e-9))

    def steps(self) -> dict[str, float]:
        """Return the step that each estimate alone would allow.

        Returns
        -------
        dict of str to float
            By the names of the estimates; nan where there is none.
        """
        names = ("eigenvalue", "nodal_bound", "closed_form", "row_sum")
        values = {name: float(getattr(self, name)) for name in names}
        return {name: 0.0 if lam == inf else 2.0 / sqrt(lam) for name, lam in values.items()}


def with_margins(eigenvalue: float, residual: float, products: int) -> float:
    """Return what the largest eigenvalue is at most, by a Ritz value and its residual.

    >>> with_margins(4.0, 1.0, products=0), round(with_margins(4.0, 1.0, products=40), 6)
    (5.0, 5.025)
    """
    return (eigenvalue + residual) * (1.0 + (_MISSED if products else 0.0))


def exact_eigenvalue_bound(slope: float, mean: float, density: float, dim: int, horizon: float) -> float:
    """Return ``8 f'(0) Jbar_1 / (rho d horizon^2)``, with ``Jbar_1`` the ``mean`` of J / s over the unit ball.

    It bounds ``sup a_l(u, u) / (rho (u, u))`` of the exact integrals, d times sharper than the paper does.

    >>> exact_eigenvalue_bound(slope=1.0, mean=2.0, density=1.0, dim=2, horizon=0.5)
    32.0
    """
    return 8.0 * slope * mean / (density * dim * horizon**2)


def closed_form(body: Peridynamics, density: float) -> float:
    """Return :func:`exact_eigenvalue_bound` of a body: for any mesh, whatever h; infinite in 1D.

    Of several materials the stiffest and the smallest ``density`` count.
    """
    bonds = body.bonds
    mean = as_influence(bonds.influence).mean_inverse_power(1.0, bonds.dim)
    slope = max(law.slope for law in body.laws)
    beside = 0.0 if body.dilatation is None else max(0.0, float(body.dilatation.curvature().max()))
    bound = exact_eigenvalue_bound(slope, mean, density, bonds.dim, bonds.horizon)
    return bound if beside == 0.0 else bound * (1.0 + bonds.dim * beside)


def nodal_bounds(body: Peridynamics, m: Floats, weights: Sequence[Floats] | None = None) -> tuple[float, float]:
    """Return the guaranteed nodal bound and the row-sum estimate for a lumped mass, from one pass over the bonds.

    With ``A_i`` the stiffness that all bonds of vertex i hang on it, by P1 values, and ``m_i`` its mass (one per
    component), they are the maxima over the vertices of ``2 lam_max`` and of ``2 trace`` of ``m_i^-1/2 A_i m_i^-1/2``.
    For a directed rule, whose stiffness is not symmetric, the trace of what acts on x bounds the norm of its rows.
    ``weights`` are those of another state than rest, none of them negative.
    """
    # lumped masses of a vertex may differ by component, where a user scales them: keep the scaling symmetric
    scale = 1.0 / np.sqrt(m.reshape(-1, body.bonds.dim))
    scaled = vertex_stiffness(body, weights) * scale[:, :, None] * scale[:, None, :]
    trace = float(2.0 * np.trace(scaled, axis1=1, axis2=2).max())
    if not body.symmetric:
        return trace, trace
    return float(2.0 * np.linalg.eigvalsh(scaled)[:, -1].max()), trace


def largest_eigenvalue(
    body: Peridynamics, mass: MassSolver, tolerance: float, u: Floats | None = None
) -> tuple[float, float, int]:
    """Return Ritz value, residual norm and number of products for the largest eigenvalue of ``K x = lam M x``.

    K is the stiffness at rest, or the tangent at u. Matrix-free Lanczos (SciPy's eigsh; Arnoldi, eigs, for a directed
    rule), small problems by their whole spectrum.
    """
    size, symmetric = mass.size, body.symmetric
    if size <= DENSE:
        K = (body.stiffness() if u is None else body.tangent(u)).toarray()
        # few unknowns: no bound is as good as the spectrum itself
        lam = np.linalg.eigvals(np.stack([mass.solve(column) for column in K.T], axis=1))
        # a dense M^-1 K that is similar to a symmetric matrix has real eigenvalues but for round-off
        largest = float(lam.real.max() if symmetric else np.abs(lam).max())
        return largest, float(np.abs(lam).max() * size * np.finfo(float).eps), 0
    K = body.stiffness_operator() if u is None else body.tangent_operator(u)
    count = 0

    def apply(x: Floats) -> Floats:
        nonlocal count
        count += 1
        product: Floats = K @ x
        return product

    start = np.random.default_rng(0).standard_normal(size)
    options = {"k": 1, "tol": tolerance, "ncv": _KRYLOV, "maxiter": 60, "v0": start}
    try:
        if symmetric:
            value, _, residual = largest_mode(apply, mass, **options)
            return value, residual, count
        B = LinearOperator(K.shape, matvec=lambda x: mass.solve(apply(x)), dtype=np.dtype(float))
        values, vectors = eigs(B, which="LM", **options)
    except (ArpackNoConvergence, ArpackError):
        return nan, nan, count
    x = vectors[:, 0]
    gap = mass.solve(K @ x.real) + 1j * mass.solve(K @ x.imag) - values[0] * x
    return float(abs(values[0])), float(np.linalg.norm(gap) / np.linalg.norm(x)), count + 2


def stable_time_step(
    body: Peridynamics, M: sparse.spmatrix, *, tolerance: float = 5e-3, u: Floats | None = None
) -> StepLimit:
    """Return the largest stable step of the linearised model on this mesh, with all its estimates.

    The condition is ``dt^2/4 sup a_l(u,u)/(u,u) <= 1``. For laws with ``f'' <= 0`` and bonds alone the tangent never
    exceeds its value at rest, so the limit serves the whole nonlinear run. With a dilatation beside the bonds it may,
    a little: docs/theory/dilatation.md has the bound and what was measured.

    Parameters
    ----------
    body : Peridynamics
        The body.
    M : scipy.sparse matrix or ndarray, (N,)
        The lumped or the consistent mass of the scheme.
    tolerance : float, optional
        Relative, of the eigenvalue; the default costs 40 products as a rule, and with the margin 0.5 % of the step
        at most.
    u : ndarray, (N,), optional
        Take the tangent there: for laws that stiffen, and for the part of a run that comes after something stiff
        has broken.

    Returns
    -------
    StepLimit
        The limit and its estimates.

    Raises
    ------
    ValueError
        When no bond has any stiffness, and when neither an eigenvalue nor a bound is to be had.

    References
    ----------
    Paper, section 4.3.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear, mass_matrix
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 101)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.03), Linear(slope=1.0))
    >>> limit = stable_time_step(body, mass_matrix(basis))
    >>> round(limit.dt, 5), limit.eigenvalue < limit.nodal_bound, limit.closed_form
    (0.01964, True, inf)
    """
    over_ranks = offered(body, "stable_time_step")
    if over_ranks is not None:
        if u is not None:
            raise ValueError("u does not go with a body over processes: its limit is that at rest")
        found_over_ranks: StepLimit = over_ranks(body, M, tolerance)
        return found_over_ranks
    mass = mass_solver(M, np.empty(0, dtype=np.int64))
    lumped = np.asarray(M.sum(axis=1)).ravel() if not isinstance(M, np.ndarray) else M
    nodal, row_sum = nodal_bounds(body, lumped, body.bounding_weights(u))
    if not nodal > 0.0:
        raise ValueError("no bond has any stiffness: there is no stable step to compute")
    if not isinstance(mass, Lumped):
        # M is at least the lumped mass over d + 2 (Wathen); nothing is known where K is not symmetric
        nodal = nodal * (body.bonds.dim + 2) if body.symmetric else inf
    value, residual, products = largest_eigenvalue(body, mass, tolerance, u)
    if not isfinite(value) and not isfinite(nodal):
        raise ValueError("the largest eigenvalue did not converge and no bound is known: give the step yourself")
    density = float((lumped.reshape(-1, body.bonds.dim)[:, 0] / vertex_volumes(body.bonds.mesh)).min())
    bonds = 0.0
    if u is None and body.dilatation is not None and float(body.dilatation.curvature().min()) < 0.0:
        found = largest_eigenvalue(body.bonds_alone, mass, tolerance)
        bonds, products = with_margins(*found), products + found[2]
    return StepLimit(value, residual, nodal, row_sum, closed_form(body, density), products, bonds)


def discrete_energy(K: Any, M: Any, state: State) -> float:
    """Return ``1/2 (rho ||d+ u||^2 + a_l(u^k, u^{k+1}))``, conserved by the linear scheme without loads.

    It equals the paper's ``1/2 (||d+ u||^2 - dt^2/4 a_l(d+ u, d+ u) + a_l(ubar, ubar))`` with density, norms in the
    scheme's own mass.

    Parameters
    ----------
    K : matrix or operator, (N, N)
        The stiffness.
    M : matrix or operator, (N, N)
        The mass.
    state : State
        A state of :func:`central_difference`.

    Returns
    -------
    float
        The energy.

    References
    ----------
    Paper, theorem 4.4.

    Examples
    --------
    >>> import numpy as np
    >>> s = State(t=0.0, step=0, dt=0.5, u=np.ones(1), v=np.zeros(1), a=-np.ones(1), work=0.0, initial=0.0)
    >>> discrete_energy(np.eye(1), np.eye(1), s)            # u1 = 0.875, d+ u = -0.25
    0.46875
    """
    rate = state.v + 0.5 * state.dt * state.a
    following = state.u + state.dt * rate
    return 0.5 * float(rate @ (M @ rate) + state.u @ (K @ following))
