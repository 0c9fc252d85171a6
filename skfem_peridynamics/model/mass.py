"""Mass matrices of the vector P1 space, and the projections onto it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from .._types import Basis, Csr, Floats
from ..geometry.simplices import vertex_volumes


def mass_matrix(basis: Basis, *, density: float | Floats = 1.0, kind: str = "lumped") -> Csr:
    """Return the mass ``rho (phi_i, phi_j)``.

    Parameters
    ----------
    basis : skfem.Basis
        The vector P1 basis.
    density : float or ndarray, (nelements,), optional
        Mass per volume, or one for each element.
    kind : {"lumped", "consistent"}, optional
        Row sums on the diagonal, or scikit-fem's matrix.

    Returns
    -------
    scipy.sparse.csr_matrix, (N, N)
        The mass.

    Raises
    ------
    ValueError
        For another kind, and densities that are not positive.

    Examples
    --------
    >>> import skfem
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 3)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> mass_matrix(basis, density=2.0).diagonal().tolist()
    [0.5, 1.0, 0.5]
    """
    mesh = basis.mesh
    rho = np.asarray(density, dtype=float)
    if rho.ndim and rho.shape != (mesh.nelements,):
        raise ValueError(f"density has shape {rho.shape}; the mesh has {mesh.nelements} elements")
    wrong = np.flatnonzero(~((rho > 0.0) & np.isfinite(rho)))
    if len(wrong):
        which = f" of element {wrong[0]}" if rho.ndim else ""
        raise ValueError(f"density{which} = {rho.ravel()[wrong[0]]} must be a positive number")
    restricted = basis.nelems != mesh.nelements
    if restricted and not (kind == "lumped" and getattr(basis, "numbers_only", False)):
        raise ValueError(
            f"basis is of {basis.nelems} elements or facets of a mesh of {mesh.nelements} elements: the mass is of the "
            "whole body; take a basis without elements= or facets="
        )
    if kind == "lumped":
        m = vertex_volumes(mesh, rho) if rho.ndim else float(rho) * vertex_volumes(mesh)
        return sparse.csr_matrix(sparse.diags(np.repeat(m, basis.N // mesh.nvertices)))
    if kind != "consistent":
        raise ValueError(f'kind = {kind!r} must be "lumped" or "consistent"')
    from skfem import BilinearForm
    from skfem.element import ElementVector
    from skfem.helpers import dot

    product = dot if isinstance(basis.elem, ElementVector) else np.multiply
    if not rho.ndim:
        return sparse.csr_matrix(float(rho) * BilinearForm(lambda u, v, w: product(u, v)).assemble(basis))
    return sparse.csr_matrix(BilinearForm(lambda u, v, w: w.rho * product(u, v)).assemble(basis, rho=rho[:, None]))
