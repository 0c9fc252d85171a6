"""``skfem-peridynamics study``: error against run time."""

from __future__ import annotations

import argparse
import contextlib
from pathlib import Path

from ..._files import held
from ..scene.reading import SceneError
from ..scene.scene import Scene


def study(arguments: argparse.Namespace) -> int:
    """Run a study by its name or of a scene; return the exit code."""
    with contextlib.ExitStack() as stack:
        return _study(arguments, stack)


def _study(arguments: argparse.Namespace, stack: contextlib.ExitStack) -> int:
    from ...study.catalogue import STUDIES, run_study

    if arguments.list:
        for name, entry in STUDIES.items():
            print(f"{name:<10}  {entry.what}")
        return 0
    if arguments.what is None or arguments.out is None:
        raise SceneError("study needs a name or a scene, and --out DIR; study --list names the studies")
    if arguments.what not in STUDIES and not arguments.what.endswith(".toml"):
        from difflib import get_close_matches

        near = get_close_matches(arguments.what, STUDIES, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"the studies are {', '.join(STUDIES)}"
        raise SceneError(f"study {arguments.what!r} is not known and no scene file (.toml); {hint}")
    from ..files.whole_files import make_folder
    from ..report import figure as plot
    from ..report.study_page import write_rows, write_study

    def report(line: str) -> None:
        if not arguments.quiet:
            print(line, flush=True)

    if arguments.what in STUDIES:
        make_folder(arguments.out)
        stack.enter_context(held(arguments.out))
        # a study of minutes leaves its rows behind when it is stopped
        outcome = run_study(arguments.what, arguments.quick, report, lambda part: write_rows(arguments.out, part))
    else:
        from ..run.estimate import study_scene

        scene = Scene.read(Path(arguments.what))
        outcome = study_scene(scene, arguments.out, report, levels=2 if arguments.quick else 3)
        stack.enter_context(held(arguments.out))
    names = write_study(arguments.out, outcome, plot.available())
    if not arguments.quiet:
        print(f"{outcome.name}: {', '.join(names)} written to {arguments.out}")
    return 0
