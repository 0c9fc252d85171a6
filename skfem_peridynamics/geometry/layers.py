"""Layers along boundaries: distances, collars, and the paper's boundary function w."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from .._types import Floats, Ints, Longs, Mesh
from .simplices import distance_to_simplices, offset_from_simplices, outward_normals
from .visibility import INSET, Sight, sight

_CHUNK = 4096  # points at a time: bounds the candidate pairs held in memory
_AIM = 0.1  # of the way from the nearest point of a facet to its middle


def named_facets(mesh: Mesh, facets: Any) -> Ints:
    """Return facet indices from a name, index array, callable or list of them (scikit-fem's ``normalize_facets``).

    Raises ``ValueError`` for an unknown name (the known ones are listed) and for an empty set.

    >>> import skfem
    >>> named_facets(skfem.MeshTri().with_defaults(), "left").tolist()
    [1]
    """
    try:
        numbers = np.asarray(mesh.normalize_facets(facets))
    except ValueError:
        known = ", ".join(mesh.boundaries or {}) or "none"
        raise ValueError(f"boundary {facets!r} is not in the mesh; its named boundaries are: {known}") from None
    if not len(numbers):
        raise ValueError(f"facets = {facets!r} is an empty set of facets")
    return numbers


def distance_to_facets(mesh: Mesh, facets: Any, within: float, points: Floats | None = None) -> Floats:
    """Return the distance of points (dim, n), by default the vertices, to a set of facets; ``inf`` beyond ``within``.

    >>> import skfem
    >>> m = skfem.MeshTri().refined(2).with_defaults()
    >>> sorted(set(distance_to_facets(m, "left", within=0.6).tolist()))
    [0.0, 0.25, 0.5, inf]
    """
    from scipy.spatial import cKDTree

    facets = named_facets(mesh, facets)
    points = mesh.p if points is None else points
    corners = mesh.p[:, mesh.facets[:, facets]]
    middle = corners.mean(axis=1)
    radius = np.linalg.norm(corners - middle[:, None], axis=0).max()
    extent = float(np.ptp(mesh.p, axis=1).max())
    far = (within + radius) * (1.0 + 1e-9) + 1e-12 * extent  # what lies on the rim is found
    tree = cKDTree(middle.T)
    distance = np.full(points.shape[1], np.inf)
    nearest, _ = tree.query(points.T, distance_upper_bound=far)
    close = np.flatnonzero(np.isfinite(nearest))
    close = close[np.argsort(nearest[close], kind="stable")]
    for start in range(0, len(close), _CHUNK):
        # the nearest facet has its middle no farther than a facet radius beyond the nearest middle
        chunk = close[start : start + _CHUNK]
        bound = (nearest[chunk] + radius) * (1.0 + 1e-9)
        pairs = cKDTree(points[:, chunk].T).sparse_distance_matrix(tree, bound[-1], output_type="ndarray")
        pairs = pairs[pairs["v"] <= bound[pairs["i"]]]
        point = chunk[pairs["i"]]
        np.minimum.at(distance, point, distance_to_simplices(points[:, point], corners, pairs["j"]))
    distance[distance > within * (1.0 + 1e-9) + 1e-12 * extent] = np.inf
    return distance


def visible_distance(mesh: Mesh, facets: Any, within: float) -> Floats:
    """Return the distance of the vertices to what they see of a set of facets, (nvertices,); ``inf`` beyond ``within``.

    As bonds do, a line of sight crosses no slit, notch or hole. The vertices of the facets are at 0.

    >>> import skfem
    >>> from skfem_peridynamics import Crack, slit
    >>> square = skfem.MeshTri.init_tensor(np.linspace(0, 1, 5), np.linspace(0, 1, 5))
    >>> m = slit(square, Crack([[0.0, 0.5], [1.0, 0.5]])).with_boundaries({"low": lambda x: x[1] == 0.0})
    >>> seen = visible_distance(m, "low", within=0.75)
    >>> float(seen[m.p[1] < 0.75][np.isfinite(seen[m.p[1] < 0.75])].max()), bool(np.isinf(seen[m.p[1] == 0.75]).all())
    (0.5, True)
    """
    facets = named_facets(mesh, facets)
    distance = distance_to_facets(mesh, facets, within)
    view = sight(mesh, within)
    own = np.zeros(mesh.nvertices, dtype=bool)
    own[mesh.facets[:, facets]] = True
    asked = np.flatnonzero(view.near & np.isfinite(distance) & ~own)
    if len(asked):
        distance[asked] = _seen(mesh, facets, view, asked, within)
    return distance


@dataclass(frozen=True, eq=False)
class _Faces:
    """Facets that are looked at from vertices."""

    mesh: Mesh
    facets: Ints
    view: Sight

    @cached_property
    def corners(self) -> Floats:
        corners: Floats = self.mesh.p[:, self.mesh.facets[:, self.facets]]
        return corners

    @cached_property
    def middle(self) -> Floats:
        middle: Floats = self.corners.mean(axis=1)
        return middle

    @cached_property
    def inward(self) -> Floats:
        """An inset into the body; a facet inside it is seen from both sides."""
        normal, _ = outward_normals(self.mesh, self.facets)
        return np.where(self.mesh.f2t[1, self.facets] < 0, -INSET, 0.0) * normal

    def distance(self, vertices: Longs, which: Longs) -> Floats:
        """The distance of each vertex to a facet; ``inf`` where it does not see it."""
        mesh, view = self.mesh, self.view
        offset = offset_from_simplices(mesh.p[:, vertices], self.corners, which)
        # not at a corner: who sees no more than a crack tip does not see the crack
        end = mesh.p[:, vertices] - offset
        end += _AIM * (self.middle[:, which] - end) + view.size[vertices] * self.inward[:, which]
        # an element sees its own facets; on the boundary the second element of a facet is the first
        sides = mesh.f2t[:, self.facets[which]]
        touching = (mesh.t[:, np.where(sides < 0, sides[:1], sides)] == vertices).any(axis=(0, 1))
        hidden = view.hidden(view.points[:, vertices], end, view.size[vertices]) & ~touching
        return np.where(hidden, np.inf, np.linalg.norm(offset, axis=0))


def _seen(mesh: Mesh, facets: Ints, view: Sight, vertices: Longs, within: float) -> Floats:
    """The distance of some vertices to what they see of the facets."""
    from scipy.spatial import cKDTree

    faces = _Faces(mesh, facets, view)
    radius = np.linalg.norm(faces.corners - faces.middle[:, None], axis=0).max()
    tree = cKDTree(faces.middle.T)
    reach = (within + radius) * (1.0 + 1e-9)
    counts = tree.query_ball_point(mesh.p[:, vertices].T, reach, return_length=True)
    out = np.full(len(vertices), np.inf)
    # as many vertices at a time as have a bounded number of facets in reach
    part = np.cumsum(counts) // (_CHUNK * 16)
    for start, end in pairwise([*np.unique(part, return_index=True)[1].tolist(), len(vertices)]):
        lists = tree.query_ball_point(mesh.p[:, vertices[start:end]].T, reach)
        which = np.concatenate([np.array(found, dtype=np.int64) for found in lists])
        at = np.repeat(np.arange(start, end), counts[start:end])
        length = distance_to_simplices(mesh.p[:, vertices[at]], faces.corners, which)
        order = np.lexsort((length, at))
        order = order[length[order] <= within * (1.0 + 1e-9)]
        which, at = which[order], at[order]
        # the nearest facet first: most vertices see it
        first = np.unique(at, return_index=True)[1]
        out[at[first]] = faces.distance(vertices[at[first]], which[first])
        rest = np.flatnonzero(np.isinf(out[at]))
        np.minimum.at(out, at[rest], faces.distance(vertices[at[rest]], which[rest]))
    return out


def collar(mesh: Mesh, facets: Any, width: float) -> Longs:
    """Return the vertices within ``width`` of a set of facets that see it: no slit, notch or hole is between.

    Parameters
    ----------
    mesh : skfem.Mesh
        Lines, triangles or tetrahedra.
    facets : str, array_like or callable
        As scikit-fem names facets: a name, indices, or a callable of midpoints.
    width : float
        A length; 0 takes the vertices of the facets alone.

    Returns
    -------
    ndarray of int
        Numbers of vertices.

    Raises
    ------
    ValueError
        For a negative width, an unknown or an empty set.

    Examples
    --------
    >>> import skfem
    >>> m = skfem.MeshTri().refined(2).with_defaults()
    >>> len(collar(m, "left", width=0.25))
    10
    """
    if not width >= 0.0:
        raise ValueError(f"width = {width} of a collar must not be negative")
    return np.flatnonzero(np.isfinite(visible_distance(mesh, facets, width)))


def region(mesh: Mesh, elements: Any) -> Longs:
    """Return the vertices of a set of elements.

    Parameters
    ----------
    mesh : skfem.Mesh
        Lines, triangles or tetrahedra.
    elements : str, array_like or callable
        A subdomain's name, indices, or a callable of the midpoints.

    Returns
    -------
    ndarray of int
        Numbers of vertices.

    Raises
    ------
    ValueError
        For an unknown or an empty set.

    Examples
    --------
    >>> import skfem
    >>> region(skfem.MeshLine(np.linspace(0, 1, 5)), lambda x: x[0] < 0.5).tolist()
    [0, 1, 2]
    """
    try:
        numbers = np.asarray(mesh.normalize_elements(elements))
    except (ValueError, KeyError):
        known = ", ".join(mesh.subdomains or {}) or "none"
        raise ValueError(f"subdomain {elements!r} is not in the mesh; its subdomains are: {known}") from None
    if not len(numbers):
        raise ValueError(f"elements = {elements!r} is an empty set of elements")
    return np.unique(mesh.t[:, numbers]).astype(np.int64)


def boundary_function(mesh: Mesh, horizon: float) -> Floats:
    """Return the paper's ``w`` at the vertices: 1 deeper than the horizon, 0 on the boundary, C2 in between.

    With ``s = distance / horizon`` it is ``s^3 (10 - 15 s + 6 s^2)``.

    Parameters
    ----------
    mesh : skfem.Mesh
        Lines, triangles or tetrahedra.
    horizon : float
        The depth from which on it is 1.

    Returns
    -------
    ndarray, (nvertices,)
        Values between 0 and 1.

    References
    ----------
    Paper, section 2.

    Examples
    --------
    >>> import skfem
    >>> boundary_function(skfem.MeshLine(np.linspace(0, 1, 5)), horizon=0.5).tolist()
    [0.0, 0.5, 1.0, 0.5, 0.0]
    """
    s = np.minimum(distance_to_facets(mesh, mesh.boundary_facets(), horizon) / horizon, 1.0)
    w: Floats = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return w
