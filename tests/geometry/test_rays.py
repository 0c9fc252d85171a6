"""Rays through meshes against brute force: every facet of the boundary, every element, one ray at a time."""

import tracemalloc

import numpy as np
import pytest
import skfem

from bodies import box, grid
from skfem_peridynamics import Crack, slit
from skfem_peridynamics.geometry.rays import Tracer, opposite_neighbours

NODES = np.array([0.1, 0.5, 0.9])


def directions(dim, rng, n=10):
    """Along axes and diagonals, where rays run along edges and through vertices, and at random."""
    lattice = np.array(list(np.ndindex(*(3,) * dim))) - 1.0
    e = np.vstack([lattice[np.abs(lattice).sum(axis=1) > 0], rng.standard_normal((n, dim))])
    return e / np.linalg.norm(e, axis=1, keepdims=True)


def origins(mesh, rng):
    """Vertices, points on edges, on facets and inside, each with an element that holds it (-1: start at a vertex)."""
    dim, t, p = mesh.dim(), mesh.t, mesh.p
    inside = rng.dirichlet(np.ones(dim + 1), mesh.nelements)
    facet = inside.copy()
    facet[:, 0] = 0.0
    facet /= facet.sum(axis=1, keepdims=True)
    edge = np.zeros_like(inside)
    edge[:, :2] = rng.dirichlet(np.ones(2), mesh.nelements)
    points = [np.einsum("ek,dke->ed", lam, p[:, t]) for lam in (inside, facet, edge)]
    return np.vstack(points), np.tile(np.arange(mesh.nelements), 3)


def brute_reach(mesh, x, e, length):
    """Distance to the first boundary facet that the ray crosses outward; facets as planes with corners."""
    facets = mesh.boundary_facets()
    opposite = mesh.t[:, mesh.f2t[0, facets]].sum(axis=0) - mesh.facets[:, facets].sum(axis=0)
    out = length
    for f, far in zip(facets, opposite, strict=True):
        corners = mesh.p[:, mesh.facets[:, f]]
        edges = corners[:, 1:] - corners[:, :1]
        normal = np.linalg.svd(edges.T)[2][-1] if mesh.dim() > 1 else np.ones(1)
        normal = normal * np.sign(normal @ (corners[:, 0] - mesh.p[:, far]))
        rate = normal @ e
        if rate <= 1e-12:
            continue
        s = normal @ (corners[:, 0] - x) / rate
        if s < -1e-12 or s > out:
            continue
        rest = x + s * e - corners[:, 0]
        if mesh.dim() > 1:
            lam = np.linalg.lstsq(edges, rest, rcond=None)[0]
            if lam.min() < -1e-9 or lam.sum() > 1 + 1e-9:
                continue
        out = max(s, 0.0)
    return out


def check(tracer, x, e, element, length):
    rays = tracer.march(x, element, e, length, NODES)
    live = element >= 0
    assert (rays.reach[~live] == 0.0).all()
    for k, s in enumerate(NODES):
        lam = tracer.barycentric(rays.element[:, k], x + s * rays.reach[:, None] * e)
        assert lam[live].min() > -1e-9
    return rays.reach


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("kind", ["structured", "random", "graded"])
def test_rays_in_a_box(dim, kind):
    """The reach in a box is known; from vertices, edges, facets and inside; nodes lie in their elements."""
    rng = np.random.default_rng(0)
    mesh = box(dim, {1: 25, 2: 9, 3: 4}[dim], kind)
    tracer, e = Tracer(mesh), directions(dim, rng)
    points, element = origins(mesh, rng)
    vertex = np.repeat(np.arange(mesh.nvertices), len(e))
    ways = np.tile(e, (mesh.nvertices, 1))
    cases = [(mesh.p.T[vertex], ways, tracer.first_elements(vertex, ways))]
    cases.append((np.repeat(points, len(e), axis=0), np.tile(e, (len(points), 1)), np.repeat(element, len(e))))
    for x, way, start in cases:
        with np.errstate(divide="ignore", invalid="ignore"):
            gap = np.where(way > 0, (1 - x) / way, np.where(way < 0, -x / way, np.inf))
        exact = np.minimum(0.43, np.maximum(gap.min(axis=1), 0.0))
        assert check(tracer, x, way, start, 0.43) == pytest.approx(exact, abs=1e-11)


@pytest.mark.parametrize("which", ["slit", "notch", "hole", "slit 3D"])
def test_rays_end_at_slits_notches_and_holes(which):
    rng = np.random.default_rng(1)
    if which == "slit":
        mesh = slit(box(2, 8), Crack([[0.0, 0.5], [0.5, 0.5]]))
    elif which == "slit 3D":
        mesh = slit(
            grid((1.0, 3), (1.0, 3), (1.0, 4)), Crack([[0, 0, 0.5], [2 / 3, 0, 0.5], [2 / 3, 1, 0.5], [0, 1, 0.5]])
        )
    elif which == "notch":
        mesh = skfem.MeshTri.init_lshaped().refined(3)
    else:
        full = box(2, 9)
        middle = full.p[:, full.t].mean(axis=1)
        mesh = full.restrict(np.flatnonzero(np.abs(middle - 0.5).max(axis=0) > 0.2))
    tracer = Tracer(mesh)
    points, element = origins(mesh, rng)
    points, element = points[: mesh.nelements], element[: mesh.nelements]  # inside: no ray grazes anything
    e = rng.standard_normal((len(points), mesh.dim()))
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    exact = np.array([brute_reach(mesh, x, way, 0.6) for x, way in zip(points, e, strict=True)])
    assert (exact < 0.6).mean() > 0.2
    assert check(tracer, points, e, element, 0.6) == pytest.approx(exact, abs=1e-10)


def test_rays_from_the_faces_and_the_tip_of_a_slit():
    mesh = slit(box(2, 8), Crack([[0.0, 0.5], [0.5, 0.5]]))
    tracer = Tracer(mesh)
    at = np.flatnonzero(np.abs(mesh.p - np.array([[0.25], [0.5]])).max(axis=0) < 1e-12)
    tip = np.flatnonzero(np.abs(mesh.p - np.array([[0.5], [0.5]])).max(axis=0) < 1e-12)
    assert (len(at), len(tip)) == (2, 1)
    above = at[[mesh.p[1, mesh.t[:, (mesh.t == v).any(axis=0)]].mean() > 0.5 for v in at].index(True)]
    vertex = np.array([above, above, above, tip[0], tip[0], tip[0]])
    e = np.array([[0.0, 1.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [-1.0, 0.0]])
    start = tracer.first_elements(vertex, e)
    reach = check(tracer, mesh.p.T[vertex], e, start, 0.3)
    # up and along the face it sees, through the slit it does not; the tip sees all around, along the slit on one side
    assert reach.tolist() == pytest.approx([0.3, 0.0, 0.3, 0.3, 0.3, 0.3])


def test_rays_that_touch_a_corner_or_a_tip_go_on_or_end_there():
    """From all vertices straight through a re-entrant corner or the tip of a slit: on to the boundary, or there."""
    lshaped = skfem.MeshTri.init_lshaped().refined(3)
    cracked = slit(box(2, 8), Crack([[0.0, 0.5], [0.5, 0.5]]))
    for mesh, tip, ways in (
        (lshaped, np.zeros(2), [(1.0, -1.0), (-1.0, 1.0), (2.0, -1.0), (-1.0, 2.0)]),
        (cracked, np.full(2, 0.5), [(0.0, 1.0), (0.0, -1.0), (1.0, 1.0), (1.0, -1.0)]),
    ):
        tracer, met = Tracer(mesh), 0
        for way in np.array(ways) / np.linalg.norm(ways, axis=1, keepdims=True):
            away = tip - mesh.p.T
            gap = away @ way
            on = np.flatnonzero((np.abs(away @ np.array([-way[1], way[0]])) < 1e-12) & (gap > 1e-9))
            start = tracer.first_elements(on, np.tile(way, (len(on), 1)))
            rays = tracer.march(mesh.p.T[on], start, np.tile(way, (len(on), 1)), 0.6, NODES)
            box_low, box_high = mesh.p.min(axis=1), mesh.p.max(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                ends = np.where(way > 0, (box_high - mesh.p.T[on]) / way, (box_low - mesh.p.T[on]) / way)
            exact = np.minimum(0.6, np.where(way == 0, np.inf, ends).min(axis=1))
            ended = np.minimum(0.6, gap[on])
            assert np.minimum(np.abs(rays.reach - exact), np.abs(rays.reach - ended)).max() < 1e-11
            met += len(on)
        assert met > 5


@pytest.mark.parametrize("dim", [2, 3])
def test_slivers(dim):
    """Angles of a tenth of a degree: a box flattened to 1:600, with nodes in their elements and the known reach."""
    rng = np.random.default_rng(2)
    mesh = box(dim, {2: 8, 3: 3}[dim], "random")
    squash = np.ones(dim)
    squash[-1] = 1 / 600
    mesh = type(mesh)(mesh.p * squash[:, None], mesh.t)
    tracer = Tracer(mesh)
    points, element = origins(mesh, rng)
    e = rng.standard_normal((len(points), dim)) * squash
    e /= np.linalg.norm(e, axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = np.where(e > 0, (squash - points) / e, np.where(e < 0, -points / e, np.inf)).min(axis=1)
    assert check(tracer, points, e, element, 0.3) == pytest.approx(np.minimum(0.3, np.maximum(gap, 0)), abs=1e-9)


def test_neighbours_and_first_elements():
    mesh = grid((1.0, 3), (1.0, 2), (1.0, 2))
    neighbour = opposite_neighbours(mesh)
    for element in range(mesh.nelements):
        for corner in range(4):
            across = neighbour[element, corner]
            shared = set(np.delete(mesh.t[:, element], corner))
            if across >= 0:
                assert shared <= set(mesh.t[:, across])
    assert (neighbour == -1).sum() == len(mesh.boundary_facets())
    tracer = Tracer(mesh)
    corner = np.flatnonzero((mesh.p == 0).all(axis=0))
    assert tracer.first_elements(corner, np.array([[-1.0, 0.1, 0.1]])).tolist() == [-1]


def test_points_are_found_in_their_elements():
    rng = np.random.default_rng(3)
    mesh = box(3, 4, "random")
    tracer, x = Tracer(mesh), rng.uniform(0, 1, (300, 3))
    assert tracer.barycentric(tracer.elements_at(x), x).min() > -1e-9
    assert tracer.barycentric(tracer.elements_at(mesh.p.T), mesh.p.T).min() > -1e-9
    with pytest.raises(ValueError, match=r"point \[2.0, 0.5, 0.5\] is not seen from its nearest vertex"):
        tracer.elements_at(np.array([[2.0, 0.5, 0.5]]))


def test_a_ray_that_turns_is_moved_on(monkeypatch):
    """With no patience at all every ray through a vertex is moved aside, and still ends where it should."""
    monkeypatch.setattr("skfem_peridynamics.geometry.rays._TURNS", 0)
    mesh = box(2, 6)
    tracer = Tracer(mesh)
    vertex = np.arange(mesh.nvertices)
    e = np.tile([np.sqrt(0.5), np.sqrt(0.5)], (mesh.nvertices, 1))
    reach = tracer.march(mesh.p.T, tracer.first_elements(vertex, e), e, 2.0, NODES).reach
    assert reach == pytest.approx((1 - mesh.p).min(axis=0) * np.sqrt(2), abs=1e-8)


@pytest.mark.slow
def test_a_million_rays_take_little_memory():
    """On a mesh of 100,000 triangles: the result is 20 bytes a ray, the work space is bounded."""
    mesh = grid((1.0, 224), (1.0, 224))
    tracer = Tracer(mesh)
    n = 1_000_000
    rng = np.random.default_rng(4)
    element = rng.integers(0, mesh.nelements, n)
    x = mesh.p[:, mesh.t[:, element]].mean(axis=1).T
    angle = rng.uniform(0, 2 * np.pi, n)
    e = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    _ = tracer.gradient, tracer.neighbour, tracer.base
    tracemalloc.start()
    rays = tracer.march(x, element, e, 3 / 224, NODES)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"{mesh.nelements} triangles, {n} rays: {peak / n:.0f} bytes a ray at the peak")
    assert mesh.nelements > 100_000
    assert peak < 42 * n  # 38 measured
    inside = tracer.barycentric(rays.element[:, 1], x + 0.5 * rays.reach[:, None] * e)
    assert inside.min() > -1e-9
