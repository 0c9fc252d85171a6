"""Meshes and bodies that the tests share."""

import numpy as np
import skfem

import skfem_peridynamics as peri

ELEMENT = {1: skfem.ElementLineP1, 2: skfem.ElementTriP1, 3: skfem.ElementTetP1}


def grid(*sides):
    """A structured mesh; each side is (length, divisions)."""
    axes = [np.linspace(0.0, length, n + 1) for length, n in sides]
    if len(axes) == 1:
        return skfem.MeshLine(axes[0])
    return {2: skfem.MeshTri, 3: skfem.MeshTet}[len(axes)].init_tensor(*axes)


def box(dim, n, kind="structured", seed=0):
    """The unit interval, square or cube: structured, randomly shifted by 40 % of h inside, or graded 1:3."""
    axes = [np.linspace(0.0, 1.0, n + 1)] * dim
    if kind == "graded":
        axes = [(0.5 * s + 0.5 * s**2) for s in axes]
    mesh = skfem.MeshLine(axes[0]) if dim == 1 else {2: skfem.MeshTri, 3: skfem.MeshTet}[dim].init_tensor(*axes)
    if kind == "random":
        shift = np.random.default_rng(seed).uniform(-0.4, 0.4, mesh.p.shape) / n
        shift *= ((mesh.p > 1e-9) & (mesh.p < 1 - 1e-9)).all(axis=0)
        for _ in range(20):  # a few elements invert at 40 %: their vertices move less
            before, after = (orientation(x, mesh.t) for x in (mesh.p, mesh.p + shift))
            wrong = before * after < 0.05 * before**2
            if not wrong.any():
                break
            shift[:, np.unique(mesh.t[:, wrong])] *= 0.7
        mesh = type(mesh)(mesh.p + shift, mesh.t)
        assert not wrong.any()
    return mesh


def orientation(p, t):
    """Signed volumes of elements, up to a factor."""
    return np.linalg.det(np.moveaxis(p[:, t[1:]] - p[:, t[:1]], 2, 0))


def vector_basis(mesh):
    return skfem.Basis(mesh, skfem.ElementVector(ELEMENT[mesh.dim()]()))


def body_on(mesh, horizon, law=None, influence="constant", **options):
    keys = {name: options.pop(name) for name in ("rule", "boundary_function") if name in options}
    bonds = peri.BondBasis(vector_basis(mesh), horizon, influence, **keys)
    return peri.Peridynamics(bonds, law or peri.Linear(1.0), **options)


def at_vertices(mesh, *components):
    """Nodal values of a field given by one array or number per component."""
    return np.stack([np.broadcast_to(c, mesh.p[0].shape) for c in components], axis=1).astype(float).ravel()
