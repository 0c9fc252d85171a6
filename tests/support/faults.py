"""Small runs that are stopped, killed, starved of disk; and what must hold afterwards."""

import contextlib
import os
import resource
import signal
import time
import warnings
import xml.etree.ElementTree as ET

import meshio
import numpy as np

from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.files.checkpoint import DamagedCheckpoint, read_checkpoint
from skfem_peridynamics.app.files.whole_files import OutputError
from skfem_peridynamics.app.run.progress import Silent
from skfem_peridynamics.app.run.record import COLUMNS

SMALL = """
title = "small"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [16, 8]}
material = {young = 1.0, toughness = 1e-3, density = 1.0, plane = "stress"}
bonds = {horizon = 0.13}
crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]
load = [{traction = [0, "0.02*min(t, 1)"], on = "top", layer = 0.13}, {traction = [0, -0.01], on = "bottom"}]
fixed = [{on = "left", component = "x", displacement = 0}]
initial = {velocity = ["0", "1e-3*y"]}
time = {until = 3.0}
output = {frames = 6, history = 12, pictures = false, checkpoint_every = 5}
"""
RESULTS = ("history.csv", "frames.pvd", *(f"frame_{k:04d}.vtu" for k in range(6)))
FULL_DISK, KILLED = 41, 42


def results(out):
    """The bytes of all files that a resumed run must have in common with one that was never stopped."""
    return {name: (out / name).read_bytes() for name in RESULTS if (out / name).exists()}


class Stopped(Exception):
    """What a test raises in the middle of a run."""


class StopAt(Silent):
    def __init__(self, step):
        self.step = step

    def advance(self, step, energy=None, largest_Z=None):
        if step >= self.step:
            raise Stopped


def stop(scene, out, step, **keys):
    """Run until a step and break off there."""
    with contextlib.suppress(Stopped):
        run(scene, out, StopAt(step), **keys)
        raise AssertionError("the run has ended before it was stopped")


def nothing_corrupt(out):
    """What has its final name is whole: frames and lists parse, rows are complete, checkpoints have their sum."""
    for path in out.iterdir():
        if path.suffix == ".vtu":
            assert set(meshio.read(path).point_data) >= {"displacement", "intact", "Z"}, path
        elif path.suffix == ".pvd":
            listed = [one.get("file") for one in ET.parse(path).getroot().findall("./Collection/DataSet")]
            assert all((out / name).exists() for name in listed)
        elif path.suffix == ".csv":
            lines = path.read_text().splitlines()
            assert lines[0].startswith(",".join(COLUMNS))
            assert path.read_bytes().endswith(b"\n")
            rows = np.array([[float(x) for x in line.split(",")] for line in lines[1:]])
            rows = rows.reshape(-1, lines[0].count(",") + 1)
            assert (np.diff(rows[:, 1]) > 0).all()
        elif path.suffix == ".bin":
            with contextlib.suppress(FileNotFoundError):
                read_checkpoint(path)
        elif path.suffix == ".json":
            import json

            json.loads(path.read_text())


def last_step(out):
    """The step of the newest checkpoint, -1 where there is none."""
    for name in ("checkpoint.bin", "checkpoint_older.bin"):
        with contextlib.suppress(DamagedCheckpoint):
            return read_checkpoint(out / name).state.step
    return -1


def forked(act):
    """Run something in a forked process and return its number."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # there are threads; they have nothing to do
        child = os.fork()
    if child:
        return child
    code = 1
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        code = act()
    except OutputError as error:
        code = FULL_DISK if "'" in str(error) and "cannot be written" in str(error) else 1
    finally:
        os._exit(code)


def killed_run(scene, out, delay, resume=True):
    """Run in a process and kill it without warning after so many seconds; return whether it was still running."""

    def act():
        run(scene, out, resume=resume)
        return 0

    child = forked(act)
    time.sleep(delay)
    os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.WIFSIGNALED(status)


def starved_run(scene, out, size, resume=True):
    """Run in a process none of whose files may grow beyond ``size`` bytes; return its exit code."""

    def act():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
        run(scene, out, resume=resume)
        return 0

    _, status = os.waitpid(forked(act), 0)
    return os.waitstatus_to_exitcode(status)


def small(**changes):
    content = SMALL
    for old, new in changes.values():
        assert old in content
        content = content.replace(old, new)
    return Scene.parse(content)


# what an entry of a file may be changed to
ODD = [None, -1, 0, 1.5, 1e308, 10**400, True, "x", "\ud800", [], [[1]], {}, {"a": [None]}]


def leaves(value, path=()):
    """All places of a JSON value, the tables and arrays themselves among them; a few of long arrays."""
    yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for name, entry in entries:
        yield from leaves(entry, (*path, name))


def changed(value, path, new):
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = changed(copy[path[0]], path[1:], new)
    return copy
