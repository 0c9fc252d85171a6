import numpy as np
import pytest
from skfem import Basis, BoundaryFacetBasis, ElementTriP1, ElementVector, LinearForm

from bodies import box, grid, vector_basis
from skfem_peridynamics import Crack, body_force, interpolate, layer_traction, project, slit, traction
from skfem_peridynamics.model.loads import layer_share


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_body_force_has_the_resultant_and_moment_of_the_field(dim):
    basis = vector_basis(box(dim, 4, "random"))
    F = body_force(basis, lambda x: np.stack([2.0 + 3.0 * x[0]] * dim)).reshape(-1, dim)
    assert F.sum(axis=0) == pytest.approx(3.5, rel=1e-12)
    constant = body_force(basis, np.arange(1.0, dim + 1)).reshape(-1, dim)
    assert constant.sum(axis=0) == pytest.approx(np.arange(1.0, dim + 1), rel=1e-12)


def test_traction_is_scikit_fems_boundary_integral():
    mesh = box(2, 5).with_defaults()
    basis = Basis(mesh, ElementVector(ElementTriP1()))
    facets = BoundaryFacetBasis(mesh, ElementVector(ElementTriP1()), facets=mesh.boundaries["right"], intorder=4)
    stock = LinearForm(lambda v, w: (1 + w.x[1]) * v[0] - 2 * w.x[1] * v[1]).assemble(facets)
    ours = traction(basis, "right", lambda x: np.stack([1 + x[1], -2 * x[1]]))
    assert ours == pytest.approx(stock, abs=1e-13)


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_a_layer_carries_exactly_the_traction(dim):
    mesh = box(dim, 8, "graded")
    side = np.flatnonzero(np.isclose(mesh.p[0, mesh.facets], 1.0).all(axis=0))
    basis = vector_basis(mesh)
    F = layer_traction(basis, side, np.arange(1.0, dim + 1), width=0.3).reshape(-1, dim)
    assert F.sum(axis=0) == pytest.approx(np.arange(1.0, dim + 1), rel=1e-12)
    assert not F[mesh.p[0] < 0.6].any()


@pytest.mark.parametrize("dim", [2, 3])
def test_a_load_on_one_face_of_a_slit_stays_on_its_side(dim):
    corners = {2: [[0.0, 0.5], [0.5, 0.5]], 3: [[0, 0, 0.5], [0.5, 0, 0.5], [0.5, 1, 0.5], [0, 1, 0.5]]}
    mesh = slit(grid(*((1.0, 8),) * dim), Crack(corners[dim]))
    faces = mesh.boundaries["slit"]
    lower = faces[mesh.p[-1, mesh.t[:, mesh.f2t[0, faces]]].mean(axis=0) < 0.5]
    t = np.arange(1.0, dim + 1)
    load = layer_traction(vector_basis(mesh), lower, t, width=0.25).reshape(-1, dim)
    assert load.sum(axis=0) == pytest.approx(0.5 * t, rel=1e-12)
    above = np.ones(mesh.nvertices, dtype=bool)
    above[mesh.t[:, mesh.p[-1, mesh.t].mean(axis=0) < 0.5]] = False
    assert above.sum() > 9 * 4
    assert not load[above].any()


def test_a_layer_is_a_constant_body_force_deep_inside_it():
    mesh = grid((1, 20), (1, 20)).with_defaults()
    basis = vector_basis(mesh)
    share = layer_share(basis, "top", 0.2)
    inner = np.isclose(mesh.p[1], 0.9) & (mesh.p[0] > 0.01) & (mesh.p[0] < 0.99)
    assert share[inner] == pytest.approx(0.05**2 / 0.2, rel=0.02)
    rim = np.isclose(mesh.p[1], 0.8) & (mesh.p[0] > 0.01) & (mesh.p[0] < 0.99)
    assert share[rim] == pytest.approx(0.5 * share[inner].max(), rel=1e-12)


def test_projection_and_interpolation():
    basis = vector_basis(box(2, 6, "random"))

    def field(x):
        return np.stack([1 + 2 * x[0] - x[1], 3 * x[1]])

    assert project(basis, field) == pytest.approx(interpolate(basis, field), abs=1e-12)
    assert interpolate(basis, field).reshape(-1, 2)[5] == pytest.approx(field(basis.mesh.p)[:, 5])
    with pytest.raises(ValueError, match="gives 3 components; the displacement has 2"):
        interpolate(basis, lambda x: np.stack([x[0]] * 3))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda b: body_force(b, [1.0]), r"body force has shape \(1,\); it needs 2 components"),
        (lambda b: body_force(b, [1.0, np.nan]), "values that are not finite"),
        (lambda b: traction(b, "up", [1.0, 0.0]), "boundary 'up' is not in the mesh"),
        (lambda b: traction(b, "top", 1.0), r"traction has shape \(\); it needs 2 components"),
        (lambda b: layer_traction(b, "top", [0.0, 1.0], 0.0), "width = 0.0 of a load layer must be positive"),
    ],
)
def test_loads_that_make_no_sense(call, message):
    basis = vector_basis(grid((1, 4), (1, 4)).with_defaults())
    with pytest.raises(ValueError, match=message):
        call(basis)
