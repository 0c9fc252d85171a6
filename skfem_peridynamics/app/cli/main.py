"""The command ``skfem-peridynamics``. Exit codes: 0 fine, 2 a mistake in the input, 1 ours."""

from __future__ import annotations

import argparse
import logging
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from ..._version import __version__
from ..scene.reading import SceneError


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    arguments = make_parser().parse_args(argv)
    logging.basicConfig(format="note: %(message)s")
    try:
        # each subcommand is a module with a function of the same name, loaded when it is asked for
        command = getattr(import_module(f".{arguments.command}", __package__), arguments.command)
        code: int = command(arguments)
        sys.stdout.flush()
        return code
    except KeyboardInterrupt as error:
        return _complain(str(error) or "interrupted", getattr(error, "code", 130))
    except SceneError as error:
        return _complain(error, 2)
    except MemoryError as error:
        return _complain(f"not enough memory: {error or 'take a coarser mesh or a smaller horizon'}", 2)
    except (OverflowError, RecursionError) as error:
        return _complain(f"a number in the input is too large or too small to compute with: {error}", 2)
    except BrokenPipeError:  # whoever read the table has read enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        return _complain(f"cannot read or write {error.filename!r}: {error.strerror}", 1)
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
    print(f"skfem-peridynamics: {' '.join(str(message).split())}", file=sys.stderr)
    return code


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line, with a subparser for each subcommand."""
    parser = argparse.ArgumentParser(prog="skfem-peridynamics", description="Nonlocal fracture on scikit-fem meshes.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    run = commands.add_parser("run", help="run a scene into a folder")
    run.add_argument("scene", type=Path)
    run.add_argument("--out", type=Path, required=True, metavar="DIR")
    run.add_argument("--estimate", action="store_true", help="run the scene again on a refined mesh: its error")
    again = run.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on from the last checkpoint, if there is one")
    again.add_argument("--overwrite", "--restart", action="store_true", help="start over, whatever the folder holds")
    run.add_argument("--report", action="store_true", help="write report.html: pictures, figures, how to run it again")
    run.add_argument("--quiet", action="store_true", help="no progress, no table at the end")

    cfl = commands.add_parser("cfl", help="the stable time step of a scene or of a mesh file")
    cfl.add_argument("scene", type=Path, nargs="?")
    cfl.add_argument("--mesh", metavar="FILE")
    cfl.add_argument("--horizon", type=float, metavar="H")
    cfl.add_argument("--young", type=float, metavar="E")
    cfl.add_argument("--density", type=float, metavar="R")
    cfl.add_argument("--plane", choices=("stress", "strain"))
    cfl.add_argument("--influence", choices=("constant", "conical", "gaussian"), default=None)
    cfl.add_argument("--json", action="store_true", help="print the numbers as JSON")

    study = commands.add_parser("study", help="error against run time: a study by its name, or of a scene")
    study.add_argument("what", nargs="?", metavar="NAME_OR_SCENE")
    study.add_argument("--out", type=Path, metavar="DIR")
    study.add_argument("--quick", action="store_true", help="fewer sizes")
    study.add_argument("--list", action="store_true", help="name the studies, one a line")
    study.add_argument("--quiet", action="store_true", help="no line a run")

    stability = commands.add_parser("stability", help="stiff and extreme cases, each judged by numbers")
    stability.add_argument("--out", type=Path, required=True, metavar="DIR")
    stability.add_argument("--quick", action="store_true", help="fewer and smaller cases: half a minute")
    stability.add_argument("--only", nargs="+", metavar="CASE", default=None, help="some of the cases, by name")
    stability.add_argument("--quiet", action="store_true", help="no line a verdict")

    plot = commands.add_parser("plot", help="draw the pictures of a run again, from its files")
    plot.add_argument("folder", type=Path, metavar="DIR")
    plot.add_argument("--animate", action="store_true", help="an animation as well, animation.gif")

    check = commands.add_parser("check", help="read a scene and tell its size before anything runs")
    check.add_argument("scene", type=Path)
    return parser
