"""``skfem-peridynamics info``: what a mesh file has."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from ..problem.domain import make_mesh
from ..problem.mesh_info import MeshInfo
from ..scene.body_tables import MeshTable
from ..scene.reading import SceneError
from .table import print_table


def info(arguments: argparse.Namespace) -> int:
    """Print sizes, groups, quality and a horizon that suits a mesh; return the exit code."""
    if arguments.scale is not None and not 0.0 < arguments.scale < float("inf"):
        raise SceneError(f"--scale {arguments.scale} must be a positive number")
    found = MeshInfo.of(make_mesh(MeshTable(file=str(arguments.mesh), scale=arguments.scale), Path()))
    if arguments.json:
        print(json.dumps(found.as_json(), indent=2))
        return 0
    print(f"{arguments.mesh}")
    print_table(found.rows())
    return 0
