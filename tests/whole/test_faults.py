"""Faults at random points of a small run: at most what came after the last checkpoint is lost, and nothing is corrupt.

The short form is part of the suite; the long one, hundreds of each fault, is
``pytest -m long tests/whole/test_faults.py -s``
"""

import contextlib
import os
import random
import shutil
import subprocess
import sys
import time

import pytest

import faults
from faults import FULL_DISK, SMALL, forked, killed_run, last_step, nothing_corrupt, results, small, starved_run, stop
from skfem_peridynamics import Scene, UnstableRun, run
from skfem_peridynamics import _files as files
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.files import history
from skfem_peridynamics.app.files.checkpoint import NAME, read_checkpoint
from skfem_peridynamics.app.files.whole_files import OutputError, hold
from skfem_peridynamics.app.run.signals import Signals
from skfem_peridynamics.app.scene.reading import SceneError


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    begin = time.monotonic()
    run(small(), out)
    return results(out), time.monotonic() - begin


def kill_at_random(count, whole, tmp_path, seed):
    """Kill a run again and again and go on, until it ends; then anew. Return how many kills hit a run at work."""
    content, seconds = whole
    rng, hits, ended, out = random.Random(seed), 0, 0, tmp_path / "out"
    scene = small()
    while hits < count:
        before = last_step(out) if out.exists() else -1
        hit = killed_run(scene, out, rng.uniform(0.2, 1.3) * seconds)
        hits += hit
        if out.exists():
            nothing_corrupt(out)
            assert hit is False or last_step(out) >= before or (out / "summary.json").exists()
        if not hit or rng.random() < 0.2:
            run(scene, out, resume=True)
            assert results(out) == content
            shutil.rmtree(out)
            ended += 1
    print(f"\n{hits} kills, {ended} runs that ended with the bytes of an undisturbed one")
    return hits


@pytest.mark.slow
def test_kill_at_random_points(whole, tmp_path):
    assert kill_at_random(40, whole, tmp_path, seed=1) >= 40


@pytest.mark.long
def test_hundreds_of_kills(whole, tmp_path):
    assert kill_at_random(500, whole, tmp_path, seed=2) >= 500


def starve_at_random(count, whole, tmp_path, seed):
    """No file may grow beyond a random size; then there is room again. Frame, history and checkpoint are all hit."""
    content, _ = whole
    rng, codes, out = random.Random(seed), [], tmp_path / "out"
    largest = max(map(len, content.values()))
    for _ in range(count):
        codes.append(starved_run(small(), out, int(rng.choice([200, 1500, 1.2 * largest]) * rng.random())))
        assert codes[-1] in (0, FULL_DISK)
        nothing_corrupt(out)
        assert not list(out.glob("*.part"))
        if rng.random() < 0.4:
            run(small(), out, resume=True)
            assert results(out) == content
            shutil.rmtree(out)
    print(f"\n{codes.count(FULL_DISK)} runs of {count} ran out of disk")
    return codes


@pytest.mark.slow
def test_no_room_at_random_points(whole, tmp_path):
    codes = starve_at_random(30, whole, tmp_path, seed=3)
    assert codes.count(FULL_DISK) >= 20


@pytest.mark.long
def test_hundreds_of_full_disks(whole, tmp_path):
    assert starve_at_random(300, whole, tmp_path, seed=4).count(FULL_DISK) >= 200


class Full:
    """A file on a disk with room for so many more bytes."""

    def __init__(self, file, room):
        self.file, self.room = file, room

    def write(self, content):
        taken = min(self.room[0], len(content))
        self.room[0] -= taken
        if taken == 0 and len(content):
            raise OSError(28, "No space left on device")
        return self.file.write(content[:taken])

    def __getattr__(self, name):
        return getattr(self.file, name)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.file.close()


@pytest.mark.parametrize("name", ["history.csv", "frame_0002.vtu", "checkpoint.bin", "summary.json", "frames.pvd"])
def test_a_full_disk_names_the_file(name, whole, tmp_path, monkeypatch, caplog):
    """A row is taken back whole; a checkpoint is done without; all else ends the run, which can then go on."""
    real, room = files.open_new, [100]

    def open_new(path, *how):
        return Full(real(path, *how), room) if path.name == f"{name}.part" else real(path, *how)

    monkeypatch.setattr(files, "open_new", open_new)
    if name == "history.csv":
        made = history.History.__init__

        def starved(rows, *arguments):
            made(rows, *arguments)
            rows._file = Full(rows._file, [150])

        monkeypatch.setattr(history.History, "__init__", starved)
        monkeypatch.setattr(files, "open_new", real)
    if name == "checkpoint.bin":
        run(small(), tmp_path / "out")
        assert "checkpoint.bin' cannot be written: No space left on device; the run goes on" in caplog.text
    else:
        with pytest.raises(OutputError, match=f"{name}' cannot be written: No space left on device"):
            run(small(), tmp_path / "out")
        nothing_corrupt(tmp_path / "out")
        assert not list((tmp_path / "out").glob("*.part"))
    monkeypatch.undo()
    run(small(), tmp_path / "out", resume=True)
    assert results(tmp_path / "out") == whole[0]


def test_a_folder_that_vanishes(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SMALL)
    out = tmp_path / "out"

    class Vanish(faults.Silent):
        def advance(self, step, energy=None, largest_Z=None):
            if step == 10:
                shutil.rmtree(out)

    with pytest.raises(OutputError, match=r"(history.csv|frame_....\.vtu)' cannot be written: "):
        run(small(), out, Vanish())
    assert not out.exists()
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(out), "--quiet", "--resume"]) == 0


def test_a_history_that_another_took_the_place_of(tmp_path):
    class Replace(faults.Silent):
        def advance(self, step, energy=None, largest_Z=None):
            if step == 10:
                (tmp_path / "history.csv").unlink()
                (tmp_path / "history.csv").write_text("mine\n")

    with pytest.raises(OutputError, match="history.csv' cannot be written: another file has taken its place"):
        run(small(), tmp_path, Replace())
    assert (tmp_path / "history.csv").read_text() == "mine\n"


def test_folders_that_cannot_be_written(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(SMALL)
    places = ["/proc/nowhere"] if os.path.isdir("/proc") else []
    if os.geteuid():  # the administrator may write anywhere
        (tmp_path / "closed").mkdir(mode=0o500)
        places += [tmp_path / "closed", tmp_path / "closed" / "out"]
    for place in places:
        assert main(["run", str(tmp_path / "scene.toml"), "--out", str(place), "--quiet"]) == 2
        told = capsys.readouterr().err
        assert f"output folder '{place}' cannot be written: " in told
        assert told.count("\n") == 1


def test_two_runs_into_one_folder(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    with hold(out), pytest.raises(SceneError, match=rf"'{out}' is in use by another run \(process {os.getpid()}\)"):
        run(small(), out)
    assert not list(out.iterdir())
    go = tmp_path / "go"

    def held():
        with hold(out):
            go.write_text("")
            time.sleep(60)
        return 0

    child = forked(held)
    while not go.exists():
        time.sleep(0.005)
    with pytest.raises(SceneError, match=rf"process {child}\)"):
        run(small(), out)
    os.kill(child, 9)
    os.waitpid(child, 0)
    assert (out / ".lock").exists()  # and yet nobody holds it
    assert run(small(), out)["status"] == "finished"
    assert not (out / ".lock").exists()


def test_links_are_not_followed(whole, tmp_path):
    """Links under every name that a run writes, aside or final, lead nowhere: what they point to stays as it is."""
    out, outside = tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.write_text("mine")
    names = [*whole[0], "summary.json", NAME, "checkpoint_older.bin"]
    for name in names:
        os.symlink(outside, out / name)
        os.symlink(outside, out / f"{name}.part")

    class Plant(faults.Silent):
        """And links that appear while it goes on."""

        def advance(self, step, energy=None, largest_Z=None):
            for name in ("frame_0003.vtu", NAME, "summary.json"):
                with contextlib.suppress(FileExistsError):
                    os.symlink(outside, out / f"{name}.part")

    run(small(), out, Plant())
    assert outside.read_text() == "mine"
    assert results(out) == whole[0]
    assert not any(path.is_symlink() and path.suffix != ".part" for path in out.iterdir())
    os.symlink(outside, out / ".lock")
    with pytest.raises(SceneError, match="cannot be written"):
        run(small(), out)
    assert outside.read_text() == "mine"


def test_the_last_good_state_is_kept(tmp_path):
    """An instability above the limit: the step, the place and the cause are named, and the checkpoint is sound."""
    scene = small(
        step=("until = 3.0}", "until = 30.0, step = 0.12, above_limit = true}"),
        every=("checkpoint_every = 5", "checkpoint_every = 0"),
    )
    with pytest.raises(UnstableRun) as error:
        run(scene, tmp_path)
    said = str(error.value)
    for word in ("by step ", " at vertex ", "the stable limit", "Take a smaller dt: the step is above the limit"):
        assert word in said
    kept = read_checkpoint(tmp_path / NAME)
    assert 0 <= kept.state.step < error.value.step
    rows = (tmp_path / "history.csv").read_text().splitlines()[1:]
    assert all(float(row.split(",")[1]) <= error.value.step for row in rows)
    assert all(abs(float(row.split(",")[7])) < 1e-3 for row in rows)  # no row of what had gone wrong
    assert all(row[1] <= kept.state.step for row in kept.rows)


def test_a_load_that_is_too_much_is_named(tmp_path):
    """Below the limit a smaller step is tried first; far below it the step is not blamed."""
    scene = small(
        motion=('component = "x", displacement = 0', 'component = "x", velocity = "100*step(t-1)"'),
        long=("until = 3.0", "until = 5.0"),
        rows=("history = 12", "history = 200"),
    )
    with pytest.raises(UnstableRun, match="below the limit of small motions, and fast ones .*take half of it, 0.0"):
        run(scene, tmp_path)
    text = SMALL.replace('component = "x", displacement = 0', 'component = "x", velocity = "100*step(t-1)"')
    slow = Scene.parse(
        text.replace("until = 3.0", "until = 5.0, safety = 0.4").replace("history = 12", "history = 200")
    )
    with pytest.raises(UnstableRun, match="The step is below the limit: let loads and motions grow over several steps"):
        run(slow, tmp_path)


def test_no_number_is_found_at_once(tmp_path, capsys):
    """A load that is no number from some time on: found at that step, whatever the interval of the rows."""
    (tmp_path / "scene.toml").write_text(SMALL.replace('"0.02*min(t, 1)"', '"0.02*sqrt(2 - t)"'))
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert "formula '0.02*sqrt(2 - t)' is nan at x = " in capsys.readouterr().err
    assert last_step(tmp_path / "out") == 25  # t = 2 is step 27 of 40
    nothing_corrupt(tmp_path / "out")


def test_stopped_while_a_checkpoint_is_written(whole, tmp_path, monkeypatch):
    """An interrupt in the middle of the file: the older one is still there."""
    real, calls = files.os.replace, []

    def replaced(source, target, **how):
        calls.append(os.path.basename(target))
        if calls.count(NAME) == 3:
            raise KeyboardInterrupt
        real(source, target, **how)

    monkeypatch.setattr(files.os, "replace", replaced)
    with pytest.raises(KeyboardInterrupt), Signals():
        run(small(), tmp_path)
    monkeypatch.undo()
    assert last_step(tmp_path) == 10
    nothing_corrupt(tmp_path)
    run(small(), tmp_path, resume=True)
    assert results(tmp_path) == whole[0]


def test_a_frame_that_went_missing_is_told(tmp_path):
    stop(small(), tmp_path, 20)
    (tmp_path / "frame_0001.vtu").unlink()
    with pytest.raises(SceneError, match=r"frame_0001.vtu' is missing, and the run to go on with has written it"):
        run(small(), tmp_path, resume=True)


@pytest.mark.skipif(
    os.geteuid() != 0 or sys.platform != "linux", reason="only the administrator can mount a small disk"
)
def test_a_disk_that_is_really_full(whole, tmp_path):
    """A file system of 64 kB, too small for the run; then 1 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("no file system can be mounted here")
    try:
        with pytest.raises(OutputError, match="cannot be written: No space left on device"):
            run(small(), disk / "out")
        nothing_corrupt(disk / "out")
        subprocess.run(["mount", "-o", "remount,size=1m", str(disk)], check=True)
        run(small(), disk / "out", resume=True)
        assert results(disk / "out") == whole[0]
    finally:
        subprocess.run(["umount", str(disk)], check=True)
