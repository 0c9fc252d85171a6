"""Scenes of this folder with some keys changed, on meshes of other kinds, run into a folder that is thrown away."""

from __future__ import annotations

import tempfile
import tomllib
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import skfem
from page import Page

import skfem_peridynamics as peri
from skfem_peridynamics.app.results import Results

HERE = Path(__file__).parent


def read(name: str, **changes: Any) -> dict[str, Any]:
    """Return the tables of a scene; ``mesh__divisions=[2, 3]`` changes ``mesh.divisions``."""
    tables: dict[str, Any] = tomllib.loads((HERE / name).read_text())
    for path, value in changes.items():
        *way, last = path.split("__")
        entry: Any = tables
        for step in way:
            entry = entry[int(step)] if step.isdigit() else entry.setdefault(step, {})
        entry[last] = value
    return tables


def mesh_file(path: Path, box: list[list[float]], divisions: list[int], kind: str, keep: Any) -> None:
    """Write the mesh of a box whose diagonals run the other way, or whose inner vertices are moved at random.

    ``keep(x)`` is true for the vertices that stay: those on cracks.
    """
    grid = [np.linspace(low, high, n + 1) for (low, high), n in zip(box, divisions, strict=True)]
    mesh = skfem.MeshTri.init_tensor(*grid)
    p, t = mesh.p.copy(), mesh.t
    (low, high), h = box[0], grid[0][1] - grid[0][0]
    if kind == "mirrored":
        p[0] = low + high - p[0]
    if kind == "random":
        stays = keep(p) | np.isin(np.arange(p.shape[1]), mesh.boundary_nodes())
        p += np.random.default_rng(2).uniform(-0.22, 0.22, p.shape) * h * ~stays
    meshio.Mesh(np.pad(p.T, ((0, 0), (0, 1))), [("triangle", t.T)]).write(path)


def run(page: Page, what: str, tables: dict[str, Any], kind: str = "structured", keep: Any = None) -> Results:
    """Run a scene without pictures and return its results; count its seconds, steps and energy drift on the page."""
    with tempfile.TemporaryDirectory() as room, page.timed(what) as said:
        folder = Path(room)
        if kind != "structured":
            mesh = tables["mesh"]
            mesh_file(folder / "mesh.vtu", mesh["box"], mesh["divisions"], kind, keep)
            tables = tables | {"mesh": {"file": "mesh.vtu"}}
        output = tables.get("output", {}) | {"pictures": False}
        scene = peri.Scene.of(tables | {"output": output}, folder)
        summary = peri.run(scene, folder / "out")
        said["steps"], said["error"] = summary["steps"], summary["energy_drift"]
        results = Results.read(folder / "out")
        _ = results.last  # read before the folder goes
    return results
