"""The commands that write reports and pictures: ``plot``, ``study`` and ``stability``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..scene.reading import SceneError
from ..scene.scene import Scene


def plot(arguments: argparse.Namespace) -> int:
    """Draw the pictures and the report of a run again; return the exit code."""
    from ..report import figure as drawing

    if not drawing.available():
        raise SceneError('plot needs matplotlib: install the extra "plot"')
    from ..files.results import Results
    from ..report.run_page import write_report
    from ..report.run_pictures import draw, draw_animation

    results = Results.read(arguments.folder)
    names = draw(results, course=True)
    if arguments.animate:
        names.append(draw_animation(results))
    names.append(write_report(arguments.folder).name)
    print(f"{results.title}: {', '.join(names)} written to {arguments.folder}")
    return 0


def study(arguments: argparse.Namespace) -> int:
    """Run a study by its name or of a scene; return the exit code."""
    from ...study.catalogue import STUDIES, run_study

    if arguments.list:
        for name, one in STUDIES.items():
            print(f"{name:<10}  {one.what}")
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
        # a study of minutes leaves its rows behind when it is stopped
        result = run_study(arguments.what, arguments.quick, report, lambda part: write_rows(arguments.out, part))
    else:
        from ..run.estimate import study_scene

        scene = Scene.read(Path(arguments.what))
        result = study_scene(scene, arguments.out, report, levels=2 if arguments.quick else 3)
    names = write_study(arguments.out, result, plot.available())
    if not arguments.quiet:
        print(f"{result.name}: {', '.join(names)} written to {arguments.out}")
    return 0


def stability(arguments: argparse.Namespace) -> int:
    """Run the cases of the stability report; return the exit code, 1 where something does not hold."""
    from ...stability.cases import CASES, run_cases

    names = list(CASES) if arguments.only is None else arguments.only
    for name in names:
        if name not in CASES:
            raise SceneError(f"--only {name}: there is no such case; the cases are {', '.join(CASES)}")
    from ..files.whole_files import make_folder
    from ..report import figure as plot
    from ..report.stability_page import allowed, write_report

    make_folder(arguments.out)
    shown: list[str] = []

    def tell(verdict: Any) -> None:
        if arguments.quiet:
            return
        if verdict.case not in shown:
            shown.append(verdict.case)
            print(f"{verdict.case}:", flush=True)
        if not verdict.holds:
            said = f"{verdict.must} is {verdict.figure:.3g}, allowed {allowed(verdict)}"
            print(f"  does not hold: {verdict.setting}: {said} {verdict.note}".rstrip(), flush=True)
        elif verdict.note:
            print(f"  {verdict.setting}: {verdict.note}", flush=True)

    book = run_cases(names, arguments.quick, tell)
    files = write_report(arguments.out, book, arguments.quick, plot.available())
    wrong = sum(not verdict.holds for verdict in book.verdicts)
    if not arguments.quiet:
        print(
            f"{len(book.verdicts) - wrong} of {len(book.verdicts)} hold; {', '.join(files)} written to {arguments.out}"
        )
    return 1 if wrong else 0
