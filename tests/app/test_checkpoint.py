"""A run that was stopped goes on to the same bytes, or says in a sentence why it does not."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
import skfem

import faults
import skfem_peridynamics as peri
from faults import ODD, RESULTS, SMALL, StopAt, Stopped, changed, leaves, results, small, stop
from skfem_peridynamics import Scene, run
from skfem_peridynamics._clock import Clock
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.files import identity
from skfem_peridynamics.app.files.checkpoint import (
    NAME,
    OLDER,
    Checkpoint,
    DamagedCheckpoint,
    latest,
    read_checkpoint,
    write_checkpoint,
)
from skfem_peridynamics.app.problem import problem as build
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.run.resume import earlier_run, restore
from skfem_peridynamics.app.run.signals import Interrupted, Signals
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.solve.instability import Watch
from skfem_peridynamics.solve.state import State

CANTILEVER = """
title = "torn"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [20, 10]}
material = {young = 1.0, toughness = 1e-4, density = 1.0, plane = "stress"}
bonds = {horizon = 0.13}
crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]
fixed = [{on = "top", component = "y", displacement = "0.02*t"}, {on = "bottom", component = "y", displacement = 0},
         {on = "right", component = "x", displacement = 0}]
no_fail = [{on = "top", width = 0.1}, {on = "bottom", width = 0.1}]
"""
SCHEMES = {
    "central difference": SMALL,
    "consistent mass, ball rule": SMALL.replace("horizon = 0.13}", 'horizon = 0.13, rule = "ball"}').replace(
        "until = 3.0", "until = 1.0"
    ),
    "any Poisson ratio, breaking": SMALL.replace('plane = "stress"', 'plane = "stress", poisson = 0.2, breaking = 1.2'),
    "Newmark": SMALL.replace("until = 3.0}", 'until = 3.0, scheme = "newmark", step = 0.1}'),
    "statics": CANTILEVER
    + 'time = {until = 1.0, scheme = "static", steps = 12}\n'
    + "output = {frames = 6, history = 12, pictures = false, checkpoint_every = 2}",
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    made = {}

    def get(name):
        if name not in made:
            out = tmp_path_factory.mktemp("whole")
            summary = run(Scene.parse(SCHEMES[name]), out)
            made[name] = results(out), summary.get("newton_iterations")
        return made[name][0]

    get.iterations = lambda name: made[name][1]

    return get


@pytest.mark.parametrize("name", SCHEMES)
def test_stopped_twice_and_gone_on_with(name, whole, tmp_path):
    scene = Scene.parse(SCHEMES[name])
    stop(scene, tmp_path, 7)
    first = read_checkpoint(tmp_path / NAME)
    assert 4 <= first.state.step <= 7
    stop(scene, tmp_path, 11, resume=True)
    assert read_checkpoint(tmp_path / NAME).state.step > first.state.step
    summary = run(scene, tmp_path, resume=True)
    assert summary["resumed_at_steps"][0] == first.state.step
    assert len(summary["resumed_at_steps"]) == 2
    assert set(results(tmp_path)) == set(RESULTS)
    assert results(tmp_path) == whole(name)
    assert summary.get("newton_iterations") == whole.iterations(name)
    assert not (tmp_path / NAME).exists()
    assert not (tmp_path / OLDER).exists()


def test_what_a_linear_solver_has_learnt_goes_along(tmp_path):
    """Without it the continued path takes other Newton steps: the multigrid cycle is made of the tangent meanwhile."""
    from bodies import body_on, box
    from skfem_peridynamics import Prescribed, mass_matrix, newmark

    mesh = box(2, 16, "random")
    body = body_on(mesh, 0.2, peri.Exponential(slope=1.0, limit=0.01))
    M = mass_matrix(body.basis)
    ends = [
        Prescribed(body.basis.nodal_dofs[:, mesh.p[0] < 0.1].ravel(), displacement=0.0),
        Prescribed(body.basis.nodal_dofs[0, mesh.p[0] > 0.9], displacement=lambda t: 2e-4 * t),
    ]
    keys = {"dt": 100.0, "until": 1200.0, "fixed": ends, "linear": "blocks", "watch": 0}
    states = [state.copy() for state in newmark(body, M, **keys)]
    learnt = [k for k, state in enumerate(states) if state.memory.tangent is not None]
    assert learnt
    assert learnt[0] + 1 < len(states)
    middle = states[learnt[0] + 1]
    *_, end = newmark(body, M, start=middle, **keys)
    assert np.array_equal(end.u, states[-1].u)
    *_, other = newmark(body, M, start=replace(middle, memory=None), **keys)
    assert not np.array_equal(other.u, states[-1].u)


def test_the_end_itself_is_a_checkpoint(whole, tmp_path):
    """Killed after the last step and before the summary."""
    scene = Scene.parse(SCHEMES["central difference"])
    last = run(scene, tmp_path / "a")["steps"]
    scene = replace(scene, output=replace(scene.output, checkpoint_every=last))

    class Late(StopAt):
        def end(self):
            raise Stopped

    with pytest.raises(Stopped):
        run(scene, tmp_path / "b", Late(10**9))
    (tmp_path / "b" / "summary.json").unlink(missing_ok=True)
    assert read_checkpoint(tmp_path / "b" / NAME).state.step == last
    assert run(scene, tmp_path / "b", resume=True)["status"] == "finished"
    assert results(tmp_path / "b") == whole("central difference")


def test_without_a_checkpoint_it_starts_afresh_and_finished_is_finished(whole, tmp_path, caplog):
    scene = Scene.parse(SCHEMES["central difference"])
    stop(scene, tmp_path, 3)
    assert not (tmp_path / NAME).exists()
    assert run(scene, tmp_path, resume=True)["resumed_at_steps"] == []
    assert results(tmp_path) == whole("central difference")
    before = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    assert run(scene, tmp_path, resume=True)["status"] == "finished"
    assert {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()} == before
    assert "is finished: there is nothing to go on with" in caplog.text
    with pytest.raises(SceneError, match=r"a finished run of another scene: time.until is 2.0 and was 3.0"):
        run(small(until=("until = 3.0", "until = 2.0")), tmp_path, resume=True)


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("until = 3.0", "until = 4.0", "time.until is 4.0 and was 3.0"),
        ("young = 1.0", "young = 2.0", "material.young is 2.0 and was 1.0"),
        ("horizon = 0.13", "horizon = 0.14", "bonds.horizon is 0.14 and was 0.13"),
        ("0.02*min(t, 1)", "0.03*min(t, 1)", "load[0].traction is [0, '0.03*min(t, 1)'] and was [0, '0.02"),
        ('component = "x", ', 'component = "y", ', "fixed[0].component is 'y' and was 'x'"),
        ("frames = 6", "frames = 7", "output.frames is 7 and was 6"),
        ("[16, 8]", "[16, 9]", "mesh.divisions is [16, 9] and was [16, 8]"),
        ("initial = ", "no_fail = [{on = 'top'}]\ninitial = ", "no_fail is not given and was []"),
    ],
)
def test_another_scene_is_refused(old, new, told, tmp_path):
    stop(small(), tmp_path, 12)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    content = SMALL.replace(old, new).replace("[0.0, 0.25], [0.5, 0.25]", "[0.0, 0.25], [0.5, 0.25]")
    if "[16, 9]" in new:
        content = content.replace("crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]\n", "")
        told = "mesh.divisions is [16, 9] and was [16, 8]"
    with pytest.raises(SceneError, match="holds the checkpoint of another run: ") as error:
        run(Scene.parse(content), tmp_path, resume=True)
    assert told in str(error.value)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_what_may_differ(whole, tmp_path):
    scene = Scene.parse(SCHEMES["central difference"])
    stop(scene, tmp_path, 12)
    other = replace(scene, title="by another name", output=replace(scene.output, checkpoint_every="1 h"))
    run(other, tmp_path, resume=True)
    assert results(tmp_path) == whole("central difference")


def test_another_version_is_refused(tmp_path, monkeypatch):
    stop(small(), tmp_path, 12)
    monkeypatch.setattr(identity, "versions", lambda: {**identity_versions, "numpy": "0.1", "numba": "none at all"})
    with pytest.raises(SceneError, match=r"another run: numpy is 0.1 and was \d.*; numba is none at all and was "):
        run(small(), tmp_path, resume=True)


identity_versions = identity.versions()


def test_another_mesh_file_is_refused(tmp_path):
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 17), np.linspace(0, 0.5, 9))
    mesh.save(str(tmp_path / "plate.vtu"))
    content = SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", 'file = "plate.vtu"')
    scene = Scene.parse(content, tmp_path)
    stop(scene, tmp_path / "out", 12)
    p = mesh.p.copy()
    p[0, 40] += 1e-9
    skfem.MeshTri(p, mesh.t).save(str(tmp_path / "plate.vtu"))
    with pytest.raises(SceneError, match="another run: the mesh in 'plate.vtu' is another than it was"):
        run(scene, tmp_path / "out", resume=True)


def test_hours_are_not_thrown_away_unasked(tmp_path, monkeypatch, capsys):
    (tmp_path / "scene.toml").write_text(SMALL)
    out = tmp_path / "out"
    stop(small(), out, 12)
    monkeypatch.setattr("skfem_peridynamics.app.run.resume.WORTH_KEEPING", 0.0)
    kept = read_checkpoint(out / NAME)
    for name, value in (("seconds", {"steps": "many"}), ("run", {"scene": [1], "versions": 7, "mesh": None})):
        write_checkpoint(tmp_path, replace(kept, facts=kept.facts | {name: value}))
        assert earlier_run(tmp_path, identity.identity(small(), Problem(small()).mesh), None) is None
    command = ["run", str(tmp_path / "scene.toml"), "--out", str(out), "--quiet"]
    assert main(command) == 2
    told = capsys.readouterr().err
    assert "of this very run, stopped at step 1" in told
    assert "go on with --resume, or start over with --overwrite" in told
    assert main([*command, "--overwrite"]) == 0
    assert json.loads((out / "summary.json").read_text())["resumed_at_steps"] == []
    stop(small(), out, 12, resume=False)
    with pytest.raises(SceneError, match=r"of another run \(time.until is 0.5 and was 3.0\), stopped at step"):
        run(small(until=("until = 3.0", "until = 0.5")), out)
    assert (out / NAME).exists()
    assert run(small(until=("until = 3.0", "until = 0.5")), out, resume=False)["status"] == "finished"


def a_state(step=3):
    x = np.arange(6.0)
    return State(0.5, step, 0.1, x, 2 * x, 3 * x, 1.0, 2.0, 0.5)


def test_two_are_kept_and_the_damaged_one_falls_back(tmp_path):
    for step in (1, 2, 3):
        write_checkpoint(tmp_path, Checkpoint(a_state(step), [(1.0, 2)], [0.5], {"a": 1}))
    assert sorted(path.name for path in tmp_path.iterdir()) == [NAME, OLDER]
    said = []
    found = latest(tmp_path, said.append)
    assert (found.state.step, said) == (3, [])
    assert found.rows == [(1.0, 2)]
    assert isinstance(found.rows[0][1], int)
    assert (found.frames, found.facts) == ([0.5], {"a": 1})
    assert np.array_equal(found.state.v, 2 * np.arange(6.0))
    content = (tmp_path / NAME).read_bytes()
    (tmp_path / NAME).write_bytes(content[:-20])
    assert latest(tmp_path, said.append).state.step == 2
    why = "its checksum does not match what it holds"
    assert said == [f"'{tmp_path / NAME}' is damaged: {why}; going on from the older one, of step 2"]
    assert not (tmp_path / NAME).exists()
    (tmp_path / OLDER).write_bytes(b"")
    with pytest.raises(DamagedCheckpoint, match="it does not begin as one, and there is no other; remove it"):
        latest(tmp_path, said.append)


def test_every_flipped_bit_and_every_length_is_noticed(tmp_path):
    write_checkpoint(tmp_path, Checkpoint(a_state(), [], [], {}))
    path = tmp_path / NAME
    content = path.read_bytes()
    for k in range(len(content)):
        for damaged in (content[:k], content[:k] + bytes([content[k] ^ (1 << k % 8)]) + content[k + 1 :]):
            path.write_bytes(damaged)
            with pytest.raises(DamagedCheckpoint, match="checkpoint"):
                read_checkpoint(path)
    path.write_bytes(content)
    assert read_checkpoint(path).state.step == 3


def signalled(tmp_path, numbers, wait, *more):
    """Run the command in a process of its own, send it signals, and return its exit code and what it said."""
    (tmp_path / "scene.toml").write_text(
        SMALL.replace("until = 3.0", "until = 2000.0").replace("checkpoint_every = 5", "checkpoint_every = 0")
    )
    process = subprocess.Popen(
        [sys.executable, "-m", "skfem_peridynamics", "run", "scene.toml", "--out", "out", *more],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    while not (tmp_path / "out" / "history.csv").exists():
        time.sleep(0.01)
        assert process.poll() is None
    time.sleep(wait)
    for number in numbers:
        process.send_signal(number)
    said = process.communicate()[1]
    return process.returncode, said


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_a_signal_leaves_a_checkpoint(number, code, tmp_path):
    found, said = signalled(tmp_path, [number], 0.3)
    assert found == code
    assert said.count("\n") == 1
    assert f"{signal.Signals(number).name}: the run was stopped at step" in said
    assert "a checkpoint was written, --resume goes on" in said
    kept = read_checkpoint(tmp_path / "out" / NAME)
    assert kept.state.step > 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["steps"] == kept.state.step
    assert not (tmp_path / "out" / ".lock").exists()


def test_a_second_signal_stops_at_once():
    """In the handler itself: the first only asks, the second finds the handler that was there before."""
    with Signals() as signals:
        signals.patient = True
        signal.raise_signal(signal.SIGINT)
        assert signals.asked == signal.SIGINT
        with pytest.raises(KeyboardInterrupt) as error:
            signal.raise_signal(signal.SIGINT)
        assert not isinstance(error.value, Interrupted)
    with Signals(), pytest.raises(Interrupted, match="SIGTERM: the run was stopped before its first step"):
        signal.raise_signal(signal.SIGTERM)


def test_signals_of_the_host_are_its_own(tmp_path):
    heard = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: heard.append(number))
    try:
        with Signals() as signals:
            signal.raise_signal(signal.SIGTERM)
            assert (heard, signals.asked) == ([signal.SIGTERM], 0)
        mine = signal.getsignal(signal.SIGTERM)
        run(small(), tmp_path / "a")
        assert signal.getsignal(signal.SIGTERM) is mine
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)
    done = []
    other = threading.Thread(target=lambda: done.append(run(small(), tmp_path / "b")["status"]))
    other.start()
    other.join()
    assert done == ["finished"]


def test_the_limit_is_not_computed_again_and_the_peak_is_known(whole, tmp_path, monkeypatch):
    scene = Scene.parse(SCHEMES["central difference"])
    stop(scene, tmp_path, 12)
    found = read_checkpoint(tmp_path / NAME)
    watch = Watch(100, None)
    assert restore(found, Problem(scene), Clock(), watch).limit == Problem(scene).limit
    assert watch.peak == found.facts["peak"] > 0.0
    undisturbed = whole("central difference")
    monkeypatch.setattr(build, "stable_time_step", None)
    run(scene, tmp_path, resume=True)
    assert results(tmp_path) == undisturbed


def test_a_clock_that_jumps(whole, tmp_path, monkeypatch):
    """Two hours forward or back: a checkpoint too many, no failure, the same bytes."""
    scene = small(every=("checkpoint_every = 5", 'checkpoint_every = "1 min"'))
    plain, wall, calls = time.monotonic, time.time, []
    assert run(scene, tmp_path / "steady")["checkpoints"] == 0
    for jump in (-7200.0, 7200.0):
        calls.clear()

        def jumping(jump=jump):
            calls.append(None)
            return plain() + (jump if len(calls) > 5 else 0.0)

        with monkeypatch.context() as patch:
            patch.setattr(time, "monotonic", jumping)
            patch.setattr(time, "time", lambda: wall() - 10.0**9)
            assert run(scene, tmp_path / str(jump))["checkpoints"] == 1
        assert results(tmp_path / str(jump)) == whole("central difference")


@pytest.mark.slow
def test_any_number_of_threads_and_a_kill_in_between(tmp_path):
    """One core, then two, BLAS with one thread, then two: 10,302 unknowns, above which BLAS splits its sums."""
    (tmp_path / "scene.toml").write_text(
        SMALL.replace("[16, 8]", "[100, 50]").replace("0.13", "0.031").replace("until = 3.0", "until = 0.8")
    )
    program = """
import os, sys
cores = set(list(os.sched_getaffinity(0))[:int(sys.argv[1])])
os.sched_setaffinity(0, cores)
os.environ["OPENBLAS_NUM_THREADS"] = sys.argv[1]
sys.path.insert(0, sys.argv[4])
from faults import StopAt, Stopped
from skfem_peridynamics import Scene, run
try:
    run(Scene.read("scene.toml"), sys.argv[2], StopAt(int(sys.argv[3])), resume=True)
except Stopped:
    pass
"""
    for cores, out, at in ((1, "one", 10**9), (2, "two", 10**9), (1, "both", 20), (2, "both", 10**9)):
        subprocess.run(
            [sys.executable, "-c", program, str(cores), out, str(at), os.path.dirname(faults.__file__)],
            cwd=tmp_path, check=True,
        )  # fmt: skip
    one, two, both = (results(tmp_path / name) for name in ("one", "two", "both"))
    assert set(one) == set(RESULTS)
    assert one == two == both


def test_a_scene_comes_back_from_the_summary(tmp_path):
    run(small(), tmp_path / "a")
    kept = json.loads((tmp_path / "a" / "summary.json").read_text())["run"]
    assert set(kept) == {"scene", "mesh", "versions"}
    assert {"numpy", "scipy", "scikit-fem", "numba", "python", "skfem-peridynamics"} <= set(kept["versions"])
    run(Scene.of(kept["scene"]), tmp_path / "b")
    assert results(tmp_path / "a") == results(tmp_path / "b")


@pytest.mark.slow
@pytest.mark.parametrize("name", SCHEMES)
def test_right_checksums_and_wrong_facts(name, tmp_path):
    """Each fact of a checkpoint replaced by each of many others: taken where it fits, or refused in a sentence."""
    scene = Scene.parse(SCHEMES[name])
    stop(scene, tmp_path, 7)
    first, header, rest = (tmp_path / NAME).read_bytes()[:-65].split(b"\n", 2)
    header = json.loads(header)
    kept = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    refused = 0
    for path in leaves(header):
        if path[:2] == ("facts", "run"):
            continue  # compared whole
        for new in ODD:
            content = b"\n".join([first, json.dumps(changed(header, path, new)).encode(), rest])
            (tmp_path / NAME).write_bytes(content + hashlib.sha256(content).hexdigest().encode() + b"\n")
            (tmp_path / OLDER).unlink(missing_ok=True)
            try:
                problem = Problem(scene)
                earlier = earlier_run(tmp_path, identity.identity(scene, problem.mesh), True)
                restore(earlier, problem, Clock("setup", "steps", "output", "cfl"), Watch(100, None))
            except SceneError:
                refused += 1
            for known, bytes_before in kept.items():
                if known != NAME:
                    (tmp_path / known).write_bytes(bytes_before)
    assert refused > 300
    print(f"\n{name}: {refused} refused")


@pytest.mark.parametrize(
    ("name", "value"), [("eigenvalue", 0.0), ("eigenvalue", 1e-90), ("eigenvalue", 1e12), ("residual", 1e9)]
)
def test_a_limit_that_does_not_give_the_step(name, value, tmp_path):
    stop(small(), tmp_path, 12)
    kept = read_checkpoint(tmp_path / NAME)
    limit = {**kept.facts["limit"], name: value}
    write_checkpoint(tmp_path, replace(kept, facts=kept.facts | {"limit": limit}))
    with pytest.raises(SceneError, match="its step is not that of its limit"):
        run(small(), tmp_path, resume=True)


WITHOUT_A_BOUND = {
    "1D": """
mesh = {box = [[0, 1]], divisions = [40]}
material = {young = 1.0, toughness = 1.0, density = 1.0}
bonds = {horizon = 0.1}
initial = {velocity = ["1e-3*x"]}
""",
    "one-sided": """
mesh = {box = [[0, 1], [0, 1]], divisions = [8, 8]}
material = {young = 1.0, toughness = 1.0, density = 1.0, plane = "stress"}
bonds = {horizon = 0.3, rule = "ball", symmetric = false}
initial = {velocity = ["1e-3*x", "0"]}
""",
}


@pytest.mark.parametrize("kind", WITHOUT_A_BOUND)
def test_a_run_without_a_bound_of_its_step_goes_on(kind, tmp_path):
    """In 1D the closed form is infinite, of a one-sided rule with the consistent mass the nodal bound, too."""
    mass = ', mass = "consistent"' if kind == "one-sided" else ""
    ending = f"time = {{until = 1.0, step = 0.01{mass}}}\n"
    ending += "output = {frames = 0, history = 20, pictures = false, checkpoint_every = 10}\n"
    scene = Scene.parse(WITHOUT_A_BOUND[kind] + ending)
    stop(scene, tmp_path / "stopped", 45)
    assert run(scene, tmp_path / "stopped", resume=True)["resumed_at_steps"]
    run(scene, tmp_path / "whole")
    ours, theirs = ((tmp_path / folder / "history.csv").read_bytes() for folder in ("stopped", "whole"))
    assert ours == theirs


@pytest.mark.parametrize(
    "limit", [{"eigenvalue": 0.0, "nodal_bound": 0.0}, {"nodal_bound": -1.0}, {"closed_form": "x"}]
)
def test_a_limit_without_a_step_is_none(limit, tmp_path):
    stop(small(), tmp_path, 7)
    known = read_checkpoint(tmp_path / "checkpoint.bin")
    facts = known.facts | {"limit": known.facts["limit"] | limit}
    write_checkpoint(tmp_path, replace(known, facts=facts))
    with pytest.raises(SceneError, match="its step limit is none"):
        run(small(), tmp_path, resume=True)
