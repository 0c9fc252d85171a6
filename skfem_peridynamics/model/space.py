"""The vector P1 space of a mesh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._types import Basis, Floats, Mesh


def vector_basis(mesh: Mesh, **options: Any) -> Basis:
    """Return scikit-fem's vector P1 basis of a line, triangle or tetrahedron mesh; ``options`` are those of ``Basis``.

    >>> import skfem
    >>> int(vector_basis(skfem.MeshTri()).N)
    8
    """
    from skfem import Basis, ElementLineP1, ElementTetP1, ElementTriP1, ElementVector

    element = (ElementLineP1, ElementTriP1, ElementTetP1)[mesh.dim() - 1]()
    return Basis(mesh, ElementVector(element), **{"intorder": 2, **options})


def numbering_basis(mesh: Mesh) -> Basis:
    """Return the same basis where only its numbers are used: a single element is all it tabulates.

    >>> import skfem
    >>> basis = numbering_basis(skfem.MeshTri().refined(3))
    >>> int(basis.N), basis.nelems
    (162, 1)
    """
    basis = vector_basis(mesh, elements=np.array([0]), intorder=1)
    basis.numbers_only = True
    return basis


def interpolate(basis: Basis, function: Callable[[Floats], Floats]) -> Floats:
    """Return ``I_h(function)``: its values at the vertices.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    function : callable
        Of x, (dim, n), with results of that shape.

    Returns
    -------
    ndarray, (N,)
        Nodal values.

    Raises
    ------
    ValueError
        For results of another shape.

    References
    ----------
    Paper, section 3.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> interpolate(basis, lambda x: x**2).tolist()
    [0.0, 0.25, 1.0]
    """
    p = basis.mesh.p
    values = np.stack(np.broadcast_arrays(*np.asarray(function(p), dtype=float), p[0])[:-1])
    if values.shape != p.shape:
        raise ValueError(f"function gives {values.shape[0]} components; the displacement has {p.shape[0]}")
    return values.T.ravel()


def project(basis: Basis, function: Callable[[Floats], Floats]) -> Floats:
    """Return ``r_h(function)``: the L2 projection of scikit-fem.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    function : callable
        Of x, (dim, ...), with results of that shape.

    Returns
    -------
    ndarray, (N,)
        Nodal values.

    References
    ----------
    Paper, eq. 3.4.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> project(basis, lambda x: 2 * x).round(12).tolist()
    [0.0, 1.0, 2.0]
    """
    projected: Floats = basis.project(function)
    return projected
