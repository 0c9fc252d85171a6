import numpy as np
import pytest

from bodies import at_vertices, body_on, box, grid
from skfem_peridynamics import Exponential, Linear, census, damage


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_counts_against_a_loop_over_bonds(dim):
    mesh = box(dim, {1: 10, 2: 5, 3: 3}[dim], "random")
    law = Exponential(1.3, 0.4)
    body = body_on(mesh, {1: 0.3, 2: 0.45, 3: 0.8}[dim], law, no_fail=[0, 1])
    u = 0.4 * np.random.default_rng(0).standard_normal(mesh.nvertices * dim)
    U, bonds = u.reshape(-1, dim), body.bonds
    Z, every, gone, energy = (
        np.zeros(mesh.nvertices),
        np.zeros(mesh.nvertices),
        np.zeros(mesh.nvertices),
        [0.0, 0.0],
    )
    for b, k in enumerate(bonds.measure()):
        i, j = bonds.ends[:, b]
        xi = mesh.p[:, j] - mesh.p[:, i]
        r = np.linalg.norm(xi)
        S = (U[j] - U[i]) @ xi / r**2
        spared = i < 2 or j < 2
        z = 0.0 if spared else abs(S) / law.critical_strain(r)
        for end in (i, j):
            Z[end] = max(Z[end], z)
            every[end] += 1
            gone[end] += z > 1
        energy[int(z > 1)] += k * (Linear(1.3).f(r * S**2) if spared else law.f(np.array(r * S**2)))
    assert gone.sum() > 10
    d, c = damage(body, u), census(body, u)
    assert pytest.approx(Z, rel=1e-12) == d.Z
    assert d.intact == pytest.approx(1 - gone / every, rel=1e-12)
    assert d.softened == c.softened == gone.sum() / 2
    assert [c.energy_intact, c.energy_softened] == pytest.approx(energy, rel=1e-12)
    assert c.elastic == pytest.approx(body.energy(u), rel=1e-12)
    assert pytest.approx(Z.max(), rel=1e-12) == c.Z


def test_a_body_at_rest_is_whole():
    body = body_on(grid((1, 6), (1, 6)), 0.4, Exponential(1.0, 1.0))
    u = np.zeros(body.basis.N)
    assert damage(body, u).intact.min() == 1.0
    assert census(body, u) == type(census(body, u))(0.0, 0, 0.0, 0.0)


def test_softening_is_reversible():
    mesh = grid((1, 10))
    body = body_on(mesh, 0.25, Exponential(1.0, 1.0))
    stretched = at_vertices(mesh, 30 * mesh.p[0])
    assert damage(body, stretched).softened > 0
    assert damage(body, 1e-3 * stretched).softened == 0
