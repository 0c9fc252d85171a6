"""Scenes with implicit steps, statics and inclusions: what they run, write, and refuse."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import skfem_peridynamics as peri
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.run.estimate import run_once
from small_scenes import GOOD, complaint

EXAMPLES = Path(__file__).parents[2] / "examples"
BAR = """
title = "bar"
mesh = {box = [[0, 1]], divisions = [40]}
material = {young = 1.0, density = 1.0, potential = "linear"}
bonds = {horizon = 0.1}
fixed = [{on = "left", displacement = 0}]
initial = {velocity = ["0.01*x"]}
time = {until = 2.0, scheme = "newmark", step = 0.05}
output = {frames = 3, history = 5, pictures = false}
"""
PULLED = """
title = "pulled"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [16, 8]}
material = {young = 1.0, toughness = 1e-3, density = 1.0, plane = "stress"}
bonds = {horizon = 0.13}
fixed = [{on = "left", displacement = 0}, {on = "right", component = "x", displacement = "0.001*t"}]
time = {until = 1.0, scheme = "static", steps = 2}
output = {frames = 3, history = 3, pictures = false}
"""


def ran(tmp_path, content, code=0):
    (tmp_path / "scene.toml").write_text(content)
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--overwrite", "--quiet"]) == code
    return json.loads((tmp_path / "out" / "summary.json").read_text())


def test_newmark_and_central_difference_run_to_the_same_end(tmp_path):
    implicit = Problem(peri.Scene.parse(BAR))
    explicit = Problem(peri.Scene.parse(BAR.replace('scheme = "newmark", ', "")))
    ends = [run_once(one).u[-1] for one in (implicit, explicit)]
    assert np.abs(ends[0] - ends[1]).max() < 0.02 * np.abs(ends[1]).max()
    assert np.abs(ends[0] - ends[1]).max() > 1e-6 * np.abs(ends[1]).max()  # and are not the same run
    summary = ran(tmp_path, BAR)
    assert summary["scheme"] == "Newmark, weak form, lumped mass"
    assert summary["steps"] == 40
    assert summary["newton_iterations"] == 40
    assert summary["energy_drift"] < 1e-3
    assert "step_limits" not in summary  # not asked for, not computed
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").read_text().splitlines()))
    assert [float(row["t"]) for row in rows] == [0.0, 0.5, 1.0, 1.5, 2.0]
    assert len(list((tmp_path / "out").glob("frame_*.vtu"))) == 3


def test_an_implicit_scene_computes_no_limit(tmp_path, monkeypatch):
    import skfem_peridynamics.app.problem.problem as build

    def never(*arguments, **options):
        raise AssertionError

    monkeypatch.setattr(build, "stable_time_step", never)
    ran(tmp_path, BAR)
    ran(tmp_path, PULLED)
    assert main(["check", str(tmp_path / "scene.toml")]) == 0


def test_a_static_scene_builds_no_mass(tmp_path, monkeypatch):
    import skfem_peridynamics.app.problem.problem as build

    monkeypatch.setattr(build, "mass_matrix", None)
    summary = ran(tmp_path, PULLED)
    assert summary["scheme"] == "statics"
    assert summary["steps"] == 2
    assert summary["energy_lost"] < 1e-6
    assert summary["energy_drift"] < 1e-3
    rows = list(csv.DictReader((tmp_path / "out" / "history.csv").read_text().splitlines()))
    assert [float(row["kinetic"]) for row in rows] == [0.0] * 3
    assert float(rows[1]["total"]) == pytest.approx(0.25 * float(rows[2]["total"]), rel=1e-3)


@pytest.mark.slow
def test_a_plate_is_torn_in_two(tmp_path):
    """The example: its last energy is that of a crack through the ligament of 0.45, and it holds nothing any more.

    Round-off does not decide where it tears: the same plate, stiffer by 1e-9, tears alike.
    """
    content, ends = (EXAMPLES / "double_cantilever.toml").read_text(), []
    for young in ("1.000000001", "1.0"):
        summary = ran(tmp_path, content.replace("young = 1.0", f"young = {young}"))
        rows = list(csv.DictReader((tmp_path / "out" / "history.csv").read_text().splitlines()))
        ends.append([float(rows[-1][name]) for name in ("softened", "work")])
    assert ends[0] == pytest.approx(ends[1], rel=1e-6)
    assert float(rows[-1]["softened"]) == pytest.approx(1e-4 * 0.45, rel=0.05)  # 0.973 seen
    assert float(rows[-1]["intact"]) < 1e-12 * float(rows[-1]["softened"])
    assert float(rows[-1]["work"]) == pytest.approx(float(rows[-2]["work"]), rel=1e-9)
    assert 0.3 < summary["energy_lost"] < 0.7
    assert summary["energy_drift"] < 0.02


def test_a_load_that_nothing_carries_ends_with_words_and_the_last_state(tmp_path, capsys):
    content = PULLED.replace(', {on = "right", component = "x", displacement = "0.001*t"}', "")
    content += 'load = [{traction = ["t", 0], on = "right", layer = 0.13}]\n'
    content = content.replace("steps = 2", "steps = 4").replace("divisions = [16, 8]", "divisions = [8, 4]")
    content = content.replace("horizon = 0.13", "horizon = 0.26").replace("layer = 0.13", "layer = 0.26")
    summary = ran(
        tmp_path, content.replace('title = "pulled"', 'title = "pulled"\n').replace("load = [", "load = ["), 2
    )
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "no equilibrium was found beyond t = " in told
    assert summary["status"].startswith("stopped: no equilibrium was found beyond")
    assert summary["steps"] >= 1


INCLUSION = """
title = "inclusion"
mesh = {box = [[0, 1], [0, 1]], divisions = [12, 12]}
material = {young = 1.0, toughness = 1.0, density = 1.0, plane = "stress"}
inclusion = [{where = "0.3 - sqrt((x - 0.5)^2 + (y - 0.5)^2)", young = 100.0, density = 4.0}]
bonds = {horizon = 0.25}
initial = {velocity = ["0.01*x", "0"]}
time = {until = 0.5}
output = {frames = 0, history = 3, pictures = false}
"""


def test_an_inclusion_is_stiff_and_heavy_where_it_is(tmp_path):
    problem = Problem(peri.Scene.parse(INCLUSION))
    middle = problem.mesh.p[:, problem.mesh.t].mean(axis=1)
    inside = np.hypot(*(middle - 0.5)) < 0.3
    assert set(problem.mesh.subdomains["inclusion[0]"]) == set(np.flatnonzero(inside))
    matrix, stiff = problem.body.laws
    assert stiff.slope == pytest.approx(100 * matrix.slope)
    assert stiff.limit == pytest.approx(matrix.limit)
    assert problem.mass.diagonal()[::2].sum() == pytest.approx((1 + 3 * inside).sum() / len(inside))
    plain = Problem(peri.Scene.parse(INCLUSION.replace("inclusion = [", "# inclusion = [")))
    assert problem.limit.dt < 0.25 * plain.limit.dt
    summary = ran(tmp_path, INCLUSION)
    assert summary["energy_drift"] < 1e-2
    other = Problem(peri.Scene.parse(INCLUSION.replace("young = 100.0", "lame = 37.5, K_Ic = 2.0")))
    again = other.body.laws[1]
    assert again.slope == pytest.approx(stiff.slope)  # 3/8 of Young's modulus in plane stress
    assert again.limit == pytest.approx(matrix.limit * 2.0**2 / 100.0)  # G_c = K^2 / E
    # refined, the same elements are inside
    refined = Problem(peri.Scene.parse(INCLUSION), refinements=1)
    fine = refined.mesh.p[:, refined.mesh.t].mean(axis=1)
    listed = refined.mesh.subdomains["inclusion[0]"]
    assert len(listed) == 4 * inside.sum()
    assert np.hypot(*(fine[:, listed] - 0.5)).max() < 0.35


BAD = {
    "no step": (BAR.replace(", step = 0.05", ""), 'time: scheme = "newmark" needs a step: how finely the motion'),
    "safety": (
        BAR.replace("step = 0.05", "step = 0.05, safety = 0.5"),
        "safety = 0.5 does not go with scheme = 'newmark'",
    ),
    "gamma": (BAR.replace("step = 0.05", "step = 0.05, gamma = 0.4"), "time: gamma = 0.4 must be at least 1/2"),
    "no steps": (PULLED.replace(", steps = 2", ""), 'time: scheme = "static" needs steps, 1 or more'),
    "zero steps": (PULLED.replace("steps = 2", "steps = 0"), 'scheme = "static" needs steps, 1 or more, not 0'),
    "mass of statics": (PULLED.replace("steps = 2", 'steps = 2, mass = "lumped"'), "mass = 'lumped' does not go with"),
    "velocity of statics": (
        PULLED.replace('component = "x", displacement = "0.001*t"', 'component = "x", velocity = 1'),
        "time: a body at rest has no velocity: prescribe the displacement",
    ),
    "initial velocity": (
        PULLED + 'initial = {velocity = ["1", "0"]}\n',
        'time: scheme = "static" has no initial velocity',
    ),
    "loose": (
        PULLED.replace('{on = "left", displacement = 0}, ', ""),
        "can move rigidly, in 1 of 3 ways: statics needs it held",
    ),
    "steps": (
        GOOD.replace("until = 0.5", "until = 0.5, steps = 3"),
        "steps = 3 does not go with scheme = 'central_diff",
    ),
    "mass scaling": (
        GOOD.replace("until = 0.5", "until = 0.5, mass_scaling = 10"),
        "time.mass_scaling = 10: there is none, for it buys a longer step with another motion; take scheme",
    ),
    "lattice": (
        GOOD.replace("bonds = {horizon = 0.13}", "bonds = {horizon = 0.063, partial_volume = false}"),
        "bonds: no bond resists a shear of x and y of the whole body",
    ),
    "nowhere": (INCLUSION.replace('"0.3 -', '"-3 -'), "inclusion[0].where selects no element: the set is empty"),
    "no such region": (
        INCLUSION.replace('where = "0.3 - sqrt((x - 0.5)^2 + (y - 0.5)^2)"', 'region = "fibre"'),
        "inclusion: inclusions names the subdomain 'fibre'; the mesh has none",
    ),
    "where and region": (
        INCLUSION.replace("{where", '{region = "a", where'),
        "inclusion[0]: give one of region and where",
    ),
    "between": (
        INCLUSION.replace('plane = "stress"', 'plane = "stress", between = "sum"'),
        "material.between = 'sum' must",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_what_makes_no_sense_is_one_sentence(name, tmp_path, capsys):
    content, said = BAD[name]
    assert said in complaint(capsys, tmp_path, content)
