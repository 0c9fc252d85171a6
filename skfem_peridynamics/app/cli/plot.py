"""``skfem-peridynamics plot``: the pictures of a run again, from its files."""

from __future__ import annotations

import argparse

from ..._files import held
from ..scene.reading import SceneError


def plot(arguments: argparse.Namespace) -> int:
    """Draw the pictures and the report of a run again; return the exit code."""
    from ..report import figure as drawing

    if not drawing.available():
        raise SceneError('plot needs matplotlib: install the extra "plot"')
    from ..files.results import Results
    from ..report.run_page import write_report
    from ..report.run_pictures import draw, draw_animation

    results = Results.read(arguments.folder)
    with held(arguments.folder):
        names = draw(results, course=True)
        if arguments.animate:
            names.append(draw_animation(results))
        names.append(write_report(arguments.folder).name)
    print(f"{results.title}: {', '.join(names)} written to {arguments.folder}")
    return 0
