"""Odd moments: disks that fail in mid-run, kills inside study, stability and plot, cold caches.

The long forms: ``python -m pytest -m long tests/whole/test_moments.py -n 0 -s``.
"""

import errno
import json
import os
import random
import signal
import subprocess
import sys
import time

import pytest

from faults import FULL_DISK, SMALL, forked, nothing_corrupt, results, small
from skfem_peridynamics import run

HERE = [sys.executable, "-P", "-m", "skfem_peridynamics"]


@pytest.mark.slow
@pytest.mark.parametrize("number", [errno.EROFS, errno.EDQUOT, errno.EIO], ids=["read-only", "quota", "broken"])
def test_a_file_system_that_fails_from_some_moment_on(number, tmp_path):
    """From the n-th file that is opened for writing or put in place on: a sentence, nothing corrupt, and resumable.

    Linux turns no file system read-only while a file is open there for writing, unless its disk is broken.
    """
    run(small(), tmp_path / "whole")
    met = 0
    for first in (3, 5, 8, 13, 21, 34):
        out, calls = tmp_path / f"out{first}", [0]

        def counted(function, calls=calls, first=first):
            def wrapped(path, *args, **options):
                writes = function is not os.open or (args and args[0] & (os.O_WRONLY | os.O_RDWR))
                calls[0] += bool(writes)
                if writes and calls[0] >= first:
                    raise OSError(number, os.strerror(number), path)
                return function(path, *args, **options)

            return wrapped

        def act(out=out, counted=counted):
            os.open, os.replace = counted(os.open), counted(os.replace)
            run(small(), out, resume=True)
            return 0

        _, status = os.waitpid(forked(act), 0)
        code = os.waitstatus_to_exitcode(status)
        assert code in (0, FULL_DISK)  # a sentence that names the file
        met += code == FULL_DISK
        nothing_corrupt(out)
        run(small(), out, resume=True)
        assert results(out) == results(tmp_path / "whole")
    print(f"{met} of 6 runs met it")
    assert met > 1


KILLS = {
    "study": (["study", "waves-1d", "--quick", "--out"], 12),
    "stability": (["stability", "--quick", "--only", "units", "--out"], 8),
    "plot": (["plot"], 8),
}


@pytest.mark.long
@pytest.mark.parametrize("what", KILLS)
@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM], ids=["killed", "stopped"])
def test_kills_inside_other_commands(what, sign, tmp_path):
    """At random moments; what is there is whole, and the command run again ends well."""
    command, count = KILLS[what]
    out = tmp_path / "out"
    if what == "plot":
        run(small(), out)
    begin = time.monotonic()
    assert subprocess.run([*HERE, *command, out], capture_output=True, check=False).returncode == 0
    length, chance = time.monotonic() - begin, random.Random(1)
    for _ in range(count):
        child = subprocess.Popen([*HERE, *command, out], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        time.sleep(chance.uniform(0.1, 1.0) * length)
        child.send_signal(sign)
        _, told = child.communicate(timeout=60)
        assert "Traceback" not in told
        for path in out.rglob("*"):
            if path.suffix == ".json":
                json.loads(path.read_text())
            elif path.suffix == ".png":
                assert path.read_bytes()[-8:] == b"IEND\xaeB`\x82", path
            elif path.suffix == ".csv":
                rows = path.read_text().splitlines()
                assert rows
    assert subprocess.run([*HERE, *command, out], capture_output=True, check=False).returncode == 0
    assert not list(out.rglob("*.part"))


@pytest.mark.long
def test_eight_processes_on_a_cold_cache(tmp_path):
    """All compile at once, into one folder; each has the same bytes, and none a word to say."""
    (tmp_path / "scene.toml").write_text(SMALL)
    code = (
        "import sys, numpy as np, skfem, skfem_peridynamics as peri;"
        "g = np.linspace(0, 1, 41); mesh = skfem.MeshTri.init_tensor(g, g);"
        "basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()));"
        "m = peri.Material.from_elastic(young=1.0, poisson=0.2, toughness=1.0, density=1.0, plane='stress');"
        "body = peri.Peridynamics(peri.BondBasis(basis, 0.1), m, compiled=True);"
        "u = 1e-3 * np.random.default_rng(0).standard_normal(basis.N);"
        "sys.stdout.write(body.force(u).tobytes().hex())"
    )
    pytest.importorskip("numba", reason="without numba nothing is compiled")
    given = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    children = [
        subprocess.Popen([sys.executable, "-P", "-c", code], env=given, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        for _ in range(8)
    ]
    told = [child.communicate(timeout=600) for child in children]
    assert [child.returncode for child in children] == [0] * 8
    assert {error for _, error in told} == {b""}
    assert len({out for out, _ in told}) == 1
