"""Long forms over several processes: the examples, and fifty kills. python -m pytest -m long tests/ranks -s"""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import meshio
import numpy as np
import pytest
from over_ranks import SLOW, environment, history, launch, launch_run, mpiexec, needs_mpi, off, ranks_of, wait_for

from skfem_peridynamics import Scene, run

HERE = Path(__file__).parent
EXAMPLES = HERE.parents[1] / "examples"
pytestmark = [pytest.mark.long, needs_mpi]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_first_steps_of_the_glass_plate(n):
    ended = launch(n, HERE / "plate.py", EXAMPLES / "glass_branching.toml")
    assert ended.returncode == 0, ended.stderr[-2000:]
    found = json.loads(ended.stdout.splitlines()[-1])
    print(n, found)
    assert found["steps"] == [36, 36]
    assert found["u"] < 1e-13
    assert found["v"] < 1e-13
    assert found["softened"][0] == found["softened"][1]
    assert found["intact"]


@pytest.mark.parametrize("n", [1, 2, 3])
def test_the_block_is_torn_as_by_one_process(n, tmp_path_factory):
    """The whole run: softened bonds of every row, and what is left of the vertices in every frame."""
    place = tmp_path_factory.getbasetemp() / "block"
    text = (EXAMPLES / "block3d.toml").read_text()
    old = next(line for line in text.splitlines() if line.startswith("until ="))
    text = text.replace(old, f"{old}\nstep = 9.6e-7")
    if not place.exists():
        place.mkdir()
        run(Scene.parse(text), place / "whole")
    assert launch_run(n, place / f"of{n}", text=text, timeout=500).returncode == 0
    ours, theirs = history(place / f"of{n}"), history(place / "whole")
    print(n, "softened at the end", ours[-1, 8], "history", off(ours, theirs))
    assert theirs[-1, 8] > 1000
    assert (ours[:, 8] == theirs[:, 8]).all()
    frames = sorted((place / "whole").glob("frame_*.vtu"))
    assert len(frames) == 7
    for frame in frames:
        a, b = (meshio.read(folder / frame.name).point_data["intact"] for folder in (place / f"of{n}", place / "whole"))
        assert np.array_equal(a, b), frame.name


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="finds ranks by /proc")
def test_fifty_kills(tmp_path):
    """A rank killed at a random moment, fifty times in one run that goes on each time; its end is that of the whole."""
    rng, folder = np.random.default_rng(0), tmp_path / "out"
    slow = SLOW.replace("step = 2e-3", "step = 1e-4")
    (tmp_path / "scene.toml").write_text(slow)
    words = ("-P", "-m", "skfem_peridynamics", "run", tmp_path / "scene.toml", "--out", folder, "--mpi", "--quiet")
    slowest, kills = 0.0, 0
    while kills < 50:
        resume = ("--resume",) if (folder / "checkpoint.bin").exists() else ()
        with subprocess.Popen(mpiexec(2, *words, *resume), env=environment(), stderr=subprocess.DEVNULL) as process:
            wait_for(folder / "checkpoint.bin", process)
            while len(ranks := ranks_of(process)) < 2:
                time.sleep(0.02)
            time.sleep(
                rng.uniform(0.0, 3.0)
            )  # while libraries load, in the set-up, between steps and as files are written
            if process.poll() is not None:  # it was done before
                break
            os.kill(ranks[rng.integers(len(ranks))], signal.SIGKILL)
            before = time.monotonic()
            assert process.wait(timeout=10) != 0
            slowest, kills = max(slowest, time.monotonic() - before), kills + 1
    print(f"{kills} kills, the slowest end after {slowest:.1f} s")
    assert kills == 50
    assert launch_run(2, folder, "--resume", text=slow, timeout=500).returncode == 0
    run(Scene.parse(slow), tmp_path / "whole")
    print("history", off(history(folder), history(tmp_path / "whole")))
    assert off(history(folder), history(tmp_path / "whole")) < 1e-11
