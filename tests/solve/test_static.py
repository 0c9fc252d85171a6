"""Equilibria against dense algebra and closed forms, and honest failure where there are none."""

import numpy as np
import pytest

import skfem_peridynamics as peri
from bodies import body_on, box
from skfem_peridynamics.model.rigidity import check_rigid, connected_parts


def ends_of(body, width, pull, component=None):
    p, dim = body.bonds.mesh.p, body.bonds.dim
    left, right = np.flatnonzero(p[0] < width), np.flatnonzero(p[0] > 1 - width)
    held = peri.Prescribed((left[:, None] * dim + np.arange(dim)).ravel(), displacement=0.0)
    return [held, peri.Prescribed(right * dim, displacement=pull)]


@pytest.mark.parametrize("kind", ["blocks", "amg", "direct", "auto"])
@pytest.mark.parametrize("rule", [peri.PairRule(), peri.BallRule(3, 8)])
def test_linear_equilibrium_against_dense_algebra(kind, rule):
    body = body_on(box(2, 6, "random"), 0.4, rule=rule)
    fixed = ends_of(body, 0.2, lambda t: 0.1 * t)
    b = np.random.default_rng(0).standard_normal(body.basis.N)
    *_, state = peri.static(body, steps=2, load=lambda t: t * b, fixed=fixed, linear=kind, tolerance=1e-10)
    K = body.stiffness().toarray()
    given = np.zeros(body.basis.N)
    given[fixed[1].dofs] = 0.1
    prescribed = np.r_[fixed[0].dofs, fixed[1].dofs]
    free = np.setdiff1d(np.arange(len(b)), prescribed)
    u = given.copy()
    u[free] = np.linalg.solve(K[np.ix_(free, free)], (b - K @ given)[free])
    np.testing.assert_allclose(state.u, u, rtol=0, atol=1e-7 * np.abs(u).max())
    np.testing.assert_allclose(state.reaction[prescribed], (K @ u - b)[prescribed], rtol=0, atol=1e-6 * np.abs(b).max())
    effort = peri.Effort()
    list(peri.static(body, steps=6, load=lambda t: t * b, fixed=fixed, linear=kind, effort=effort))
    assert effort.iterations <= 3  # the path is straight: what follows the first two equilibria is where they point to
    # the path is straight: work by the trapezoidal rule is exact
    assert state.elastic == pytest.approx(state.work, rel=1e-7)
    assert state.imbalance == pytest.approx(0.0, abs=1e-7 * state.work)


def chain(n=30):
    """A bar with one weak link: all other bonds never fail."""
    mesh = box(1, n)
    strong = np.flatnonzero(np.abs(mesh.p[0] - 0.5) > 2.6 / n)
    return body_on(mesh, 1.0 / n, peri.Exponential(1.0, 1e-3), rule=peri.PairRule(partial_volume=False), no_fail=strong)


def test_prescribed_displacement_leads_through_the_largest_force():
    body = chain()
    fixed = ends_of(body, 1e-9, lambda t: 0.3 * t)
    states = [s.copy() for s in peri.static(body, steps=60, fixed=fixed)]
    pull = np.array([s.reaction[fixed[1].dofs[0]] for s in states])
    top = int(np.argmax(pull))
    assert 3 < top < 57
    assert pull[-1] < 0.05 * pull[top]  # down the other side, to nothing
    for s in states:  # every state is an equilibrium
        assert np.abs(np.delete(body.force(s.u), [0, 30])).max() < 1e-6 * pull[top]
    # k F1' is largest at the inflection: the weak bonds are in series, and carry one force
    law = body.law
    k = max(float(block.k.max()) for block in body.blocks)
    r = 1.0 / 30
    largest = k * float(law.gradient(np.array([law.inflection]))[0]) / np.sqrt(r)
    assert pull[top] == pytest.approx(largest, rel=2e-3)
    assert pull[top] <= largest * (1 + 1e-9)


def test_a_load_beyond_the_largest_is_refused_with_the_last_equilibrium():
    body = chain()
    law, r = body.law, 1.0 / 30
    k = max(float(block.k.max()) for block in body.blocks)
    largest = k * float(law.gradient(np.array([law.inflection]))[0]) / np.sqrt(r)
    b = np.zeros(31)
    b[-1] = 2.03 * largest
    held = peri.Prescribed(np.array([0]), displacement=0.0)
    states = []
    run = peri.static(body, steps=10, load=lambda t: t * b, fixed=[held])
    with pytest.raises(peri.NotConverged, match=r"no equilibrium was found beyond t = 0\.49") as caught:
        states.extend(s.copy() for s in run)
    last = caught.value.state
    assert last.t == states[-1].t
    np.testing.assert_array_equal(last.u, states[-1].u)
    assert 0 < 1 / 2.03 - last.t < 2e-4  # the largest load that it carries, to the smallest step
    assert "with steps from 0.1 down to 9.76563e-05: " in str(caught.value)


def test_a_jump_loses_energy_and_says_how_much():
    """A long soft bar tears at once: what the bar gives back is more than the link takes."""
    mesh = box(1, 30)
    strong = np.flatnonzero(np.abs(mesh.p[0] - 0.5) > 2.6 / 30)
    body = body_on(mesh, 1 / 30, peri.Exponential(1.0, 2e-5), rule=peri.PairRule(partial_volume=False), no_fail=strong)
    fixed = ends_of(body, 1e-9, lambda t: 0.05 * t)
    states = [s.copy() for s in peri.static(body, steps=100, fixed=fixed)]
    lost = np.array([s.imbalance for s in states])
    assert lost[-1] < -0.05 * states[-1].work
    assert (np.diff(lost) < 2e-3 * states[-1].work).all()  # never gains


def test_what_can_move_is_named():
    body = body_on(box(2, 6), 0.4)
    p = body.bonds.mesh.p
    corner = int(np.flatnonzero((p == 0.0).all(axis=0))[0])
    one = peri.Prescribed(np.array([2 * corner, 2 * corner + 1]), displacement=0.0)
    with pytest.raises(ValueError, match=r"vertex at \(0, 0\) can move rigidly, in 1 of 3 ways"):
        peri.static(body, steps=1, fixed=[one])
    with pytest.raises(ValueError, match=r"in 3 of 3 ways: statics needs it held"):
        peri.static(body, steps=1)
    mesh = peri.slit(box(2, 6), peri.Crack([[0.0, 0.5], [1.0, 0.5]]))
    torn = body_on(mesh, 0.4)
    parts = connected_parts(torn)
    assert sorted(set(parts)) == [0, 1]
    bottom = np.flatnonzero(mesh.p[1] < 0.1)
    held = peri.Prescribed(np.r_[2 * bottom, 2 * bottom + 1], displacement=0.0)
    with pytest.raises(ValueError, match="can move rigidly, in 3 of 3 ways"):
        peri.static(torn, steps=1, fixed=[held])


@pytest.mark.parametrize("rule", [peri.PairRule(), peri.PairRule(points="gauss"), peri.BallRule(3, 8, "vertices")])
def test_parts_of_any_rule(rule):
    mesh = peri.slit(box(2, 6), peri.Crack([[0.0, 0.5], [1.0, 0.5]]))
    parts = connected_parts(body_on(mesh, 0.4, rule=rule))
    upper = np.zeros(mesh.nvertices, dtype=bool)
    upper[mesh.t[:, mesh.p[1, mesh.t].mean(axis=0) > 0.5]] = True
    assert len(set(parts[upper])) == len(set(parts[~upper])) == 1
    assert parts[upper][0] != parts[~upper][0]


def test_bonds_that_leave_a_vertex_free_are_refused():
    check_rigid(body_on(box(2, 6), 0.4))
    check_rigid(body_on(box(3, 3), 0.6))
    lattice = body_on(box(2, 6), 1.01 / 6, rule=peri.PairRule(partial_volume=False))
    with pytest.raises(ValueError, match="no bond resists a shear of x and y of the whole body"):
        check_rigid(lattice)
    import skfem

    needle = skfem.MeshTri(
        np.array([[0.0, 1.0, 0.0, 1.0, 2.5], [0.0, 0.0, 1.0, 1.0, 0.5]]),
        np.array([[0, 1, 2], [1, 2, 3], [1, 3, 4]]).T,
    )
    assert np.linalg.eigvalsh(body_on(needle, 1.6).stiffness().toarray())[3] > 1e-6
    check_rigid(body_on(needle, 1.6))
    far = skfem.MeshTri(
        np.array([[0.0, 1.0, 0.0, 1.0, 2.0], [0.0, 0.0, 1.0, 1.0, 0.0]]),
        np.array([[0, 1, 2], [1, 2, 3], [1, 3, 4]]).T,
    )
    body = body_on(far, 1.2, rule=peri.PairRule(partial_volume=False))
    assert abs(np.linalg.eigvalsh(body.stiffness().toarray())[3]) < 1e-12  # vertex 4 hangs on one bond
    with pytest.raises(ValueError, match=r"all bonds of vertex 4 at \(2, 0\) lie along a line"):
        check_rigid(body)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"steps": 0}, "steps = 0 must be a whole number, 1 or more"),
        ({"steps": 2.5}, "steps = 2.5 must be a whole number"),
        ({"until": -1.0}, "until = -1.0 must be positive"),
        ({"tolerance": 0.0}, "tolerance = 0.0 must be between 0 and 1"),
        ({"fixed": [peri.Prescribed(np.array([0]), velocity=1.0)]}, "a body at rest has no velocity"),
    ],
)
def test_arguments_that_make_no_sense(change, said):
    body = body_on(box(1, 10), 0.3)
    with pytest.raises(ValueError, match=said):
        peri.static(body, **({"steps": 1} | change))


def test_everything_prescribed_is_an_equilibrium_too():
    body = body_on(box(1, 4), 0.3)
    every = peri.Prescribed(np.arange(5), displacement=lambda t: t * body.bonds.mesh.p[0])
    *_, state = peri.static(body, steps=3, fixed=[every])
    np.testing.assert_allclose(state.u, body.bonds.mesh.p[0])
    assert state.work == pytest.approx(state.elastic, rel=1e-12)


@pytest.mark.parametrize("linear", ["direct", "amg", "blocks"])
def test_vertices_without_stiffness_stay_where_they_are(linear):
    """A boundary function leaves corners without a bond: there is nothing to solve for there."""
    mesh = box(2, 8)
    body = body_on(mesh, 0.4, boundary_function="smooth", rule=peri.BallRule(3, 8))
    rim = mesh.boundary_nodes()
    pull = np.zeros(body.basis.N)
    inner = np.argmin(np.abs(mesh.p.T - 0.5).sum(axis=1))
    pull[2 * inner] = 0.01
    held = np.setdiff1d(np.flatnonzero(mesh.p[0] < 0.3), rim)
    fixed = [peri.Prescribed(body.basis.nodal_dofs[:, held].ravel(), displacement=0.0)]
    *_, state = peri.static(body, steps=1, load=lambda t: t * pull, fixed=fixed, linear=linear)
    empty = body.stiffness().diagonal() == 0.0
    assert empty.any()
    assert np.abs(state.u[empty]).max() < 1e-12  # of 0.04: a multigrid cycle reaches them by round-off
    force = body.force(state.u) + pull
    force[fixed[0].dofs] = 0.0
    assert np.abs(force).max() < 1e-7 * 0.01


def test_a_load_where_nothing_holds_has_no_equilibrium():
    mesh = box(2, 2)
    body = body_on(mesh, 1.0, boundary_function="smooth", rule=peri.BallRule(3, 8))
    empty = np.flatnonzero(body.stiffness().diagonal() == 0.0)
    pull = np.zeros(body.basis.N)
    pull[empty[-1]] = 1.0
    left = peri.Prescribed(body.basis.nodal_dofs[:, mesh.p[0] < 0.1].ravel(), displacement=0.0)
    with pytest.raises(peri.NotConverged, match="there is no equilibrium at t = 0"):
        next(peri.static(body, steps=1, load=lambda t: pull, fixed=[left]))
