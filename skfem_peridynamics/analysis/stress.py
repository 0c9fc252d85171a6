"""Strain and stress at the vertices."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._types import Basis, Floats, Mesh
from ..engine.block import Block
from ..geometry.simplices import element_volumes, vertex_volumes
from ..material.elastic import lame_constants, poisson_of
from ..model.peridynamics import Peridynamics


def gradients(mesh: Mesh, u: Floats) -> Floats:
    """Return the displacement gradient of each element, ``du_i / dx_j``, (nelements, dim, dim).

    >>> import skfem
    >>> mesh = skfem.MeshTri()
    >>> gradients(mesh, np.stack([2 * mesh.p[1], 0 * mesh.p[0]], axis=1).ravel())[0].tolist()
    [[0.0, 2.0], [0.0, 0.0]]
    """
    dim = int(mesh.dim())
    x, v = mesh.p.T[mesh.t.T], u.reshape(-1, dim)[mesh.t.T]
    edges, moved = x[:, 1:] - x[:, :1], v[:, 1:] - v[:, :1]
    return np.asarray(np.swapaxes(np.linalg.solve(edges, moved), 1, 2), dtype=float) + 0.0


def strain(basis: Basis, u: Floats) -> Floats:
    """Return the strain at the vertices, the mean of the elements there by volume.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    u : ndarray, (N,)
        Displacement, numbered as the basis numbers it.

    Returns
    -------
    ndarray, (nvertices, dim, dim)
        Symmetric.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshTri().refined(1), skfem.ElementVector(skfem.ElementTriP1()))
    >>> strain(basis, basis.project(lambda x: np.array([0.2 * x[0], 0.1 * x[0]])))[0].round(12).tolist()
    [[0.2, 0.05], [0.05, 0.0]]
    """
    mesh = basis.mesh
    dim, volume = int(mesh.dim()), element_volumes(mesh)
    G = gradients(mesh, u)
    each = (0.5 * (G + np.swapaxes(G, 1, 2))).reshape(len(G), -1) * volume[:, None]
    total = np.zeros((int(mesh.nvertices), dim * dim))
    for corner in mesh.t:
        np.add.at(total, corner, each)
    around = np.bincount(mesh.t.ravel(), np.tile(volume, len(mesh.t)), int(mesh.nvertices))
    return (total / around[:, None]).reshape(-1, dim, dim)


def stress(body: Peridynamics, u: Floats) -> Floats:
    """Return the stress at the vertices that the bonds carry, ``1/(2 V) sum p xi^T``.

    p is what the bond pulls with, half of each bond counts at either end. Inside a body under a uniform strain it
    is Hooke's; broken bonds carry nothing, and within a horizon of the surface there are fewer of them. Summed with
    the volumes it is the virial, minus ``sum F x^T``.

    Parameters
    ----------
    body : Peridynamics
        The body.
    u : ndarray, (N,)
        Displacement, numbered as the basis numbers it.

    Returns
    -------
    ndarray, (nvertices, dim, dim)
        Forces per area.

    References
    ----------
    R. B. Lehoucq and S. A. Silling, J. Mech. Phys. Solids 56 (2008) 1566.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Linear
    >>> grid = np.linspace(0, 1, 21)
    >>> basis = skfem.Basis(skfem.MeshTri.init_tensor(grid, grid), skfem.ElementVector(skfem.ElementTriP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.2), Linear(slope=6.0))         # lambda = mu = 1
    >>> u = basis.project(lambda x: np.array([0.1 * x[0], 0 * x[0]]))
    >>> stress(body, u)[(abs(basis.mesh.p.T - 0.5) < 0.01).all(axis=1)].round(2).tolist()
    [[[0.3, 0.0], [0.0, 0.1]]]
    """
    volume = vertex_volumes(body.bonds.mesh)
    return vertex_virials(body, u, body.pressure(u)) / volume[:, None, None]


def vertex_virials(body: Peridynamics, u: Floats, pressure: Floats | None = None) -> Floats:
    """Return ``1/2 sum p xi^T`` over the bonds of each vertex, (nvertices, dim, dim): its stress times its volume.

    ``pressure`` is that of a dilatation, at the samples.
    """
    samples, dim = body.bonds.samples, body.bonds.dim
    total = np.zeros((samples.nsamples, dim * dim))

    def of_block(block: Block, T: Floats) -> tuple[slice, Floats]:
        p = block.directions()  # e / sqrt(r)
        xi = block.part.vectors() if block.which is None else block.part.vectors()[block.which]
        pull = block.tension(T, pressure)[:, None] * p
        each = (pull[:, :, None] * xi[:, None, :]).reshape(len(T), -1)
        sampled: Floats = block.incidence(1.0).T @ each
        return block.window, sampled

    for window, summed in body.each_block(u, of_block):
        total[window] += summed
    return 0.5 * samples.spread(total).reshape(-1, dim, dim)


def voigt(tensors: Floats) -> Floats:
    """Return symmetric tensors (n, dim, dim) as ParaView takes them, (n, 6): xx, yy, zz, xy, yz, xz.

    >>> voigt(np.array([[[1.0, 2.0], [2.0, 3.0]]])).tolist()
    [[1.0, 3.0, 0.0, 2.0, 0.0, 0.0]]
    >>> voigt(np.array([[[1.0, 4, 6], [4, 2, 5], [6, 5, 3]]])).tolist()
    [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]
    """
    dim = tensors.shape[1]
    full = np.zeros((len(tensors), 3, 3))
    full[:, :dim, :dim] = tensors
    return full[:, [0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2]]


def von_mises(stress: Floats, across: float = 0.0) -> Floats:
    """Return the von Mises stress of tensors (n, dim, dim), (n,); in 2D ``across`` times the trace acts out of plane.

    >>> von_mises(np.diag([3.0, 0.0, 0.0])[None]).tolist(), von_mises(np.diag([3.0, 3.0])[None], 0.5).tolist()
    ([3.0], [0.0])
    """
    dim = stress.shape[1]
    whole = np.zeros((len(stress), 3, 3))
    whole[:, :dim, :dim] = stress
    trace = np.trace(stress, axis1=1, axis2=2)
    if dim == 2:
        whole[:, 2, 2] = across * trace
    deviator = whole - np.trace(whole, axis1=1, axis2=2)[:, None, None] / 3.0 * np.eye(3)
    return np.asarray(np.sqrt(1.5 * (deviator**2).sum(axis=(1, 2))), dtype=float)


def largest_principal(stress: Floats) -> Floats:
    """Return the largest principal stress of tensors (n, dim, dim), (n,).

    >>> largest_principal(np.array([[[0.0, 2.0], [2.0, 0.0]]])).tolist()
    [2.0]
    """
    return np.asarray(np.linalg.eigvalsh(stress)[:, -1], dtype=float)


def out_of_plane(material: Any, dim: int) -> float | None:
    """Return what part of the trace acts out of plane in 2D: Poisson's ratio in plane strain, else nothing.

    None where materials of several ratios are strained in a plane, or where only a law is known.

    >>> from ..material.material import Material
    >>> out_of_plane(Material.from_elastic(young=1.0, density=1.0, plane="strain", potential="linear"), 2)
    0.25
    """
    if dim != 2:
        return 0.0
    found = set()
    for one in getattr(material, "materials", (material,)):
        if getattr(one, "plane", None) is None:
            return None
        lame, mu = lame_constants(dim, one.plane, one.young, one.lame, one.poisson, one.mu, one.bulk)
        found.add(0.0 if one.plane == "stress" else round(poisson_of(lame, mu, one.plane), 12))
    return found.pop() if len(found) == 1 else None
