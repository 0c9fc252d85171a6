"""Bodies side by side in one process, in threads, in processes, again and again: the same bits, nothing left behind."""

import locale
import logging
import multiprocessing
import os
import signal
import sys
import threading
import warnings

import numpy as np
import pytest

from faults import results, small
from skfem_peridynamics import run
from skfem_peridynamics.meshes.read_mesh import read_mesh


def in_process(folder):
    """For processes: the scene must be made there."""
    return run(small(), folder)["status"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    run(small(), out)
    return results(out)


def test_bodies_in_threads_at_once(whole, tmp_path):
    scenes = [small(), small(young=("young = 1.0", "young = 2.0"))]
    run(scenes[1], tmp_path / "alone")
    done = []

    def work(k):
        run(scenes[k % 2], tmp_path / str(k))
        done.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(done) == list(range(6))
    alone = results(tmp_path / "alone")
    assert alone != whole
    for k in range(6):
        assert results(tmp_path / str(k)) == (alone if k % 2 else whole)


@pytest.mark.parametrize("method", ["spawn", "fork"])
def test_in_processes(method, whole, tmp_path):
    run(small(), tmp_path / "before")  # this process has threads and compiled code already
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        context = multiprocessing.get_context(method)
        with context.Pool(2) as pool:
            assert pool.map(in_process, [tmp_path / "a", tmp_path / "b"]) == ["finished"] * 2
    assert results(tmp_path / "a") == results(tmp_path / "b") == whole


def host():
    """What belongs to the host program."""
    state = np.random.get_state()  # noqa: NPY002 (it is the host that may use it)
    numba = sys.modules.get("numba")
    return {
        "directory": os.getcwd(),
        "environment": dict(os.environ),
        "random": (state[1].tobytes(), state[2]),
        "errors": np.geterr(),
        "filters": list(warnings.filters),
        "locale": locale.setlocale(locale.LC_ALL),
        "loggers": (logging.getLogger().level, list(logging.getLogger().handlers)),
        "signals": [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)],
        "numba": None if numba is None else (numba.get_num_threads(), numba.config.NUMBA_NUM_THREADS),
        "streams": (sys.stdout, sys.stderr),
    }


def test_again_and_again_as_in_a_notebook(whole, tmp_path):
    """Ten runs: the same bytes, the host's settings as they were, no more threads than after the first."""
    numba = pytest.importorskip("numba")
    numba.set_num_threads(1)
    try:
        before = host()
        threads = None
        for k in range(10):
            run(small(), tmp_path / str(k))
            threads = threads or threading.active_count()
            assert results(tmp_path / str(k)) == whole
        assert host() == before
        assert threading.active_count() <= threads
    finally:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)


def test_meshes_read_in_threads_leave_the_output_alone(tmp_path):
    """Readers print; what they print is caught, and both streams are given back whoever comes last."""
    import skfem

    skfem.MeshTri().refined(2).save(str(tmp_path / "a.vtu"))
    before = sys.stdout, sys.stderr
    threads = [threading.Thread(target=lambda: [read_mesh(tmp_path / "a.vtu") for _ in range(20)]) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert (sys.stdout, sys.stderr) == before
