"""Bodies of any Poisson ratio whose answer is known: bars, beams, a hole, an open crack and a torn ligament."""

import numpy as np
import pytest
import skfem
from ligament import rectangle, solid, torn

import skfem_peridynamics as peri
from bodies import vector_basis
from skfem_peridynamics import BondBasis, PairRule, Peridynamics
from skfem_peridynamics.geometry.simplices import vertex_volumes


@pytest.mark.slow
@pytest.mark.parametrize("nu", [-0.3, 0.0, 0.2, 0.3, 1 / 3, 0.45])
def test_contraction_of_a_bar(nu):
    """Plane stress, 20 horizons wide, held at its ends; the mean over the middle, and at the free surface."""
    eps, width = 1.0, 20.0
    mesh = rectangle(40.0, width, eps / 4)
    body = Peridynamics(BondBasis(vector_basis(mesh), eps).balanced(), solid(nu, potential="linear"))
    x, y = mesh.p
    ends = np.abs(x) > 20.0 - 1e-6
    middle = np.argmin(np.hypot(x, y))
    fixed = [
        peri.Prescribed(2 * np.flatnonzero(ends), displacement=1e-3 * x[ends]),
        peri.Prescribed(np.array([2 * middle + 1]), displacement=0.0),
    ]
    *_, last = peri.static(body, steps=1, fixed=fixed)
    u = last.u.reshape(-1, 2)
    section = np.abs(x) < 3.0
    stretch = np.polyfit(x[section & (np.abs(y) < 8.0)], u[section & (np.abs(y) < 8.0), 0], 1)[0]
    inner = section & (np.abs(y) < 8.0)
    found = -np.polyfit(y[inner], u[inner, 1], 1)[0] / stretch
    rim = section & (y > 10.0 - eps)
    surface = -np.polyfit(y[rim], u[rim, 1], 1)[0] / stretch
    print(f"nu = {nu:.3f}: contraction {found:.4f}, within a horizon of the surface {surface:.4f}")
    assert found == pytest.approx(nu, rel=0.02, abs=0.005 if abs(nu) < 0.1 else 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("nu", [0.0, 0.3, 1 / 3])
def test_a_bent_beam(nu):
    """Saint-Venant's bending prescribed at the ends of a beam 20 horizons high: its deflection between, and the moment.

    Within a horizon of the free surfaces a body of bonds is softer, with a dilatation as without.
    """
    eps = 1.0
    mesh = rectangle(40.0, 20.0, eps / 4)
    body = Peridynamics(BondBasis(vector_basis(mesh), eps).balanced(), solid(nu, potential="linear"))
    x, y = mesh.p
    curve = 1e-4
    exact = np.stack([-curve * x * y, 0.5 * curve * (x**2 + nu * y**2)])
    ends = np.flatnonzero(np.abs(x) > 18.0)
    fixed = [peri.Prescribed(2 * ends + a, displacement=exact[a, ends]) for a in (0, 1)]
    *_, last = peri.static(body, steps=1, fixed=fixed)
    off = np.abs(last.u.reshape(-1, 2).T - exact).max() / np.abs(exact).max()
    F = body.force(last.u).reshape(-1, 2)
    left = x < 0.0
    moment, inertia = abs((F[left, 0] * y[left]).sum()), 20.0**3 / 12
    print(f"nu = {nu:.2f}: deflection off {off:.2e}, moment over E I curvature {moment / (inertia * curve):.4f}")
    assert off < 0.01
    # 0.953 to 0.961 measured, 0.961 at 1/3 with bonds alone: the soft surfaces are a tenth of the height
    assert moment == pytest.approx(0.957 * inertia * curve, rel=0.006)


def end_loaded(p, nu, length, height, load):
    """Timoshenko and Goodier's cantilever from x = 0, loaded by a parabola of shear at its end; E = 1, plane stress."""
    x, y = p
    scale = load / (6 * height**3 / 12)
    ux = scale * y * ((6 * length - 3 * x) * x + (2 + nu) * (y**2 - height**2 / 4))
    uy = -scale * (3 * nu * y**2 * (length - x) + (4 + 5 * nu) * height**2 * x / 4 + (3 * length - x) * x**2)
    return np.stack([ux, uy])


@pytest.mark.slow
@pytest.mark.parametrize("nu", [0.0, 0.3, 1 / 3])
def test_a_cantilever(nu):
    """Held by the exact displacement over two horizons, loaded at its end: the deflection there, as eps goes to 0."""
    length, height, load, found = 40.0, 10.0, 1e-4, {}
    for eps in (2.0, 1.0, 0.5):
        mesh = skfem.MeshTri.init_tensor(
            np.linspace(0.0, length, round(4 * length / eps) + 1),
            np.linspace(-height / 2, height / 2, round(4 * height / eps) + 1),
        ).with_boundaries({"end": lambda x: x[0] > 40.0 - 1e-9})
        body = Peridynamics(BondBasis(vector_basis(mesh), eps).balanced(), solid(nu, potential="linear"))
        exact = end_loaded(mesh.p, nu, length, height, load)
        root = np.flatnonzero(mesh.p[0] < 2 * eps)
        fixed = [peri.Prescribed(2 * root + a, displacement=exact[a, root]) for a in (0, 1)]
        pull = peri.traction(
            body.basis, "end", lambda x: np.stack([0 * x[0], -6 * load / height**3 * (height**2 / 4 - x[1] ** 2)])
        )
        *_, last = peri.static(body, steps=1, fixed=fixed, load=lambda t, pull=pull: t * pull)
        tip = np.argmin(np.hypot(mesh.p[0] - length, mesh.p[1]))
        found[eps] = last.u.reshape(-1, 2)[tip, 1] / exact[1, tip] - 1
    print(f"nu = {nu:.2f}: deflection off {', '.join(f'{off:+.4f} (eps {eps:g})' for eps, off in found.items())}")
    rate = np.polyfit(np.log(list(found)), np.log(np.abs(list(found.values()))), 1)[0]
    # first order: the surfaces are soft within a horizon
    assert rate > 0.8
    assert abs(found[0.5]) < 0.06


def kirsch(p, nu, load=1e-3):
    """Displacement (2, n), stress (n, 2, 2) of a plate with a hole of radius 1, pulled along x; E = 1, plane stress."""
    r, t = np.hypot(*p), np.arctan2(p[1], p[0])
    kappa, mu = (3 - nu) / (1 + nu), 0.5 / (1 + nu)
    ur = load / (8 * mu) * (r * (kappa - 1 + 2 * np.cos(2 * t)) + 2 / r * (1 + (kappa + 1 - r**-2.0) * np.cos(2 * t)))
    ut = load / (8 * mu) * np.sin(2 * t) * (-2 * r + 2 / r * (1 - kappa - r**-2.0))
    c, s = np.cos(t), np.sin(t)
    rr = load / 2 * (1 - r**-2.0 + (1 - 4 * r**-2.0 + 3 * r**-4.0) * np.cos(2 * t))
    tt = load / 2 * (1 + r**-2.0 - (1 + 3 * r**-4.0) * np.cos(2 * t))
    rt = -load / 2 * (1 + 2 * r**-2.0 - 3 * r**-4.0) * np.sin(2 * t)
    turn = np.array([[c, -s], [s, c]])
    polar = np.array([[rr, rt], [rt, tt]])
    return np.stack([ur * c - ut * s, ur * s + ut * c]), np.einsum("abn,bcn,dcn->nad", turn, polar, turn)


def annulus(h, outside):
    """Triangles between a circle of radius 1 and one outside, about h in size everywhere."""
    radii = np.linspace(1.0, outside, round((outside - 1) / h) + 1)
    around = 4 * round(0.5 * np.pi * np.sqrt(outside) / h)
    angles = 2 * np.pi * np.arange(around) / around
    p = np.stack([np.outer(radii, np.cos(angles)).ravel(), np.outer(radii, np.sin(angles)).ravel()])
    i, j = np.meshgrid(np.arange(len(radii) - 1), np.arange(around), indexing="ij")
    a, b = (i * around + j).ravel(), (i * around + (j + 1) % around).ravel()
    t = np.hstack([[a, a + around, b], [a + around, b + around, b]])
    return skfem.MeshTri(p, t)


@pytest.mark.slow
@pytest.mark.parametrize("nu", [-0.2, 0.3])
def test_kirsch(nu):
    """A plate with a hole, its displacement prescribed two horizons from the rim: displacement and stress by rates."""
    sizes, off_u, off_s = [0.4, 0.2, 0.1], [], []
    for eps in sizes:
        mesh = annulus(eps / 4, 2.5 + 2 * eps)
        body = Peridynamics(BondBasis(vector_basis(mesh), eps).balanced(), solid(nu, potential="linear"))
        exact, sigma = kirsch(mesh.p, nu)
        r, volume = np.hypot(*mesh.p), vertex_volumes(mesh)
        rim = np.flatnonzero(r > 2.5 - 1e-9)
        fixed = [peri.Prescribed(2 * rim + a, displacement=exact[a, rim]) for a in (0, 1)]
        *_, last = peri.static(body, steps=1, fixed=fixed)
        gap = last.u.reshape(-1, 2).T - exact
        off_u.append(np.sqrt((volume * (gap**2).sum(axis=0)).sum() / (volume * (exact**2).sum(axis=0)).sum()))
        inner = (r > 1.4) & (r < 2.3)
        gap = (peri.stress(body, last.u) - sigma)[inner]
        size = np.einsum("n,nab,nab->", volume[inner], sigma[inner], sigma[inner])
        off_s.append(np.sqrt(np.einsum("n,nab,nab->", volume[inner], gap, gap) / size))
    rates = [np.polyfit(np.log(sizes), np.log(off), 1)[0] for off in (off_u, off_s)]
    print(f"nu = {nu}: displacement {np.round(off_u, 4)}, stress {np.round(off_s, 4)}, rates {np.round(rates, 2)}")
    # first order, for the surface of the hole is soft within a horizon; 0.49 and 0.71, 0.83 and 0.97 measured
    assert rates[0] > 0.45
    assert np.log2(off_u[1] / off_u[2]) > 0.6
    assert rates[1] > 0.8


@pytest.mark.parametrize("nu", [0.2, 0.3])
@pytest.mark.parametrize(("dim", "n"), [(2, 40), pytest.param(3, 20, marks=pytest.mark.slow)])
def test_an_open_crack_has_no_dilatation(dim, n, nu):
    """Halves far apart: the energy is that of the bonds, and away from the surface of the body G_c per area."""
    axis, window = np.linspace(0.0, 1.0, n + 1), 0.5 - 4 / n
    mesh = (skfem.MeshTri if dim == 2 else skfem.MeshTet).init_tensor(*[axis] * dim)
    bonds = BondBasis(vector_basis(mesh), 4 / n, rule=PairRule()).balanced()
    body = Peridynamics(bonds, solid(nu, "stress" if dim == 2 else None))
    u = np.zeros((mesh.nvertices, dim))
    u[mesh.p[0] > 0.5 - 1e-9, 0] = 1e5
    whole = body.bonds_alone.energy(u.ravel())
    assert body.dilatation is not None
    assert abs(body.energy(u.ravel()) - whole) < 1e-12 * whole
    places = bonds.samples.take(mesh.p.T)[:, 1:]

    def look(block, T):
        weight = 1.0
        for place in places.T:
            middle = 0.5 * (block.part.near(place) + block.part.far(place)) - 0.5
            weight = weight * np.cos(0.5 * np.pi * np.clip(middle / window, -1.0, 1.0)) ** 2
        return float((block.k * block.law.energy(T)) @ weight)

    found = sum(body.each_block(u.ravel(), look)) / window ** (dim - 1)
    print(f"{dim}D nu = {nu}: energy over G_c {found:.4f}")
    assert found == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(
    ("dim", "ratios"),
    [
        pytest.param(2, (1 / 3, 0.0, 0.2, 0.3, 0.45), marks=pytest.mark.slow),
        pytest.param(3, (1 / 4, 0.2, 0.3), marks=pytest.mark.long),
    ],
)
def test_a_torn_ligament_costs_what_it_costs_at_the_ratio_of_bonds(dim, ratios):
    found = {nu: torn(dim, nu) for nu in ratios}
    print(f"{dim}D", {f"{nu:.3f}": f"{energy:.4f}" for nu, energy in found.items()})
    for energy in found.values():
        assert energy == pytest.approx(found[ratios[0]], rel=0.02)
