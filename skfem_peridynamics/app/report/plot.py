"""A body on matplotlib's axes, for scripts and notebooks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ..._types import Floats, Mesh
from ...analysis.stress import largest_principal, out_of_plane, von_mises
from ...model.peridynamics import Peridynamics

SIX = [0, 3, 5, 3, 1, 4, 5, 4, 2]  # of xx, yy, zz, xy, yz, xz, as frames have them
FIELDS = ("damage", "displacement", "von Mises", "largest principal")


def plot(
    body: Peridynamics | Mesh,
    u: npt.ArrayLike | None = None,
    of: str | npt.ArrayLike = "damage",
    *,
    ax: Any = None,
    scale: float = 1.0,
    fields: Mapping[str, Floats] | None = None,
    **options: Any,
) -> Any:
    """Draw a body in one or two dimensions, moved by ``scale`` times a displacement; return matplotlib's axes.

    Parameters
    ----------
    body : Peridynamics or skfem.Mesh
        The body, or a mesh, where ``fields`` has what is drawn.
    u : array_like, (N,), optional
        Displacement, numbered as the basis numbers it; none by default.
    of : str or array_like, (nvertices,), optional
        ``"damage"`` (the part of a vertex's bonds that is gone), ``"displacement"`` (its length), ``"von Mises"``,
        ``"largest principal"`` (stresses), or numbers at the vertices.
    ax : matplotlib.axes.Axes, optional
        Where to draw; the current axes by default.
    scale : float, optional
        What displacements are multiplied by in the picture.
    fields : mapping of str to ndarray, optional
        Fields at the vertices that are known: ``intact``, ``stress``.
    **options
        Of matplotlib's ``tripcolor`` (2D) or ``plot`` (1D): ``cmap``, ``vmin``, ``vmax``, ...

    Returns
    -------
    matplotlib.axes.Axes
        The axes; in 2D ``ax.collections[0]`` is what a colour bar is of.

    Raises
    ------
    ValueError
        For a body in space, which :func:`view` shows, and for fields that are not known.

    Examples
    --------
    >>> import skfem
    >>> from matplotlib.figure import Figure
    >>> mesh = skfem.MeshTri().refined(3)
    >>> ax = plot(mesh, of=mesh.p[0] ** 2, ax=Figure().add_subplot())
    >>> float(ax.collections[0].get_array().max())
    1.0
    """
    mesh = body.bonds.mesh if isinstance(body, Peridynamics) else body
    if not hasattr(mesh, "dim") or len(mesh.t) != mesh.dim() + 1:
        raise ValueError(f"body = {type(body).__name__} must be a body, or a mesh of lines or triangles")
    dim = int(mesh.dim())
    if dim == 3:
        raise ValueError("a body in space is shown by skfem_peridynamics.view, which needs the extra view (pyvista)")
    moved = np.zeros(dim * int(mesh.nvertices)) if u is None else np.asarray(u, dtype=float)
    if moved.shape != (dim * int(mesh.nvertices),):
        raise ValueError(f"u has shape {moved.shape}; the mesh has {dim * int(mesh.nvertices)} unknowns")
    values = field_of(body, moved, of, fields or {})
    if ax is None:
        import matplotlib.pyplot as plt

        ax = plt.gca()
    p = mesh.p + scale * moved.reshape(-1, dim).T
    if dim == 1:
        order = np.argsort(mesh.p[0], kind="stable")
        ax.plot(p[0][order], values[order], **options)
        return ax
    shades: dict[str, Any] = {
        "shading": "gouraud",
        "cmap": "magma_r" if isinstance(of, str) and of == "damage" else "viridis",
    }
    if isinstance(of, str) and of == "damage":
        shades |= {"vmin": 0.0, "vmax": 1.0}
    ax.tripcolor(p[0], p[1], mesh.t.T, values, **(shades | options)).set_in_layout(False)  # quicker by far
    from matplotlib.collections import LineCollection

    rim = mesh.facets[:, mesh.boundary_facets()]
    ax.add_collection(LineCollection(np.moveaxis(p[:, rim], 0, 2).swapaxes(0, 1), color="0.25", lw=0.7))
    ax.set_aspect("equal")
    ax.autoscale_view()
    return ax


def field_of(body: Peridynamics | Mesh, u: Floats, of: str | npt.ArrayLike, fields: Mapping[str, Floats]) -> Floats:
    """Return numbers at the vertices, (nvertices,), by name or as they are given. Raises ``ValueError``."""
    mesh = body.bonds.mesh if isinstance(body, Peridynamics) else body
    n, dim = int(mesh.nvertices), int(mesh.dim())
    if not isinstance(of, str):
        given = np.asarray(of, dtype=float)
        if given.shape != (n,):
            raise ValueError(f"of has shape {given.shape}; the mesh has {n} vertices")
        return given
    if of == "displacement":
        return np.asarray(np.linalg.norm(u.reshape(-1, dim), axis=1), dtype=float)
    if of == "damage":
        if "intact" in fields:
            return np.asarray(1.0 - fields["intact"], dtype=float)
        if isinstance(body, Peridynamics):
            from ...analysis.damage import damage

            return np.asarray(1.0 - damage(body, u).intact, dtype=float)
    elif of in FIELDS:
        if "stress" in fields or isinstance(body, Peridynamics):
            return _of_stress(body, u, of, fields, dim)
    else:
        raise ValueError(f"of = {of!r} must be one of {', '.join(map(repr, FIELDS))}, or numbers at the vertices")
    raise ValueError(f"of = {of!r} needs a body, or it among the fields of a frame; there are {', '.join(fields)}")


def _of_stress(body: Peridynamics | Mesh, u: Floats, of: str, fields: Mapping[str, Floats], dim: int) -> Floats:
    if of == "von Mises" and "von_mises" in fields:
        return np.asarray(fields["von_mises"], dtype=float)
    if "stress" in fields:
        tensor = np.asarray(fields["stress"], dtype=float)[:, SIX].reshape(-1, 3, 3)[:, :dim, :dim]
        across: float | None = None if dim == 2 and of == "von Mises" else 0.0
    else:
        from ...analysis.stress import stress

        assert isinstance(body, Peridynamics)
        tensor, across = stress(body, u), out_of_plane(body.material, dim)
    if of == "largest principal":
        return largest_principal(tensor)
    if across is None:
        raise ValueError(
            'of = "von Mises" needs a material that says whether its plane is one of stress or of strain, with one '
            "Poisson ratio, or von_mises among the fields"
        )
    return von_mises(tensor, across)
