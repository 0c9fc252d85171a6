"""The error estimate of a scene: against a far finer mesh, and what it says where it cannot be had."""

import json
from dataclasses import replace

import numpy as np
import pytest
import skfem

from bodies import grid
from skfem_peridynamics import Crack, Scene, slit
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.problem import cost
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.problem.states import states
from skfem_peridynamics.app.run import estimate
from skfem_peridynamics.app.run.estimate import distance, order_of, prolongation, run_once

WAVE = """
title = "a bump that spreads"
mesh = {box = [[0, 1], [0, 1]], divisions = [8, 8]}
material = {lame = 1.0, potential = "linear", density = 1.0, plane = "strain"}
bonds = {horizon = 0.25}
initial = {displacement = ["0.01*exp(-10*((x-0.5)^2+(y-0.5)^2))", "0"]}
time = {until = 0.3}
output = {pictures = false, frames = 0}
"""


@pytest.mark.parametrize(
    "mesh",
    [
        skfem.MeshLine(np.sort(np.random.default_rng(0).random(9))),
        grid((1, 3), (2, 4)),
        skfem.MeshTet().refined(2),
        slit(grid((1.0, 6), (1.0, 6)), Crack([[0.0, 0.5], [0.5, 0.5]])),
    ],
    ids=["1D", "2D", "3D", "slit"],
)
def test_prolongation_keeps_linear_fields(mesh):
    P, fine = prolongation(mesh), mesh.refined()
    assert P.shape == (fine.nvertices, mesh.nvertices)
    assert np.abs(P @ mesh.p.T - fine.p.T).max() < 1e-14
    assert np.abs(P.sum(axis=1) - 1).max() < 1e-14
    if "slit" in (mesh.boundaries or {}):  # the faces of a crack stay apart
        upper = (mesh.p[1, mesh.t].mean(axis=0) > 0.5)[None].repeat(3, axis=0)
        side = np.zeros(mesh.nvertices)
        side[mesh.t[upper]] = 1.0
        faces = np.unique(fine.facets[:, fine.boundaries["slit"]])
        faces = faces[fine.p[0, faces] < 0.4]
        assert set((P @ side)[faces]) == {0.0, 1.0}


@pytest.mark.slow
def test_estimate_against_a_far_finer_run(tmp_path):
    scene = Scene.parse(WAVE)
    first = Problem(scene)
    coarse = run_once(first)
    finest = coarse
    for k in (1, 2, 3):
        finest = run_once(replace(first, refinements=k), finest)
    true = distance(coarse, finest)
    (tmp_path / "scene.toml").write_text(WAVE)
    assert main(["run", str(tmp_path / "scene.toml"), "--quiet", "--estimate", "--out", str(tmp_path / "out")]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    found = summary["error_estimate"]
    print(f"estimated {found:.2e}, against three refinements {true:.2e}")
    assert found == pytest.approx(true, rel=0.1)  # 6.6 % measured
    assert "one refinement, taken to be of order 2" in summary["estimate_note"]
    assert summary["seconds"]["estimate"] > 0
    assert main(["run", str(tmp_path / "scene.toml"), "--quiet", "--overwrite", "--out", str(tmp_path / "out")]) == 0
    assert "error_estimate" not in json.loads((tmp_path / "out" / "summary.json").read_text())


def test_refined_runs_halve_the_step_and_keep_the_times():
    first = Problem(Scene.parse(WAVE))
    coarse = run_once(first)
    fine = run_once(replace(first, refinements=1), coarse)
    assert fine.dt <= 0.5 * coarse.dt
    assert coarse.steps % 4 == fine.steps % 4 == 0
    # four times, the last at the end: a distance at the end alone would miss what swings
    problem, steps = coarse.problem, coarse.steps
    at = {state.step: state.u.copy() for state in states(problem, coarse.dt)}
    assert [u.tobytes() for u in coarse.u] == [at[k * steps // 4].tobytes() for k in (1, 2, 3, 4)]
    assert coarse.steps * coarse.dt == pytest.approx(0.3, rel=1e-14)


def test_order_of_distances():
    assert order_of(4.0, 1.0) == 2.0
    assert order_of(3.0, 1.5) == 1.0
    assert order_of(1.0, 2.0) == 0.5
    assert order_of(9.0, 1.0) == 2.0
    assert order_of(0.0, 0.0) == 2.0


def test_study_of_a_scene(tmp_path, capsys, monkeypatch):
    (tmp_path / "scene.toml").write_text(WAVE)
    words = ["study", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert "refined 2 times:" in capsys.readouterr().out
    (table,) = json.loads((tmp_path / "out" / "study.json").read_text())["tables"]
    errors = [row[table["columns"].index("estimated error")] for row in table["rows"]]
    assert len(errors) == 3
    assert 3 < errors[0] / errors[1] < 5
    levels = json.loads((tmp_path / "out" / "study.json").read_text())["levels"]
    assert [level["error"] for level in levels] == errors
    assert [level["nodes"] for level in levels] == [row[table["columns"].index("nodes")] for row in table["rows"]]
    assert (tmp_path / "out" / "study.png").stat().st_size > 10_000
    monkeypatch.setattr(estimate, "free_memory", lambda: 1.0)
    assert main(words) == 0
    assert "is left out" in (tmp_path / "out" / "study.md").read_text()
    assert estimate.estimate(Problem(Scene.parse(WAVE)))["error_estimate"] is None
    assert cost.SPARE < 1


def test_fracturing_scenes_get_a_cautious_order():
    torn = WAVE.replace('potential = "linear"', "toughness = 1e-6").replace("0.01*exp", "0.3*exp")
    told = estimate.estimate(Problem(Scene.parse(torn)))
    assert "order 0.5" in told["estimate_note"]
    assert told["error_estimate"] > 0
