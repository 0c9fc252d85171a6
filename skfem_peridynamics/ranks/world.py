"""The processes of a run: MPI first, then PETSc on it, and one that fails takes the others along."""

from __future__ import annotations

import os
import sys
import time
from functools import cache
from types import TracebackType
from typing import Any, TextIO

_SIZES = ("PMI_SIZE", "OMPI_COMM_WORLD_SIZE", "MPI_LOCALNRANKS")  # what launchers tell their processes
_PATIENCE, _PAUSE = 3.0, 0.01  # seconds that a launcher may take to read what is said before the end


@cache
def world() -> Any:
    """Return the communicator of all processes, with PETSc started on it.

    Raises ``ValueError`` where the extra ``mpi`` is not installed, and where the launcher is that of another MPI, whose
    processes would each run the whole by themselves.
    """
    try:
        import petsc4py
        from mpi4py import MPI  # before PETSc, which starts MPI otherwise
    except ImportError as error:
        raise ValueError(
            f"runs over several processes need mpi4py, petsc4py and slepc4py ({error}): pip install "
            "'skfem-peridynamics[mpi]', with Python 3.12 or newer"
        ) from None
    petsc4py.init([sys.argv[0], "-no_signal_handler"])  # signals are the run's own
    comm = MPI.COMM_WORLD
    asked = [int(os.environ[name]) for name in _SIZES if os.environ.get(name, "").isdigit()]
    if asked and comm.size < asked[0]:
        raise ValueError(
            f"mpiexec has started {asked[0]} processes, and MPI knows of {comm.size}: it belongs to another MPI; take "
            f"the mpiexec beside {sys.executable}"
        )
    sys.excepthook = _abort
    return comm


def threads_of_a_rank() -> int:
    """Return how many threads each rank of this machine may have: its part of the cores that they may use together."""
    from mpi4py import MPI

    beside = world().Split_type(MPI.COMM_TYPE_SHARED)
    # bound to different cores they may use more together than each alone
    together, ranks = set[int]().union(*beside.allgather(_cores())), beside.size
    beside.Free()
    return max(1, len(together) // int(ranks))


def _cores() -> set[int]:
    affinity = getattr(os, "sched_getaffinity", None)
    return set(range(os.cpu_count() or 1)) if affinity is None else set(affinity(0))


def _abort(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Print an error that nobody has caught, and end all processes: the others would wait for this one for ever."""
    sys.__excepthook__(kind, error, trace)
    abort(1)


def abort(code: int) -> None:
    """End all processes, when what this one has said is on its way."""
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
        _wait_for_reader(stream)
    world().Abort(code)
    os._exit(code)  # where the call comes back, as it may when another rank was first


def _wait_for_reader(stream: TextIO) -> None:
    """Wait until the launcher has read what is written: what is left in a pipe is lost when it ends the job."""
    try:
        import fcntl  # of Unix alone, as the launchers are that end a job at once
        import termios
    except ImportError:
        return
    for _ in range(round(_PATIENCE / _PAUSE)):
        try:
            left = fcntl.ioctl(stream.fileno(), termios.FIONREAD, bytes(4))
        except (OSError, ValueError):  # a file, which has it already, or no descriptor at all
            return
        if int.from_bytes(left, sys.byteorder) == 0:
            return
        time.sleep(_PAUSE)
