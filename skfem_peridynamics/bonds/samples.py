"""Sample points: where a rule reads the displacement, as P1 values of the vertices.

Vertex pairs read it at the vertices. Rules with Gauss points outside read it there, and at the vertices of the elements
that hold the far ends. All kernels work on samples, numbered along the body so that near points have near numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Ints, Longs, Mesh
from ..geometry.neighbours import local_order
from ..geometry.simplices import edge_of_volume, element_volumes, vertex_sizes, vertex_volumes


@dataclass(frozen=True, eq=False)
class Samples:
    """Points with their P1 values, and which of them are outer points of the double integral.

    ``vertices`` and ``values`` (n, k): the vertices of the mesh that make up each sample; k is 1 where all samples are
    vertices. ``sites`` are the numbers of the outer points, ``volume`` (nsites,) their quadrature weights, ``element``
    (nsites,) the element that holds each, -1 for a vertex. ``place`` (nvertices,) is the sample of each vertex, -1
    where there is none. ``along`` (nsamples,), of a part of a body, are the numbers along the whole.
    """

    points: Floats
    vertices: Ints
    values: Floats
    sites: Longs
    volume: Floats
    size: Floats
    element: Longs
    place: Longs
    nvertices: int
    along: Longs | None = None

    @property
    def nsamples(self) -> int:
        return len(self.vertices)

    @property
    def at_vertices(self) -> bool:
        """Whether the samples are the vertices, in another order."""
        return bool(self.vertices.shape[1] == 1)

    @cached_property
    def matrix(self) -> Csr:
        """P1 values, csr (nsamples, nvertices)."""
        n = self.nsamples
        used = self.values != 0.0
        rows = np.concatenate([[0], np.cumsum(used.sum(axis=1))])
        matrix = sparse.csr_matrix((self.values[used], self.vertices[used], rows), shape=(n, self.nvertices))
        return matrix

    def take(self, field: Floats) -> Floats:
        """Return samples of a nodal field (nvertices,) or (nvertices, m)."""
        if self.at_vertices:
            return field.take(self.vertices[:, 0], axis=0)
        sampled: Floats = self.matrix @ field
        return sampled

    def spread(self, field: Floats) -> Floats:
        """Return the transpose of :meth:`take`: samples to vertices."""
        if self.at_vertices:
            return field.take(self.place, axis=0)
        nodal: Floats = self.matrix.T @ field
        return nodal


def vertex_samples(mesh: Mesh) -> Samples:
    """Return the vertices as samples and as outer points.

    >>> import skfem
    >>> s = vertex_samples(skfem.MeshLine(np.array([0.0, 1.0, 3.0])))
    >>> s.points.tolist(), s.volume.tolist()
    ([[0.0], [1.0], [3.0]], [0.5, 1.5, 1.0])
    """
    order = local_order(mesh.p)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return Samples(
        points=np.ascontiguousarray(mesh.p[:, order].T),
        vertices=order[:, None].astype(np.int32),
        values=np.ones((len(order), 1)),
        sites=np.arange(len(order)),
        volume=vertex_volumes(mesh)[order],
        size=vertex_sizes(mesh)[order],
        element=np.full(len(order), -1, dtype=np.int64),
        place=place,
        nvertices=int(mesh.nvertices),
    )


def gauss_rule(mesh: Mesh, order: int) -> tuple[Floats, Floats]:
    """Return scikit-fem's rule of an element, of the order or the next one whose weights are all positive.

    >>> import skfem
    >>> [gauss_rule(skfem.MeshTri(), order)[0].shape[1] for order in (2, 3, 4, 6)]     # its order 3 has a negative one
    [3, 6, 6, 12]
    """
    from skfem.quadrature import get_quadrature

    while True:
        X, W = get_quadrature(mesh.elem, order)
        if W.min() > 0.0:
            return X, W
        order += 1


def gauss_count(mesh: Mesh, order: int) -> int:
    """Return how many Gauss points of an order an element has.

    >>> import skfem
    >>> gauss_count(skfem.MeshTet(), 2)
    4
    """
    return int(gauss_rule(mesh, order)[0].shape[1])


def gauss_samples(mesh: Mesh, with_vertices: bool, order: int = 2) -> Samples:
    """Return scikit-fem's Gauss points of an order as outer points, and the vertices among the samples if asked.

    Order 2 has two points a line, three a triangle, four a tetrahedron. (Order 1 has one, and zero modes.)

    >>> import skfem
    >>> s = gauss_samples(skfem.MeshTri(), with_vertices=True)
    >>> s.nsamples, len(s.sites), round(float(s.volume.sum()), 12)
    (10, 6, 1.0)
    """
    X, W = gauss_rule(mesh, order)
    dim, ngauss = X.shape
    nelements, nvertices = int(mesh.nelements), int(mesh.nvertices)
    points, vertices, values, volume = _in_elements(mesh, X, W, np.arange(nelements))
    if with_vertices:
        points = np.hstack([points, mesh.p])
        own = np.zeros((nvertices, dim + 1))
        own[:, 0] = 1.0
        values = np.vstack([values, own])
        vertices = np.vstack([vertices, np.repeat(np.arange(nvertices)[:, None], dim + 1, axis=1)])
    sweep = local_order(points)
    # Gauss points come first in the list, vertices after them; both are numbered along one curve
    is_site = sweep < nelements * ngauss
    gauss = sweep[is_site]
    place = np.full(nvertices, -1, dtype=np.int64)
    if with_vertices:
        place[sweep[~is_site] - nelements * ngauss] = np.flatnonzero(~is_site)
    return Samples(
        points=np.ascontiguousarray(points[:, sweep].T),
        vertices=vertices[sweep].astype(np.int32),
        values=values[sweep],
        sites=np.flatnonzero(is_site),
        volume=volume[gauss],
        size=edge_of_volume(volume[gauss], dim),
        element=gauss // ngauss,
        place=place,
        nvertices=nvertices,
    )


def _in_elements(mesh: Mesh, X: Floats, W: Floats, elements: Longs) -> tuple[Floats, Longs, Floats, Floats]:
    """Points (dim, n), vertices and P1 values (n, dim + 1) and volumes (n,) of a reference rule in some elements."""
    value = np.vstack([1.0 - X.sum(axis=0), X])  # (dim + 1, npoints)
    points = np.einsum("kg,dke->deg", value, mesh.p[:, mesh.t[:, elements]]).reshape(len(X), -1)
    volume = (element_volumes(mesh)[elements, None] * (W / W.sum())).ravel()
    return points, np.repeat(mesh.t.T[elements], X.shape[1], axis=0), np.tile(value.T, (len(elements), 1)), volume
