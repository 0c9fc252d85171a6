"""A body in space, by pyvista: deformed, with its crack's surface and slices; in a window or a notebook."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._types import Floats, Mesh
from ...model.peridynamics import Peridynamics
from .plot import field_of

_CRACK = 0.3  # of the bonds gone: what counts as the crack
_VTK = {1: 3, 2: 5, 3: 10}  # lines, triangles, tetrahedra


def view(
    body: Peridynamics | Mesh,
    u: npt.ArrayLike | None = None,
    of: str | npt.ArrayLike = "damage",
    *,
    scale: float = 1.0,
    crack: bool = True,
    slices: bool = False,
    fields: Mapping[str, Floats] | None = None,
    **options: Any,
) -> Any:
    """Return pyvista's plotter with a body, moved by ``scale`` times a displacement: call ``show()`` of it.

    Parameters
    ----------
    body : Peridynamics or skfem.Mesh
        The body, or a mesh, where ``fields`` has what is shown.
    u : array_like, (N,), optional
        Displacement, numbered as the basis numbers it.
    of : str or array_like, (nvertices,), optional
        What colours show, as for :func:`plot`.
    scale : float, optional
        What displacements are multiplied by in the picture.
    crack : bool, optional
        In space, show the surface where three tenths of the bonds are gone, in a body that is seen through.
    slices : bool, optional
        Show three slices through the middle in place of the body.
    fields : mapping of str to ndarray, optional
        Fields at the vertices that are known.
    **options
        Of pyvista's ``Plotter``: ``off_screen``, ``window_size``, ``notebook``, ...

    Returns
    -------
    pyvista.Plotter
        With all in it.

    Raises
    ------
    ValueError
        Where pyvista is not installed, and for fields that are not known.

    Examples
    --------
    >>> import skfem
    >>> mesh = skfem.MeshTet().refined(1)
    >>> view(mesh, of=mesh.p[2], off_screen=True).mesh.n_points         # doctest: +SKIP
    27
    """
    try:
        import pyvista
    except ImportError:
        raise ValueError("view needs pyvista: pip install 'skfem-peridynamics[view]'") from None
    grid = grid_of(body, u, of, scale=scale, fields=fields)
    plotter = pyvista.Plotter(**options)
    name, three = grid.active_scalars_name, grid.celltypes.max(initial=0) == _VTK[3]
    if slices and three:
        plotter.add_mesh(grid.slice_orthogonal(), scalars=name)
        plotter.add_mesh(grid.outline(), color="gray")
    elif crack and three and "damage" in grid.point_data and grid["damage"].max() > _CRACK:
        plotter.add_mesh(grid, color="lightgray", opacity=0.25)
        plotter.add_mesh(grid.contour([_CRACK], scalars="damage"), color="firebrick")
    else:
        plotter.add_mesh(grid, scalars=name, show_edges=grid.n_cells < 5000)
    return plotter


def grid_of(
    body: Peridynamics | Mesh,
    u: npt.ArrayLike | None = None,
    of: str | npt.ArrayLike | None = None,
    *,
    scale: float = 1.0,
    fields: Mapping[str, Floats] | None = None,
) -> Any:
    """Return pyvista's grid of a body, moved, with what is asked for at its vertices."""
    import pyvista

    mesh = body.bonds.mesh if isinstance(body, Peridynamics) else body
    dim, n = int(mesh.dim()), int(mesh.nvertices)
    moved = np.zeros(dim * n) if u is None else np.asarray(u, dtype=float)
    points = np.zeros((n, 3))
    points[:, :dim] = mesh.p.T + scale * moved.reshape(n, dim)
    cells = np.concatenate([np.full((1, mesh.nelements), dim + 1), mesh.t]).T.ravel()
    grid = pyvista.UnstructuredGrid(cells, np.full(mesh.nelements, _VTK[dim], dtype=np.uint8), points)
    if of is not None:
        name = of if isinstance(of, str) else "values"
        grid[name] = field_of(body, moved, of, fields or {})
        grid.set_active_scalars(name)
    return grid
