"""Meshes of scenes: boxes with named sides, and whatever meshio reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..._memory import free_memory
from ..._types import Longs, Mesh
from ...geometry.boxes import box_of_axes, with_sides
from ...geometry.layers import collar, region
from ...geometry.slit import Crack, facets_on, slit
from ...meshes.read_mesh import mended_mesh
from ..scene.body_tables import InclusionTable, MeshTable
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene, Where

# bytes of a vertex of a box while it is made, by dimension (151, 496 and 2386 were taken); of a bond, at the least
_VERTEX, _BOND = {1: 150.0, 2: 480.0, 3: 2300.0}, 24.0
_BALL = {1: 1.0, 2: np.pi / 4, 3: np.pi / 6}  # a ball over the cube around it


def make_mesh(spec: MeshTable, folder: Path) -> Mesh:
    """Return the mesh of a ``[mesh]`` table; a box has the boundaries left, right, bottom, top, front, back."""
    if spec.file is not None:
        try:
            mended = mended_mesh(folder / spec.file, spec.scale or 1.0, bool(spec.join))
        except ValueError as error:  # its sentence begins with the name of the file
            raise SceneError(f"mesh.file = {error}") from None
        # names of a box's sides are for files that name no boundary, and never for a name that a file means otherwise
        mesh = mended.mesh
        return mesh if mesh.boundaries else with_sides(mesh, without=(*mended.lost, *(mesh.subdomains or ())))
    assert spec.box is not None
    assert spec.divisions is not None
    check_box(spec)
    grid = [np.linspace(low, high, n + 1) for (low, high), n in zip(spec.box, spec.divisions, strict=True)]
    return with_sides(box_of_axes(*grid))


def check_box(spec: MeshTable, horizon: float = 0.0) -> None:
    """Raise :class:`SceneError` where a box, or its bonds, would take more memory than there is: before it is made."""
    if spec.box is None or spec.divisions is None:
        return
    dim = len(spec.divisions)
    vertices = np.prod([n + 1.0 for n in spec.divisions])
    element = np.prod([(high - low) / n for (low, high), n in zip(spec.box, spec.divisions, strict=True)])
    ball = np.prod([min(2.0 * horizon, high - low) for low, high in spec.box])
    bonds = vertices * 0.5 * _BALL[dim] * ball / element
    need, free = vertices * _VERTEX[dim] + bonds * _BOND, free_memory()
    if need > free:
        raise SceneError(
            f"mesh.divisions = {list(spec.divisions)} makes {vertices:.3g} vertices"
            + (f" with about {bonds:.3g} bonds" if horizon else "")
            + f", which need {need / 1e9:.3g} GB; {free / 1e9:.3g} GB are free: take a coarser mesh"
        )


def cracked_mesh(scene: Scene) -> Mesh:
    """Return the mesh of a scene with its cracks as slits, and a subdomain for each inclusion.

    It may be refined: that goes by elements, and keeps the faces of a slit apart.
    """
    check_box(scene.mesh, scene.bonds.horizon)
    mesh = make_mesh(scene.mesh, scene.folder)
    cuts: list[str | Longs] = []
    for k, table in enumerate(scene.crack):
        if table.points is not None:
            with blame(f"crack[{k}].points"):
                cuts.append(facets_on(mesh, Crack(table.points)))
        elif table.facets is not None:
            cuts.append(table.facets)
    if scene.crack:
        with blame("crack"):
            mesh = slit(mesh, facets=cuts)
    return tagged(mesh, scene) if scene.inclusion else mesh


def vertices(mesh: Mesh, where: Where, path: str) -> Longs:
    """Return the vertices a table selects. Raises :class:`SceneError` when there are none."""
    if where.on is not None:
        with blame(f"{path}.on"):
            chosen = collar(mesh, where.on, where.width or 0.0)
    elif where.region is not None:
        with blame(f"{path}.region"):
            chosen = region(mesh, where.region)
    else:
        assert where.where is not None
        with blame(f"{path}.where"):
            chosen = np.flatnonzero(where.where(mesh.p) > 0.0)
    if not len(chosen):
        raise SceneError(f"{path} selects no vertex: the set is empty")
    return chosen


def tag(inclusion: InclusionTable, number: int) -> str:
    """Return the name of the subdomain of an inclusion."""
    return inclusion.region if inclusion.region is not None else f"inclusion[{number}]"


def tagged(mesh: Mesh, scene: Scene) -> Mesh:
    """Return the mesh with a subdomain for each inclusion that is given by a formula, of the middles of elements."""
    tags = dict(mesh.subdomains or {})
    for k, inclusion in enumerate(scene.inclusion):
        if inclusion.where is None:
            continue
        with blame(f"inclusion[{k}].where"):
            inside = np.flatnonzero(inclusion.where(mesh.p[:, mesh.t].mean(axis=1)) > 0.0)
        if not len(inside):
            raise SceneError(f"inclusion[{k}].where selects no element: the set is empty")
        tags[tag(inclusion, k)] = inside
    return mesh.with_subdomains(tags)
