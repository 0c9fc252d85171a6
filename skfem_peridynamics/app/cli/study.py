"""``skfem-peridynamics study``: error against run time."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable
from pathlib import Path

from ..._files import held
from ..scene.reading import SceneError
from ..scene.scene import Scene


def study(arguments: argparse.Namespace) -> int:
    """Run a study by its name or of a scene; return the exit code."""
    with contextlib.ExitStack() as stack:
        return _study(arguments, stack)


def _study(arguments: argparse.Namespace, stack: contextlib.ExitStack) -> int:
    from ...study.catalogue import STUDIES

    if arguments.list:
        for name, entry in STUDIES.items():
            print(f"{name:<10}  {entry.what}")
        return 0
    if arguments.what is None or arguments.out is None:
        raise SceneError("study needs a name, all, or a scene, and --out DIR; study --list names the studies")
    if arguments.what not in (*STUDIES, "all") and not arguments.what.endswith(".toml"):
        from difflib import get_close_matches

        near = get_close_matches(arguments.what, [*STUDIES, "all"], n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"the studies are {', '.join(STUDIES)}, or all of them: all"
        raise SceneError(f"study {arguments.what!r} is not known and no scene file (.toml); {hint}")
    if arguments.resume and arguments.what.endswith(".toml"):
        raise SceneError(f"study {arguments.what!r} --resume: a study of a scene has three runs, and is not resumed")
    from ..files.whole_files import make_folder

    def report(line: str) -> None:
        if not arguments.quiet:
            print(line, flush=True)

    if arguments.what in (*STUDIES, "all"):
        make_folder(arguments.out)
        stack.enter_context(held(arguments.out))
        for name in STUDIES if arguments.what == "all" else [arguments.what]:
            folder = arguments.out / name if arguments.what == "all" else arguments.out
            _named(name, folder, arguments.quick, arguments.resume, report)
        return 0
    from ..report import figure as plot
    from ..report.study_page import write_study
    from ..run.estimate import study_scene

    scene = Scene.read(Path(arguments.what))
    outcome = study_scene(scene, arguments.out, report, levels=2 if arguments.quick else 3)
    stack.enter_context(held(arguments.out))
    names = write_study(arguments.out, outcome, plot.available())
    report(f"{outcome.name}: {', '.join(names)} written to {arguments.out}")
    return 0


def _named(name: str, folder: Path, quick: bool, resume: bool, report: Callable[[str], None]) -> None:
    """Run one of the studies that have a name."""
    from ...study.catalogue import run_study
    from ..files.whole_files import make_folder
    from ..report import figure as plot
    from ..report.study_page import is_whole, read_rows, write_rows, write_study

    if resume and is_whole(folder, name, quick):
        report(f"{name}: is whole in {folder}")
        return
    try:
        known = read_rows(folder, name) if resume else []
    except ValueError as error:
        raise SceneError(f"study {name} --resume: {error}; without --resume it begins anew") from error
    make_folder(folder)
    # a study of minutes leaves its rows behind when it is stopped
    outcome = run_study(name, quick, report, lambda part: write_rows(folder, part), known)
    names = write_study(folder, outcome, plot.available())
    report(f"{outcome.name}: {', '.join(names)} written to {folder}")
