"""Deal a scene out over the processes that ``mpiexec`` has started, and run it."""

from __future__ import annotations

import contextlib
import signal
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

from ...ranks.world import abort, world
from ...solve.instability import UnstableRun
from ...solve.newton import NotConverged
from ..files.whole_files import OutputError
from ..problem.cost import check_memory
from ..problem.problem import Problem
from ..run.logged import logged_warnings
from ..run.progress import Progress
from ..run.run import run
from ..run.signals import Interrupted
from ..scene.reading import SceneError
from ..scene.scene import Scene
from .crew import Crew
from .lead import LeadingProblem, refuse, refuse_problem

Made = TypeVar("Made")


def first() -> bool:
    """Return whether this is the first rank, which speaks. Raises :class:`SceneError` where there is no MPI."""
    try:
        return bool(world().rank == 0)
    except ValueError as error:
        raise SceneError(str(error)) from None


def run_over_ranks(
    path: Path, out: Path, progress: Progress | bool | None = None, *, changes: Sequence[str] = (), **options: Any
) -> dict[str, Any]:
    """Run a scene over all ranks into a folder; return the summary, on the first rank, and nothing on the others.

    ``options`` are those of :func:`run`, but for the estimate. A rank that fails ends all of them.
    """

    def lead(scene: Scene, problem: LeadingProblem) -> dict[str, Any]:
        return run(scene, out, progress, problem=problem, **options)

    return over_ranks(lambda: Scene.read(path, changes), lead) or {}


def over_ranks(read: Callable[[], Scene], lead: Callable[[Scene, LeadingProblem], Made]) -> Made | None:
    """Deal a scene, which every rank can read, out over all; return what the first makes of it, None on the others.

    A rank that fails ends all of them.
    """
    comm = world()
    if comm.rank:
        _follow(comm, read)
        return None
    crew: Crew | None = None
    begun, before = False, contextlib.ExitStack()
    try:
        scene = read()
        refuse(scene)
        problem, notes = Problem(scene), before.enter_context(logged_warnings())
        refuse_problem(problem)
        for name in ("load", "fixed", "u0", "v0", "mass", "no_fail"):  # its mistakes are told before the others begin
            getattr(problem, name)
        try:
            check_memory(problem.expected_bytes // comm.size)
        except ValueError as error:
            raise SceneError(str(error)) from None
        comm.bcast(True, root=0)
        begun = True
        crew = Crew.of(comm, scene, problem)
        before.close()
        leading = LeadingProblem(scene, crew=crew, notes=notes)
        leading.__dict__.update(problem.__dict__)  # what is made already
        return lead(scene, leading)
    except (SceneError, UnstableRun, NotConverged, OutputError, Interrupted, ValueError) as error:
        if not begun:
            comm.bcast(False, root=0)
        elif crew is None or crew.busy:  # in the midst of what all do together: the others wait for ever
            _tell(error)
            abort(getattr(error, "code", 1 if isinstance(error, OutputError) else 2))
        raise
    except BaseException:
        traceback.print_exc()
        abort(1)
        raise
    finally:
        before.close()
        if crew is not None and not crew.busy:
            crew.order("close")


def _tell(error: BaseException) -> None:
    print(f"skfem-peridynamics: {' '.join(str(error).split())}", file=sys.stderr, flush=True)


def _follow(comm: Any, read: Callable[[], Scene]) -> None:
    """Take part in what the first rank leads."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the first one hears them, and says what follows
        with contextlib.suppress(AttributeError, ValueError):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    try:
        if comm.bcast(None, root=0):
            Crew.of(comm, read(), None).follow()
    except ValueError as error:  # a formula that is no number, or a vertex without a bond, of this rank
        _tell(error)
        abort(2)
    except BaseException:
        traceback.print_exc()
        abort(1)
