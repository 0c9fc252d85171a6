"""The command ``skfem-peridynamics``. Exit codes: 0 fine, 2 a mistake in the input, 1 ours."""

from __future__ import annotations

import argparse
import json
import logging
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..._version import __version__
from ..scene.body_tables import BondsTable, MaterialTable, MeshTable
from ..scene.reading import SceneError
from ..scene.scene import Scene, TimeTable


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code."""
    parser = argparse.ArgumentParser(prog="skfem-peridynamics", description="Nonlocal fracture on scikit-fem meshes.")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True)

    run = commands.add_parser("run", help="run a scene into a folder")
    run.add_argument("scene", type=Path)
    run.add_argument("--out", type=Path, required=True, metavar="DIR")
    run.add_argument("--estimate", action="store_true", help="run the scene again on a refined mesh: its error")
    again = run.add_mutually_exclusive_group()
    again.add_argument("--resume", action="store_true", help="go on from the last checkpoint, if there is one")
    again.add_argument("--restart", action="store_true", help="start over, whatever the folder holds")
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

    arguments = parser.parse_args(argv)
    logging.basicConfig(format="note: %(message)s")
    try:
        code = _COMMANDS[arguments.command](arguments)
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


def _complain(what: object, code: int) -> int:
    print(f"skfem-peridynamics: {' '.join(str(what).split())}", file=sys.stderr)
    return code


def _run(arguments: argparse.Namespace) -> int:
    scene = Scene.read(arguments.scene)
    from ..run.progress import Line, Silent
    from ..run.run import run

    progress = Silent() if arguments.quiet else Line()
    begin = time.perf_counter()
    if not arguments.quiet:
        print(f"{scene.title}: setting up", flush=True)
    resume = True if arguments.resume else False if arguments.restart else None
    summary = run(
        scene, arguments.out, progress, with_estimate=arguments.estimate, resume=resume, with_report=arguments.report
    )
    if not arguments.quiet:
        seconds = summary["seconds"]
        parts = ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items())
        _table(
            [
                ("nodes, bonds", f"{summary['nodes']}, {summary['bonds']}"),
                ("steps, dt", f"{summary['steps']}, {summary['dt']:.6g}"),
                ("softened bonds", f"{summary['softened_bonds']}, largest |S|/S_c {_strain(summary['largest_Z'])}"),
                ("result", _verdict(arguments.out, summary)),
                ("energy drift", f"{summary['energy_drift']:.2e} of the peak energy"),
                *_implicit(summary),
                *_estimated(summary),
                ("time", f"{time.perf_counter() - begin:.1f} s ({parts})"),
                ("per step", f"{1e3 * summary['seconds_per_step']:.2f} ms"),
                ("memory", f"{summary['peak_memory_mb']:.0f} MB"),
                ("written to", f"{arguments.out}" + (", report.html" if arguments.report else "")),
            ]
        )
    return 0


def _verdict(out: Path, summary: dict[str, Any]) -> str:
    from ..files.results import Results
    from ..report.run_page import verdict

    return verdict(Results(out, summary, {}, (), summary["run"]["scene"]))


def _implicit(summary: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    if "energy_lost" in summary:
        rows.append(("lost in jumps", f"{summary['energy_lost']:.2e} of the peak energy, where cracks ran away"))
    if "newton_iterations" in summary:
        products = summary["hessian_products"]
        rows.append(("Newton", f"{summary['newton_iterations']} iterations, {products} products with the tangent"))
    return rows


def _estimated(summary: dict[str, Any]) -> list[tuple[str, str]]:
    if "estimate_note" not in summary:
        return []
    error = summary["error_estimate"]
    return [("error", summary["estimate_note"] if error is None else f"{error:.2e}: {summary['estimate_note']}")]


def _strain(Z: float) -> str:
    if Z < 0.1:
        return f"{Z:.3g}: no bond came near its critical strain"
    return f"{Z:.3g}" + (": far beyond any fracture, are the units those of one system?" if Z > 1e5 else "")


def _table(rows: Sequence[tuple[str, str]]) -> None:
    width = max(len(name) for name, _ in rows)
    for name, value in rows:
        print(f"  {name:<{width}}  {value}")


def _from_flags(arguments: argparse.Namespace) -> Scene:
    """A scene with just enough in it for a step limit."""
    missing = [f"--{name}" for name in ("mesh", "horizon", "young", "density") if getattr(arguments, name) is None]
    if missing:
        raise SceneError(f"cfl needs a scene, or a mesh file with {', '.join(missing)} as well")
    for name in ("horizon", "young", "density"):
        if not 0.0 < getattr(arguments, name) < float("inf"):
            raise SceneError(f"--{name} {getattr(arguments, name)} must be a positive number")
    if arguments.plane is None:
        from ..problem.domain import make_mesh

        if make_mesh(MeshTable(file=arguments.mesh), Path()).dim() == 2:
            raise SceneError("cfl of a mesh in 2D needs --plane stress or --plane strain")
    return Scene(
        title=arguments.mesh,
        mesh=MeshTable(file=arguments.mesh),
        material=MaterialTable(
            density=arguments.density, young=arguments.young, plane=arguments.plane, potential="linear"
        ),
        bonds=BondsTable(horizon=arguments.horizon, influence=arguments.influence or "constant"),
        time=TimeTable(until=1.0),
    )


def _cfl(arguments: argparse.Namespace) -> int:
    flags = [
        name
        for name in ("mesh", "horizon", "young", "density", "plane", "influence")
        if getattr(arguments, name) is not None
    ]
    if arguments.scene is not None and flags:
        raise SceneError(f"--{flags[0]} is for a mesh file; with a scene, change the scene instead")
    scene = _from_flags(arguments) if arguments.scene is None else Scene.read(arguments.scene)
    from ..problem.problem import Problem

    begin = time.perf_counter()
    problem = Problem(replace(scene, load=(), fixed=()))
    limit = problem.limit
    numbers: dict[str, Any] = {
        "nodes": int(problem.mesh.nvertices),
        "bonds": int(problem.bonds.nbonds),
        "dt": limit.dt,
        "dt_limit": limit.steps(),
        "largest_eigenvalue": limit.eigenvalue,
        "residual": limit.residual,
        "stiffness_products": limit.products,
        "seconds": time.perf_counter() - begin,
        "version": __version__,
    }
    if arguments.json:
        from ..files.history import _plain

        print(json.dumps(_plain(numbers), indent=2, allow_nan=False))
        return 0
    steps = limit.steps()

    def against(dt: float) -> str:
        return (
            f"{dt:<12.6g} {dt / limit.dt:6.3f} of the limit"
            if dt > 0.0
            else "none in 1D: the exact integrals have no bound"
        )

    print(f"stable time step of {scene.title}")
    _table(
        [
            ("nodes, bonds", f"{numbers['nodes']}, {numbers['bonds']}"),
            ("limit", f"{limit.dt:<12.6g} take 0.8 to 0.95 of it; from the eigenvalue, its residual and 0.5 %"),
            (
                "eigenvalue",
                against(steps["eigenvalue"]) + f", residual {limit.residual / limit.eigenvalue:.1e}",
            ),
            ("nodal bound", against(steps["nodal_bound"]) + ", guaranteed without computing an eigenvalue"),
            ("closed form", against(steps["closed_form"])),
            ("row sum", against(steps["row_sum"]) + ", what other codes use"),
            ("seconds", f"{numbers['seconds']:.2f} ({limit.products} products)"),
        ]
    )
    return 0


def _check(arguments: argparse.Namespace) -> int:
    scene = Scene.read(arguments.scene)
    from ..run.check import check

    rows = check(scene)
    print(f"{scene.title}: the scene is sound")
    _table(rows)
    return 0


def _plot(arguments: argparse.Namespace) -> int:
    from .stability import plot

    return plot(arguments)


def _study(arguments: argparse.Namespace) -> int:
    from .stability import study

    return study(arguments)


def _stability(arguments: argparse.Namespace) -> int:
    from .stability import stability

    return stability(arguments)


_COMMANDS = {"run": _run, "cfl": _cfl, "check": _check, "plot": _plot, "study": _study, "stability": _stability}
