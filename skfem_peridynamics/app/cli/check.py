"""``skfem-peridynamics check``: what a scene says, and what it will cost."""

from __future__ import annotations

import argparse

from ..scene.scene import Scene
from .table import print_table


def check(arguments: argparse.Namespace) -> int:
    """Read a scene and print its size before anything runs; return the exit code."""
    scene = Scene.read(arguments.scene)
    from ..run.check import check as check_scene

    if arguments.mpi is not None:
        from ..ranks.lead import refuse

        refuse(scene)
    rows = check_scene(scene)
    if arguments.mpi is not None:
        from ..ranks.check import check as check_ranks

        rows += check_ranks(scene, arguments.mpi)
    print(f"{scene.title}: the scene is sound")
    print_table(rows)
    return 0
