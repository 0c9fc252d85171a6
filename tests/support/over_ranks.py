"""Start runs over several processes, and look at what they wrote."""

import contextlib
import csv
import importlib.util
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

HERE = Path(__file__).parents[1] / "ranks"
needs_mpi = pytest.mark.skipif(
    not all(importlib.util.find_spec(name) for name in ("mpi4py", "petsc4py", "slepc4py")),
    reason="needs mpi4py, petsc4py and slepc4py: the extra mpi, Python 3.12 or newer",
)
PLATE = """
title = "plate"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [48, 24]}
material = {young = 1.0, toughness = 2e-4, density = 1.0, plane = "stress"}
bonds = {horizon = 0.085}
crack = [{points = [[0, 0.25], [0.5, 0.25]]}]
time = {until = 2.0}
initial = {velocity = ["2e-3*x", "1e-3"]}
inclusion = [{where = "0.15 - sqrt((x - 0.8)**2 + (y - 0.1)**2)", young = 2.0}]
no_fail = [{where = "0.1 - x"}]
load = [
  {traction = ["0", "0.02*min(t,1)"], on = "top", layer = 0.05},
  {traction = ["1e-3*y", "-0.02*min(t,1)"], on = "bottom"},
  {body = ["0", "1e-3"]},
]
fixed = [{on = "left", component = "x", displacement = "1e-3*sin(t)*y"}]
probe = [{at = [0.7, 0.3]}]
output = {frames = 3, history = 12, pictures = false, checkpoint_every = 10}
"""

# many steps, and tougher: where bonds soften round-off grows, in any two runs whose sums are not in the same order
SLOW = PLATE.replace("until = 2.0", "until = 2.0, step = 2e-3").replace("toughness = 2e-4", "toughness = 2e-3")


def mpiexec(n, *words, **options):
    """The command that starts n processes of this Python."""
    beside = Path(sys.executable).with_name("mpiexec")
    return [str(beside) if beside.exists() else shutil.which("mpiexec"), "-n", str(n), sys.executable, *map(str, words)]


def environment():
    return os.environ | {"OMP_NUM_THREADS": "1"}


def launch(n, *words, timeout=200):
    return subprocess.run(
        mpiexec(n, *words), capture_output=True, text=True, timeout=timeout, env=environment(), check=False
    )


def launch_run(n, folder, *words, text=PLATE, timeout=200):
    scene = folder.parent / "scene.toml"
    scene.write_text(text)
    module = ("-P", "-m", "skfem_peridynamics")
    return launch(n, *module, "run", scene, "--out", folder, "--mpi", "--quiet", *words, timeout=timeout)


def history(folder):
    with open(folder / "history.csv") as file:
        return np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])


def off(a, b):
    """The largest difference of two histories, over the largest of its column; of the imbalance, of the energy."""
    assert np.array_equal(
        np.isnan(a), np.isnan(b)
    )  # of a body at rest there is no kinetic energy, and no tip before it
    a, b = np.nan_to_num(a), np.nan_to_num(b)
    scale = np.abs(b).max(axis=0)
    scale[7] = scale[5]
    return float((np.abs(a - b) / np.where(scale > 0, scale, 1)).max())


def wait_for(path, process):
    wait_until(path.exists, process)


def wait_until(there, process, seconds=60):
    end = time.monotonic() + seconds
    while not there():
        if process.poll() is not None or time.monotonic() > end:
            process.kill()
            raise AssertionError("what was waited for did not come")
        time.sleep(0.02)


def ranks_of(process):
    """The processes of Python that mpiexec has started."""
    out = []
    for entry in Path("/proc").iterdir():
        with contextlib.suppress(OSError, ValueError):
            words = (entry / "cmdline").read_bytes().split(b"\0")
            ours = b"skfem_peridynamics" in words and str(process_folder(process)).encode() in words
            if ours and b"mpiexec" not in words[0] and b"hydra" not in words[0]:
                out.append(int(entry.name))
    return sorted(out)


def process_folder(process):
    return process.args[process.args.index("--out") + 1]
