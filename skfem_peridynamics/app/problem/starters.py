"""Scenes to begin with: commented, complete, ready to run; one of them for a mesh of one's own."""

from __future__ import annotations

import os
from importlib.resources import files
from math import sqrt
from pathlib import Path
from string import Template

from ..scene.body_tables import MeshTable
from ..scene.reading import SceneError
from .domain import make_mesh
from .mesh_info import VERTICES_PER_HORIZON, MeshInfo

NAMES = ("plate", "bar", "static", "part")
_GLASS = 72e9, 2440.0  # young and density of the template


def starter(name: str, mesh: Path | None = None, folder: Path = Path()) -> str:
    """Return the text of a scene to begin with: a name of :data:`NAMES`; ``part`` is for a mesh file.

    The file is named as seen from ``folder``. Raises :class:`SceneError`.
    """
    if (name == "part") != (mesh is not None):
        said = "needs a mesh: add --from FILE" if mesh is None else f"does not go with --from {mesh}; take part"
        raise SceneError(f"the scene {name!r} {said}")
    text = files(f"{__package__.rsplit('.', 1)[0]}.templates").joinpath(f"{name}.toml").read_text(encoding="utf-8")
    return text if mesh is None else Template(text).substitute(_filled(mesh, folder))


def _filled(path: Path, folder: Path) -> dict[str, str]:
    info = MeshInfo.of(make_mesh(MeshTable(file=str(path)), Path()))
    extent = max(b - a for a, b in info.box)
    speed = sqrt(_GLASS[0] / _GLASS[1])
    return {
        "mesh": _text(path.name).strip('"'),
        "title": _text(path.stem).strip('"'),
        "size": f"{info.nvertices} vertices in {info.dim}D, {' x '.join(f'{b - a:.4g}' for a, b in info.box)}",
        "file": _text(Path(os.path.relpath(path, folder)).as_posix()).strip('"'),
        "plane": 'plane = "stress"                     # or "strain"\n' if info.dim == 2 else "",
        "horizon": f"{info.horizon:<26g}",
        "vertices_per_horizon": f"{VERTICES_PER_HORIZON:g} or more",
        "until": f"{extent / speed:<28.2g}",
        "groups": _groups(info),
    }


def _text(text: str) -> str:
    """A text as TOML writes it."""
    if any(ord(c) < 32 or ord(c) == 127 for c in text):
        raise SceneError(f"{text!r}: a name with such characters cannot be written into a scene")
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"') + '"'


def _groups(info: MeshInfo) -> str:
    """Tables for the groups of a mesh, to be uncommented; without one what holds and what pulls goes by formulas."""
    zero = ", ".join(["0.0"] * info.dim)
    outer = [name for name, count in info.boundaries.items() if count and name not in info.inner]
    lines = [f"# boundaries of the mesh: {', '.join(outer) or 'none is named'}"]
    if outer:
        lines += ["", "[[fixed]]                            # held; takes displacement and velocity, in x, y, z, t"]
        lines += [f"on = {_text(outer[0])}"]
    for name in outer[1:]:
        lines += ["", "# [[load]]                           # a traction a component", f"# traction = [{zero}]"]
        lines += [f"# on = {_text(name)}", f"# layer = {info.horizon:g}"]
    for name in sorted(info.inner):
        lines += [
            "",
            "[[crack]]                            # facets inside the body: a slit",
            f"facets = {_text(name)}",
        ]
    # the largest subdomain of those that fill the body is what [material] is of
    filled = sum(info.subdomains.values()) == info.nelements
    matrix = max(info.subdomains, key=info.subdomains.__getitem__) if filled else None
    for name in info.subdomains:
        if name != matrix:
            lines += ["", "# [[inclusion]]                      # what is not given is that of [material]"]
            lines += [f"# region = {_text(name)}", "# young = 200e9"]
    if not info.inner:
        lines += ["", "# [[crack]]                          # or  facets = a group of facets inside"]
        lines += ["# points = [" + ", ".join(f"[{zero}]" for _ in range(2 if info.dim < 3 else 4)) + "]"]
    return "\n".join(lines) + "\n"
