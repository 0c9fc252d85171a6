"""The J-integral about a crack tip: the energy that flows into it, as an integral over a ring around it."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from .._types import Floats, Mesh
from ..geometry.simplices import describe_point, element_volumes, outward_normals
from ..material.composite import Composite
from ..model.peridynamics import Peridynamics
from .stress import gradients


def j_integral(
    body: Peridynamics,
    u: Floats,
    tip: npt.ArrayLike,
    direction: npt.ArrayLike,
    radius: float,
    inner: float | None = None,
    v: Floats | None = None,
    a: Floats | None = None,
) -> float:
    """Return the energy release rate of a crack with this tip that grows in this direction, in 2D.

    It is the domain form of Rice's integral with the stress of the strains (Hooke's), ``int (sigma_ij
    u_i,1 - W delta_1j) q_,j``; q falls from 1 at ``inner`` to 0 at ``radius``. In the ring the body is taken for a
    local, linear one; what is left is of order ``(eps/inner)^2``. The ring runs around the tip from one face of the
    crack to the other, which must be free of load there. A crack that has grown is a band of torn elements, with
    neither stress nor energy: those with an edge beyond its critical strain.

    Parameters
    ----------
    body : Peridynamics
        The body.
    u : ndarray, (N,)
        Displacement, numbered as the basis numbers it.
    tip : array_like, (2,)
        Where the crack ends.
    direction : array_like, (2,)
        Which way it grows; any length.
    radius : float
        Of the ring, at most its distance to the boundary.
    inner : float, optional
        Where q begins to fall, at least a horizon; half the radius by default.
    v : ndarray, (N,), optional
        Velocity: with it the kinetic terms of a moving body are added.
    a : ndarray, (N,), optional
        Acceleration, likewise.

    Returns
    -------
    float
        J, an energy per area.

    Raises
    ------
    ValueError
        For a body that is not in 2D, a bare potential, and a ring that is too small or reaches the boundary of the
        body.

    References
    ----------
    J. R. Rice, J. Appl. Mech. 35 (1968) 379.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Crack, Material, slit
    >>> axis = np.linspace(-1, 1, 21)
    >>> mesh = slit(skfem.MeshTri.init_tensor(axis, axis), Crack([[-1, 0], [0, 0]]))
    >>> basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    >>> stone = Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane="stress")
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), stone)
    >>> j_integral(body, np.zeros(basis.N), tip=[0, 0], direction=[1, 0], radius=0.8)         # at rest
    0.0
    """
    mesh, dim = body.bonds.mesh, body.bonds.dim
    if dim != 2:
        raise ValueError(f"the J-integral is computed in 2D; the body has {dim} dimensions")
    tip, along = np.asarray(tip, dtype=float), np.asarray(direction, dtype=float)
    along = along / np.linalg.norm(along)
    inner = 0.5 * radius if inner is None else inner
    if not body.bonds.horizon * (1.0 - 1e-9) <= inner < radius:
        raise ValueError(
            f"radius = {radius:g} with inner = {inner:g}: the ring must begin a horizon, {body.bonds.horizon:g}, from "
            "the tip or farther, where strains are those of a local body"
        )
    gap = np.linalg.norm(mesh.p - tip[:, None], axis=0)
    q = np.clip((radius - gap) / (radius - inner), 0.0, 1.0)
    inside = np.flatnonzero(q[mesh.t].max(axis=0) > 0.0)
    if not len(inside) or not (q[mesh.t[:, inside]] > 0.999).any():
        raise ValueError(f"the ring of radius {radius:g} about {describe_point(tip)} holds no elements of the body")
    _check_ring(mesh, q, along)
    part = mesh.restrict(inside)
    vertices = np.unique(mesh.t[:, inside])
    lame, shear, density, critical = (constant[inside] for constant in _constants(body))
    dofs = (2 * vertices[:, None] + np.arange(2)).ravel()
    whole = _worst_edge(part, u[dofs]) <= critical
    lame, shear, density = lame * whole, shear * whole, density * whole
    G = gradients(part, u[dofs])
    strain = 0.5 * (G + np.swapaxes(G, 1, 2))
    trace = np.trace(strain, axis1=1, axis2=2)
    stress = (lame * trace)[:, None, None] * np.eye(2) + (2.0 * shear)[:, None, None] * strain
    W = 0.5 * np.einsum("nij,nij->n", stress, strain)
    volume = element_volumes(part)
    dq = gradients(part, np.repeat(q[vertices], 2))[:, 0]
    moving = G @ along
    if v is not None:
        speed = v[dofs].reshape(-1, 2)[part.t].mean(axis=0)
        W = W + 0.5 * density * (speed**2).sum(axis=1)
    flow = np.einsum("nij,ni,nj->n", stress, moving, dq) - W * (dq @ along)
    if v is not None and a is not None:
        push = a[dofs].reshape(-1, 2)[part.t].mean(axis=0)
        change = gradients(part, v[dofs]) @ along
        share = q[vertices][part.t].mean(axis=0)
        flow += density * share * ((push * moving).sum(axis=1) - (speed * change).sum(axis=1))
    return float(volume @ flow)


def _check_ring(mesh: Mesh, q: Floats, along: Floats) -> None:
    """Raise ``ValueError`` where the ring reaches a boundary across the direction of the crack, unless it is a slit."""
    slit = np.asarray((mesh.boundaries or {}).get("slit", []), dtype=np.int64)
    facets = np.setdiff1d(mesh.boundary_facets(), slit)
    facets = facets[q[mesh.facets[:, facets]].min(axis=0) > 0.0]
    if len(facets):
        normal, _ = outward_normals(mesh, facets)
        across = np.abs(along @ normal)
        worst = int(across.argmax())
        if across[worst] > 0.05:
            where = describe_point(mesh.p[:, mesh.facets[:, facets[worst]]].mean(axis=1))
            raise ValueError(f"the ring reaches the boundary of the body at {where}: take a smaller radius")


def _worst_edge(mesh: Mesh, u: Floats) -> Floats:
    """The largest scaled strain ``sqrt(r) S`` of an edge of each element."""
    v, worst = u.reshape(-1, mesh.dim()).T, np.zeros(int(mesh.nelements))
    for a, b in combinations(mesh.t, 2):
        xi = mesh.p[:, b] - mesh.p[:, a]
        r = np.linalg.norm(xi, axis=0)
        worst = np.maximum(worst, (xi * (v[:, b] - v[:, a])).sum(axis=0) / r**1.5)
    return worst


def _constants(body: Peridynamics) -> tuple[Floats, Floats, Floats, Floats]:
    """Lamé constants, density, and critical scaled strain of each element."""
    material: Any = body.material
    mesh, dim = body.bonds.mesh, body.bonds.dim
    if not hasattr(material, "laws") and not hasattr(material, "elastic"):
        raise ValueError("material is a bare potential; the J-integral needs a Material")
    moments = body.moments
    if isinstance(material, Composite):
        each = [
            member_material.elastic(law, dim, *moments)
            for member_material, law in zip(material.materials, body.laws, strict=True)
        ]
        member = material.member_of(mesh)
    else:
        each, member = [body.elastic], np.zeros(int(mesh.nelements), dtype=np.int64)
    constants = (
        [member_material.lame for member_material in each],
        [member_material.shear for member_material in each],
        [member_material.density for member_material in each],
        [law.inflection for law in body.laws],
    )
    lame, shear, density, critical = (np.array(constant, dtype=float)[member] for constant in constants)
    return lame, shear, density, critical
