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
