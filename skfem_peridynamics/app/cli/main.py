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
from typing import Any, NoReturn

from ..._version import __version__
from ..scene.reading import SceneError
from ..scene.shown import cut, shown
from .streams import guarded

_LONG, _MOST = re.compile(r"\S{200,}"), 2500  # characters of a word, and of a message
_TABLES = ("check", "cfl", "info", "schema", "completion", "examples")  # commands that are asked for what they print


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
    parser = _Parser(
        prog="skfem-peridynamics",
        description="Nonlocal fracture on scikit-fem meshes.",
        epilog=_words(
            "to begin with:",
            "skfem-peridynamics init plate                  a commented scene, plate.toml",
            "skfem-peridynamics check plate.toml            what it says, and what it will cost",
            "skfem-peridynamics run plate.toml -o out --report",
            "skfem-peridynamics init --from part.msh        a scene for a mesh of your own",
            "skfem-peridynamics cfl --mesh part.msh --horizon 2e-3 --young 72e9 --density 2440 --plane stress",
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, about: str, *examples: str) -> argparse.ArgumentParser:
        return commands.add_parser(
            name,
            help=about,
            description=f"{about[0].upper()}{about[1:]}.",
            epilog=_words("for example:", *(f"skfem-peridynamics {name} {text}" for text in examples)),
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    init = command("init", "write a commented scene to begin with", "plate", "--from part.msh", "static -o slow.toml")
    init.add_argument("name", nargs="?", choices=("plate", "bar", "static", "part"), metavar="NAME", help=_STARTERS)
    init.add_argument("--from", dest="mesh", type=Path, metavar="MESH", help="a mesh file, whose groups are filled in")
    init.add_argument("-o", "--out", type=Path, metavar="FILE", help="the file to write; NAME.toml by default")

    run = command(
        "run", "run a scene into a folder", "plate.toml -o out --report", "plate.toml -o out --set time.until=1e-5"
    )
    _add_scene(run)
    run.add_argument("-o", "--out", type=_folder, required=True, metavar="DIR", help="the folder of the results")
    run.add_argument("--estimate", action="store_true", help="run the scene again on a refined mesh: its error")
    again = run.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on from the last checkpoint, if there is one")
    again.add_argument("--overwrite", "--restart", action="store_true", help="start over, whatever the folder holds")
    run.add_argument("--report", action="store_true", help="write report.html: pictures, figures, how to run it again")
    run.add_argument("-q", "--quiet", action="store_true", help="no progress, no table at the end")
    run.add_argument("-v", "--verbose", action="store_true", help="print the rest of summary.json as well")
    run.add_argument("--mpi", action="store_true", help="over the processes that mpiexec has started")

    check = command("check", "read a scene and tell its size before anything runs", "plate.toml", "plate.toml --json")
    _add_scene(check)
    check.add_argument("--json", action="store_true", help="print what was found, and all mistakes, as JSON")
    check.add_argument("--mpi", type=_count, metavar="N", help="as a run over N processes: what each has, what goes")

    cfl = command("cfl", "tell the stable time step of a scene or of a mesh file", "plate.toml", _OF_MESH)
    _add_scene(cfl, nargs="?")
    cfl.add_argument("--mesh", metavar="FILE", help="a mesh file, in place of a scene")
    cfl.add_argument("--scale", type=float, metavar="S", help="what lengths of the mesh file are multiplied by")
    cfl.add_argument("--horizon", type=float, metavar="H", help="the horizon, a length of the scaled mesh")
    cfl.add_argument("--young", type=float, metavar="E", help="Young's modulus")
    cfl.add_argument("--poisson", type=float, metavar="NU", help="Poisson's ratio; that of bonds alone by default")
    cfl.add_argument("--density", type=float, metavar="R", help="the density")
    cfl.add_argument("--plane", choices=("stress", "strain"), help="of a mesh in 2D")
    cfl.add_argument("--influence", choices=("constant", "conical", "gaussian"), help="constant by default")
    cfl.add_argument("--rule", choices=("pairs", "gauss_pairs", "ball", "corners", "auto"), help="pairs by default")
    cfl.add_argument("--balanced", action="store_true", help="with balanced weights")
    cfl.add_argument("--mass", choices=("lumped", "consistent"), help="that of the rule by default")
    cfl.add_argument("--json", action="store_true", help="print the numbers as JSON")
    cfl.add_argument("--mpi", action="store_true", help="over the processes that mpiexec has started")

    info = command(
        "info", "tell what a mesh file has: sizes, groups, quality, a horizon", "part.msh", "part.msh --scale 1e-3"
    )
    info.add_argument("mesh", type=Path, metavar="MESH", help="whatever meshio reads")
    info.add_argument("--scale", type=float, metavar="S", help="what lengths are multiplied by")
    info.add_argument("--json", action="store_true", help="print the numbers as JSON")

    plot = command("plot", "draw the pictures of a run again, from its files", "out", "out --animate")
    plot.add_argument("folder", type=Path, metavar="DIR", help="the folder of a run")
    plot.add_argument("--animate", action="store_true", help="an animation as well, animation.gif")

    study = command(
        "study",
        "measure error against run time: a study by its name, all of them, or of a scene",
        "--list",
        "smooth-2d --quick -o out",
        "plate.toml -o out",
    )
    study.add_argument("what", nargs="?", metavar="NAME_OR_SCENE", help='a name of --list, "all", or a scene file')
    study.add_argument("-o", "--out", type=_folder, metavar="DIR", help="the folder of tables and pictures")
    study.add_argument("--quick", action="store_true", help="fewer sizes")
    study.add_argument("--resume", action="store_true", help="go on where an earlier run of this command was stopped")
    study.add_argument("--list", action="store_true", help="name the studies, one a line")
    study.add_argument("-q", "--quiet", action="store_true", help="no line a run")

    stability = command("stability", "judge stiff and extreme cases, each by numbers", "--quick -o out")
    stability.add_argument("-o", "--out", type=_folder, required=True, metavar="DIR", help="the folder of the verdicts")
    stability.add_argument("--quick", action="store_true", help="fewer and smaller cases: half a minute")
    stability.add_argument("--only", nargs="+", metavar="CASE", default=None, help="some of the cases, by name")
    stability.add_argument("-q", "--quiet", action="store_true", help="no line a verdict")

    examples = command("examples", "list the examples, or copy them into a folder", "", "my-examples")
    examples.add_argument("folder", type=Path, nargs="?", metavar="FOLDER", help="where to copy them")

    schema = command("schema", "print the JSON Schema of scenes, for editors", "-o scene.schema.json")
    schema.add_argument("-o", "--out", type=Path, metavar="FILE", help="the file to write")

    completion = command(
        "completion", "print what a shell completes the command with", "bash > ~/.skfem-peridynamics.bash"
    )
    completion.add_argument("shell", choices=("bash", "zsh", "tcsh"), help="the shell")
    return parser


_OF_MESH = "--mesh part.msh --horizon 2e-3 --young 72e9 --density 2440 --plane stress"
_STARTERS = "plate (a running crack), bar (waves in 1D), static (pulled slowly), part (a mesh of your own)"


def _words(*lines: str) -> str:
    return "\n  ".join(lines)


def _add_scene(parser: argparse.ArgumentParser, **options: Any) -> None:
    parser.add_argument("scene", type=Path, help="a scene, a TOML file", metavar="SCENE", **options)
    about = "set a key of the scene anew, as in time.until=1e-5; may be given again"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="changes", help=about)
