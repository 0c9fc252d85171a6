"""The stability report: every case holds when quick, what does not hold is told, the oracles stand by themselves."""

import csv
from itertools import combinations

import numpy as np
import pytest

import skfem_peridynamics as peri
from bodies import body_on, box
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.report.stability_page import allowed, as_markdown, nearness
from skfem_peridynamics.geometry.boxes import graded_axis, unit_box
from skfem_peridynamics.geometry.simplices import edge_of_volume
from skfem_peridynamics.model.space import vector_basis
from skfem_peridynamics.stability import cases, oracles
from skfem_peridynamics.stability.bodies import ball
from skfem_peridynamics.stability.extreme_meshes import meshes
from skfem_peridynamics.stability.verdicts import Verdict, Verdicts, reported
from skfem_peridynamics.study.choose_rule import choose


def smallest_angle(mesh):
    """Return the smallest angle of the triangles of a mesh, in degrees."""
    least = 180.0
    for i, j in combinations(range(3), 2):
        k = 3 - i - j
        a, b = (mesh.p[:, mesh.t[end]] - mesh.p[:, mesh.t[k]] for end in (i, j))
        cos = (a * b).sum(axis=0) / np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
        sin = np.abs(a[0] * b[1] - a[1] * b[0]) / np.sqrt((a * a).sum(axis=0) * (b * b).sum(axis=0))
        least = min(least, float(np.degrees(np.arctan2(sin, cos)).min()))
    return least


@pytest.mark.slow
def test_every_case_holds_when_quick(tmp_path, capsys):
    assert main(["stability", "--quick", "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "does not hold" not in said
    rows = list(csv.DictReader((tmp_path / "out" / "stability.csv").read_text().splitlines()))
    assert {row["case"].split()[0] for row in rows} == set(cases.CASES)
    assert all(row["holds"] == "True" for row in rows)
    assert f"{len(rows)} of {len(rows)} hold" in said
    assert len(rows) > 350
    report = (tmp_path / "out" / "stability.md").read_text()
    assert report.startswith(f"# Stability report, version {peri.__version__}: everything holds")
    assert "Quick run" in report
    for name in ("race", "tear", "orders", "long_runs", "energy_balance", "torn_energy"):
        assert (tmp_path / "out" / f"{name}.png").stat().st_size > 5000
        assert f"({name}.png)" in report
    # which scheme is first in a race of seconds is the machine's to say
    assert report.count("first ") >= 3
    for what in ("Newmark", "statics", "explicit", "e-fold every"):
        assert what in report


@pytest.mark.long
def test_every_case_holds(tmp_path):
    assert main(["stability", "--out", str(tmp_path)]) == 0


def test_what_does_not_hold_is_told(tmp_path, capsys, monkeypatch):
    def wrong(verdicts, quick):
        verdicts.add("strains", "here", "be small", 2.0, 1.0)

    def broken(verdicts, quick):
        raise ZeroDivisionError("a slip")

    monkeypatch.setitem(cases.CASES, "strains", cases.Case("what", (wrong, broken)))
    assert main(["stability", "--only", "strains", "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "does not hold: here: be small is 2, allowed at most 1" in said
    assert "0 of 2 hold" in said
    report = (tmp_path / "stability.md").read_text()
    assert "2 of 2 do not hold" in report
    assert "| strains | broken | runs to its end | nan | 0 | ZeroDivisionError: a slip |" in report


def test_what_cannot_be_run_is_refused(tmp_path, capsys):
    assert main(["stability", "--only", "strain", "--out", str(tmp_path)]) == 2
    assert "--only strain: there is no such case; the cases are limit, long," in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["stability", "--quick", "--only", "units", "--out", str(tmp_path / "file")]) == 2
    assert "exists and is not a folder" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("figure", "low", "high", "holds", "near"),
    [
        (0.5, -np.inf, 1.0, True, 0.5),
        (2.0, -np.inf, 1.0, False, 2.0),
        (np.nan, -np.inf, 1.0, False, np.inf),
        (np.inf, -np.inf, 1.0, False, np.inf),
        (1.0, 1.0, 1.0, True, 0.0),
        (2.0, 1.0, 1.0, False, np.inf),
        (3.0, 1.5, np.inf, True, 0.5),
        (1.0, 1.5, np.inf, False, 1.5),
        (1.04, 0.95, 1.05, True, 0.8),
        (0.0, -np.inf, 0.0, True, 0.0),
        (-1.0, -np.inf, 1.0, True, -1.0),
    ],
)
def test_verdicts(figure, low, high, holds, near):
    verdict = Verdict("case", "setting", "must", figure, low, high, 0.0)
    assert verdict.holds is holds
    assert nearness(verdict) == pytest.approx(near)
    verdicts = Verdicts()
    assert verdicts.add("case", "setting", "must", figure, high, low) is holds
    assert verdicts.holds is holds
    assert allowed(verdict) in as_markdown(verdicts, False, [])


def test_an_exception_is_a_verdict():
    verdicts = Verdicts()
    with reported(verdicts, "case", "setting", "must"):
        raise ValueError("no")
    assert not verdicts.holds
    assert verdicts.entries[0].note == "ValueError: no"


def test_the_oracle_of_pairs_is_no_copy():
    """A mesh by hand: two bonds of a bar, one of them on the rim."""
    import skfem

    mesh = skfem.MeshLine(np.array([0.0, 1.0, 2.5]))
    # volumes 1/2, 5/4, 3/4; sizes 1, 5/4, 3/2; horizon 2: r = 1 and 3/2 within, r = 5/2 at the rim
    u = np.array([0.0, 1.0, 0.0])
    c = 1.0 / (2.0**2 * 2.0)
    share = 0.5 * (min(1.0, 0.5 / 1.25 + 0.5) + min(1.0, 0.5 / 1.5 + 0.5))
    by_hand = 2.0 * c * (0.5 * 1.25 * 1.0 + 1.25 * 0.75 * share / 1.5)
    assert oracles.energy_of_pairs(mesh, 2.0, 1.0, u) == pytest.approx(by_hand, rel=1e-14)


@pytest.mark.parametrize(("dim", "value"), [(1, 0.833333333333), (2, 0.388591539836), (3, 0.219522238189)])
def test_the_oracle_of_a_stretch_against_closed_forms(dim, value):
    assert 2.0 * oracles.energy_of_a_stretch(dim, 0.25) == pytest.approx(value, rel=1e-9)
    far = 2.0 * oracles.energy_of_a_stretch(dim, 50.0) * 50.0 ** (dim + 1)  # all pairs are bonds
    assert far == pytest.approx(2.0 * oracles.energy_of_a_stretch(dim, 100.0) * 100.0 ** (dim + 1), rel=1e-9)
    if dim == 1:
        assert far == pytest.approx(1.0 / 3.0, rel=1e-12)  # the mean distance of two points of the interval


def test_zero_modes_are_counted():
    assert oracles.zero_modes(body_on(box(2, 3), 0.5).stiffness().toarray()) == 3
    lattice = body_on(box(2, 3), 0.34, rule=peri.PairRule(partial_volume=False))
    assert oracles.zero_modes(lattice.stiffness().toarray()) > 3


def test_the_meshes_are_as_extreme_as_they_say():
    found = {name: (mesh, horizon) for name, mesh, horizon in meshes(quick=False)}
    h = np.diff(np.sort(found["1D, two vertices 1e-9 apart"][0].p[0]))
    assert h.min() / h.max() < 1.01e-9
    assert smallest_angle(found["2D, slivers of 0.1 degrees"][0]) == pytest.approx(0.1, rel=1e-3)
    assert smallest_angle(box(2, 2)) == pytest.approx(45.0)
    h = np.diff(graded_axis(16, 1e4))
    assert h.max() / h.min() == pytest.approx(1e4)
    assert found["3D, horizon = 1000 bodies"][1] == 1e3


def test_no_one_sided_rule_is_chosen_where_bonds_soften():
    for dim in (1, 2, 3):
        for per_horizon in (2, 4, 8):
            mesh = box(dim, 8)
            chosen = choose(mesh, per_horizon / 8, fracturing=True)
            assert chosen.scheme.rule.symmetric


# ---- what the cases rest on
def test_the_limit_of_a_displaced_body_against_its_dense_spectrum():
    body = body_on(box(2, 12, "random"), 0.3, peri.Exponential(1.0, 1e-2))
    u = 0.1 * np.sin(np.pi * body.bonds.mesh.p.T).ravel()
    for kind in ("lumped", "consistent"):
        M = peri.mass_matrix(body.basis, kind=kind)
        lam = np.linalg.eigvals(np.linalg.solve(M.toarray(), body.tangent(u).toarray())).real.max()
        limit = peri.stable_time_step(body, M, u=u)
        assert 0.99 < limit.dt * np.sqrt(lam) / 2 <= 1.0
        assert limit.nodal_bound >= lam
        assert limit.dt > peri.stable_time_step(body, M).dt  # softened bonds allow more
        from skfem_peridynamics.solve.tangent_limit import TangentLimit

        again = TangentLimit(body, M)
        first, before = again.at(u), again.products
        second = again.at(1.001 * u)
        assert again.products - before <= before
        for dt in (first, second):
            assert 0.97 < dt * np.sqrt(lam) / 2 <= 1.001


class Stiffening(peri.Potential):
    """f' goes from 1 to 3."""

    def f(self, q):
        return self.slope * (3.0 * q - 2.0 * np.log1p(q))

    def df(self, q):
        return self.slope * (3.0 - 2.0 / (1.0 + q))

    def d2f(self, q):
        return self.slope * 2.0 / (1.0 + q) ** 2


def test_a_law_that_stiffens_takes_an_adapted_step():
    body = body_on(box(2, 12, "random"), 0.3, Stiffening(1.0, np.inf))
    M = peri.mass_matrix(body.basis)
    limit = peri.stable_time_step(body, M)
    p = body.bonds.mesh.p
    u0 = np.stack([1.0 * np.cos(np.pi * p[0]), 0 * p[0]], axis=1).ravel()
    options = {"dt": 0.7 * limit.dt, "until": 70 * limit.dt, "limit": limit}
    with pytest.raises(
        peri.UnstableRun, match="Take a smaller dt: the material has stiffened, the limit is 0"
    ) as error:
        list(peri.central_difference(body, M, u0, **options))
    assert error.value.state.step < error.value.step
    assert np.isfinite(error.value.state.u).all()
    right = np.flatnonzero(p[0] > 1 - 1e-9)
    moved = peri.Prescribed(2 * right, displacement=lambda t: u0[2 * right] * np.cos(0.05 * t))
    states = [
        (s.t, s.dt, s.u[2 * right[0]]) for s in peri.central_difference(body, M, u0, adapt=10, fixed=[moved], **options)
    ]
    t, dt, u = np.array(states).T
    assert dt.min() < 0.6 * limit.dt
    assert dt.max() <= 0.7 * limit.dt
    assert (dt[20:] < 0.65 * limit.dt).any()  # not at the start alone
    assert t[-1] == pytest.approx(70 * limit.dt)
    np.testing.assert_allclose(np.diff(t), dt[1:], rtol=1e-9)
    np.testing.assert_allclose(u, u0[2 * right[0]] * np.cos(0.05 * t), rtol=1e-9)


def test_an_adapted_step_is_never_longer_than_asked_for():
    """A body that has softened would allow longer ones."""
    body = body_on(box(2, 12, "random"), 0.3, peri.Exponential(1.0, 1e-3))
    M = peri.mass_matrix(body.basis)
    limit = peri.stable_time_step(body, M)
    p = body.bonds.mesh.p
    u0 = np.stack([0.055 * p[0], 0.055 * p[1]], axis=1).ravel()
    assert peri.stable_time_step(body, M, u=u0).dt > 1.5 * limit.dt
    dt = 0.5 * limit.dt
    states = peri.central_difference(body, M, u0, dt=dt, until=40.5 * dt, limit=limit, adapt=5)
    steps = [state.dt for state in states]
    assert len(steps) > 40
    assert max(steps) <= dt * (1 + 1e-12)


@pytest.mark.parametrize("change", [{"adapt": -1}, {"adapt": 10, "limit": None}])
def test_adapting_needs_a_limit(change):
    body = body_on(box(1, 20), 0.2)
    M = peri.mass_matrix(body.basis)
    options = {"dt": 0.1, "until": 1.0, "limit": peri.stable_time_step(body, M)} | change
    with pytest.raises(ValueError, match="must be 0, or positive with a limit and a body of a symmetric rule"):
        peri.central_difference(body, M, **options)


def test_a_step_beyond_the_limit_for_certain_is_told_from_one_that_may_be():
    body = body_on(box(1, 40, "random"), 0.1)
    M = peri.mass_matrix(body.basis)
    limit = peri.stable_time_step(body, M)
    lam = np.linalg.eigvals(np.linalg.solve(M.toarray(), body.stiffness().toarray())).real.max()
    exact = 2.0 / np.sqrt(lam)
    assert not limit.exceeded(limit.dt)
    assert not limit.exceeded(0.999 * exact)
    assert limit.exceeded(1.001 * exact)


@pytest.mark.parametrize("law", [peri.Exponential, peri.Rational])
@pytest.mark.parametrize("limit", [1e-250, 1.0, 1e250])
def test_laws_overflow_nowhere(law, limit):
    """By themselves, where no one looks away: values, forces and tangents of strains from 1e-300 to 1e150."""
    made = law(1.0, limit)
    T = np.r_[0.0, np.geomspace(1e-300, 1e150, 91)]
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        energy, gradient, hessian = made.energy(T), made.gradient(T), made.hessian(T)
    for what in (energy, gradient, hessian):
        assert np.isfinite(what).all()
    assert (np.diff(energy) >= 0.0).all()
    assert energy.max() <= limit
    assert hessian[0] == 2.0
    if limit <= 1.0:
        assert energy[-1] == pytest.approx(limit, rel=1e-12)
        assert abs(gradient[-1]) < 1e-100


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_sizes_scale_with_the_same_bits(dim):
    volume = np.random.default_rng(0).uniform(0.1, 10.0, 1000)
    edge = edge_of_volume(volume, dim)
    np.testing.assert_allclose(edge**dim, volume, rtol=1e-14)
    for power in (-330, -40, -3, 1, 17, 300):
        assert (edge_of_volume(volume * 2.0 ** (power * dim), dim) == edge * 2.0**power).all()


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("rule", ["pairs", "gauss pairs", "balls"])
@pytest.mark.parametrize("dim", [1, 2, 3])
def test_powers_of_two_in_the_units_keep_the_bits(dim, rule, compiled):
    made_by = {"pairs": peri.PairRule(), "gauss pairs": peri.PairRule(points="gauss"), "balls": ball(dim)}[rule]

    def quantities(length, stress):
        mesh = unit_box(dim, {1: 12, 2: 6, 3: 3}[dim], "random")
        mesh = type(mesh)(mesh.p * length, mesh.t)
        bonds = peri.BondBasis(vector_basis(mesh), 0.6 * length, influence="gaussian", rule=made_by)
        body = peri.Peridynamics(bonds, peri.Exponential(2.0 * stress, 0.3 * stress * length), compiled=compiled)
        u = 0.05 * length * np.sin(np.arange(body.basis.N))
        volume = length**dim
        return {
            "weight": bonds.weight / (volume * volume),
            "measure": bonds.measure() * length / volume,
            "energy": body.energy(u) / (stress * volume),
            "force": body.force(u) * length / (stress * volume),
            "stiffness": body.stiffness().data * length**2 / (stress * volume),
        }

    plain = quantities(1.0, 1.0)
    # strains are scaled by the root of the length: its bits stay with even powers
    for length, stress in ((2.0**10, 2.0**-21), (2.0**-40, 2.0**38), (4.0, 1.0)):
        for name, scaled in quantities(length, stress).items():
            assert np.array_equal(scaled, plain[name]), (name, length)


@pytest.mark.parametrize("law", [peri.Exponential, peri.Rational])
def test_laws_without_numbers_are_refused(law):
    for slope, limit in ((1.0, 1e-310), (1e-300, 1e300)):
        with pytest.raises(ValueError, match="b = f'\\(0\\) / f_inf must lie between 1e-300 and 1e\\+300"):
            law(slope, limit)
