"""Scenes of any Poisson ratio: what they say, cost, refuse, and what inclusions take from the matrix."""

import json

import numpy as np
import pytest
import skfem

import skfem_peridynamics as peri
from bodies import vector_basis
from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.files.results import Results
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.report.run_page import page
from skfem_peridynamics.app.run.check import check
from small_scenes import GOOD, change, complaint


def solid(said, **more):
    return change('plane = "stress"}', f'plane = "stress", {said}' + "}")


def test_a_run_reports_its_constants(tmp_path):
    summary = run(Scene.parse(solid("poisson = 0.2")), tmp_path / "out")
    elastic = json.loads((tmp_path / "out" / "summary.json").read_text())["elastic"]
    assert elastic["poisson"] == pytest.approx(0.2)
    assert elastic["lame"] == pytest.approx(0.2 / 0.96)
    assert elastic["mu"] == pytest.approx(1 / 2.4)
    alone = run(Scene.parse(GOOD), tmp_path / "alone")
    assert abs(summary["energy_drift"]) < 1.2 * abs(alone["energy_drift"])
    assert summary["steps"] > alone["steps"] - 3
    words = [page(Results.read(tmp_path / name), {}) for name in ("out", "alone")]
    for name, nu, lam, mu in (("out", "0.2", "0.2083", "0.4167"), ("alone", "0.3333", "0.375", "0.375")):
        told = words[name == "alone"]
        for label, value in (("Poisson&#x27;s ratio", nu), ("lambda", lam), ("mu", mu), ("toughness G_c", "0.001")):
            assert f"<th>{label}</th><td>{value}</td>" in told


@pytest.mark.parametrize(
    ("inclusion", "nu", "young"),
    [
        ("young = 3.0", 0.2, 3.0),
        ("poisson = 0.4", 0.4, 1.0),
        ("young = 3.0, poisson = 0.0", 0.0, 3.0),
        ("lame = 1.0, mu = 1.0", 1 / 3, 8 / 3),
        ("bulk = 2.0, mu = 1.0", 1 / 3, 8 / 3),
        ("density = 2.0", 0.2, 1.0),
    ],
)
def test_an_inclusion_takes_what_it_does_not_say_from_the_matrix(inclusion, nu, young):
    text = solid("poisson = 0.2") + "[[inclusion]]\nwhere = 'x - 0.5'\n" + inclusion.replace(", ", "\n")
    problem = Problem(Scene.parse(text))
    material = problem.materials[1]
    elastic = material.elastic(material.law(2, 0.3), 2, 0.3)
    assert (elastic.poisson, elastic.young) == pytest.approx((nu, young))


def test_check_knows_what_it_costs():
    rows = {
        name: dict(check(Scene.parse(solid(f"poisson = {nu}")))) for name, nu in (("with", 0.2), ("without", 1 / 3))
    }
    limit = [float(rows[name]["steps"].split()[2].rstrip(",")) for name in ("with", "without")]
    assert np.isfinite(limit).all()
    from skfem_peridynamics.app.problem.cost import seconds_of_run

    given = {"explicit": True, "balanced": False, "frames": 0}
    with_it, without = (
        seconds_of_run(1000, 10**6, 1000, **given, dilated=dilated)["steps"] for dilated in (True, False)
    )
    assert 1.5 < with_it / without < 2.5
    assert "note" not in rows["with"]


@pytest.mark.parametrize(
    ("matrix", "inclusion", "nu"),
    [
        ("lame = 0.5, mu = 1.0", "young = 3.0", 0.2),
        ("bulk = 1.0, mu = 1.0", "young = 3.0", 0.0),
        ("lame = 0.5, mu = 1.0", "lame = 1.0", 1 / 3),
        ("lame = 0.5, mu = 1.0", "mu = 0.5", 1 / 3),
        ("lame = 1.0", "young = 3.0", 1 / 3),
    ],
)
def test_however_the_matrix_says_its_ratio(matrix, inclusion, nu):
    text = GOOD.replace("young = 1.0", matrix) + "[[inclusion]]\nwhere = 'x - 0.5'\n" + inclusion
    material = Problem(Scene.parse(text)).materials[1]
    assert material.elastic(material.law(2, 0.3), 2, 0.3).poisson == pytest.approx(nu, abs=1e-12)


def test_steps_told_from_estimates_are_enough(monkeypatch):
    """A stiffer dilatation in the bound of the exact integrals: with a factor that the scene shows."""
    from skfem_peridynamics.app.run import check as module

    monkeypatch.setattr(module, "_TRIED", 0)
    told = {}
    for said in ("lame = 1.0, mu = 1.0", "lame = 9.0, mu = 1.0"):
        text = GOOD.replace("young = 1.0", said).replace("until = 0.5", "until = 50.0")
        told[said] = int(dict(check(Scene.parse(text)))["steps"].split()[-1])
    few, many = told.values()
    assert many / few == pytest.approx(np.sqrt(1 + 2 * 8 / 4), rel=0.01)


def test_a_ratio_beside_that_of_bonds_is_remarked_on(capsys, tmp_path):
    (tmp_path / "scene.toml").write_text(solid("poisson = 0.33"))
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    told = capsys.readouterr().out
    assert "poisson = 0.33 is near 0.3333, which bonds alone have" in " ".join(told.split())
    for same in ("poisson = 0.333333333", "poisson = 0.2"):
        (tmp_path / "scene.toml").write_text(solid(same))
        main(["check", str(tmp_path / "scene.toml")])
        assert "is near" not in capsys.readouterr().out
    beside = solid("poisson = 0.333333") + "[[inclusion]]\nwhere = 'x - 0.5'\npoisson = 0.2\n"
    (tmp_path / "scene.toml").write_text(beside)
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    assert "is near" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (solid("poisson = 1.0"), "material: poisson = 1: in plane stress Poisson's ratio lies between -1 and 1"),
        (solid("mu = 1.0"), "material: mu = 1 goes with lame or with bulk, not with young"),
        (
            solid("poisson = 0.2").replace("0.13}\ncrack", '0.13, rule = "ball", symmetric = false}\ncrack'),
            "symmetric rule",
        ),
        (change(', plane = "stress"', ""), "material: plane = None: a body in 2D"),
        (
            solid("poisson = 0.2") + "[[inclusion]]\nwhere = 'x - 0.5'\nlame = 1.0\n",
            "inclusion[0]: lame = 1 alone is lambda = mu, and [material] has another Poisson ratio, 0.2: give mu",
        ),
        (GOOD.replace("young = 1.0", "lame = -3.0, mu = 1.0"), "material: lame = -3 with mu = 1 is Poisson's ratio"),
    ],
)
def test_what_is_refused(capsys, tmp_path, content, message):
    told = complaint(capsys, tmp_path, content)
    assert told.startswith("skfem-peridynamics: " + message.split("symmetric rule")[0])
    assert message in told


def test_the_step_of_a_mesh_file(tmp_path, capsys):
    """As of a body in Python; nothing of it at the ratio of bonds."""
    mesh = skfem.MeshTri.init_tensor(*[np.linspace(0, 1, 9)] * 2)
    mesh.save(tmp_path / "square.msh")
    bonds = peri.BondBasis(vector_basis(mesh), 0.4)
    for nu, same in ((None, None), (None, "0.333333333"), (0.45, "0.45"), (-0.5, "-0.5")):
        more = [] if same is None else [f"--poisson={same}"]
        command = ["cfl", "--mesh", str(tmp_path / "square.msh"), "--horizon", "0.4", "--young", "1", "--density", "2"]
        assert main([*command, "--plane", "stress", "--json", *more]) == 0
        solid = peri.Material.from_elastic(young=1.0, poisson=nu, density=2.0, plane="stress", potential="linear")
        limit = peri.stable_time_step(peri.Peridynamics(bonds, solid), peri.mass_matrix(bonds.space, density=2.0))
        assert json.loads(capsys.readouterr().out)["stable_step"] == pytest.approx(limit.dt, rel=1e-12)
