"""Crack tips and lengths of cracks that are known, the J-integral of a K field, stress of uniform strains."""

import numpy as np
import pytest

import skfem_peridynamics as peri
from bodies import at_vertices, body_on, box, grid, vector_basis
from skfem_peridynamics import BallRule, Breaking, Crack, Exponential, PairRule, slit
from skfem_peridynamics.analysis.crack import Ground, _crushed, crack_path, speeds
from skfem_peridynamics.analysis.j_integral import j_integral
from skfem_peridynamics.analysis.stress import strain, stress, voigt
from skfem_peridynamics.geometry.slit_tips import slit_tips

EPS = 0.1


def beside(mesh, *lines, width=0.026):
    """What is left of the bonds of vertices beside some lines."""
    near = np.zeros(mesh.nvertices, dtype=bool)
    for a, b in lines:
        a, b = np.array(a), np.array(b)
        along = (b - a) / np.linalg.norm(b - a)
        x = mesh.p.T - a
        s = x @ along
        off = np.linalg.norm(x - s[:, None] * along, axis=1)
        near |= (off < width) & (s >= 0) & (s <= np.linalg.norm(b - a))
    return 1.0 - 0.45 * near


@pytest.mark.parametrize("kind", ["structured", "random"])
@pytest.mark.parametrize("angle", [0.0, 22.5, 45.0, 70.0])
def test_a_straight_crack_of_any_direction(kind, angle):
    """Its length is that of the crack, not of the edges along it: within the width of its band."""
    mesh, c = box(2, 40, kind), np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    start = np.array([0.2, 0.05])
    path = crack_path(mesh, beside(mesh, (start, start + 0.8 * c)), EPS)
    assert len(path.tips) == 1
    assert path.length == pytest.approx(0.8, abs=0.04)
    assert abs(path.direction @ c) > 0.98
    ends = [start, start + 0.8 * c]
    assert min(np.linalg.norm(path.tips[0] - end) for end in ends) < 0.05


def test_from_the_slit_on():
    """With a slit the way is counted from its tip, and the tip is the end away from it."""
    mesh = slit(grid((1, 40), (1, 40)), Crack([[0.0, 0.5], [0.3, 0.5]]))
    assert np.allclose(mesh.p[:, slit_tips(mesh)].T, [[0.3, 0.5]])
    path = crack_path(mesh, beside(mesh, ([0.32, 0.5], [0.7, 0.5])), EPS)
    assert np.allclose(path.tips, [[0.7, 0.5]], atol=0.03)
    assert path.reach[0] == pytest.approx(0.4, abs=0.026)  # an edge
    assert path.direction @ [1.0, 0.0] > 0.99
    away = crack_path(mesh, beside(mesh, ([0.9, 0.1], [0.9, 0.9])), EPS)  # one that has nothing to do with it
    assert away.length == pytest.approx(0.8, abs=0.03)


def test_branches():
    mesh = slit(grid((1, 50), (1, 50)), Crack([[0.0, 0.5], [0.2, 0.5]]))
    stem, up, down = ([0.22, 0.5], [0.5, 0.5]), ([0.5, 0.5], [0.8, 0.8]), ([0.5, 0.5], [0.7, 0.3])
    path = crack_path(mesh, beside(mesh, stem, up, down), 0.08)
    assert len(path.tips) == 2
    assert np.allclose(path.tips, [[0.8, 0.8], [0.7, 0.3]], atol=0.04)
    assert path.reach[0] == pytest.approx(0.3 + 0.3 * 2**0.5, rel=0.05)  # it cuts the corner within its band
    assert path.length == pytest.approx(0.3 + 0.5 * 2**0.5, rel=0.04)
    assert path.direction @ np.array([1, 1]) / 2**0.5 > 0.98
    bump = crack_path(mesh, beside(mesh, stem, ([0.4, 0.5], [0.4, 0.59])), 0.08)  # a horizon, not a branch
    assert len(bump.tips) == 1


def test_no_crack_and_one_in_space():
    mesh = grid((1, 10), (1, 10))
    assert not crack_path(mesh, np.ones(mesh.nvertices), EPS).found
    alone = np.ones(mesh.nvertices)
    alone[7] = 0.0  # a single vertex is a crack of no length
    assert crack_path(mesh, alone, EPS).length == 0.0
    cube = slit(grid((1, 10), (1, 10), (1, 10)), Crack([[0, 0, 0.5], [0.3, 0, 0.5], [0.3, 1, 0.5], [0, 1, 0.5]]))
    assert np.allclose(cube.p[0, slit_tips(cube)], 0.3)
    hurt = (np.abs(cube.p[2] - 0.5) < 0.01) & (cube.p[0] > 0.35) & (cube.p[0] < 0.75)
    path = crack_path(cube, 1.0 - 0.5 * hurt, 0.25)
    assert path.reach[0] == pytest.approx(0.4, abs=0.02)


def test_speed_of_a_tip_that_jumps():
    """A tip that moves by whole elements has the speed of the straight line."""
    t = np.linspace(0, 1, 101)
    found = speeds(t, np.floor(2.0 * t / 0.05) * 0.05, window=11)
    assert np.abs(found[10:-10] - 2.0).max() < 0.5
    assert found[10:-10].mean() == pytest.approx(2.0, rel=0.01)
    assert speeds(t, 3 * t)[[0, 50, 100]] == pytest.approx([3, 3, 3])


@pytest.mark.parametrize("compiled", [True, False])
def test_area_of_a_crack_by_its_bonds(compiled):
    """A straight crack across a strip that is periodic in nothing: as many bonds as a flat one, but for its ends."""
    for n, off in ((16, 0.12), (64, 0.03)):
        mesh = grid((1, 2 * n), (1, n))
        eps = 4.0 / n
        material = peri.Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane="stress")
        body = peri.Peridynamics(body_on(mesh, eps).bonds, material, compiled=compiled)
        torn = at_vertices(mesh, 1e3 * (mesh.p[0] > 0.5 + 0.1 / n), 0.0)
        found = peri.census(body, torn)
        assert found.area == pytest.approx(1.0, abs=off)
        assert found.energy_softened == pytest.approx(found.area, rel=1e-6)  # G_c is 1
        broken = Breaking(body.bonds, material, at=1.0, compiled=compiled)
        broken.force_and_break(torn)
        assert peri.census(broken, 0 * torn).area == pytest.approx(found.area, rel=1e-12)


def test_a_body_that_is_damaged_all_over_is_all_crushed():
    mesh = grid((1, 8), (1, 8))
    volume = np.arange(1.0, mesh.nvertices + 1.0)
    assert _crushed(mesh, volume, np.ones(mesh.nvertices, dtype=bool), 0.2) == 1.0
    strip = mesh.p[0] < 0.1
    assert _crushed(mesh, volume[strip], strip, 0.2) == 0.0
    # a block: what is farther than 0.15 from all that is whole, by all distances
    block = (mesh.p < 0.8).all(axis=0)
    gap = np.linalg.norm(mesh.p[:, block][:, :, None] - mesh.p[:, ~block][:, None, :], axis=0).min(axis=1)
    assert 0.1 < (gap > 0.15).mean() < 0.9
    expected = volume[block][gap > 0.15].sum() / volume[block].sum()
    assert _crushed(mesh, volume[block], block, 0.2) == pytest.approx(expected, rel=1e-14)


def test_the_ground_of_a_mesh_changes_nothing():
    mesh = slit(grid((1, 40), (1, 40)), Crack([[0.0, 0.5], [0.4, 0.5]]))
    intact = 1.0 - 0.45 * ((abs(mesh.p[1] - 0.5) < 0.03) & (mesh.p[0] > 0.38) & (mesh.p[0] < 0.8))
    one, other = (crack_path(mesh, intact, EPS, ground=ground) for ground in (None, Ground.of(mesh)))
    assert one.found
    assert (one.length, one.cracks, one.crushed) == (other.length, other.cracks, other.crushed)
    np.testing.assert_array_equal(one.tips, other.tips)


# ---- J
LAME, K = 2.0, 0.3


def k_field(mesh, tip=0.5, kappa=2.0):
    """Displacement of mode I about (tip, 1/2), slit to the left; kappa is 2 for lambda = mu."""
    middle = mesh.p[:, mesh.t].mean(axis=1)
    side = np.zeros(mesh.nvertices)
    for corner in mesh.t:  # which face of the slit a doubled vertex is on
        side[corner] = np.sign(middle[1] - 0.5)
    x, y = mesh.p[0] - tip, mesh.p[1] - 0.5
    r, angle = np.hypot(x, y), np.arctan2(y, x)
    on = (np.abs(y) < 1e-9) & (x < -1e-9)
    angle[on] = np.pi * side[on]
    root = K / (2 * LAME) * np.sqrt(r / (2 * np.pi))
    ux = root * np.cos(angle / 2) * (kappa - 1.0 + 2 * np.sin(angle / 2) ** 2)
    uy = root * np.sin(angle / 2) * (kappa + 1.0 - 2 * np.cos(angle / 2) ** 2)
    return at_vertices(mesh, ux, uy)


def j_body(n=80, **keys):
    mesh = slit(grid((1, n), (1, n)), Crack([[0.0, 0.5], [0.5, 0.5]]))
    material = peri.Material.from_elastic(lame=LAME, toughness=1.0, density=1.5, plane="strain", **keys)
    return peri.Peridynamics(peri.BondBasis(vector_basis(mesh), 4.0 / n), material)


def test_j_of_a_k_field():
    """J = K^2 (kappa + 1) / (8 mu), whatever the ring; the opposite direction gives the opposite sign."""
    body = j_body()
    u, exact = k_field(body.bonds.mesh), K**2 * 3 / (8 * LAME)
    for radius, inner in ((0.4, None), (0.4, 0.1), (0.3, 0.15), (0.2, 0.1)):
        assert j_integral(body, u, [0.5, 0.5], [1, 0], radius, inner) == pytest.approx(exact, rel=0.01)
    assert j_integral(body, u, [0.5, 0.5], [-2, 0], 0.4) == pytest.approx(-exact, rel=0.01)
    shifted = u + at_vertices(body.bonds.mesh, 1.0 - 0.1 * body.bonds.mesh.p[1], 0.1 * body.bonds.mesh.p[0])
    assert j_integral(body, u, [0.5, 0.5], [1, 0], 0.4) == pytest.approx(
        j_integral(body, shifted, [0.5, 0.5], [1, 0], 0.4), rel=0.02
    )


@pytest.mark.parametrize("nu", [0.0, 0.4])
def test_j_knows_both_elastic_constants(nu):
    """Plane strain: kappa = 3 - 4 nu, lambda = 2 mu nu / (1 - 2 nu)."""
    body = j_body(mu=LAME)
    solid = peri.Material.from_elastic(
        lame=2 * LAME * nu / (1 - 2 * nu), mu=LAME, toughness=1.0, density=1.5, plane="strain"
    )
    u = k_field(body.bonds.mesh, kappa=3 - 4 * nu)
    found = j_integral(body.with_(material=solid), u, [0.5, 0.5], [1, 0], 0.4)
    assert found == pytest.approx(K**2 * (4 - 4 * nu) / (8 * LAME), rel=0.01)


def test_j_past_a_band_of_torn_elements():
    """The crack of the K field is a slit up to 1/4 and torn elements from there to the tip: they do not count."""
    mesh = slit(grid((1, 80), (1, 80)), Crack([[0.0, 0.5], [0.25, 0.5]]))
    for toughness, near in ((0.02, True), (1e9, False)):  # with a law that nothing can break they spoil it
        material = peri.Material.from_elastic(lame=LAME, toughness=toughness, density=1.5, plane="strain")
        body = peri.Peridynamics(peri.BondBasis(vector_basis(mesh), 0.05), material)
        found = j_integral(body, k_field(mesh), [0.5, 0.5], [1, 0], 0.4) / (K**2 * 3 / (8 * LAME))
        assert (abs(found - 1.0) < 0.1) is near, found


def test_j_converges():
    off = []
    for n in (20, 40, 80):
        body = j_body(n)
        off.append(j_integral(body, k_field(body.bonds.mesh), [0.5, 0.5], [1, 0], 0.45, 0.22) / (K**2 * 3 / 16) - 1)
    assert abs(off[2]) < 0.6 * abs(off[1]) < 0.4 * abs(off[0])


def test_j_of_a_wave():
    """A shear wave has no crack in it: with the kinetic terms J is 0, without them it is not."""
    body = j_body()
    x, y = body.bonds.mesh.p
    phase, across = 3 * x + y, np.array([-1.0, 3.0]) / np.sqrt(10.0)
    w = np.sqrt(LAME / 1.5) * np.sqrt(10.0)  # angular frequency
    u, v, a = (
        at_vertices(body.bonds.mesh, across[0] * f, across[1] * f)
        for f in (np.sin(phase), -w * np.cos(phase), -(w**2) * np.sin(phase))
    )
    ring = ([0.75, 0.5], [1, 0], 0.18, 0.06)
    static, whole = j_integral(body, u, *ring), j_integral(body, u, *ring, v=v, a=a)
    assert abs(static) > 0.1
    assert abs(whole) < 0.02 * abs(static)


def test_j_of_two_materials():
    """The same body in two halves of one material: the same J; and constants of each element where they differ."""
    body = j_body()
    mesh = body.bonds.mesh.with_subdomains({"up": lambda x: x[1] > 0.5})
    same = peri.Composite(body.material, {"up": body.material.with_(density=3.0)})
    other = peri.Composite(body.material, {"up": body.material.with_(lame=2 * LAME)})
    u = k_field(mesh)
    first, one, two = (
        j_integral(body.with_(bonds=peri.BondBasis(vector_basis(mesh), 0.05), material=m), u, [0.5, 0.5], [1, 0], 0.4)
        for m in (body.material, same, other)
    )
    assert one == pytest.approx(first, rel=1e-12)
    assert two == pytest.approx(1.5 * first, rel=1e-3)  # half of the ring, twice as stiff


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"radius": 0.06}, "the ring must begin a horizon, 0.05, from the tip"),
        ({"radius": 0.55}, "the ring reaches the boundary of the body at"),
        ({"radius": 0.3, "tip": [9.0, 9.0]}, "about (9, 9) holds no elements of the body"),
    ],
)
def test_rings_that_do_not_fit(keys, message):
    body = j_body()
    with pytest.raises(ValueError) as error:
        j_integral(body, k_field(body.bonds.mesh), keys.get("tip", [0.5, 0.5]), [1, 0], keys["radius"])
    assert message in str(error.value)


def test_j_where_it_has_no_meaning():
    cube, square = body_on(box(3, 4), 0.5), body_on(box(2, 20), 0.1)
    with pytest.raises(ValueError, match="the J-integral is computed in 2D"):
        j_integral(cube, np.zeros(cube.basis.N), [0, 0, 0], [1, 0, 0], 0.9)
    with pytest.raises(ValueError, match="material is a bare potential"):
        j_integral(square, np.zeros(square.basis.N), [0.5, 0.5], [1, 0], 0.4)


@pytest.mark.slow
# ---- stress
@pytest.mark.parametrize("dim", [1, 2, 3])
@pytest.mark.parametrize("kind", [PairRule, BallRule])
def test_stress_is_the_virial(dim, kind):
    """``sum V sigma = -sum F x^T``, whatever the law, the rule and the displacement."""
    rule = PairRule() if kind is PairRule else BallRule(3, {1: 2, 2: 8, 3: 13}[dim])
    n, eps = {1: (20, 0.2), 2: (6, 0.4), 3: (4, 0.6)}[dim]
    body = body_on(box(dim, n, "random"), eps, Exponential(2.0, 0.5), rule=rule, no_fail=[0])
    mesh = body.bonds.mesh
    u = 0.2 * np.random.default_rng(1).standard_normal(body.basis.N)
    from skfem_peridynamics.geometry.simplices import vertex_volumes

    whole = np.einsum("n,nij->ij", vertex_volumes(mesh), stress(body, u))
    F = body.force(u).reshape(-1, dim)
    assert np.allclose(whole, -F.T @ mesh.p.T, atol=1e-12 * np.abs(whole).max())
    assert np.allclose(whole, whole.T, atol=1e-12 * np.abs(whole).max())


def test_stress_of_a_uniform_strain_is_hookes():
    mesh, eps = grid((1, 24), (1, 24)), 1 / 6
    material = peri.Material.from_elastic(lame=1.0, toughness=1.0, density=1.0, plane="strain", potential="linear")
    body = peri.Peridynamics(peri.BondBasis(vector_basis(mesh), eps, rule=BallRule(3, 8)), material)
    x, y = mesh.p
    u = at_vertices(mesh, 0.1 * x + 0.05 * y, 0.02 * x - 0.03 * y)
    e = np.array([[0.1, 0.035], [0.035, -0.03]])
    inside = (np.abs(mesh.p - 0.5) < 0.5 - 2 * eps).all(axis=0)
    assert np.allclose(strain(body.basis, u), e, atol=1e-12)
    assert np.allclose(stress(body, u)[inside], np.trace(e) * np.eye(2) + 2 * e, atol=1e-3)
    assert voigt(stress(body, u)).shape == (mesh.nvertices, 6)


def test_broken_bonds_carry_no_stress():
    mesh = grid((1, 10), (1, 10))
    torn = at_vertices(mesh, 0.0, 1e3 * (mesh.p[1] > 0.55))
    body = Breaking(body_on(mesh, 0.3).bonds, Exponential(2.0, 0.5), at=3.0)
    body.force_and_break(torn)
    assert np.abs(stress(body, torn)).max() < 1e-12
    closed = at_vertices(mesh, 0.0, 0.1 * mesh.p[1])
    beside_it = np.abs(mesh.p - [[0.5], [0.55]]).max(axis=0) < 0.06
    ratio = stress(body, closed)[beside_it, 1, 1] / stress(body.whole, closed)[beside_it, 1, 1]
    assert (ratio > 0.4).all()
    assert (ratio < 0.7).all()
