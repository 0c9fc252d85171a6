"""Load vectors: body forces, surface tractions, and tractions as a body force in a layer (the paper's remark)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.sparse as sparse

from .._types import Basis, Csr, Floats, Mesh
from ..geometry.layers import named_facets, visible_distance
from ..geometry.simplices import outward_normals, vertex_sizes, vertex_volumes

# a constant vector, or a function of x (dim, ...) with as many rows
Field: TypeAlias = npt.ArrayLike | Callable[[Floats], Floats]


def _at(field: Field, x: Floats, name: str) -> Floats:
    values = field(x) if callable(field) else field
    values = np.asarray(values, dtype=float)
    if values.ndim == 0 or values.shape[0] != x.shape[0]:
        raise ValueError(f"{name} has shape {values.shape}; it needs {x.shape[0]} components")
    if not np.isfinite(values).all():
        raise ValueError(f"{name} = {values.tolist() if values.ndim == 1 else '...'} has values that are not finite")
    return np.broadcast_to(values.reshape(values.shape + (1,) * (x.ndim - values.ndim)), x.shape)


def body_force(basis: Basis, field: Field) -> Floats:
    """Return ``(b, phi_i)`` of a force per volume, by scikit-fem's quadrature.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    field : array_like, (dim,), or callable
        A constant vector, or a function of x (dim, ...) that gives one of that shape.

    Returns
    -------
    ndarray, (N,)
        The load.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body_force(basis, [4.0]).tolist()
    [1.0, 2.0, 1.0]
    """
    from skfem import LinearForm
    from skfem.helpers import dot

    out: Floats = LinearForm(lambda v, w: dot(_at(field, w.x, "body force"), v)).assemble(basis)
    return out


def traction(basis: Basis, facets: Any, field: Field) -> Floats:
    """Return the load vector of a force per area t over boundary facets, ``int t.phi_i ds``.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    facets : str, array_like or callable
        As scikit-fem names facets: a name, indices, or a callable of midpoints.
    field : array_like, (dim,), or callable
        A constant vector, or a function of x (dim, ...) that gives one of that shape.

    Returns
    -------
    ndarray, (N,)
        The load.

    Raises
    ------
    ValueError
        For an unknown or an empty set.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshTri().with_defaults()
    >>> basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    >>> float(traction(basis, "right", [3.0, 0.0]).sum())
    3.0
    """
    out: Floats = facet_mass(basis.mesh, facets) @ _at(field, basis.mesh.p, "traction").T
    return out.ravel()


def facet_mass(mesh: Mesh, facets: Any) -> Csr:
    """Return ``int phi_i phi_j ds`` over a set of boundary facets, (nvertices, nvertices): exact for P1 tractions.

    >>> import skfem
    >>> mesh = skfem.MeshTri().with_defaults()
    >>> facet_mass(mesh, "right").toarray()[1:4:2, 1:4:2].round(6).tolist()
    [[0.333333, 0.166667], [0.166667, 0.333333]]
    """
    facets = named_facets(mesh, facets)
    _, area = outward_normals(mesh, facets)
    corners = mesh.facets[:, facets]
    k = len(corners)
    values = area / (k * (k + 1)) * (1.0 + np.eye(k))[:, :, None]
    rows, columns = np.broadcast_arrays(corners[:, None], corners[None])
    return sparse.csr_matrix((values.ravel(), (rows.ravel(), columns.ravel())), shape=(mesh.nvertices,) * 2)


def layer_share(basis: Basis, facets: Any, width: float) -> Floats:
    """Return what each vertex carries of a unit traction spread over a layer, (nvertices,); the sum is the area.

    The body force is constant through the layer of that width, which is what sees the facets: a slit, a notch or a
    hole ends it. A vertex near its inner rim counts in part. Shares
    are normalised so that the resultant is that of the surface traction exactly.
    """
    mesh = basis.mesh
    if not width > 0.0:
        raise ValueError(f"width = {width} of a load layer must be positive")
    facets = named_facets(mesh, facets)
    h = vertex_sizes(mesh)
    depth = visible_distance(mesh, facets, width + 0.5 * float(h.max()))
    inside = np.clip((width + 0.5 * h - np.minimum(depth, 2.0 * width + h)) / h, 0.0, 1.0)
    share = vertex_volumes(mesh) * inside
    _, area = outward_normals(mesh, facets)
    share *= area.sum() / share.sum()
    return share


def layer_traction(basis: Basis, facets: Any, field: Field, width: float) -> Floats:
    """Return the load of a traction that is applied as a body force in a layer.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    facets : str, array_like or callable
        As scikit-fem names facets: a name, indices, or a callable of midpoints.
    field : array_like, (dim,), or callable
        A force per area.
    width : float
        Thickness of the layer, as a rule a horizon.

    Returns
    -------
    ndarray, (N,)
        The load; its sum is that of the traction.

    Raises
    ------
    ValueError
        For a width that is not positive, an unknown or an empty set.

    References
    ----------
    Paper, section 2.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 2, 17)).with_defaults()
    >>> basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    >>> load = layer_traction(basis, "top", [0.0, 5.0], width=0.25)
    >>> round(float(load.sum()), 12), int((load > 0).sum())
    (5.0, 27)
    """
    t = _at(field, basis.mesh.p, "traction")
    return (layer_share(basis, facets, width) * t).T.ravel()
