import numpy as np
import pytest

from bodies import box, grid, vector_basis
from skfem_peridynamics import Crack, boundary_function, collar, region, slit
from skfem_peridynamics.geometry.layers import distance_to_facets
from skfem_peridynamics.geometry.simplices import outward_normals, vertex_sizes, vertex_volumes
from skfem_peridynamics.model.mass import mass_matrix


@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("kind", ["structured", "random", "graded"])
def test_vertex_volumes_are_the_row_sums_of_scikit_fems_mass(dim, kind):
    mesh = box(dim, 4, kind)
    consistent = mass_matrix(vector_basis(mesh), kind="consistent")
    rows = np.asarray(consistent.sum(axis=1)).ravel().reshape(-1, dim)[:, 0]
    assert vertex_volumes(mesh) == pytest.approx(rows, rel=1e-12)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_vertex_size_is_h_on_structured_meshes_slits_included(dim):
    mesh = grid(*((1.0, 4),) * dim)
    corners = {
        1: [[0.5]],
        2: [[0.0, 0.5], [0.5, 0.5]],
        3: [[0.5, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 1], [0.5, 0, 1]],
    }
    assert vertex_sizes(slit(mesh, Crack(corners[dim]))) == pytest.approx(0.25, rel=1e-12)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_normals_close_and_point_outward(dim):
    mesh = box(dim, 4, "random")
    facets = mesh.boundary_facets()
    normal, area = outward_normals(mesh, facets)
    assert (normal * area).sum(axis=1) == pytest.approx(0.0, abs=1e-12)
    middle = mesh.p[:, mesh.facets[:, facets]].mean(axis=1)
    # divergence theorem: int x.n = d |D|
    assert (normal * area * middle).sum() == pytest.approx(dim, rel=1e-12)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_distance_to_the_whole_boundary_of_a_cube(dim):
    mesh = box(dim, 5, "random")
    x = np.random.default_rng(1).uniform(0, 1, (dim, 300))
    exact = np.minimum(x, 1 - x).min(axis=0)
    gap = distance_to_facets(mesh, mesh.boundary_facets(), 0.3, x)
    assert np.where(exact <= 0.3, exact, np.inf) == pytest.approx(gap, rel=1e-9, abs=1e-12)


def test_distance_outside_goes_to_edges_and_corners():
    mesh = box(3, 2)
    x = np.array([[1.5, 1.5, 1.5], [0.5, 1.5, 1.5], [0.5, 0.5, 1.5]])
    gap = distance_to_facets(mesh, mesh.boundary_facets(), 3.0, x)
    assert gap == pytest.approx(np.sqrt([0.25, 0.5, 0.75]), rel=1e-12)


def holed(mesh, outside):
    """A mesh without the elements whose middle is outside the body."""
    middle = mesh.p[:, mesh.t].mean(axis=1)
    return mesh.restrict(np.flatnonzero(~outside(middle)))


def flank(mesh, face, axis, at, low=-1.0):
    """Facets of a flank: boundary facets in a plane, seen from below or above it."""
    facets = mesh.boundary_facets()
    normal, _ = outward_normals(mesh, facets)
    on = np.isclose(mesh.p[axis, mesh.facets[:, facets]], at).all(axis=0) & (normal[axis] * face > 0.9)
    return facets[on & (mesh.p[axis - 1, mesh.facets[:, facets]].mean(axis=0) > low)]


@pytest.mark.parametrize("kind", ["structured", "random"])
@pytest.mark.parametrize("dim", [2, 3])
def test_a_collar_ends_at_a_slit(dim, kind):
    """The lower face of a slit at half height is seen from below it, and by nothing above."""
    corners = {2: [[0.0, 0.5], [0.5, 0.5]], 3: [[0, 0, 0.5], [0.5, 0, 0.5], [0.5, 1, 0.5], [0, 1, 0.5]]}
    n = {2: 16, 3: 8}[dim]
    if kind == "structured":
        mesh = grid(*((1.0, n),) * dim)
    else:
        mesh = grid(*((1.0, n),) * dim)
        inner = ((mesh.p > 0.01) & (mesh.p < 0.99)).all(axis=0) & ~np.isclose(mesh.p[-1], 0.5)
        mesh.p[:, inner] += np.random.default_rng(3).uniform(-0.2 / n, 0.2 / n, (dim, inner.sum()))
    mesh = slit(mesh, Crack(corners[dim]))
    halves = [np.zeros(mesh.nvertices, dtype=bool) for _ in range(2)]
    for half, is_in in zip(halves, (lambda y: y < 0.5, lambda y: y > 0.5), strict=True):
        half[mesh.t[:, is_in(mesh.p[-1, mesh.t].mean(axis=0))]] = True
    for face, side, other in ((1.0, *halves), (-1.0, *halves[::-1])):
        facets = flank(mesh, face, dim - 1, 0.5)
        assert len(facets) == (n // 2 if dim == 2 else n**2)
        near = np.isfinite(distance_to_facets(mesh, facets, 0.3))
        chosen = np.zeros(mesh.nvertices, dtype=bool)
        chosen[collar(mesh, facets, 0.3)] = True
        assert np.array_equal(chosen, near & side)  # ahead of the tip a vertex is of both halves
        assert (near & ~side & other).any()  # the plain distance reaches to the other side


@pytest.mark.parametrize("body", ["notch", "hole"])
def test_a_collar_ends_at_a_notch_and_at_a_hole(body):
    """The left flank of a gap 0.4 < x < 0.6 is seen from x <= 0.4 alone."""
    top = 2.0 if body == "notch" else 0.8
    mesh = holed(grid((1, 20), (1, 20)), lambda x: (abs(x[0] - 0.5) < 0.1) & (x[1] > 0.5) & (x[1] < top))
    facets = flank(mesh, 1.0, 0, 0.4)
    assert len(facets) == (10 if body == "notch" else 6)
    chosen = np.zeros(mesh.nvertices, dtype=bool)
    chosen[collar(mesh, facets, 0.3)] = True
    near = np.isfinite(distance_to_facets(mesh, facets, 0.3))
    assert np.array_equal(chosen, near & (mesh.p[0] < 0.401))
    assert near.sum() > 1.3 * chosen.sum()


def test_a_collar_of_a_facet_inside_the_body_is_on_both_sides():
    mesh = grid((1, 8), (1, 8))
    inside = np.flatnonzero(np.isclose(mesh.p[1, mesh.facets], 0.5).all(axis=0))
    assert len(collar(mesh, inside, 0.125)) == 27
    mesh = slit(mesh, Crack([[0.0, 0.25], [1.0, 0.25]]))
    inside = np.flatnonzero(np.isclose(mesh.p[1, mesh.facets], 0.5).all(axis=0))
    assert len(collar(mesh, inside, 0.25)) == 45
    assert mesh.p[1, collar(mesh, inside, 0.5)].min() == 0.25


def test_collar_and_region():
    mesh = grid((1, 8), (1, 8)).with_defaults().with_subdomains({"low": lambda x: x[1] < 0.25})
    assert len(collar(mesh, "top", 0.25)) == 27
    assert len(collar(mesh, ["top", "bottom"], 0.125)) == 36
    assert len(region(mesh, "low")) == 27
    with pytest.raises(ValueError, match="boundary 'up' is not in the mesh; its named boundaries are: left, bottom"):
        collar(mesh, "up", 0.1)
    with pytest.raises(ValueError, match="subdomain 'high' is not in the mesh; its subdomains are: low"):
        region(mesh, "high")
    with pytest.raises(ValueError, match="empty set of facets"):
        collar(mesh, lambda x: x[0] > 2, 0.1)
    with pytest.raises(ValueError, match="empty set of elements"):
        region(mesh, lambda x: x[0] > 2)
    with pytest.raises(ValueError, match="width = -1"):
        collar(mesh, "top", -1)


def test_boundary_function_falls_from_one_to_zero():
    mesh = grid((1, 20), (1, 20))
    w = boundary_function(mesh, 0.25)
    depth = np.minimum(mesh.p, 1 - mesh.p).min(axis=0)
    assert (w[depth < 1e-12] == 0.0).all()
    assert (w[depth >= 0.25 - 1e-12] == 1.0).all()
    middle = np.isclose(depth, 0.125)
    assert not middle.any()  # h = 0.05: 0.1 and 0.15 frame the middle, symmetric about 1/2
    assert w[np.isclose(depth, 0.1)][0] + w[np.isclose(depth, 0.15)][0] == pytest.approx(1.0, abs=1e-12)


def test_wide_collars_cost_little_more_than_narrow_ones(monkeypatch):
    """Pairs of vertices and facets that are formed, not seconds: a few hundred per vertex at the far end."""
    import scipy.spatial

    formed = []

    class Counting(scipy.spatial.cKDTree):
        def sparse_distance_matrix(self, *args, **keys):
            pairs = super().sparse_distance_matrix(*args, **keys)
            formed.append(len(pairs))
            return pairs

    mesh = grid((1, 16), (1, 16), (1, 16)).with_defaults()
    monkeypatch.setattr(scipy.spatial, "cKDTree", Counting)
    assert len(collar(mesh, "left", 0.5)) == 9 * 17 * 17
    assert sum(formed) < 150 * mesh.nvertices  # all facets of the side would be 512 for each
