"""``skfem-peridynamics check``: what a scene says, and what it will cost."""

from __future__ import annotations

import argparse
import json

from ..scene.reading import SceneError
from ..scene.scene import Scene
from .table import print_table


def check(arguments: argparse.Namespace) -> int:
    """Read a scene and print its size before anything runs; return the exit code."""
    try:
        title, rows = _found(arguments)
    except SceneError as error:
        if not arguments.json:
            raise
        print(json.dumps({"sound": False, "mistakes": list(error.mistakes)}, indent=2, ensure_ascii=False))
        return 2
    if arguments.json:
        print(json.dumps({"sound": True, "title": title, "mistakes": [], "found": _by_name(rows)}, indent=2))
        return 0
    print(f"{title}: the scene is sound")
    print_table(rows)
    return 0


def _found(arguments: argparse.Namespace) -> tuple[str, list[tuple[str, str]]]:
    scene = Scene.read(arguments.scene, arguments.changes)
    from ..run.check import check as check_scene

    if arguments.mpi is not None:
        from ..ranks.lead import refuse

        refuse(scene)
    rows = check_scene(scene)
    if arguments.mpi is not None:
        from ..ranks.check import check as check_ranks

        rows += check_ranks(scene, arguments.mpi)
    return scene.title, rows


def _by_name(rows: list[tuple[str, str]]) -> dict[str, list[str]]:
    out: dict[str, list[str]] = {}
    for name, value in rows:
        out.setdefault(name, []).append(value)
    return out
