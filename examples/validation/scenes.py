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
from skfem_peridynamics.app.files.results import Results

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


def box_mesh(box: list[list[float]], divisions: list[int], kind: str, keep: Any = None) -> skfem.MeshTri:
    """Return the mesh of a box with diagonals one way and the other in turn (crossed), or moved vertices (random).

    ``keep(x)`` is true for the vertices that stay: those on cracks.
    """
    x, y = (np.linspace(low, high, n + 1) for (low, high), n in zip(box, divisions, strict=True))
    mesh = skfem.MeshTri.init_tensor(x, y)
    if kind == "random":
        p = mesh.p.copy()
        stays = keep(p) | np.isin(np.arange(p.shape[1]), mesh.boundary_nodes())
        p += np.random.default_rng(2).uniform(-0.22, 0.22, p.shape) * (x[1] - x[0]) * ~stays
        return skfem.MeshTri(p, mesh.t)
    i, j = (one.ravel() for one in np.meshgrid(np.arange(len(x) - 1), np.arange(len(y) - 1)))
    corner = [(j + b) * len(x) + i + a for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]
    rising, falling = ((0, 1, 2), (0, 2, 3)), ((0, 1, 3), (1, 2, 3))
    odd = (i + j) % 2 == 1
    some = [
        np.stack([np.where(odd, corner[b], corner[a]) for a, b in zip(one, other, strict=True)])
        for one, other in zip(rising, falling, strict=True)
    ]
    t = np.concatenate(some, axis=1)
    X, Y = np.meshgrid(x, y)
    return skfem.MeshTri(np.stack([X.ravel(), Y.ravel()]), t)


def mesh_file(path: Path, box: list[list[float]], divisions: list[int], kind: str, keep: Any) -> None:
    """Write such a mesh into a file."""
    mesh = box_mesh(box, divisions, kind, keep)
    meshio.Mesh(np.pad(mesh.p.T, ((0, 0), (0, 1))), [("triangle", mesh.t.T)]).write(path)


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
