"""What whoever prepared a folder, a file or a stream can do to a run: nothing outside the folder, and no silence."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

import faults
from faults import SMALL, results, small
from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.cli.streams import Stream
from skfem_peridynamics.app.files.whole_files import OutputError
from skfem_peridynamics.app.run.signals import Interrupted
from skfem_peridynamics.app.scene.reading import SceneError

COMMAND = str(Path(sys.executable).with_name("skfem-peridynamics"))
OFF = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 1 3 2\n"
SHADOWS = (
    "numpy",
    "scipy",
    "meshio",
    "matplotlib",
    "skfem",
    "numba",
    "tomllib",
    "pyamg",
    "PIL",
    "json",
    "re",
    "logging",
)


def slow(*values):
    """Parameters of the second tier."""
    return [pytest.param(value, marks=pytest.mark.slow) for value in values]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "out"
    run(small(), out)
    return results(out)


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        "check scene.toml",
        "check foreign.toml",
        "cfl scene.toml --json",
        "cfl --mesh plate.off --horizon 1.5 --young 1 --density 1 --plane stress",
        "run scene.toml --out made --report",
        "plot done --animate",
        "study --list",
        "study scene.toml --quick --out studied",
        "stability --quick --only units --out judged",
    ],
)
def test_nothing_of_the_working_folder_is_executed(arguments, tmp_path, whole):
    """Files named as modules beside the scene, and a package of each name: the command of the console never looks."""
    (tmp_path / "scene.toml").write_text(SMALL)
    foreign = SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", 'file = "plate.off"')
    (tmp_path / "foreign.toml").write_text(
        foreign.replace("crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]", "").replace(
            "horizon = 0.13", "horizon = 1.5"
        )
    )
    (tmp_path / "plate.off").write_text(OFF)
    if "done" in arguments:
        run(small(), tmp_path / "done")
    trap = f"open({str(tmp_path / 'EXECUTED')!r}, 'w').close()\n"
    for name in SHADOWS:
        (tmp_path / f"{name}.py").write_text(trap)
        (tmp_path / "done" / f"{name}.py").write_text(trap) if (tmp_path / "done").exists() else None
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    done = subprocess.run(
        [COMMAND, *arguments.split()], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120
    )
    assert not (tmp_path / "EXECUTED").exists()
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr


def command(tmp_path, arguments, tail, **environment):
    """Run the command in a shell, with something done to its streams; give the code of the command itself."""
    script = f"{COMMAND} {arguments} {tail}; exit ${{PIPESTATUS[0]}}"
    return subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env={**os.environ, **environment}, capture_output=True, timeout=120
    )


@pytest.mark.parametrize("tail", ["| head -1", *slow(">&-", "2>&-", ">&- 2>&- <&-", "| true")])
def test_a_closed_stream_never_ends_a_run(tail, tmp_path, whole):
    (tmp_path / "scene.toml").write_text(SMALL)
    done = command(tmp_path, "run scene.toml --out out", tail)
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    assert b"Exception ignored" not in done.stderr
    assert results(tmp_path / "out") == whole
    assert not list((tmp_path / "out").glob("checkpoint*"))


@pytest.mark.slow
def test_a_table_that_cannot_be_written_is_no_success(tmp_path):
    (tmp_path / "scene.toml").write_text(SMALL)
    assert command(tmp_path, "cfl scene.toml", "| true").returncode == 0
    for tail, why in (("> /dev/full", b"No space left"), (">&-", b"it is closed")):
        if "full" in tail and not os.path.exists("/dev/full"):
            continue
        done = command(tmp_path, "cfl scene.toml --json", tail)
        assert done.returncode == 1
        assert done.stderr.startswith(b"skfem-peridynamics: standard output cannot be written: " + why)
        assert done.stderr.count(b"\n") == 1


@pytest.mark.parametrize("letters", ["ascii", *slow("latin-1", "utf-8")])
def test_terminals_of_few_letters_and_names_that_are_no_text(letters, tmp_path, whole):
    scene = os.fsencode(tmp_path) + b"/sc\xff\xe9ne.toml"
    try:
        with open(scene, "wb") as file:
            file.write(SMALL.replace('title = "small"', 'title = "\u2603 caf\u00e9"').encode())
    except OSError:
        pytest.skip("this file system has names of UTF-8 only")
    out = os.fsencode(tmp_path) + b"/\xfeout"
    arguments = ["run", scene, "--out", out, "--report"]
    done = subprocess.run(
        [COMMAND, *arguments], env={**os.environ, "PYTHONIOENCODING": letters}, capture_output=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert b"Traceback" not in done.stderr
    shown = done.stdout.decode(letters)
    assert ("caf\u00e9" in shown) or (letters == "ascii" and "\\u2603 caf\\xe9" in shown)
    assert b"report.html" in done.stdout
    assert (tmp_path / os.fsdecode(b"\xfeout") / "report.html").stat().st_size > 1000


def test_escapes_of_a_terminal_are_shown(tmp_path, capsys):
    content = SMALL.replace('title = "small"', 'title = "\\u001b[2J\\u202eevil\\u0007"')
    (tmp_path / "scene.toml").write_text(content)
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    told = capsys.readouterr().out
    assert "\\x1b[2J\\u202eevil\\x07: the scene is sound" in told
    assert not any(c in told for c in "\x1b\u202e\x07")
    (tmp_path / "scene.toml").write_text(SMALL + '\n"k\\u001b]0;x\\u0007" = 1\n')
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    assert "\x1b" not in capsys.readouterr().err


def test_nothing_that_is_said_moves_the_cursor(capsys):
    stream = Stream(sys.stdout)
    stream.write("\r\x1b[Kx\n")
    assert capsys.readouterr().out == "\\r\\x1b[Kx\n"


def test_a_hard_link_under_the_name_of_the_lock(tmp_path, whole):
    """It is removed, and what it stood for stays as it is; so for a pipe."""
    out, outside = tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.write_text("mine")
    os.link(outside, out / ".lock")
    run(small(), out)
    assert outside.read_text() == "mine"
    assert results(out) == whole
    other = tmp_path / "other"
    other.mkdir()
    os.mkfifo(other / ".lock")
    run(small(), other)
    assert results(other) == whole


def test_a_folder_that_becomes_a_link_in_mid_run(tmp_path):
    """Nothing is written through it; the run ends with a sentence, and where it was it left sound files."""
    out, moved, outside = tmp_path / "out", tmp_path / "moved", tmp_path / "outside"
    outside.mkdir()

    class Swap(faults.Silent):
        def advance(self, step, energy=None, largest_Z=None):
            if step == 10:
                out.rename(moved)
                out.symlink_to(outside)

    with pytest.raises(OutputError, match="another folder has taken the place of the one that was begun with"):
        run(small(), out, Swap())
    assert not list(outside.iterdir())
    faults.nothing_corrupt(moved)


def test_a_part_that_another_takes_the_place_of(tmp_path, monkeypatch):
    """A file that appears under the name of a part while it is written does not get the final name."""
    from skfem_peridynamics import _files

    outside = tmp_path / "outside"
    outside.write_text("mine")

    def replaced(swap):
        with _files.aside(tmp_path / "a"):
            (tmp_path / "a.part").unlink()
            swap(outside, tmp_path / "a.part")

    for swap in (os.symlink, os.link):
        with pytest.raises(OSError, match="another file has taken its place"):
            replaced(swap)
        assert not (tmp_path / "a").exists()
        assert outside.read_text() == "mine"
    with pytest.raises(OSError, match="another file has taken its place"), _files.aside(tmp_path / "a"):
        os.link(tmp_path / "a.part", tmp_path / "second")


@pytest.mark.parametrize(
    "name", ["summary.json", *slow("checkpoint.bin", "history.csv", "frame_0000.vtu", "frames.pvd")]
)
@pytest.mark.parametrize("kind", ["pipe", "zero"])
def test_pipes_and_endless_devices_do_not_hang(name, kind, tmp_path):
    """Under every name that is read back; a link to /dev/zero would be read for ever."""
    (tmp_path / "scene.toml").write_text(SMALL)
    out = tmp_path / "out"
    if name.startswith("frame"):
        run(small(), out)
        (out / name).unlink()
    out.mkdir(exist_ok=True)
    os.mkfifo(out / name) if kind == "pipe" else os.symlink("/dev/zero", out / name)
    for more in ([], ["--resume"]):
        begin = time.monotonic()
        done = subprocess.run(
            [COMMAND, "run", str(tmp_path / "scene.toml"), "--out", str(out), "--quiet", *more],
            capture_output=True,
            timeout=30,
        )
        assert done.returncode in (0, 2)
        assert b"Traceback" not in done.stderr
        assert time.monotonic() - begin < 20.0
    done = subprocess.run([COMMAND, "plot", str(out)], capture_output=True, timeout=60)
    assert done.returncode in (0, 2)
    assert b"Traceback" not in done.stderr


@pytest.mark.parametrize("place", ["scene", "mesh", "mesh of a child", "include"])
def test_inputs_that_are_no_files(place, tmp_path, capsys):
    scene, mesh = tmp_path / "scene.toml", tmp_path / {"mesh": "a.vtu", "include": "a.inp"}.get(place, "a.off")
    scene.write_text(SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", f'file = "{mesh.name}"'))
    if place == "include":
        mesh.write_text("*NODE\n1, 0, 0\n*INCLUDE, INPUT=pipe\n")
        os.mkfifo(tmp_path / "pipe")
    elif place == "scene":
        scene.unlink()
        os.mkfifo(scene)
    else:
        os.mkfifo(mesh)
    begin = time.monotonic()
    assert main(["check", str(scene)]) == 2
    assert time.monotonic() - begin < 10.0
    told = capsys.readouterr().err
    assert "not a file" in told
    assert told.count("\n") == 1


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("at", ["pictures", *slow("estimate")])
def test_a_signal_after_the_last_step(number, at, tmp_path, monkeypatch, whole):
    """The run is whole, and its files say so; what was under way can be had later."""
    if threading.current_thread() is not threading.main_thread():
        pytest.skip("signals go to the main thread")
    name = {"pictures": "draw", "estimate": "_estimated"}[at]

    def interrupted(*arguments, **keys):
        signal.raise_signal(number)
        raise AssertionError

    import importlib

    monkeypatch.setattr(importlib.import_module("skfem_peridynamics.app.run.run"), name, interrupted)
    scene = Scene.parse(SMALL.replace("pictures = false", "pictures = true"))
    with pytest.raises(Interrupted, match="stopped after its last step: it is whole") as error:
        run(scene, tmp_path, with_estimate=at == "estimate")
    assert error.value.code == 128 + number
    assert results(tmp_path) == whole
    monkeypatch.undo()
    summary = run(scene, tmp_path, resume=True, with_estimate=at == "estimate")
    assert summary["status"] == "finished"
    assert ("error_estimate" in summary) == (at == "estimate")
    assert not list(tmp_path.glob("checkpoint*"))


MANY = {
    "crack points": (
        "crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]",
        "crack = [{points = [" + "[0.0, 0.25]," * 20000 + "]}]",
        "at most 1000",
    ),
    "loads": ("fixed = ", "load = [" + "{body = [0, 1]}," * 5000 + "]\nfixed = ", "at most 1000"),
    "rows": ("history = 12", "history = 1000000", "at most 100000"),
    "frames": ("frames = 6", "frames = 100000", "at most 10000"),
    "title": ('title = "small"', f'title = "{"a" * 100000}"', "at most 1000"),
    "dots": ('title = "small"', ".".join(["a"] * 20000) + " = 1", "nested too deeply"),
    "digits": ("horizon = 0.13", f"horizon = 0x{'f' * 3600}", "bits must be a finite number"),
    "count": ("frames = 6", f"frames = 0x{'f' * 3600}", "beyond any count"),
    "divisions": ("divisions = [16, 8]", f"divisions = [16, 0x{'f' * 3600}]", "beyond any count"),
    "inclusions": ("fixed = ", "inclusion = [" + '{where = "x"},' * 500 + "]\nfixed = ", "at most 100"),
    "key": ("fixed = ", f"{'k' * 100000} = 1\nfixed = ", "there is no such key"),
    "formula": ('"0.02*min(t, 1)"', f'"{"x + " * 400}x + w"', "is not a name"),
    "text for a number": ("horizon = 0.13", f'horizon = "{"9" * 100000}"', "must be a finite number"),
    "array for a number": ("horizon = 0.13", f"horizon = [{'1, ' * 100000}]", "must be a finite number"),
    "box": ("divisions = [16, 8]", "divisions = [50000, 50000]", "need"),
    "points of a grid": (
        "box = [[0, 1], [0, 0.5]], divisions = [16, 8]",
        'file = "grid.vtk"',
        "has quadrilaterals or bricks",
    ),
}


@pytest.mark.parametrize("name", MANY)
def test_counts_and_sizes_have_bounds_that_are_named(name, tmp_path, capsys):
    old, new, told = MANY[name]
    assert old in SMALL
    content = SMALL.replace(old, new, 1)
    if name == "loads":
        content = "\n".join(line for line in content.splitlines() if not line.startswith("load = [{traction"))
    (tmp_path / "grid.vtk").write_text(
        "# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 12000 12000 1\n"
        "ORIGIN 0 0 0\nSPACING 1 1 1\n"
    )
    (tmp_path / "scene.toml").write_text(content)
    begin = time.monotonic()
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    assert time.monotonic() - begin < 10.0
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    longest = max(len(word) for word in said.replace("'", " ").split())
    assert longest <= 200
    assert len(said) < 3000


def test_arguments_are_not_repeated_whole(tmp_path, capsys):
    for arguments in (["run", "x" * 100000, "--out", "y"], ["check", "x" * 300], ["plot", "y" * 100000]):
        assert main(arguments) == 2
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert len(told) < 700
        assert "None" not in told
    (tmp_path / "scene.toml").write_text(SMALL)
    for out in ("y" * 5000, str(tmp_path / "scene.toml"), str(tmp_path / "scene.toml" / "inside")):
        assert main(["run", str(tmp_path / "scene.toml"), "--out", out]) == 2
        told = capsys.readouterr().err
        assert "output folder" in told
        assert len(told) < 700
    for arguments in (["run", "s", "--out", ""], ["x" * 100000], ["cfl", "--horizon", "z" * 100000]):
        with pytest.raises(SystemExit) as error:
            main(arguments)
        assert error.value.code == 2
        told = capsys.readouterr().err
        assert len(told) < 1200


@pytest.mark.slow
def test_mathematics_in_titles_and_units_is_text(tmp_path):
    content = SMALL.replace('title = "small"', 'title = "$^$ \\\\frac{"').replace("pictures = false", "pictures = true")
    scene = Scene.parse(content + '\n[units]\nlength = "$^$"\nforce = "$\\\\q$"\ntime = "$_$"\n')
    summary = run(scene, tmp_path, with_report=True)
    assert summary["status"] == "finished"
    assert (tmp_path / "damage.png").stat().st_size > 1000


def test_a_load_that_is_singular_in_time(tmp_path):
    """Where a step meets the pole, that is said; the last good state is kept."""
    content = SMALL.replace('"0.02*min(t, 1)"', '"0.001/(t - 1.5)"').replace(
        "until = 3.0", "until = 3.0, step = 0.03125"
    )
    with pytest.raises(SceneError, match=r"formula '0.001/\(t - 1.5\)' is inf at .* t = 1.5"):
        run(Scene.parse(content), tmp_path)
    faults.nothing_corrupt(tmp_path)


@pytest.mark.parametrize("what", ["plot", *slow("study", "stability")])
def test_other_commands_hold_their_folder_too(what, tmp_path, monkeypatch):
    """A link that takes its place while they work is not written through."""
    from skfem_peridynamics.app.report import run_pictures, study_page
    from skfem_peridynamics.stability import cases

    out, outside = tmp_path / "out", tmp_path / "outside"
    outside.mkdir()

    def swapped(real):
        def act(*arguments, **keys):
            if not out.is_symlink():
                out.rename(tmp_path / "moved")
                out.symlink_to(outside)
            return real(*arguments, **keys)

        return act

    if what == "plot":
        run(small(), out)
        monkeypatch.setattr(run_pictures, "plot_energies", swapped(run_pictures.plot_energies))
        code = main(["plot", str(out)])
    elif what == "study":
        (tmp_path / "scene.toml").write_text(SMALL)
        monkeypatch.setattr(study_page, "as_json", swapped(study_page.as_json))
        code = main(["study", str(tmp_path / "scene.toml"), "--quick", "--quiet", "--out", str(out)])
    else:
        monkeypatch.setattr(cases, "run_cases", swapped(cases.run_cases))
        code = main(["stability", "--quick", "--only", "units", "--quiet", "--out", str(out)])
    assert code in (1, 2)
    assert not list(outside.iterdir())


def test_a_run_that_appears_while_another_sets_up(tmp_path, monkeypatch):
    import importlib

    module = importlib.import_module("skfem_peridynamics.app.run.run")
    real, out = module._prepare, tmp_path / "out"

    def other_first(*arguments):
        monkeypatch.setattr(module, "_prepare", real)
        run(small(), out)
        return real(*arguments)

    monkeypatch.setattr(module, "_prepare", other_first)
    with pytest.raises(SceneError, match="has come to hold frame_0000.vtu meanwhile"):
        run(small(), out)
    assert (out / "summary.json").exists()
    faults.nothing_corrupt(out)


@pytest.mark.parametrize("at", ["clear", "summary_after"])
def test_signals_between_two_files(at, tmp_path, monkeypatch, whole):
    """While a folder is cleared, and between the last step and the summary: gone on with, or whole."""
    import importlib

    module = importlib.import_module("skfem_peridynamics.app.run.run")
    module = importlib.import_module("skfem_peridynamics.app.run.record") if at == "clear" else module
    faults.stop(small(), tmp_path, 12)
    real = getattr(module, at)

    def asked(*arguments):
        made = real(*arguments)
        signal.raise_signal(signal.SIGTERM)
        return made

    monkeypatch.setattr(module, at, asked)
    with pytest.raises(Interrupted):
        run(small(checkpoints=("checkpoint_every = 5", "checkpoint_every = 0")), tmp_path, resume=False)
    monkeypatch.undo()
    if at == "summary_after":
        assert json.loads((tmp_path / "summary.json").read_text())["status"] == "finished"
    assert not list(tmp_path.glob("checkpoint*"))
    assert run(small(), tmp_path, resume=True)["status"] == "finished"
    assert results(tmp_path) == whole


def test_a_reader_dies_with_its_command(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n")
    scene = SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", 'file = "a.off"')
    (tmp_path / "scene.toml").write_text(scene)

    def readers():
        found = subprocess.run(["pgrep", "-f", str(tmp_path / "a.off")], capture_output=True, text=True)
        return found.stdout.split()

    child = subprocess.Popen([COMMAND, "check", "scene.toml"], cwd=tmp_path, stderr=subprocess.DEVNULL)
    for _ in range(400):
        if readers():
            break
        time.sleep(0.02)
    assert readers()
    child.kill()
    child.wait()
    for _ in range(400):
        if not readers():
            break
        time.sleep(0.02)
    assert not readers()


@pytest.mark.slow
def test_a_file_of_settings_in_the_working_folder_is_not_obeyed(tmp_path, monkeypatch):
    (tmp_path / "matplotlibrc").write_text("text.usetex: True\nsavefig.dpi: 2000\n")
    (tmp_path / "scene.toml").write_text(SMALL.replace("pictures = false", "pictures = true"))
    done = subprocess.run(
        [COMMAND, "run", "scene.toml", "--out", "out"], cwd=tmp_path, capture_output=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert 1000 < (tmp_path / "out" / "damage.png").stat().st_size < 2_000_000


FINISHED = [
    ("nodes", None),
    ("largest_Z", None),
    ("seconds", "x"),
    ("seconds", {"a": "b"}),
    ("estimate_note", "only this"),
    ("energy_drift", [1]),
    ("step", "0"),
]


@pytest.mark.parametrize(("name", "value"), FINISHED)
def test_summaries_of_finished_runs_that_no_run_wrote(name, value, tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SMALL)
    out = tmp_path / "out"
    run(small(), out)
    summary = json.loads((out / "summary.json").read_text())
    (out / "summary.json").write_text(json.dumps({**summary, name: value}))
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(out)]) == 0
    assert "fault" not in capsys.readouterr().err


BOMBS = {
    "deep.vtu": (b'<?xml version="1.0"?>' + b"<a>" * 200_000, "tags"),
    "words.vtu": (b'<VTKFile x="1">' + b"<AppendedData" * 60_000, "is not XML"),
    "many.inp": (
        b"*PART, NAME=P\n*NODE\n"
        + b"".join(b"%d, %d, 0\n" % (k, k) for k in range(1, 3001))
        + b"*END PART\n*ASSEMBLY, NAME=A\n"
        + b"".join(b"*INSTANCE, NAME=I%d, PART=P\n*END INSTANCE\n" % k for k in range(3000))
        + b"*END ASSEMBLY\n",
        "more than 5000000 nodes",
    ),
    "rows.inp": (b"*NODE, INPUT=rows.txt\n" * 2000, "more than 100 files"),
    "word.inp": (b"*" + b"Q" * 100_000 + b"\n1, 2\n", ""),
    "word.vtk": (b"# vtk DataFile Version 3.0\nx\nASCII\nDATASET " + b"Q" * 100_000 + b"\n", ""),
    "word.stl": (b"solid\n" + b"q" * 100_000 + b"\n", ""),
    "endless.off": (b"OFF\n", "has not come to an end"),
    "groups.msh": (
        b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Entities\n1 0 0 0\n1 0 0 0 100 "
        + b" ".join(b"%d" % k for k in range(1, 101))
        + b"\n$EndEntities\n$Nodes\n1 1 1 1\n0 1 0 1\n1\n0 0 0\n$EndNodes\n"
        + b"$Elements\n1 150000 1 150000\n0 1 15 150000\n"
        + b"".join(b"%d 1\n" % k for k in range(1, 150_001))
        + b"$EndElements\n",
        "more than 10000000 members",
    ),
}


@pytest.mark.parametrize("name", [*(name for name in BOMBS if name != "endless.off"), *slow("endless.off")])
def test_mesh_files_that_stand_for_more_than_they_are(name, tmp_path, capsys):
    content, told = BOMBS[name]
    (tmp_path / name).write_bytes(content)
    (tmp_path / "rows.txt").write_text("1, 0, 0\n")
    scene = SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", f'file = "{name}"')
    (tmp_path / "scene.toml").write_text(scene)
    begin = time.monotonic()
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    assert time.monotonic() - begin < 10.0
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1
    assert len(said) < 3000
    assert "None" not in said
    assert "Warning" not in said
    assert max(map(len, said.split())) <= 200


def test_exodus_files_whose_numbers_are_elsewhere_or_nowhere(tmp_path, capsys):
    h5py = pytest.importorskip("h5py")
    os.mkfifo(tmp_path / "pipe")
    scene = SMALL.replace("box = [[0, 1], [0, 0.5]], divisions = [16, 8]", 'file = "a.exo"')
    (tmp_path / "scene.toml").write_text(scene)

    def link(file):
        file["coord"] = h5py.ExternalLink(str(tmp_path / "pipe"), "/x")

    def outside(file):
        file.create_dataset("coord", (2, 4), dtype=float, external=[(str(tmp_path / "pipe"), 0, 64)])

    def filled(file):
        file.create_dataset("coord", (3, 80_000_000), dtype=float, chunks=(3, 100_000), fillvalue=1.0)

    def kind(file):
        file.create_dataset("coord", data=np.zeros((2, 4)))
        file.create_dataset("connect1", data=np.ones((1, 3), dtype=int)).attrs["elem_type"] = np.int64(3_000_000_000)

    for make in (link, outside, filled, kind):
        with h5py.File(tmp_path / "a.exo", "w") as file:
            make(file)
        begin = time.monotonic()
        assert main(["check", str(tmp_path / "scene.toml")]) == 2
        assert time.monotonic() - begin < 10.0
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert "fault" not in said


def test_a_checkpoint_that_is_only_long(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SMALL)
    out = tmp_path / "out"
    out.mkdir()
    with open(out / "checkpoint.bin", "wb") as file:
        file.write(b"skfem-peridynamics checkpoint 1\n")
        file.truncate(1 << 40)
    begin = time.monotonic()
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(out), "--resume", "--quiet"]) == 2
    assert time.monotonic() - begin < 10.0
    assert "cannot be read" in capsys.readouterr().err
