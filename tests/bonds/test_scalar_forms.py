"""Scalar forms on bonds: against vector forms, dense sums over pairs and closed forms; what a basis is asked for."""

import numpy as np
import pytest
import skfem
from skfem import BilinearForm, LinearForm
from skfem.helpers import dot, grad

import skfem_peridynamics as peri
from bodies import ELEMENT, box, vector_basis
from skfem_peridynamics import BallRule, BondBasis, PairRule

RULES = [PairRule(), PairRule(points="gauss"), BallRule(2, 20, outer="vertices"), BallRule(2, 4)]
HORIZON = {1: 0.3, 2: 0.45, 3: 0.7}
DIVISIONS = {1: 8, 2: 4, 3: 2}


def kernel(r):
    return np.exp(-r) / r


@BilinearForm
def scalar(u1, u2, v1, v2, w):
    return (u2 - u1) * (v2 - v1) * kernel(w.r)


@BilinearForm
def vector(u1, u2, v1, v2, w):
    return dot(u2 - u1, v2 - v1) * kernel(w.r)


def bonds_on(mesh, rule=None, horizon=None):
    basis = skfem.Basis(mesh, ELEMENT[mesh.dim()]())
    return BondBasis(basis, horizon or HORIZON[mesh.dim()], rule=rule or PairRule())


@pytest.mark.parametrize("rule", RULES, ids=[rule.name for rule in RULES])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_scalar_form_is_each_component_of_the_vector_form(dim, rule):
    mesh = box(dim, DIVISIONS[dim], "random")
    K = scalar.assemble(bonds_on(mesh, rule)).toarray()
    whole = vector.assemble(BondBasis(vector_basis(mesh), HORIZON[dim], rule=rule)).toarray()
    assert K.shape == (mesh.nvertices, mesh.nvertices)
    np.testing.assert_allclose(whole, np.kron(K, np.eye(dim)), atol=1e-13 * np.abs(K).max())


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_scalar_form_is_the_sum_over_all_pairs(dim):
    """By a table of all pairs: volumes of vertices, no partial ones, no code of the package."""
    mesh = box(dim, DIVISIONS[dim], "random")
    K = scalar.assemble(bonds_on(mesh, PairRule(partial_volume=False))).toarray()
    edges = np.moveaxis(mesh.p[:, mesh.t[1:]] - mesh.p[:, mesh.t[:1]], 2, 0)
    volume = np.bincount(mesh.t.ravel(), np.tile(abs(np.linalg.det(edges)), dim + 1), mesh.nvertices)
    volume /= np.prod(np.arange(1, dim + 2))
    r = np.linalg.norm(mesh.p[:, :, None] - mesh.p[:, None], axis=0)
    near = (r <= HORIZON[dim] * (1 + 1e-9)) & (r > 0)
    share = np.outer(volume, volume) * np.where(near, kernel(np.where(near, r, 1.0)), 0.0)
    exact = 2.0 * (np.diag(share.sum(axis=1)) - share)
    np.testing.assert_allclose(K, exact, atol=1e-13 * np.abs(exact).max())


def test_energy_of_a_linear_field_on_the_square():
    """``int int (x1 - y1)^2`` over pairs nearer than d, in closed form; the rule comes within 1e-3 of it."""
    d = 0.2
    axis = np.linspace(0, 1, 33)
    form = BilinearForm(lambda u1, u2, v1, v2, w: (u2 - u1) * (v2 - v1))
    mesh = skfem.MeshTri.init_tensor(axis, axis)
    K = form.assemble(bonds_on(mesh, BallRule(), d))
    exact = np.pi * d**4 / 4 - 12 * d**5 / 15 + d**6 / 6
    assert mesh.p[0] @ (K @ mesh.p[0]) == pytest.approx(exact, rel=2e-3)


def test_scalar_fields_as_data_and_linear_forms():
    mesh = box(2, 4, "random")
    bonds = bonds_on(mesh)
    u = np.sin(np.arange(mesh.nvertices))
    rate = LinearForm(lambda v1, v2, w: (w.u[1] - w.u[0]) * (v2 - v1) * kernel(w.r)).assemble(
        bonds, u=bonds.interpolate(u)
    )
    np.testing.assert_allclose(rate, scalar.assemble(bonds) @ u, atol=1e-13)
    assert np.array(bonds.interpolate(mesh.p[0])[1]) == pytest.approx(np.array(bonds.default_parameters()["y"])[0])


def test_a_basis_is_asked_for_its_unknowns():
    mesh = box(2, 4).with_defaults()
    bonds = bonds_on(mesh)
    assert mesh.nvertices == bonds.N
    assert bonds.get_dofs("left").all().tolist() == bonds.space.get_dofs("left").all().tolist()
    assert len(bonds.complement_dofs(bonds.get_dofs("left"))) == mesh.nvertices - 5
    assert bonds.zeros().shape == (mesh.nvertices,)
    assert bonds.doflocs.shape == (2, mesh.nvertices)
    assert bonds.project(lambda x: x[0]) == pytest.approx(mesh.p[0])
    assert bonds.probes(np.array([[0.3], [0.4]])) @ mesh.p[1] == pytest.approx(0.4)
    h = np.array(BilinearForm(lambda u1, u2, v1, v2, w: 0 * u1 * v1 * w.h) and bonds.default_parameters()["h"])
    assert h == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("act", "words"),
    [
        (lambda bonds: bonds.with_element(skfem.ElementTriP1()), "have no with_element: their ends are read by P1"),
        (lambda bonds: bonds.quadrature, "their points are those of the rule"),
        (lambda bonds: bonds.nothing, "has no attribute 'nothing'"),
        (
            lambda bonds: BilinearForm(lambda u1, u2, v1, v2, w: dot(grad(u1), grad(v1))).assemble(bonds),
            r"no gradient: differences take its place, such as \\(u2 - u1\\) / w.r".replace("\\\\", "\\"),
        ),
    ],
)
def test_what_bonds_have_not_is_said(act, words):
    with pytest.raises(AttributeError, match=words):
        act(bonds_on(box(2, 4)))


MESH = box(2, 4).with_defaults()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BondBasis(skfem.Basis(MESH, skfem.ElementTriP2()), 0.4), "bonds need the vector P1 basis"),
        (
            lambda: BondBasis(vector_basis(MESH).with_element(skfem.ElementVector(skfem.ElementTriP2())), 0.4),
            "need the vector P1",
        ),
        (lambda: BondBasis(skfem.Basis(skfem.MeshQuad(), skfem.ElementQuad1()), 0.4), r"mesh.to_meshtri\(\)"),
        (
            lambda: BondBasis(skfem.Basis(MESH, skfem.ElementTriP1(), elements=[0, 1]), 0.4),
            "is of 2 elements or facets of a mesh of 32",
        ),
        (lambda: BondBasis(skfem.FacetBasis(MESH, skfem.ElementTriP1()), 0.4), "elements or facets of a mesh of 32"),
        (
            lambda: peri.mass_matrix(skfem.Basis(MESH, skfem.ElementTriP1(), elements=[0])),
            "the mass is of the whole body",
        ),
        (lambda: peri.Peridynamics(bonds_on(MESH), peri.Linear(1.0)), "over a scalar basis: they serve forms"),
        (lambda: peri.Peridynamics(BondBasis(vector_basis(MESH), 0.4), None), "material = None must be a Material"),
        (lambda: peri.Peridynamics(vector_basis(MESH), peri.Linear(1.0)), "must be a BondBasis"),
        (lambda: peri.Prescribed("left", displacement=0.0), r"give basis.get_dofs\('left'\)"),
    ],
)
def test_what_makes_no_sense_fails_where_it_is_written(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_complex_vectors_and_loads_that_are_no_functions_are_refused():
    body = peri.Peridynamics(BondBasis(vector_basis(MESH), 0.4), peri.Linear(1.0))
    u, M = np.ones(body.basis.N), peri.mass_matrix(body.basis)
    for act in (body.energy, body.force, body.tangent, lambda x: body.stiffness_operator() @ x, body.bonds.interpolate):
        with pytest.raises(ValueError, match="complex: the operators are real"):
            act(1j * u)
    for run in (
        lambda: peri.central_difference(body, M, dt=0.1, until=1.0, load=u),
        lambda: peri.newmark(body, M, dt=0.1, until=1.0, load=u),
        lambda: peri.static(body, steps=1, load=u),
        lambda: peri.central_difference(body, M, 1j * u, dt=0.1, until=1.0),
    ):
        with pytest.raises(ValueError, match="load must be a function of t|u0 is complex"):
            next(run())


def test_newmark_ends_where_it_is_told_to():
    body = peri.Peridynamics(BondBasis(vector_basis(MESH), 0.4), peri.Linear(1.0))
    M = peri.mass_matrix(body.basis)
    u0 = np.sin(np.arange(body.basis.N))
    states = [state.copy() for state in peri.newmark(body, M, u0, dt=0.3, until=1.0)]
    assert (states[-1].t, states[-1].dt, len(states)) == (1.0, 0.25, 5)
    rest = [state.copy() for state in peri.newmark(body, M, dt=0.3, until=1.0, start=states[2])]
    assert np.array_equal(rest[-1].u, states[-1].u)


def test_masses_of_scalar_bases():
    basis = skfem.Basis(MESH, skfem.ElementTriP1())
    lumped, consistent = (peri.mass_matrix(basis, density=2.0, kind=kind) for kind in ("lumped", "consistent"))
    assert lumped.shape == consistent.shape == (MESH.nvertices, MESH.nvertices)
    assert lumped.diagonal() == pytest.approx(np.asarray(consistent.sum(axis=1)).ravel())
    assert consistent.sum() == pytest.approx(2.0)
