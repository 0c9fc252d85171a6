"""``skfem-peridynamics stability``: stiff and extreme cases, each judged by numbers."""

from __future__ import annotations

import argparse
from typing import Any

from ..._files import held
from ..scene.reading import SceneError


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

    def report(verdict: Any) -> None:
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

    with held(arguments.out):
        verdicts = run_cases(names, arguments.quick, report)
        files = write_report(arguments.out, verdicts, arguments.quick, plot.available())
    if not arguments.quiet:
        count = len(verdicts.entries)
        holding = sum(verdict.holds for verdict in verdicts.entries)
        print(f"{holding} of {count} hold; {', '.join(files)} written to {arguments.out}")
    return 0 if verdicts.holds else 1
