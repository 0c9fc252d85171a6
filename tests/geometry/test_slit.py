import numpy as np
import pytest
import skfem
from scipy.sparse.csgraph import connected_components

from bodies import at_vertices, body_on, grid
from skfem_peridynamics import Crack, slit


def parts(mesh):
    """Number of pieces that share vertices."""
    import scipy.sparse as sparse

    k, n = mesh.t.shape
    incidence = sparse.coo_matrix((np.ones(k * n), (mesh.t.ravel(), np.tile(np.arange(n), k)))).tocsr()
    return connected_components(incidence.T @ incidence)[0]


@pytest.mark.parametrize(
    ("mesh", "crack", "doubled", "faces", "pieces"),
    [
        (grid((1, 4)), [[0.5]], 1, 2, 2),
        (grid((1, 4), (1, 4)), [[0.0, 0.5], [0.5, 0.5]], 2, 4, 1),
        (grid((1, 4), (1, 4)), [[0.25, 0.5], [0.75, 0.5]], 1, 4, 1),
        (grid((1, 4), (1, 4)), [[0.0, 0.5], [1.0, 0.5]], 5, 8, 2),
        (grid((1, 4), (1, 4)), [[0.0, 0.5], [0.5, 0.5], [0.5, 1.0]], 5, 8, 2),  # a corner of the body cut off
        (grid((1, 4), (1, 2), (1, 2)), [[0.5, 0, 0], [0.5, 1, 0], [0.5, 1, 1], [0.5, 0, 1]], 9, 16, 2),
        (grid((1, 4), (1, 2), (1, 2)), [[0.5, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 1], [0.5, 0, 1]], 3, 8, 1),
    ],
)
def test_vertices_are_doubled_but_not_at_tips(mesh, crack, doubled, faces, pieces):
    opened = slit(mesh, Crack(crack))
    assert opened.nvertices - mesh.nvertices == doubled
    assert len(opened.boundaries["slit"]) == faces
    assert len(opened.boundary_facets()) == len(mesh.boundary_facets()) + faces
    assert parts(opened) == pieces
    assert np.allclose(np.sort(opened.p[:, opened.t], axis=1), np.sort(mesh.p[:, mesh.t], axis=1))


def test_three_ways_meet_in_a_junction():
    mesh = grid((1, 4), (1, 4))
    opened = slit(mesh, Crack([[0.0, 0.5], [1.0, 0.5]]), Crack([[0.5, 0.0], [0.5, 1.0]]))
    assert parts(opened) == 4
    assert (np.abs(opened.p - 0.5).max(axis=0) < 1e-12).sum() == 4


def test_tagged_facets_do_the_same_and_names_survive():
    mesh = grid((1, 4), (1, 4))
    tag = mesh.facets_satisfying(lambda x: (np.abs(x[1] - 0.5) < 1e-9) & (x[0] < 0.5))
    mesh = mesh.with_boundaries({"crack": tag, "left": lambda x: x[0] < 1e-9}).with_subdomains(
        {"low": lambda x: x[1] < 0.5}
    )
    by_tag, by_line = slit(mesh, facets="crack"), slit(mesh, Crack([[0.0, 0.5], [0.5, 0.5]]))
    assert np.array_equal(by_tag.p, by_line.p)
    assert np.array_equal(by_tag.t, by_line.t)
    assert len(by_tag.boundaries["left"]) == 4
    assert np.allclose(by_tag.p[0, by_tag.facets[:, by_tag.boundaries["left"]]], 0.0)
    assert len(by_tag.boundaries["crack"]) == 4
    assert len(by_tag.subdomains["low"]) == 16


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_halves_pulled_apart_rigidly_store_exactly_nothing(dim):
    sides = ((1.0, 8),) + ((0.5, 4),) * (dim - 1)
    corners = {
        1: [[0.5]],
        2: [[0.5, 0.0], [0.5, 0.5]],
        3: [[0.5, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 0.5], [0.5, 0, 0.5]],
    }
    mesh = slit(grid(*sides), Crack(corners[dim]))
    body = body_on(mesh, horizon=0.3)
    right = np.zeros(mesh.nvertices)
    right[np.unique(mesh.t[:, mesh.p[0, mesh.t].mean(axis=0) > 0.5])] = 1.0
    u = at_vertices(mesh, *(right * (k + 1) for k in range(dim)))
    assert u.max() > 0.0
    assert body.energy(u) == 0.0
    assert not body.force(u).any()
    # the unslit body does store energy under the same motion
    whole = grid(*sides)
    assert body_on(whole, 0.3).energy(at_vertices(whole, *[(whole.p[0] > 0.5) * 1.0] * dim)) > 0.1


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[0.0, 0.5]], "needs at least 2 points"),
        ([[0.0, np.nan], [1.0, 0.5]], "must be finite"),
        ([[0.0, 0.5], [0.0, 0.5]], "repeat a point"),
        ([[0, 0, 0], [1, 0, 0], [2, 0, 0]], "span one plane"),
        ([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], "span one plane"),
        ([0.5], "must be rows"),
    ],
)
def test_cracks_that_are_none(points, message):
    with pytest.raises(ValueError, match=message):
        Crack(points)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (
            [[2.0, 0.5], [3.0, 0.5]],
            r"crack from \(2, 0.5\) to \(3, 0.5\) lies outside the body, which reaches from \(0, 0\)",
        ),
        (
            [[0.0, 0.4], [0.5, 0.4]],
            r"no interior facet .* nearest to its ends are at \(0, 0.5\) and \(0.5, 0.5\)",
        ),
        ([[0.0, 0.0], [1.0, 0.0]], "no interior facet"),
        ([[0.5, 0.5], [1.5, 0.5]], "follow only 0.5 of its 1"),
        ([[0.5]], "crack points have 1 coordinates, the mesh has 2"),
    ],
)
def test_cracks_that_do_not_fit_the_mesh(points, message):
    with pytest.raises(ValueError, match=message):
        slit(grid((1, 4), (1, 4)), Crack(points))


def test_slitting_again_keeps_the_first_slit():
    mesh = grid((1, 8), (1, 8))
    one, two = Crack([[0.0, 0.25], [0.5, 0.25]]), Crack([[0.0, 0.75], [0.5, 0.75]])
    again, at_once = slit(slit(mesh, one), two), slit(mesh, one, two)
    assert len(again.boundaries["slit"]) == len(at_once.boundaries["slit"]) == 16


def test_nothing_to_slit():
    mesh = grid((1, 4), (1, 4)).with_defaults()
    with pytest.raises(ValueError, match="lie on the boundary already"):
        slit(mesh, facets="left")
    with pytest.raises(ValueError, match="boundary 'crak' is not in the mesh; its named boundaries are: left"):
        slit(mesh, facets="crak")
    with pytest.raises(ValueError, match="slit needs a Crack"):
        slit(mesh)
    with pytest.raises(ValueError, match="first-order simplices"):
        slit(skfem.MeshQuad(), Crack([[0.0, 0.5], [0.5, 0.5]]))
