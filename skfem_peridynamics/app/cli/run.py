"""``skfem-peridynamics run``: a scene into a folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..scene.reading import SceneError
from ..scene.scene import Scene
from .table import print_table


def run(arguments: argparse.Namespace) -> int:
    """Run a scene into a folder and print what came out; return the exit code."""
    from ..run.progress import Silent, shown

    progress = Silent() if arguments.quiet else shown()
    options = {
        "resume": True if arguments.resume else False if arguments.overwrite else None,
        "with_report": arguments.report,
    }
    if arguments.mpi:
        if arguments.estimate:
            raise SceneError("--estimate does not go with --mpi yet: run the estimate by itself")
        from ..ranks.run import first, run_over_ranks

        speaks = first()
        summary = run_over_ranks(arguments.scene, arguments.out, progress, changes=arguments.changes, **options)
        if not speaks:
            return 0
    else:
        from ..run.run import run as run_scene

        scene = Scene.read(arguments.scene, arguments.changes)
        if not arguments.quiet:
            print(f"{scene.title}: setting up", flush=True)
        summary = run_scene(scene, arguments.out, progress, with_estimate=arguments.estimate, **options)
    if not arguments.quiet:
        seconds = summary["seconds"]
        parts = ", ".join(f"{name} {value:.1f} s" for name, value in seconds.items())
        print_table(
            [
                ("nodes, bonds", f"{summary['nodes']}, {summary['bonds']}"),
                ("steps, step", f"{summary['steps']}, {summary['step']:.6g}"),
                (
                    "softened bonds",
                    f"{summary['softened_bonds']}, largest |S|/S_c {_largest_strain(summary['largest_Z'])}",
                ),
                ("result", _headline(arguments.out, summary)),
                ("energy drift", f"{summary['energy_drift']:.2e} of the peak energy"),
                *_effort(summary),
                *_error(summary),
                ("time", f"{sum(seconds.values()):.3g} s ({parts})"),
                ("per step", f"{1e3 * seconds.get('steps', 0.0) / max(1, summary['steps']):.2f} ms"),
                ("memory", f"{summary['peak_memory_mb']:.0f} MB"),
                ("written to", f"{arguments.out}" + (", report.html" if arguments.report else "")),
                *(_rest(summary) if arguments.verbose else ()),
            ]
        )
    return 0


def _rest(summary: dict[str, Any]) -> list[tuple[str, str]]:
    """Plain numbers and texts of the summary under their names there; tables with a name a line."""
    rows = []
    for name, value in summary.items():
        if name == "seconds" or isinstance(value, list):
            continue
        entries = value.items() if isinstance(value, dict) else [(None, value)]
        for part, entry in entries:
            if not isinstance(entry, dict | list):
                shown = f"{entry:.6g}" if isinstance(entry, float) else str(entry)
                rows.append((name if part is None else f"{name}.{part}", shown))
    return rows


def _headline(out: Path, summary: dict[str, Any]) -> str:
    from ..files.results import Results
    from ..report.headline import verdict

    return verdict(Results(out, summary, {}, (), summary["run"]["scene"]))


def _effort(summary: dict[str, Any]) -> list[tuple[str, str]]:
    rows = []
    if "energy_lost" in summary:
        rows.append(("lost in jumps", f"{summary['energy_lost']:.2e} of the peak energy, where cracks ran away"))
    if "newton_iterations" in summary:
        products = summary["hessian_products"]
        rows.append(("Newton", f"{summary['newton_iterations']} iterations, {products} products with the tangent"))
    return rows


def _error(summary: dict[str, Any]) -> list[tuple[str, str]]:
    if "estimate_note" not in summary:
        return []
    error = summary.get("error_estimate")
    return [("error", summary["estimate_note"] if error is None else f"{error:.2e}: {summary['estimate_note']}")]


def _largest_strain(Z: float) -> str:
    if Z < 0.1:
        return f"{Z:.3g}: no bond came near its critical strain"
    return f"{Z:.3g}" + (": far beyond any fracture, are the units those of one system?" if Z > 1e5 else "")
