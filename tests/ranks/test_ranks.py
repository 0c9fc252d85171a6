"""Bodies and runs over several processes beside the whole: needs MPI, PETSc and SLEPc, as the extra mpi brings them."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import meshio
import numpy as np
import pytest
from over_ranks import (
    PLATE,
    SLOW,
    environment,
    history,
    launch,
    launch_run,
    mpiexec,
    needs_mpi,
    off,
    ranks_of,
    wait_for,
    wait_until,
)

from skfem_peridynamics import PairRule, Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.ranks.lead import refuse
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.geometry.boxes import unit_box
from skfem_peridynamics.ranks.distributed import reach_of, work_of_vertices
from skfem_peridynamics.ranks.share import divided, shares
from skfem_peridynamics.ranks.world import _wait_for_reader

HERE = Path(__file__).parent


# ---- without MPI
def test_parts_have_equal_weights():
    mesh = unit_box(2, 20, "graded")
    weight = 1 + 3 * mesh.p[0]
    for parts in (1, 2, 3, 7):
        owner = divided(mesh.p, weight, parts)
        sums = np.bincount(owner, weight, parts)
        assert sums.max() < 1.05 * sums.mean()
    assert len(np.unique(divided(np.arange(5.0)[None], np.array([9.0, 1, 1, 1, 1]), 5))) == 5


def test_shares_hold_what_bonds_of_their_vertices_need():
    """Every element within reach of an own vertex; own vertices first; each vertex owned once."""
    mesh = unit_box(2, 12, "random").with_subdomains({"low": np.arange(40)})
    owner = divided(mesh.p, np.ones(mesh.nvertices), 3)
    found = list(shares(mesh, owner, 0.3))
    assert sorted(np.concatenate([s.number[: s.own] for s in found]).tolist()) == list(range(mesh.nvertices))
    for share in found:
        assert (owner[share.number[: share.own]] == share.rank).all()
        assert (owner[share.number[share.own :]] != share.rank).all()
        assert np.array_equal(share.mesh.p, mesh.p[:, share.number])
        near = np.linalg.norm(mesh.p[:, None, :] - mesh.p[:, share.number[: share.own], None], axis=0).min(axis=0) < 0.3
        wanted = {tuple(sorted(t)) for t in mesh.t.T[near[mesh.t].any(axis=0)]}
        there = [tuple(sorted(t)) for t in share.number[share.mesh.t].T]
        assert set(there) == wanted
        low = {tuple(sorted(t)) for t in mesh.t.T[:40]} & wanted
        assert {there[k] for k in share.mesh.subdomains["low"]} == low
    assert len({int(p) for s in found for p in s.place[: s.own]}) == mesh.nvertices


REFUSED = {
    "time.scheme = 'newmark' with material.breaking": ("density = 1.0", "density = 1.0, breaking = 1.5"),
    'material.calibrate = "discrete" with bonds.rule = "gauss_pairs"': (
        'density = 1.0, plane = "stress"}\nbonds = {',
        'density = 1.0, plane = "stress", calibrate = "discrete"}\nbonds = {rule = "gauss_pairs", ',
    ),
}


@pytest.mark.parametrize("told", REFUSED)
def test_what_does_not_go_yet_is_said(told):
    old, new = REFUSED[told]
    newmark = PLATE.replace("until = 2.0", 'until = 2.0, scheme = "newmark", step = 0.1')
    refuse(Scene.parse(newmark))
    with pytest.raises(SceneError, match=f"{told}: does not go with --mpi yet"):
        refuse(Scene.parse(newmark.replace(old, new, 1)))


# ---- with it
@needs_mpi
@pytest.mark.parametrize("n", [1, 2, 3])
def test_operators_are_those_of_the_whole(n):
    """At a torn state of a plate with a slit and no-fail vertices; 36 steps; the step limit."""
    ended = launch(n, HERE / "operators.py", HERE.parents[0] / "support")
    assert ended.returncode == 0, ended.stderr[-2000:]
    found = json.loads(ended.stdout.splitlines()[-1])
    print(n, found)
    for name in ("force", "stiffness", "Z", "elastic", "energy", "area"):
        assert found[name] < 1e-14, name
    assert found["softened"][0] == found["softened"][1] > 1000
    assert found["intact"]
    assert found["eigenvalue"] < 1e-12
    assert max(found[name] for name in ("nodal", "row_sum", "closed")) < 1e-14
    counts, whole = found["bonds"]
    assert sum(counts) == whole
    assert max(counts) < 1.05 * whole / n
    assert found["moved"] < 1e-13
    assert found["energies"][0] == pytest.approx(found["energies"][1], rel=1e-12)
    assert found["steps"] == 36
    if n == 1:
        assert found["same_force"]
        assert found["same_motion"]


@needs_mpi
@pytest.mark.parametrize("n", [1, 2, 3])
def test_balanced_weights_are_those_of_the_whole(n):
    """Lines, a slit plate, a block; compiled loops and sparse products. Sums are taken in another order."""
    ended = launch(n, HERE / "balanced.py", HERE.parents[0] / "support")
    assert ended.returncode == 0, ended.stderr[-2000:]
    for name, apart in json.loads(ended.stdout.splitlines()[-1]).items():
        print(n, name, apart)
        assert apart["force"] < 1e-14, name  # 5e-16 found
        assert apart["product"] < 1e-14, name
        assert apart["unlike"] > 1e-3, name  # without balance it would be another body
        assert max(apart["figures"]) < 1e-14, name
        assert apart["unbalanced"], name
        assert apart["bonds"][0] == apart["bonds"][1], name


# ranks and what is computed over them; of one rank what shows that it computes the bits of the whole
OTHERS = {1: ("Gauss pairs", "balls", "one-sided balls", "poisson 0.2"), 2: ("even",), 3: ("odd",)}


@needs_mpi
@pytest.mark.parametrize("n", OTHERS)
def test_other_rules_masses_and_poisson_ratios_are_those_of_the_whole(n):
    """At a torn state; the consistent mass and its solve; the step limits and four steps of both masses."""
    assert len(compare_rules(n, *OTHERS[n])) in (4, 11, 12)


@needs_mpi
@pytest.mark.long
@pytest.mark.parametrize("n", [2, 3, 4])
def test_all_rules_masses_and_poisson_ratios_are_those_of_the_whole(n):
    assert len(compare_rules(n)) == 23


def compare_rules(n, *chosen):
    ended = launch(n, HERE / "rules.py", HERE.parents[0] / "support", *chosen)
    assert ended.returncode == 0, ended.stderr[-2000:]
    cases = json.loads(ended.stdout.splitlines()[-1])
    for name, found in cases.items():
        print(n, name, found)
        for key in ("force", "product", "energy", "Z", "elastic", "area", "mass", "solve", "moments"):
            assert found[key] < 1e-14, (name, key)  # 2e-15 found
        assert found["stress"] < 2e-14, name  # 4e-15 found: balls of other ranks end in a vertex, too
        assert found["intact"] < 1e-14, name
        counts, whole = found["bonds"]
        assert sum(counts) == whole, name
        assert found["softened"][0] == found["softened"][1] > 0.02 * whole, name
        for eigenvalue, *bounds, alone in found["limits"]:
            assert eigenvalue < 1e-12, name
            assert alone < 1e-12, name
            assert max(bounds) < 1e-14, name
        assert max(found["moved"]) < 2e-14, name  # 3e-15 found
        if n == 1 and "balanced" not in name:
            assert found["same_force"], name
    return cases


@needs_mpi
@pytest.mark.parametrize("n", [1, 3])
def test_scripts_step_implicitly_over_ranks(n):
    """The same functions as of one process, on every rank; what the first refuses all do."""
    ended = launch(n, HERE / "implicit.py", HERE.parents[0] / "support")
    assert ended.returncode == 0, ended.stderr[-2000:]
    for name, found in json.loads(ended.stdout.splitlines()[-1]).items():
        print(n, name, found)
        assert found["softened"] > 10
        for key in ("static", "reaction", "elastic", "imbalance", "lumped", "consistent", "limit"):
            assert found[key] < 1e-11, (name, key)  # 2e-15 found
        assert max(found["left"]) < 1e-13, name  # what is left of a stiffness, at rest and torn: 6e-16 found
        assert len(found["said"]) == n
        assert all(
            said == ["steps = 0 must be a whole numb", "the part of the body with the "] for said in found["said"]
        )


@needs_mpi
def test_arguments_that_make_no_sense_are_refused_by_all(tmp_path):
    """In the same sentence; a body that is left open at the end is no crash."""
    ended = launch(2, HERE / "arguments.py", HERE.parents[0] / "support")
    assert ended.returncode == 0, ended.stderr[-2000:]
    one, other = json.loads(ended.stdout.splitlines()[-1])
    assert one == other
    told = {
        "w": "boundary_function",
        "mesh": "mesh = None",
        "quadrilaterals": "MeshQuad",
        "rule": "'ball'",
        "breaking and Poisson": "Poisson ratio",
        "scatter": "(3,)",
        "mass": "positive",
        "numbers": "without --mpi",
        "foreign": "not bonds of this body",
        "closed": "closed",
    }
    for name, sentence in one.items():
        print(name, "->", sentence)
        assert told.get(name, name.split(",")[0]) in sentence, name


QUIVER = """
mesh = {box = [[0, 1], [0, 0.5]], divisions = [20, 10]}
material = {young = 1.0, toughness = 1e-5, density = 1.0, plane = "stress"}
bonds = {horizon = 0.17}
time = {until = 5, safety = 1.0}
initial = {velocity = ["2e-2*sin(50*x)", "2e-2*cos(70*y)"]}
output = {frames = 2, history = 400, pictures = false, checkpoint_every = 50}
"""
UNSTABLE = {
    "rows": [],
    "steps": [
        ("until = 5, safety = 1.0", "until = 500, step = 0.5, above_limit = true"),
        ("history = 400", "history = 2"),
        ("1e-5", "1e-3"),
        ('"2e-2*sin(50*x)", "2e-2*cos(70*y)"', '"1e-2*x", "0"'),
    ],
    "newmark": [
        ("until = 5, safety = 1.0", 'until = 10, scheme = "newmark", step = 1.0'),
        ("1e-5", "1e-3"),
        ("initial", 'fixed = [{on="left",displacement="0"},{on="right",displacement="1e3*t**3"}]\ninitial'),
    ],
    "one-sided": [
        ("until = 5, safety = 1.0", 'until = 1, scheme = "newmark", step = 0.1'),
        (" = 0.17", ' = 0.17, rule = "ball", symmetric = false'),
    ],
}


@needs_mpi
@pytest.mark.parametrize("name", UNSTABLE)
def test_runs_end_over_ranks_as_they_do_alone(name, tmp_path, capsys):
    """Unstable ones with the same sentence, of the vertex of the whole mesh; what no scheme takes."""
    scene = QUIVER
    for old, new in UNSTABLE[name]:
        assert old in scene
        scene = scene.replace(old, new)
    (tmp_path / "scene.toml").write_text(scene)
    alone = main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "one"), "--quiet"])
    said = capsys.readouterr().err.splitlines()[-1]
    ended = launch_run(3, tmp_path / "ranks", text=scene)
    assert ended.returncode == alone == 2, ended.stderr[-2000:]
    assert "Traceback" not in ended.stderr
    print(ended.stderr.splitlines()[-1])
    if name == "rows":  # found by the first rank alone, which has to know the limit for it
        assert "times the stable limit" in said
        assert "times the stable limit" in ended.stderr
    where = "; dt =" if name != "one-sided" else "; take"
    assert (
        ended.stderr.splitlines()[-1].split(where)[0].split(": its energy")[0]
        == said.split(where)[0].split(": its energy")[0]
    )


@pytest.fixture(scope="module")
def serial(tmp_path_factory):
    folder = tmp_path_factory.mktemp("serial") / "out"
    run(Scene.parse(PLATE), folder)
    return folder


@needs_mpi
def test_runs_are_those_of_one_process(serial, tmp_path):
    """All columns of the history, the frames but for round-off, and the same bits from as many ranks."""
    for n in (1, 2, 3):
        ended = launch_run(n, tmp_path / f"of{n}")
        assert ended.returncode == 0, ended.stderr[-2000:]
        rows = history(tmp_path / f"of{n}")
        print(n, off(rows, history(serial)))
        assert off(rows, history(serial)) < 1e-11
        assert (rows[:, 8] == history(serial)[:, 8]).all()
        summary = json.loads((tmp_path / f"of{n}" / "summary.json").read_text())
        assert summary["status"] == "finished"
        assert summary["softened_bonds"] > 100
        assert len(list((tmp_path / f"of{n}").glob("frame_*.vtu"))) == 3
    assert launch_run(3, tmp_path / "again").returncode == 0
    for name in ("history.csv", "frame_0002.vtu"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "of3" / name).read_bytes()


@needs_mpi
def test_cfl_over_ranks_is_that_of_one_process(tmp_path):
    """The bounds to round-off, the eigenvalue to the half per cent of the two Lanczos."""
    (tmp_path / "scene.toml").write_text(PLATE)
    ended = launch(3, "-P", "-m", "skfem_peridynamics", "cfl", tmp_path / "scene.toml", "--mpi", "--json")
    assert ended.returncode == 0, ended.stderr[-2000:]
    found, limit = json.loads(ended.stdout), Problem(Scene.parse(PLATE)).limit
    assert found["bonds"] == Problem(Scene.parse(PLATE)).bonds.nbonds
    for name in ("nodal_bound", "row_sum", "closed_form"):
        assert found["step_limits"][f"by_{name}"] == pytest.approx(limit.steps()[name], rel=1e-12)
    assert found["stable_step"] == pytest.approx(limit.dt, rel=5e-3)  # 3e-5 found
    ended = launch(2, "-P", "-m", "skfem_peridynamics", "cfl", "--mesh", "none.msh", "--horizon", "1", "--mpi")
    assert ended.returncode == 2
    assert ended.stderr.count("--young") == 1


def test_check_tells_what_each_process_would_have(tmp_path, capsys):
    """The vertices and ghosts of the shares that a run deals out, and what does not go."""
    scene = tmp_path / "scene.toml"
    scene.write_text(PLATE)
    assert main(["check", str(scene), "--mpi", "3"]) == 0
    mesh = Problem(Scene.parse(PLATE)).mesh
    rule = PairRule()
    dealt = list(shares(mesh, divided(mesh.p, work_of_vertices(mesh, 0.085, rule), 3), reach_of(mesh, 0.085, rule)))
    own = [share.own for share in dealt]
    ghosts = [share.mesh.nvertices - share.own for share in dealt]
    told = next(line for line in capsys.readouterr().out.splitlines() if "processes" in line)
    words = f"3: {min(own)} to {max(own)} vertices each, {min(ghosts)} to {max(ghosts)} ghosts"
    assert words in told
    newmark = PLATE.replace("until = 2.0", 'until = 2.0, scheme = "newmark", step = 0.1')
    scene.write_text(newmark.replace("density = 1.0", "density = 1.0, breaking = 1.5"))
    assert main(["check", str(scene), "--mpi", "3"]) == 2
    assert "breaking" in capsys.readouterr().err
    scene.write_text(PLATE.replace("density = 1.0", "density = 1.0, breaking = 1.5, poisson = 0.2"))
    assert main(["check", str(scene), "--mpi", "3"]) == 2
    assert "breaking with material.poisson" in capsys.readouterr().err
    scene.write_text(PLATE)
    assert main(["check", str(scene), "--mpi", "100000"]) == 2
    assert "too many" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["check", str(scene), "--mpi", "0"])
    assert "whole number" in capsys.readouterr().err


TOUGH = PLATE.replace("toughness = 2e-4", "toughness = 2e-3")
STRESS = ("frames = 3", 'frames = 3, fields = ["stress", "strain"]')
SCENES = {
    "balanced": [("horizon =", "balanced = true, horizon =")],
    "w": [("horizon =", 'boundary_function = "smooth", horizon =')],
    "balls": [
        ("horizon =", 'rule = "ball", horizon ='),
        ("2.0}\nin", "0.6, step = 0.03}\nin"),
        STRESS,
    ],
    "poisson": [
        ('plane = "stress"', 'plane = "stress", poisson = 0.2'),
        ("young = 2.0}", "young = 2.0, poisson = 0.4}"),
        ("\ntime", "\nmeasure = {crack = true, j_integral = 0.18, reactions = true}\ntime"),
        STRESS,
    ],
    "corners": [("horizon =", 'rule = "corners", horizon ='), ("2.0}\nin", "2.0, step = 0.03}\nin")],
    "breaking": [("density = 1.0", "density = 1.0, breaking = 1.5"), ("toughness = 2e-3", "toughness = 5e-4")],
    "newmark": [
        ("until = 2.0", 'until = 1.0, scheme = "newmark", step = 0.1'),
        ('plane = "stress"', 'plane = "stress", poisson = 0.2'),
    ],
    "static": [
        ("until = 2.0", 'until = 1.0, scheme = "static", steps = 10'),
        ('initial = {velocity = ["2e-3*x", "1e-3"]}\n', ""),
        ("fixed = [", 'fixed = [{on = "left", component = "y", displacement = "0"}, '),
        ('"0", "0.02*min', '"1e-3*t", "0.008*min'),
        ('"-0.02*min', '"-0.008*min'),
        ("toughness = 2e-3", "toughness = 4e-3"),
        STRESS,
    ],
    "consistent": [("until = 2.0", 'until = 2.0, mass = "consistent", step = 0.015')],
}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plain") / "out"
    run(Scene.parse(TOUGH), folder)
    return folder


# the bodies of these are compared in test_other_rules, too
LATER = ("w", "corners")


@needs_mpi
@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.long] * (name in LATER)) for name in SCENES])
def test_other_scenes_are_those_of_one_process(name, plain, tmp_path):
    """Rows, summary and the fields of a frame; inclusions, no-fail vertices, loads and motions as in the plate."""
    scene = TOUGH
    for old, new in SCENES[name]:
        assert old in scene
        scene = scene.replace(old, new, 1)
    assert launch_run(3, tmp_path / "ranks", text=scene).returncode == 0
    summary = run(Scene.parse(scene), tmp_path / "whole")
    assert off(history(tmp_path / "ranks"), history(tmp_path / "whole")) < 1e-11  # 2e-14 found
    if name == "breaking":
        assert summary["broken_bonds"] > 100
    found = json.loads((tmp_path / "ranks" / "summary.json").read_text())
    for key in (
        "bonds",
        "softened_bonds",
        "unbalanced_vertices",
        "smallest_weight_ratio",
        "status",
        "rule",
        "broken_bonds",
    ):
        assert found.get(key) == pytest.approx(summary.get(key)), key
    ours, theirs = (meshio.read(tmp_path / run / "frame_0002.vtu").point_data for run in ("ranks", "whole"))
    assert sorted(ours) == sorted(theirs)
    assert ("stress" in ours) == (STRESS in SCENES[name])
    for key, field in theirs.items():
        assert np.abs(ours[key] - field).max() <= 1e-6 * np.abs(field).max(), key  # frames are in single precision
    if name in ("newmark", "static"):
        assert found["newton_iterations"] == summary["newton_iterations"] > 10
    elif name not in ("balls", "corners", "consistent"):  # without what is asked for it is another motion
        assert off(history(tmp_path / "ranks")[-1:, :8], history(plain)[-1:, :8]) > 1e-4


BREAKING = SLOW.replace("density = 1.0", "density = 1.0, breaking = 1.5").replace(
    "toughness = 2e-3", "toughness = 5e-4"
)


@needs_mpi
@pytest.mark.parametrize(("first", "then", "slow"), [(3, 1, SLOW), (3, 2, SLOW), (1, 3, SLOW), (3, 0, BREAKING)])
def test_runs_are_gone_on_with_by_other_numbers_of_ranks(first, then, slow, serial, tmp_path):
    """Stopped by SIGTERM at a checkpoint; the motion is that of a run that was not stopped; so for broken bonds.

    0 is a run without MPI.
    """
    folder = tmp_path / "out"
    (tmp_path / "scene.toml").write_text(slow)
    words = ("-P", "-m", "skfem_peridynamics", "run", tmp_path / "scene.toml", "--out", folder, "--mpi", "--quiet")
    with subprocess.Popen(mpiexec(first, *words), env=environment(), stderr=subprocess.DEVNULL) as process:
        wait_for(folder / "checkpoint.bin", process)
        if slow == BREAKING:  # until some bonds have broken
            wait_until(lambda: b'"broken": [[[' in (folder / "checkpoint.bin").read_bytes()[: 10**6], process)
        process.send_signal(signal.SIGTERM)
        assert process.wait(timeout=60) != 0
    if then:
        ended = launch_run(then, folder, "--resume", text=slow)
        assert ended.returncode == 0, ended.stderr[-2000:]
    else:
        run(Scene.parse(slow), folder, resume=True)
    run(Scene.parse(slow), tmp_path / "whole")
    print(first, then, off(history(folder), history(tmp_path / "whole")))
    assert off(history(folder), history(tmp_path / "whole")) < 1e-11
    assert json.loads((folder / "summary.json").read_text())["resumed_at_steps"]


@needs_mpi
@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="finds ranks by /proc")
def test_a_rank_that_is_killed_ends_the_run_and_nothing_is_lost(serial, tmp_path):
    slow = SLOW
    for attempt in range(3):
        folder = tmp_path / f"out{attempt}"
        (tmp_path / "scene.toml").write_text(slow)
        words = ("-P", "-m", "skfem_peridynamics", "run", tmp_path / "scene.toml", "--out", folder, "--mpi", "--quiet")
        with subprocess.Popen(mpiexec(2, *words), env=environment(), stderr=subprocess.DEVNULL) as process:
            wait_for(folder / "checkpoint.bin", process)
            time.sleep(0.1 * attempt)
            ranks = ranks_of(process)
            assert len(ranks) >= 2
            os.kill(ranks[attempt % 2], signal.SIGKILL)
            before = time.monotonic()
            assert process.wait(timeout=10) != 0
        print(f"ended within {time.monotonic() - before:.1f} s")
    ended = launch_run(2, folder, "--resume", text=slow)
    assert ended.returncode == 0, ended.stderr[-2000:]
    assert json.loads((folder / "summary.json").read_text())["status"] == "finished"
    run(Scene.parse(slow), tmp_path / "whole")
    assert off(history(folder), history(tmp_path / "whole")) < 1e-11


@needs_mpi
def test_mistakes_end_all_ranks(tmp_path):
    """A key that is none; a formula that is no number at a place of the last rank alone, at a later time."""
    ended = launch_run(3, tmp_path / "a", text=PLATE.replace("horizon", "horizn"))
    assert ended.returncode == 2
    assert ended.stderr.count("horizn") == 1
    late = PLATE.replace('["0", "1e-3"]', '["0", "1e-3*sqrt(1.5 - t - 0.6*x)"]')
    begin = time.monotonic()
    ended = launch_run(3, tmp_path / "b", text=late)
    assert ended.returncode != 0
    assert time.monotonic() - begin < 60
    assert "sqrt" in ended.stderr


LOST = {
    "no_fail": (PLATE.replace("0.1 - x", "-1 - x"), "no_fail[0] selects no vertex"),
    "shear": (
        "mesh = {box = [[0, 1], [0, 1]], divisions = [12, 12]}\nbonds = {horizon = 0.05}",
        "no bond resists a shear",
    ),
    "lonely": ("mesh = {box = [[0, 1]], divisions = [10]}\nbonds = {horizon = 0.03}", "without a bond"),
    "few": ("mesh = {box = [[0, 1]], divisions = [2]}\nbonds = {horizon = 0.6}", "processes are too many"),
    "late": (PLATE.replace('"1e-3*sin(t)*y"', '"1e-3*sqrt(1 - t)"'), "sqrt"),
}
REST = """
material = {young = 1.0, toughness = 1.0, density = 1.0}
initial = {velocity = ["1e-3*x"]}
time = {until = 1.0}
output = {frames = 0, pictures = false}
"""


@needs_mpi
@pytest.mark.parametrize("what", LOST)
def test_what_is_found_when_all_have_begun_ends_all(what, tmp_path):
    """In a sentence, with the code of a mistake, and no rank waits for ever."""
    scene, told = LOST[what]
    rest = REST if "time" not in scene else ""
    if what == "shear":
        rest = rest.replace("density = 1.0", 'density = 1.0, plane = "strain"').replace('["1e-3*x"]', '["1e-3*x", "0"]')
    ended = launch_run(3, tmp_path / "out", text=scene + rest)
    assert ended.returncode == 2, ended.stderr[-2000:]
    assert told in ended.stderr
    assert "Traceback" not in ended.stderr


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of Unix")
def test_the_end_waits_until_its_reason_is_read():
    """A launcher that hears of the end first drops what is left in the pipes of its processes."""
    reader, writer = os.pipe()
    with open(reader, "rb") as launcher, open(writer, "w") as stream:
        stream.write("the reason")
        stream.flush()
        read = threading.Timer(0.3, launcher.read1)
        begin = time.monotonic()
        read.start()
        _wait_for_reader(stream)
        assert 0.25 < time.monotonic() - begin < 2.0
        read.join()
        begin = time.monotonic()
        _wait_for_reader(stream)
        assert time.monotonic() - begin < 0.1


@needs_mpi
def test_a_body_loaded_from_rest_is_no_unstable_run(tmp_path):
    """Where nothing has moved the balance is round-off of ripples, whose sums are taken in another order."""
    scene = """
mesh = {box = [[0, 1], [0, 1]], divisions = [16, 16]}
material = {young = 1.0, toughness = 1.0, density = 1.0, plane = "strain"}
bonds = {horizon = 0.2}
load = [
  {traction = ["0.3", "0"], on = "right", layer = 0.2},
  {traction = ["-0.3", "0"], on = "left", layer = 0.2},
]
time = {until = 1.0}
output = {frames = 0, pictures = false}
"""
    for n in (2, 3):
        ended = launch_run(n, tmp_path / f"of{n}", text=scene)
        assert ended.returncode == 0, ended.stderr[-2000:]
