"""The command ``skfem-peridynamics``. Exit codes: 0 fine, 2 a mistake in the input, 1 ours."""

from __future__ import annotations

import argparse
import errno
import logging
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from ..._version import __version__
from ..scene.reading import SceneError
from ..scene.shown import cut, shown
from .streams import guarded

_LONG, _MOST = re.compile(r"\S{200,}"), 2500  # characters of a word, and of a message
_TABLES = ("check", "cfl")  # commands that are asked for what they print


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    with guarded() as (out, _):
        arguments = make_parser().parse_args(argv)
        logging.basicConfig(format="note: %(message)s")
        code = _run(arguments)
        out.flush()
        # a reader that has read enough closes the pipe, and is no fault; what was asked for on a full disk is one
        if code == 0 and out.lost is not None and out.lost.errno != errno.EPIPE and arguments.command in _TABLES:
            return _complain(f"standard output cannot be written: {out.lost.strerror}", 1)
        return code


def _run(arguments: argparse.Namespace) -> int:
    try:
        # each subcommand is a module with a function of the same name, loaded when it is asked for
        command = getattr(import_module(f".{arguments.command}", __package__), arguments.command)
        code: int = command(arguments)
        return code
    except KeyboardInterrupt as error:
        return _complain(str(error) or "interrupted", getattr(error, "code", 130))
    except SceneError as error:
        return _complain(error, 2)
    except MemoryError as error:
        return _complain(f"not enough memory: {error or 'take a coarser mesh or a smaller horizon'}", 2)
    except (OverflowError, RecursionError) as error:
        return _complain(f"a number in the input is too large or too small to compute with: {error}", 2)
    except OSError as error:  # a folder that may not be read or written, a disk that is full
        what = "a file" if error.filename is None else shown(os.fspath(error.filename))
        return _complain(f"{what} cannot be read or written: {error.strerror or error}", 2)
    except Exception as error:
        from ...solve.instability import UnstableRun
        from ...solve.newton import NotConverged
        from ..files.whole_files import OutputError

        if isinstance(error, OutputError):
            return _complain(error, 1)
        if isinstance(error, (UnstableRun, NotConverged)):
            return _complain(error, 2)
        return _complain(f"a fault of the program, please report it: {type(error).__name__}: {error}", 1)


def _complain(message: object, code: int) -> int:
    # whatever a message repeats of an input, no word of it fills a screen
    words = _LONG.sub(lambda word: cut(word[0]), " ".join(str(message).split()))
    print(f"skfem-peridynamics: {cut(words, _MOST)}", file=sys.stderr)
    return code


def _folder(name: str) -> Path:
    if not name:
        raise argparse.ArgumentTypeError("the name of the folder is empty")
    return Path(name)


def _count(text: str) -> int:
    if not text.isdecimal() or not 0 < len(text) < 8 or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{cut(text)!r} is no number of processes: a whole number from 1 on")
    return int(text)


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Say what is wrong with the arguments, and no more of them than that takes."""
        super().error(cut(message, 400))


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with a subparser for each subcommand."""
    parser = _Parser(prog="skfem-peridynamics", description="Nonlocal fracture on scikit-fem meshes.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    run = commands.add_parser("run", help="run a scene into a folder")
    run.add_argument("scene", type=Path)
    run.add_argument("--out", type=_folder, required=True, metavar="DIR")
    run.add_argument("--estimate", action="store_true", help="run the scene again on a refined mesh: its error")
    again = run.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on from the last checkpoint, if there is one")
    again.add_argument("--overwrite", "--restart", action="store_true", help="start over, whatever the folder holds")
    run.add_argument("--report", action="store_true", help="write report.html: pictures, figures, how to run it again")
    run.add_argument("--quiet", action="store_true", help="no progress, no table at the end")
    run.add_argument("--mpi", action="store_true", help="over the processes that mpiexec has started")

    cfl = commands.add_parser("cfl", help="the stable time step of a scene or of a mesh file")
    cfl.add_argument("scene", type=Path, nargs="?")
    cfl.add_argument("--mesh", metavar="FILE")
    cfl.add_argument("--horizon", type=float, metavar="H")
    cfl.add_argument("--young", type=float, metavar="E")
    cfl.add_argument("--poisson", type=float, metavar="NU", help="that of bonds alone by default")
    cfl.add_argument("--density", type=float, metavar="R")
    cfl.add_argument("--plane", choices=("stress", "strain"))
    cfl.add_argument("--influence", choices=("constant", "conical", "gaussian"), default=None)
    cfl.add_argument("--json", action="store_true", help="print the numbers as JSON")
    cfl.add_argument("--mpi", action="store_true", help="over the processes that mpiexec has started")

    study = commands.add_parser("study", help="error against run time: a study by its name, all of them, or of a scene")
    study.add_argument("what", nargs="?", metavar="NAME_OR_SCENE", help='a name of --list, "all", or a scene file')
    study.add_argument("--out", type=_folder, metavar="DIR")
    study.add_argument("--quick", action="store_true", help="fewer sizes")
    study.add_argument("--resume", action="store_true", help="go on where an earlier run of this command was stopped")
    study.add_argument("--list", action="store_true", help="name the studies, one a line")
    study.add_argument("--quiet", action="store_true", help="no line a run")

    stability = commands.add_parser("stability", help="stiff and extreme cases, each judged by numbers")
    stability.add_argument("--out", type=_folder, required=True, metavar="DIR")
    stability.add_argument("--quick", action="store_true", help="fewer and smaller cases: half a minute")
    stability.add_argument("--only", nargs="+", metavar="CASE", default=None, help="some of the cases, by name")
    stability.add_argument("--quiet", action="store_true", help="no line a verdict")

    plot = commands.add_parser("plot", help="draw the pictures of a run again, from its files")
    plot.add_argument("folder", type=Path, metavar="DIR")
    plot.add_argument("--animate", action="store_true", help="an animation as well, animation.gif")

    check = commands.add_parser("check", help="read a scene and tell its size before anything runs")
    check.add_argument("scene", type=Path)
    check.add_argument("--mpi", type=_count, metavar="N", help="as a run over N processes: what each has, what goes")
    return parser
