"""The vector P1 space of a mesh."""

from __future__ import annotations

from typing import Any

from .._types import Basis, Mesh


def vector_basis(mesh: Mesh, **options: Any) -> Basis:
    """Return scikit-fem's vector P1 basis of a line, triangle or tetrahedron mesh; ``options`` are those of ``Basis``.

    >>> import skfem
    >>> int(vector_basis(skfem.MeshTri()).N)
    8
    """
    from skfem import Basis, ElementLineP1, ElementTetP1, ElementTriP1, ElementVector

    element = (ElementLineP1, ElementTriP1, ElementTetP1)[mesh.dim() - 1]()
    return Basis(mesh, ElementVector(element), **{"intorder": 2, **options})
