import numpy as np
import pytest
import skfem

from bodies import body_on, box, grid
from skfem_peridynamics import Crack, slit
from skfem_peridynamics.geometry.visibility import sight


def all_pairs(n):
    return (a.astype(np.int64) for a in np.triu_indices(n, 1))


def crosses(p, q, a, b):
    """Proper intersection of segments by orientations, one pair at a time."""

    def side(o, s, t):
        return (s[0] - o[0]) * (t[1] - o[1]) - (s[1] - o[1]) * (t[0] - o[0])

    return side(a, b, p) * side(a, b, q) < 0 and side(p, q, a) * side(p, q, b) < 0


def test_a_convex_body_hides_nothing():
    see = sight(box(2, 6, "random"), 2.0)
    assert see.blocking.middle.shape[1] == 0
    assert not see.near.any()


def test_a_slit_in_a_random_mesh_blocks_what_crosses_it():
    mesh = box(2, 8, "random")
    p = mesh.p.copy()
    row = np.flatnonzero(np.isclose(box(2, 8).p[1], 0.5))
    p[1, row] = 0.5
    mesh = skfem.MeshTri(p, mesh.t)
    tip = np.sort(p[0, row])[5]
    opened = slit(mesh, Crack([[0.0, 0.5], [tip, 0.5]]))
    i, j = all_pairs(opened.nvertices)
    free = np.abs(opened.p[1] - 0.5) > 1e-9  # ends off the line: nothing is degenerate
    keep = free[i] & free[j]
    i, j = i[keep], j[keep]
    blocked = sight(opened, 2.0).blocked(i, j)
    a, b = np.array([-1.0, 0.5]), np.array([tip, 0.5])
    expected = [crosses(opened.p[:, s], opened.p[:, t], a, b) for s, t in zip(i, j, strict=True)]
    assert blocked.tolist() == expected
    assert 200 < sum(expected) < len(expected) - 200


@pytest.mark.parametrize("what", ["hole", "notch", "corner"])
def test_holes_notches_and_corners(what):
    n = 8
    mesh = box(2, n)
    gone = {
        "hole": lambda x: (np.abs(x[0] - 0.5) < 0.25 - 1e-9) & (np.abs(x[1] - 0.5) < 0.125 - 1e-9),
        "notch": lambda x: (x[0] < 0.5 - 1e-9) & (np.abs(x[1] - 0.5) < 0.125 - 1e-9),
        "corner": lambda x: (x[0] > 0.5 + 1e-9) & (x[1] > 0.5 + 1e-9),
    }[what]
    mesh = mesh.remove_elements(np.flatnonzero(gone(mesh.p[:, mesh.t].mean(axis=1))))
    i, j = all_pairs(mesh.nvertices)
    blocked = sight(mesh, 2.0).blocked(i, j)
    # brute force: a bond that has points well inside the void must be blocked; one with none near it must not
    s = np.linspace(0.0, 1.0, 401)[1:-1]
    way = mesh.p[:, i, None] * (1 - s) + mesh.p[:, j, None] * s
    inside = gone(way).sum(axis=1)
    assert blocked[inside > 4].all()
    assert not blocked[inside == 0].any()
    assert blocked.sum() > 100


def index(mesh, *x):
    found = np.flatnonzero(np.abs(mesh.p - np.array(x)[:, None]).max(axis=0) < 1e-12)
    return found


def test_lattice_lines_tip_seam_lips_and_mouth():
    mesh = slit(grid((1, 8), (1, 8)), Crack([[0.0, 0.5], [0.5, 0.5]]))
    see = sight(mesh, 2.0)

    def hidden(a, b):
        return bool(see.blocked(np.atleast_1d(a), np.atleast_1d(b))[0])

    low, high = index(mesh, 0.5, 0.25), index(mesh, 0.5, 0.75)
    assert not hidden(low, high)  # passes exactly through the tip
    assert hidden(index(mesh, 0.375, 0.375), index(mesh, 0.375, 0.625))  # exactly through a seam of two facets
    assert hidden(index(mesh, 0.25, 0.375), index(mesh, 0.5, 0.625))
    assert not hidden(index(mesh, 0.25, 0.25), index(mesh, 0.875, 0.875))  # past the tip
    tip = index(mesh, 0.5, 0.5)
    assert len(tip) == 1
    for x in (0.0, 0.125, 0.25):
        lips = index(mesh, x, 0.5)
        assert len(lips) == 2
        above = [np.isin(mesh.t, k).any(axis=0) & (mesh.p[1, mesh.t].mean(axis=0) > 0.5) for k in lips]
        upper, lower = lips if above[0].any() else lips[::-1]
        assert hidden(upper, index(mesh, x, 0.375))
        assert hidden(lower, index(mesh, x, 0.625))
        assert not hidden(lower, index(mesh, x, 0.375))
        assert not hidden(upper, index(mesh, x + 0.125, 0.75))
        for lip in (upper, lower):
            assert not hidden(lip, tip)
        for other in index(mesh, x + 0.125, 0.5):  # along the lips: each sees its own side only
            same = (mesh.p[1, mesh.t[:, np.isin(mesh.t, other).any(axis=0)]].mean(axis=0) > 0.5).any()
            assert hidden(upper, other) != bool(same)


def test_a_planar_crack_in_3d_on_lattice_lines():
    mesh = slit(grid((1, 4), (1, 4), (1, 4)), Crack([[0.5, 0, 0], [0.5, 0.5, 0], [0.5, 0.5, 1], [0.5, 0, 1]]))
    i, j = all_pairs(mesh.nvertices)
    off = np.abs(mesh.p[0] - 0.5) > 1e-9
    keep = off[i] & off[j] & (np.linalg.norm(mesh.p[:, i] - mesh.p[:, j], axis=0) < 0.8)
    i, j = i[keep], j[keep]
    blocked = sight(mesh, 0.8).blocked(i, j)
    a, b = mesh.p[0, i] - 0.5, mesh.p[0, j] - 0.5
    through = a * b < 0
    part = np.where(through, a / np.where(through, a - b, 1.0), 0.0)
    y = mesh.p[1, i] + part * (mesh.p[1, j] - mesh.p[1, i])
    assert (y[through] == 0.5).sum() > 20  # these touch the front only, and are kept
    assert np.array_equal(blocked, through & (y < 0.5 - 1e-12))


def test_a_mirror_image_gives_the_mirror_bonds():
    crack = [[0.0, 0.5], [0.5, 0.5]]
    mesh = slit(grid((1, 8), (1, 8)), Crack(crack))
    p = mesh.p.copy()
    p[1] = 1.0 - p[1]
    mirror = skfem.MeshTri(p, mesh.t)
    assert body_on(mesh, 0.3).bonds.nbonds == body_on(mirror, 0.3).bonds.nbonds


def test_pieces_of_a_line_do_not_see_each_other():
    mesh = slit(grid((1, 6)), Crack([[0.5]]))
    i, j = all_pairs(mesh.nvertices)
    blocked = sight(mesh, 2.0).blocked(i, j)
    left = np.isin(np.arange(7 + 1), np.unique(mesh.t[:, mesh.p[0, mesh.t].mean(axis=0) < 0.5]))
    # the coincident copies have no direction and are no bond; everything else is hidden exactly across the cut
    apart = mesh.p[0, i] != mesh.p[0, j]
    assert np.array_equal(blocked[apart], (left[i] != left[j])[apart])


@pytest.mark.parametrize("slant", [0.0, -0.5, -0.7, -1.0, -2.0, 1.5])
def test_a_slanted_cut_through_a_block_glues_nothing_and_hides_nothing_else(slant):
    """Sharp wedges at the rim of the cut: averages of normals would point out of the body there."""
    whole = grid((1, 4), (1, 4), (1, 4))
    cut = np.flatnonzero((np.abs(whole.p[0][whole.facets] - 0.5) < 1e-9).all(axis=0))
    shear = np.array([[1.0, 0.0, slant], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    mesh = slit(skfem.MeshTet(shear @ whole.p, whole.t), facets=cut)
    right = np.zeros(mesh.nvertices, dtype=bool)
    right[mesh.t[:, (mesh.p[0] - slant * mesh.p[2])[mesh.t].mean(axis=0) > 0.5]] = True
    i, j = all_pairs(mesh.nvertices)
    gap = np.linalg.norm(mesh.p[:, i] - mesh.p[:, j], axis=0)
    keep = (gap > 0.0) & (gap < 0.75)
    i, j = i[keep], j[keep]
    blocked = sight(mesh, 0.75).blocked(i, j)
    assert np.array_equal(blocked, right[i] != right[j])


def test_a_block_of_separate_tetrahedra():
    """Every interior facet cut: an element sees all of itself and nothing else."""
    whole = grid((1, 2), (1, 2), (1, 2))
    mesh = slit(whole, facets=np.setdiff1d(np.arange(whole.facets.shape[1]), whole.boundary_facets()))
    assert mesh.nvertices == 4 * mesh.nelements
    owner = np.empty(mesh.nvertices, dtype=int)
    owner[mesh.t] = np.arange(mesh.nelements)
    i, j = all_pairs(mesh.nvertices)
    apart = np.linalg.norm(mesh.p[:, i] - mesh.p[:, j], axis=0) > 0
    i, j = i[apart], j[apart]
    assert np.array_equal(sight(mesh, 2.0).blocked(i, j), owner[i] != owner[j])


def test_where_two_holes_touch_the_vertex_sees_its_elements():
    mesh = box(2, 8)
    x, y = mesh.p[:, mesh.t].mean(axis=1)
    holes = ((x > 0.5) & (x < 0.75) & (y > 0.5) & (y < 0.75) & (x > y)) | (
        (x < 0.5) & (x > 0.25) & (y < 0.5) & (y > 0.25)
    )
    mesh = mesh.remove_elements(np.flatnonzero(holes))
    pinch = index(mesh, 0.5, 0.5)
    around = np.setdiff1d(np.unique(mesh.t[:, (mesh.t == pinch).any(axis=0)]), pinch)
    assert not sight(mesh, 0.3).blocked(np.full(len(around), pinch[0]), around).any()
    far = index(mesh, 0.25, 0.25)  # across the lower hole
    assert sight(mesh, 0.6).blocked(pinch, far)[0]


def test_a_body_too_flat_for_a_convex_hull():
    mesh = grid((1, 8), (1, 8))
    flat = skfem.MeshTri(mesh.p * np.array([[1.0], [1e-13]]), mesh.t)
    assert sight(flat, 0.2).blocked(np.array([0]), np.array([1])).tolist() == [False]


@pytest.mark.parametrize(("dim", "n"), [(2, 10), (3, 4)])
def test_an_element_sees_all_of_itself_in_bodies_full_of_holes(dim, n):
    """A quarter of the elements is missing: parts touch in vertices and edges, and corners have no inward direction."""
    rng = np.random.default_rng(0)
    for trial in range(20):
        mesh = box(dim, n, "random" if trial % 2 else "structured", trial)
        mesh = mesh.restrict(np.flatnonzero(rng.random(mesh.nelements) > 0.25))
        low, high = np.triu_indices(dim + 1, 1)
        i, j = (mesh.t[k].ravel().astype(np.int64) for k in (low, high))
        assert not sight(mesh, 0.3).blocked(i, j).any()
