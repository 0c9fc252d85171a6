import numpy as np
import pytest
import skfem

from bodies import body_on, box, grid, vector_basis
from skfem_peridynamics import BondBasis, PairRule
from skfem_peridynamics.bonds.discrete_moments import deep_points
from skfem_peridynamics.geometry.neighbours import pairs_within, sweep_order
from skfem_peridynamics.geometry.simplices import check_simplices


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_pairs_are_all_pairs(dim):
    x = np.random.default_rng(0).uniform(0, 1, (dim, 150))
    gap = np.linalg.norm(x[:, :, None] - x[:, None, :], axis=0)
    i, j = np.nonzero(np.triu(gap <= 0.3, 1))
    found = [np.concatenate(part) for part in zip(*pairs_within(x, 0.3), strict=True)]
    assert np.array_equal(found[0], i)
    assert np.array_equal(found[1], j)
    assert found[2] == pytest.approx(gap[i, j], rel=1e-12)


def test_chunks_join_without_a_seam(monkeypatch):
    x = np.random.default_rng(0).uniform(0, 1, (2, 500))
    whole = [np.concatenate(part) for part in zip(*pairs_within(x, 0.1), strict=True)]
    monkeypatch.setattr("skfem_peridynamics.geometry.neighbours._POINTS", 64)
    parts = [np.concatenate(part) for part in zip(*pairs_within(x, 0.1), strict=True)]
    assert all(np.array_equal(a, b) for a, b in zip(whole, parts, strict=True))


def test_rim_pairs_of_a_lattice_are_in_whatever_the_round_off():
    """Thousands of pairs at exactly r = horizon: 0.3 = 3 h, with h = 0.1 not representable."""
    n = 30
    mesh = grid((0.1 * n, n), (0.1 * n, n))
    bonds = BondBasis(vector_basis(mesh), 0.3, rule=PairRule(partial_volume=False))
    r = np.round(np.linalg.norm(bonds.vectors(), axis=0) / 0.1, 6)
    assert (r == 3.0).sum() == 2 * (n + 1) * (n - 2)
    assert r.max() == 3.0
    shifted = skfem.MeshTri(mesh.p + 7.7, mesh.t)
    assert BondBasis(vector_basis(shifted), 0.3, rule=PairRule(partial_volume=False)).nbonds == bonds.nbonds


def test_partial_volume_is_exact_in_1d():
    for n in (20, 30, 50):
        bonds = BondBasis(vector_basis(grid((1, n))), 0.2)
        assert bonds.discrete_moments == pytest.approx((0.5, 0.5), rel=1e-12)
    r = np.linalg.norm(bonds.vectors(), axis=0)
    inner = (bonds.ends[0] > 15) & (bonds.ends[0] < 25)
    on_rim = inner & np.isclose(r, 0.2)
    assert on_rim.any()
    assert bonds.weight[on_rim] == pytest.approx(2 * 0.02**2 / 2, rel=1e-9)
    assert bonds.weight[inner & (r < 0.19)] == pytest.approx(2 * 0.02**2, rel=1e-9)


def test_bonds_just_outside_keep_the_influence_of_the_rim():
    bonds = BondBasis(vector_basis(grid((1, 16), (1, 16))), 0.25)
    r = np.linalg.norm(bonds.vectors(), axis=0)
    outside = r > 0.25 + 1e-9
    assert outside.any()
    assert (bonds.measure()[outside] > 0.0).all()


def test_no_copies_bond_and_ends_are_sorted():
    from skfem_peridynamics import Crack, slit

    mesh = slit(grid((1, 8), (1, 8)), Crack([[0.0, 0.5], [0.5, 0.5]]))
    bonds = BondBasis(vector_basis(mesh), 0.3)
    assert (np.linalg.norm(bonds.vectors(), axis=0) > 0.1).all()
    ends = np.concatenate([part.ends + part.first for part in bonds.parts])
    assert (ends[:, 0] < ends[:, 1]).all()
    assert (np.diff(ends[:, 0]) >= 0).all()


def test_numbering_does_not_matter():
    mesh = box(2, 6, "random")
    shuffle = np.random.default_rng(3).permutation(mesh.nvertices)
    back = np.argsort(shuffle)
    other = skfem.MeshTri(mesh.p[:, shuffle], back[mesh.t].astype(np.int32))
    u = np.random.default_rng(4).standard_normal((mesh.nvertices, 2))
    one, two = body_on(mesh, 0.35), body_on(other, 0.35)
    assert one.energy(u.ravel()) == pytest.approx(two.energy(u[shuffle].ravel()), rel=1e-13)
    assert two.force(u[shuffle].ravel()).reshape(-1, 2)[back] == pytest.approx(
        one.force(u.ravel()).reshape(-1, 2), abs=1e-12
    )


def test_sweep_order_keeps_neighbours_near():
    x = np.random.default_rng(0).uniform(0, 1, (3, 2000)) * np.array([[1.0], [5.0], [1.0]])
    place = np.argsort(sweep_order(x))
    i, j, _ = (np.concatenate(part) for part in zip(*pairs_within(x, 0.3), strict=True))
    assert np.abs(place[i] - place[j]).max() < 2000 * 0.3 / 5 * 1.5


def test_estimate_is_near():
    mesh = grid((2, 60), (1, 30))
    rule = PairRule()
    nbonds = BondBasis(vector_basis(mesh), 0.14).nbonds
    assert rule.estimate(mesh, 0.14) == pytest.approx(nbonds, rel=0.05)


def test_lonely_vertices_are_named():
    with pytest.raises(ValueError, match=r"horizon = 0.05 leaves vertex 0 at \(0\) without a bond \(5 of 5 points\)"):
        body_on(grid((1, 4)), 0.05).energy(np.zeros(5))


def test_lonely_gauss_points_are_named():
    with pytest.raises(ValueError, match=r"leaves the Gauss point at \(0.05\d+\) without a bond \(8 of 8 points\)"):
        body_on(grid((1, 4)), 0.01, rule=PairRule(points="gauss")).energy(np.zeros(5))


def test_a_mesh_that_falls_into_strings_is_refused():
    with pytest.raises(ValueError, match=r"leaves the bonds in 6 separate pieces, the mesh has 1: in some direction"):
        body_on(grid((1, 5), (1, 100)), 0.03).energy(np.zeros(2 * 606))


@pytest.mark.parametrize("horizon", [0.0, -1.0, np.nan, np.inf])
def test_a_horizon_is_a_positive_length(horizon):
    with pytest.raises(ValueError, match=f"horizon = {horizon} must be a positive length"):
        body_on(grid((1, 4)), horizon)


def test_other_elements_are_refused():
    mesh = skfem.MeshTri()
    for element in (skfem.ElementTriP2(), skfem.ElementVector(skfem.ElementTriP2())):
        with pytest.raises(ValueError, match="bonds need the vector P1 basis"):
            BondBasis(skfem.Basis(mesh, element), 1.0)
    quads = skfem.MeshQuad()
    with pytest.raises(ValueError, match="MeshQuad1; the elements must be first-order simplices"):
        BondBasis(skfem.Basis(quads, skfem.ElementVector(skfem.ElementQuad1())), 1.0)
    flat = skfem.MeshTri(np.array([[0.0, 1, 2, 0], [0.0, 0, 0, 1]]), np.array([[0, 0], [1, 1], [2, 3]]))
    with pytest.raises(ValueError, match="element 0 has volume 0"):
        check_simplices(flat)
    orphan = skfem.MeshTri(np.array([[0.0, 1, 1, 0, 2], [0.0, 0, 1, 1, 2]]), np.array([[0, 0], [1, 2], [2, 3]]))
    with pytest.raises(ValueError, match=r"1 vertices that belong to no element, the first is 4 at \(2, 2\)"):
        check_simplices(orphan)


def test_boundary_functions():
    basis = vector_basis(grid((1, 8)))
    with pytest.raises(ValueError, match="'rough' must be"):
        BondBasis(basis, 0.3, boundary_function="rough").measure()
    with pytest.raises(ValueError, match="between 0 and 1"):
        BondBasis(basis, 0.3, boundary_function=np.full(9, 2.0)).measure()
    with pytest.raises(ValueError, match="between 0 and 1 for each of the 9 vertices; at vertex 2 it is nan"):
        BondBasis(basis, 0.3, boundary_function=np.where(np.arange(9) == 2, np.nan, 1.0)).measure()
    smooth = BondBasis(basis, 0.3, boundary_function="smooth")
    given = BondBasis(
        basis, 0.3, boundary_function=np.minimum(1.0, 10 * np.minimum(basis.mesh.p[0], 1 - basis.mesh.p[0]))
    )
    ends = smooth.ends[0] == 0
    assert (smooth.measure()[ends] == 0.0).all()
    assert smooth.measure().max() == given.measure().max() == BondBasis(basis, 0.3).measure().max()


def test_thin_bodies_have_no_discrete_moment():
    with pytest.raises(ValueError, match="no vertex lies deeper than it"):
        _ = BondBasis(vector_basis(grid((1, 8))), 0.6).discrete_moments


def test_moments_of_a_body_that_is_hardly_deep_enough():
    """Half of it 0.5 deep, horizon 0.35 and half an element of 0.125: the middle vertex is deep enough, and counts."""
    bonds = BondBasis(vector_basis(grid((1, 8))), 0.35)
    assert np.flatnonzero(deep_points(bonds, bonds.mesh.p.T)).tolist() == [4]
    assert bonds.discrete_moments[0] == pytest.approx(0.5, rel=0.006)  # 0.4974 measured
