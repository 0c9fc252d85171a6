"""What a run is: its scene, its mesh and the versions it is made with. Two with one identity have the same bits."""

from __future__ import annotations

import dataclasses
import hashlib
import platform
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import metadata
from typing import Any

import numpy as np

from ..._compile import installed
from ..._types import Mesh
from ..._version import __version__
from ..scene.formula import Formula
from ..scene.scene import Scene

# keys that a run may be continued with other values of
FREE = ("title", "output.pictures", "output.checkpoint_every")
_PACKAGES = ("numpy", "scipy", "scikit-fem", "meshio", "pyamg")


def as_tables(scene: Scene) -> dict[str, Any]:
    """Return a scene as the tables it would be read from, with all defaults: ``Scene.of`` makes it again.

    >>> scene = Scene.parse(\"\"\"
    ... mesh = {box = [[0, 1]], divisions = [10]}
    ... material = {young = 1.0, toughness = 1.0, density = 1.0}
    ... bonds = {horizon = 0.2}
    ... time = {until = 1.0}
    ... \"\"\")
    >>> as_tables(scene)["mesh"], Scene.of(as_tables(scene)) == scene
    ({'box': [[0.0, 1.0]], 'divisions': [10]}, True)
    """
    tables: dict[str, Any] = _plain(scene)
    return tables


def _plain(value: Any) -> Any:
    if isinstance(value, Formula):
        return value.text
    if dataclasses.is_dataclass(value):
        fields = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value) if field.metadata)
        return {name: _plain(entry) for name, entry in fields if entry is not None}
    if isinstance(value, tuple):
        return [_plain(entry) for entry in value]
    return value


def mesh_digest(mesh: Mesh) -> str:
    """Return a hash of vertices, elements and named sets.

    >>> import skfem
    >>> one, two = skfem.MeshTri(), skfem.MeshTri().translated((0.0, 1e-16))
    >>> mesh_digest(one) == mesh_digest(one.with_boundaries({})), mesh_digest(one) == mesh_digest(two)
    (True, False)
    """
    digest = hashlib.sha256()
    for numbers in (np.asarray(mesh.p, dtype="<f8"), np.asarray(mesh.t, dtype="<i8")):
        digest.update(repr(numbers.shape).encode() + np.ascontiguousarray(numbers).tobytes())
    for sets in (mesh.boundaries, mesh.subdomains):
        for name, members in sorted((sets or {}).items()):
            digest.update(repr(name).encode() + np.asarray(members, dtype="<i8").tobytes())
    return digest.hexdigest()


@cache
def versions() -> dict[str, str]:
    """Return the versions that the bits of a run depend on; nothing is imported to find out."""
    known = {"skfem-peridynamics": __version__, "python": "{}.{}".format(*sys.version_info)}
    known |= {name: metadata.version(name) for name in _PACKAGES}
    known["numba"] = metadata.version("numba") if installed() else "none"
    known["machine"] = platform.machine()
    return known


def identity(scene: Scene, mesh: Mesh) -> dict[str, Any]:
    """Return what must be the same for a run to be continued: ``scene``, ``mesh`` and ``versions``."""
    return {"scene": as_tables(scene), "mesh": mesh_digest(mesh), "versions": dict(versions())}


def differences(
    before: Mapping[str, Any], now: Mapping[str, Any], compared: tuple[str, ...] = ("versions",)
) -> list[str]:
    """Return in what a run differs from an earlier one, a clause each.

    Compared are the keys of its scene, its mesh, and, where they are ``compared``, the versions.
    """
    then, new = (dict(_leaves(side.get("scene"), "")) for side in (before, now))
    out = []
    for path in dict.fromkeys([*then, *new]):
        if path not in FREE and then.get(path) != new.get(path):
            was, now_is = (repr(side[path]) if path in side else "not given" for side in (then, new))
            out.append(f"{path} is {now_is} and was {was}")
    if not out and before.get("mesh") != now.get("mesh"):
        file = new.get("mesh.file")
        out.append(f"the mesh in {file!r} is another than it was" if file else "the mesh is another than it was")
    if "versions" in compared:
        old, given = before.get("versions"), now["versions"]
        old = old if isinstance(old, Mapping) else {}
        out += [
            f"{name} is {given.get(name)} and was {old.get(name)}" for name in given if given[name] != old.get(name)
        ]
    return out


def _leaves(value: Any, path: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, Mapping):
        for name, entry in value.items():
            yield from _leaves(entry, f"{path}.{name}" if path else str(name))
    elif isinstance(value, list) and any(isinstance(entry, (Mapping, list)) for entry in value):
        for k, entry in enumerate(value):
            yield from _leaves(entry, f"{path}[{k}]")
    else:
        yield path, value
