"""What a scene is made of: one material, or a matrix with inclusions."""

from __future__ import annotations

import dataclasses
from typing import Any

from ..._types import Mesh
from ...material.composite import Composite
from ...material.elastic import lame_constants, poisson_of
from ...material.material import Material
from ..scene.reading import blame
from ..scene.scene import Scene
from .domain import tag

# what an inclusion says of one key takes the place of what the matrix says of these
_REPLACED = {
    "young": ("lame", "mu", "bulk"),
    "lame": ("young", "poisson", "bulk"),
    "bulk": ("young", "poisson", "lame"),
    "toughness": ("K_Ic",),
    "K_Ic": ("toughness",),
}


def make_material(scene: Scene, mesh: Mesh) -> Material | Composite:
    """Return the material of a scene, or with inclusions what is where on its mesh.

    Raises :class:`SceneError` for constants that make no material, and for subdomains that the mesh does not have.
    """
    table = dataclasses.asdict(scene.material)
    between, _ = table.pop("between"), table.pop("breaking")
    with blame("material"):
        matrix = Material.from_elastic(**table)
    if not scene.inclusion:
        return matrix
    inclusions = {}
    for k, inclusion in enumerate(scene.inclusion):
        given = {key: value for key, value in dataclasses.asdict(inclusion).items() if value is not None}
        for key in ("region", "where"):
            given.pop(key, None)
        with blame(f"inclusion[{k}]"):
            given = _with_the_ratio_of(matrix, given)
        for key in tuple(given):
            given = dict.fromkeys(_REPLACED.get(key, ())) | given
        with blame(f"inclusion[{k}]"):
            inclusions[tag(inclusion, k)] = matrix.with_(**given)
    composite = Composite(matrix, inclusions, between)
    with blame("inclusion"):
        composite.member_of(mesh)
    return composite


def _with_the_ratio_of(matrix: Material, given: dict[str, Any]) -> dict[str, Any]:
    """What an inclusion says, and the Poisson ratio of the matrix where that is not said."""
    if "poisson" in given or "mu" in given:
        return given
    lam, mu = lame_constants(2 if matrix.plane else 3, matrix.plane, *_elastic(matrix))
    if lam == mu:
        return given
    if "young" in given:
        return given | {"poisson": poisson_of(lam, mu, matrix.plane)}
    if "lame" in given and matrix.mu is None:
        raise ValueError(
            f"lame = {given['lame']:g} alone is lambda = mu, and [material] has another Poisson ratio, "
            f"{poisson_of(lam, mu, matrix.plane):.4g}: give mu as well"
        )
    return given


def _elastic(material: Material) -> tuple[float | None, ...]:
    return material.young, material.lame, material.poisson, material.mu, material.bulk
