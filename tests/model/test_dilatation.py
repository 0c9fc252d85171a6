"""Any Poisson ratio: the energy of the dilatation against loops over bonds, differences, dense spectra."""

import numpy as np
import pytest

import skfem_peridynamics as peri
from bodies import box, vector_basis
from skfem_peridynamics import BallRule, CornerRule, Material, PairRule, Peridynamics

RULES = {"pairs": PairRule(), "gauss": PairRule(points="gauss"), "ball": BallRule(3, 4), "corners": CornerRule()}


def material(dim, nu=0.2, potential="exponential", **options):
    plane = options.pop("plane", "strain" if dim == 2 else None)
    return Material.from_elastic(
        young=2.0, poisson=nu, toughness=0.05, density=1.0, plane=plane, potential=potential, **options
    )


def make(dim, n, rule="pairs", nu=0.2, kind="random", horizon=None, balanced=False, **options):
    keys = {name: options.pop(name) for name in ("compiled", "no_fail", "threads") if name in options}
    boundary = {"boundary_function": "smooth"} if options.pop("boundary", False) else {}
    bonds = peri.BondBasis(vector_basis(box(dim, n, kind)), horizon or 2.5 / n, rule=RULES[rule], **boundary)
    return Peridynamics(bonds.balanced() if balanced else bonds, material(dim, nu, **options), **keys)


def moved(body, size=0.03, seed=1):
    return (
        size
        * np.random.default_rng(seed).standard_normal(body.basis.N)
        / body.bonds.mesh.nvertices ** (1 / body.bonds.dim)
    )


def energy_by_loops(body, u):
    """Bond by bond from the formulas, P1 values from ``sides``: nothing of the engine or of the blocks."""
    bonds, dim, law = body.bonds, body.bonds.dim, body.law
    U = u.reshape(-1, dim)
    virial, unit, total = np.zeros(len(U)), np.zeros(len(U)), 0.0
    for part in bonds.parts:
        k, xi = bonds.measure_of(part), part.vectors()
        vx, px, vy, py = part.sides()
        for b in range(part.nbonds):
            r = np.linalg.norm(xi[b])
            if r == 0.0:
                continue
            S = (py[b] @ U[vy[b]] - px[b] @ U[vx[b]]) @ xi[b] / r**2
            total += k[b] * float(law.f(np.array([r * S * S]))[0])
            pull = k[b] * r * S * float(law.df(np.array([r * S * S]))[0])
            for vertices, values in ((vx[b], px[b]), (vy[b], py[b])):
                np.add.at(virial, vertices, pull * values)
                np.add.at(unit, vertices, k[b] * law.slope * r * values / dim)
    e, elastic = virial / unit, body.elastic
    return total + (unit / ((dim + 2) * elastic.shear) * 0.5 * (elastic.lame - elastic.shear) * e**2).sum()


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize(
    ("dim", "n", "rule"),
    [(2, 5, "pairs"), (2, 4, "gauss"), (2, 4, "ball"), (2, 8, "corners"), (3, 3, "pairs"), (3, 2, "ball")],
)
@pytest.mark.parametrize("nu", [-0.4, 0.4])
def test_energy_against_loops_over_bonds(dim, n, rule, nu, compiled):
    body = make(dim, n, rule, nu, compiled=compiled)
    u = moved(body, 0.3)
    assert body.energy(u) == pytest.approx(energy_by_loops(body, u), rel=1e-11)


@pytest.mark.parametrize(
    ("dim", "n", "rule", "options"),
    [
        (2, 6, "pairs", {}),
        (2, 6, "pairs", {"potential": "rational", "nu": -0.5}),
        (2, 6, "pairs", {"potential": "linear", "nu": 0.45}),
        (2, 6, "pairs", {"compression": "elastic"}),
        (2, 6, "pairs", {"plane": "stress", "boundary": True}),
        (2, 6, "pairs", {"no_fail": [0, 1, 8], "balanced": True}),
        (2, 5, "gauss", {}),
        (2, 5, "ball", {"balanced": True}),
        (2, 8, "corners", {}),
        (3, 4, "pairs", {"nu": 0.45}),
        (3, 3, "ball", {}),
    ],
)
def test_force_tangent_and_engines(dim, n, rule, options):
    """Force is minus the gradient, the tangent its derivative, in both engines, assembled and not; they agree."""
    fast, slow = (make(dim, n, rule, **options, compiled=compiled) for compiled in (True, False))
    u, v, w = (moved(fast, 0.4, seed) for seed in (1, 2, 3))
    F = fast.force(u)
    np.testing.assert_allclose(slow.force(u), F, rtol=0, atol=1e-12 * np.abs(F).max())
    for body in (fast, slow):
        d = 1e-5
        assert (body.energy(u + d * v) - body.energy(u - d * v)) / (2 * d) == pytest.approx(-(F @ v), rel=1e-6)
        Kv = body.tangent_operator(u) @ v
        difference = (body.force(u - d * v) - body.force(u + d * v)) / (2 * d)
        np.testing.assert_allclose(Kv, difference, rtol=0, atol=1e-6 * np.abs(Kv).max())
        np.testing.assert_allclose(body.tangent(u) @ v, Kv, rtol=0, atol=1e-12 * np.abs(Kv).max())
        K0 = body.stiffness()
        assert (K0 != K0.T).nnz == 0
        rest = body.stiffness_operator() @ v
        np.testing.assert_allclose(K0 @ v, rest, rtol=0, atol=1e-12 * np.abs(rest).max())
        np.testing.assert_allclose(body.tangent_operator(0 * u) @ v, rest, rtol=0, atol=1e-11 * np.abs(rest).max())
        assert w @ (body.tangent_operator(u) @ v) == pytest.approx(v @ (body.tangent_operator(u) @ w), rel=1e-10)
