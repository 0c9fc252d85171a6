"""``skfem-peridynamics cfl``: the stable time step of a scene or of a mesh file."""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..._version import __version__
from ..files.history import plain, step_limits
from ..scene.body_tables import BondsTable, MaterialTable, MeshTable
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene, TimeTable
from .table import print_table

if TYPE_CHECKING:
    from ..problem.problem import Problem


_FLAGS = ("mesh", "scale", "horizon", "young", "poisson", "density", "plane", "influence", "rule", "balanced", "mass")


def cfl(arguments: argparse.Namespace) -> int:
    """Print the stable time step of a scene or of a mesh file; return the exit code."""
    flags = [name for name in _FLAGS if getattr(arguments, name) not in (None, False)]
    if arguments.scene is not None and flags:
        raise SceneError(f"--{flags[0]} is for a mesh file; with a scene, change the scene instead")

    def read() -> Scene:
        scene = (
            _scene_of_flags(arguments) if arguments.scene is None else Scene.read(arguments.scene, arguments.changes)
        )
        return replace(scene, load=(), fixed=())

    if not arguments.mpi:
        from ..problem.problem import Problem

        scene = read()
        return _print_limit(scene, Problem(scene), arguments.json)
    from ..ranks.run import first, over_ranks

    first()  # tells where there is no MPI
    code = over_ranks(read, lambda scene, problem: _print_limit(scene, problem, arguments.json))
    return code or 0


def _print_limit(scene: Scene, problem: Problem, as_json: bool) -> int:
    begin = time.perf_counter()
    limit = problem.limit
    numbers: dict[str, Any] = {
        "nodes": int(problem.mesh.nvertices),
        "bonds": int(problem.bonds.nbonds),
        "stable_step": limit.dt,
        "step_limits": step_limits(limit),
        "largest_eigenvalue": limit.eigenvalue,
        "residual": limit.residual,
        "stiffness_products": limit.products,
        "seconds": time.perf_counter() - begin,
        "version": __version__,
    }
    if as_json:
        print(json.dumps(plain(numbers), indent=2, allow_nan=False))
        return 0
    steps = limit.steps()

    def against(dt: float) -> str:
        return (
            f"{dt:<12.6g} {dt / limit.dt:6.3f} of the limit"
            if dt > 0.0
            else "none in 1D: the exact integrals have no bound"
        )

    print(f"stable time step of {scene.title}")
    print_table(
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


def _scene_of_flags(arguments: argparse.Namespace) -> Scene:
    """A scene with just enough in it for a step limit."""
    missing = [f"--{name}" for name in ("mesh", "horizon", "young", "density") if getattr(arguments, name) is None]
    if missing:
        raise SceneError(f"cfl needs a scene, or a mesh file with {', '.join(missing)} as well")
    if arguments.changes:
        raise SceneError(f"--set {arguments.changes[0]} is for a scene; with a mesh file give its flags")
    for name in ("horizon", "young", "density", *(("scale",) if arguments.scale is not None else ())):
        if not 0.0 < getattr(arguments, name) < float("inf"):
            raise SceneError(f"--{name} {getattr(arguments, name)} must be a positive number")
    if arguments.plane is None:
        from ..problem.domain import make_mesh

        if make_mesh(MeshTable(file=arguments.mesh), Path()).dim() == 2:
            raise SceneError("cfl of a mesh in 2D needs --plane stress or --plane strain")
    with blame("--rule and --balanced"):
        bonds = BondsTable(
            horizon=arguments.horizon,
            influence=arguments.influence or "constant",
            rule=arguments.rule or "pairs",
            balanced=arguments.balanced or None,
        )
    return Scene(
        title=arguments.mesh,
        mesh=MeshTable(file=arguments.mesh, scale=arguments.scale),
        material=MaterialTable(
            density=arguments.density,
            young=arguments.young,
            poisson=arguments.poisson,
            plane=arguments.plane,
            potential="linear",
        ),
        bonds=bonds,
        time=TimeTable(until=1.0, mass=arguments.mass),
    )
