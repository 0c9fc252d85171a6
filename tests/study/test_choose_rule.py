"""rule = "auto": what it chooses and why, and how far from the best that is on problems it was not made from."""

import csv
import logging
from pathlib import Path

import numpy as np
import pytest
import skfem

from bodies import box
from skfem_peridynamics import Scene
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.model.discretisation import CLASSICAL
from skfem_peridynamics.study.choose_rule import (
    BALANCED_PAIRS,
    CANDIDATES,
    Measured,
    choose,
    is_irregular,
    per_horizon,
    table,
)

SCENE = """
mesh = {{box = [[0, 1], [0, 1]], divisions = [16, 16]}}
material = {{lame = 1.0, density = 1.0, plane = "strain", {law}}}
bonds = {{horizon = 0.25, rule = "auto"{more}}}
time = {{until = 0.2, scheme = "auto"}}
output = {{pictures = false, frames = 0}}
"""


def scene(law='potential = "linear"', more=""):
    return Scene.parse(SCENE.format(law=law, more=more))


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_meshes_are_known(dim):
    lattice, random, graded = (box(dim, 10, kind) for kind in ("structured", "random", "graded"))
    assert [is_irregular(mesh) for mesh in (lattice, random, graded)] == [False, True, True]
    assert per_horizon(lattice, 0.4) == pytest.approx(4.0)
    assert per_horizon(random, 0.4) == pytest.approx(4.0, rel=0.03)  # 2.6 % measured (1D)
    assert is_irregular(skfem.MeshTri()) is False  # no vertex inside


def test_bodies_that_break_get_vertex_pairs():
    for kind, scheme in (("structured", CLASSICAL), ("random", BALANCED_PAIRS)):
        found = choose(box(2, 16, kind), 0.25, fracturing=True, tolerance=None, steps=100)
        assert found.scheme == scheme
        assert "bonds may break" in found.why
    assert choose(box(2, 16, "random"), 0.13, fracturing=True, tolerance=None, steps=100).scheme == CLASSICAL


def test_the_cheapest_that_meets_the_tolerance():
    names = [scheme.name for scheme in CANDIDATES[2][:3]]
    made = [
        Measured(2, "regular", name, m, error * (4 / m) ** 2, setup, step)
        for name, error, setup, step in (
            (names[0], 1e-2, 1e-9, 1e-6),
            (names[1], 5e-3, 1e-3, 1e-6),
            (names[2], 1e-3, 1e-2, 5e-6),
        )
        for m in (4.0, 8.0)
    ]

    def pick(tolerance, steps, m=4):
        return choose(box(2, 4 * m), 0.25, fracturing=False, tolerance=tolerance, steps=steps, measured=made)

    assert pick(2e-2, 100).scheme.name == names[0]
    assert pick(6e-3, 100).scheme.name == names[1]
    assert pick(2e-3, 100).scheme.name == names[2]
    assert pick(1e-4, 100).scheme.name == names[2]
    assert "none is to meet 0.0001" in pick(1e-4, 100).why
    assert pick(6e-3, 100, m=6).scheme.name == names[0]  # 1e-2 (4/6)^2: between the lines, log-log
    assert pick(6e-3, 100, m=6).predicted == pytest.approx(1e-2 * (4 / 6) ** 2)
    assert choose(box(3, 6), 0.4, fracturing=False, tolerance=None, steps=1, measured=made).scheme == CLASSICAL


def test_a_scene_says_what_was_chosen(caplog):
    with caplog.at_level(logging.WARNING):
        problem = Problem(scene(more=", tolerance = 2e-3"))
        assert problem.rule.name.startswith("ball")
        assert problem.mass_kind == "consistent"
    assert 'bonds.rule = "auto" takes ball' in caplog.text
    assert "the cheapest that is to meet 0.002" in caplog.text
    assert Problem(scene(law="toughness = 1.0")).discretisation == CLASSICAL
    assert Problem(scene(law="toughness = 1.0", more=", tolerance = 2e-3")).rule.name.startswith("ball")
    assert Problem(scene(), refinements=1).choice == Problem(scene()).choice


def test_keys_that_do_not_go_with_auto():
    for more, told in (
        (", radial = 3", "radial = 3 does not go with rule = 'auto'"),
        (", balanced = true", "balanced = True does not go with rule = 'auto'"),
    ):
        with pytest.raises(SceneError, match=told):
            scene(more=more)
    with pytest.raises(SceneError, match="tolerance = 0.1 goes with rule = 'auto'"):
        Scene.parse(SCENE.format(law='potential = "linear"', more=", tolerance = 0.1").replace('rule = "auto", ', ""))
    with pytest.raises(SceneError, match="mass = 'lumped' does not go with scheme = 'auto'"):
        Scene.parse(
            SCENE.format(law='potential = "linear"', more="").replace(
                'scheme = "auto"', 'scheme = "auto", mass = "lumped"'
            )
        )


def test_an_automatic_scene_runs(tmp_path, capsys):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.format(law='potential = "linear"', more=", tolerance = 2e-3"))
    assert main(["run", str(path), "--out", str(tmp_path / "out")]) == 0
    assert main(["check", str(path)]) == 0


def test_the_table_is_whole():
    for dim in (1, 2, 3):
        for mesh in ("regular", "random"):
            mine = [x for x in table() if x.dim == dim and x.mesh == mesh]
            assert {x.scheme for x in mine} >= {scheme.name for scheme in CANDIDATES[dim][:2]}
            assert all(0 < x.error < 0.5 and x.setup > 0 and x.step > 0 for x in mine)


def judge(rows, tolerances=(1e-2, 3e-3, 1e-3)):
    """Of each mesh and tolerance: what auto's choice costs (or misses) over the best candidate there was."""
    out = []
    groups = {}
    for x in rows:
        groups.setdefault((x["problem"], x["mesh"], int(x["n"])), []).append(x)
    for (problem, kind, n), mine in groups.items():
        dim, horizon = int(mine[0]["dim"]), float(mine[0]["horizon"])
        known = {s.name for s in CANDIDATES[dim]}
        runs = {x["scheme"]: (float(x["error_l2"]), float(x["seconds"])) for x in mine if x["scheme"] in known}
        mesh = auto_mesh(dim, n, kind)
        for tolerance in tolerances:
            steps = np.median([float(x["steps"]) for x in mine])
            found = choose(mesh, horizon, fracturing=False, tolerance=tolerance, steps=steps)
            if found.scheme.name not in runs:
                continue
            error, seconds = runs[found.scheme.name]
            good = [s for e, s in runs.values() if e <= tolerance]
            if good and error <= tolerance:
                out.append((problem, kind, n, tolerance, "seconds", seconds / min(good), found.scheme.name))
            else:
                best = tolerance if good else min(e for e, _ in runs.values())
                out.append((problem, kind, n, tolerance, "error", error / best, found.scheme.name))
    return out


def auto_mesh(dim, n, kind):
    from skfem_peridynamics.geometry.boxes import unit_box

    return unit_box(dim, n, kind)


def test_choices_on_problems_they_were_not_made_from():
    """Rows of docs/evidence/study kept out of the table, graded meshes and waves: within 1.5 of the best mostly."""
    rows = []
    for path in sorted((Path(__file__).parents[2] / "docs" / "evidence" / "study").glob("*.csv")):
        with open(path) as file:
            runs = [x for x in csv.DictReader(file) if "mesh" in x]
        rows += [x for x in runs if x["mesh"] == "graded" or x["problem"].startswith("waves")]
    judged = judge(rows)
    within = [x for x in judged if x[5] <= 1.5]
    for line in judged:
        print(*line[:5], f"{line[5]:.2f}", line[6])
    print(f"{len(within)} of {len(judged)} choices within 1.5 of the best")
    assert len(judged) > 20
    # measured: 64 of 74 on graded meshes and 1D waves, 12 of 36 on 2D waves, whose errors the table does not foresee
    assert len(within) >= 76
    assert sum(x[0] != "waves-2d" for x in within) >= 64
