"""Exact moments of a vertex: what balanced weights are to meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._scaling import whole_power
from .._types import Bools, Floats
from ..geometry.layers import distance_to_facets
from ..geometry.rays import Tracer
from ..geometry.simplices import vertex_volumes
from ..geometry.tensors import monomials, powers
from ..material.influence import as_influence
from .bond_list import BondList
from .quadrature import Cumulative, half_sphere, radial_rule
from .samples import gauss_samples

_DIRECTIONS = {1: 1, 2: 32, 3: 43}  # of half the ball
_ORDER = {
    1: 4,
    2: 2,
    3: 2,
}  # of the outer integral; 48 directions and order 4 in 2D changed no error by more than a tenth
_RADIAL = 6  # where w varies along a ray
_SITES = 2048  # at a time


@dataclass(frozen=True, eq=False)
class Targets:
    """Moments of order three and four (nvertices, n3 + n4); where order four is exact, where order three is not 0.

    ``four_everywhere`` where order four is given near the boundary, too.
    """

    values: Floats
    exact_four: Bools
    near_boundary: Bools
    four_everywhere: bool = False


def moment_targets(bonds: BondList) -> Targets:
    """Return ``T3_i = 2 int phi_i w int w J e^alpha`` and ``T4_i = 2 int phi_i w int w J s e^alpha``.

    Order three vanishes where every element of a vertex is deeper than the horizon and w is 1 (twice as deep where w
    is not). Order four is given there only: ``2 V_i horizon^d M_d`` times the mean over the sphere.
    """
    mesh, dim, eps = bonds.mesh, bonds.dim, bonds.horizon
    w = bonds.sample_weight
    reach = eps if w is None else 2.0 * eps
    slack = 1e-9 * eps
    depth = distance_to_facets(mesh, mesh.boundary_facets(), reach + slack)
    shallow = depth[mesh.t].min(axis=0) < reach - slack  # elements with a point closer to the boundary
    near = np.zeros(mesh.nvertices, dtype=bool)
    near[mesh.t[:, shallow]] = True
    # order three is odd: inside the ball it cancels. Order four is that of the elastic energy
    three, four = monomials(dim, 3), monomials(dim, 4)
    values = np.zeros((mesh.nvertices, len(three) + len(four)))
    influence = as_influence(bonds.influence)
    e, angle = half_sphere(dim, _DIRECTIONS[dim])
    # near the boundary the two halves of a ball differ
    e, angle = np.concatenate([e, -e]), np.concatenate([angle, angle])
    radial = float(influence.moment(dim))
    values[:, len(three) :] = 2.0 * vertex_volumes(mesh)[:, None] * eps**dim * radial * (angle @ powers(e, 4))
    sites = gauss_samples(mesh, with_vertices=False, order=_ORDER[dim])
    chosen = np.flatnonzero(shallow[sites.element])
    tracer = Tracer(mesh)
    cumulative = Cumulative(influence, dim - 1)
    nodal = bonds.vertex_weight
    nodes, W = radial_rule(influence, dim - 1, _RADIAL)
    cut, W_cut = radial_rule(np.ones_like, dim - 1, _RADIAL)
    directional = powers(e, 3) * angle[:, None]
    for low in range(0, len(chosen), _SITES):
        site = chosen[low : low + _SITES]
        n, k = len(site), len(e)
        x, way = np.repeat(sites.points[site], k, axis=0), np.tile(e, (n, 1))
        start = np.repeat(sites.element[site], k)
        if nodal is None:
            rays = tracer.march(x, start, way, eps, nodes[:0])
            # without a boundary function the radial integral up to the end of a ray is one function of its length
            along = cumulative(rays.reach / eps)
        else:
            rays = tracer.march(x, start, way, eps, nodes, cut)
            is_cut = rays.reach < eps
            s = (rays.reach / eps)[:, None] * np.where(is_cut[:, None], cut, nodes)
            at = np.stack(
                [
                    np.einsum(
                        "nc,nc->n",
                        nodal[mesh.t[:, rays.element[:, m]]].T,
                        tracer.barycentric(rays.element[:, m], x + eps * s[:, m, None] * way),
                    )
                    for m in range(_RADIAL)
                ],
                axis=1,
            )
            weight = np.where(
                is_cut[:, None],
                W_cut * influence(s) * (whole_power(rays.reach / eps, dim))[:, None],
                np.broadcast_to(W, s.shape),
            )
            own = np.einsum("nc,nc->n", nodal[sites.vertices[site]], sites.values[site])
            along = (at * weight).sum(axis=1) * np.repeat(own, k)
        # twice: each bond counts at both its ends, and the hat function is taken at x alone
        inner = along.reshape(n, k) @ directional * (2.0 * whole_power(eps, dim) * sites.volume[site])[:, None]
        for corner in range(dim + 1):
            part = sites.values[site, corner, None] * inner
            for column in range(len(three)):
                values[:, column] += np.bincount(sites.vertices[site, corner], part[:, column], mesh.nvertices)
    return Targets(values, ~near, near)
