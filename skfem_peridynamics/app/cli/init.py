"""``skfem-peridynamics init``: a commented scene to begin with."""

from __future__ import annotations

import argparse
from pathlib import Path
from shlex import quote

from ..problem.starters import starter
from ..scene.reading import SceneError
from ..scene.shown import named


def init(arguments: argparse.Namespace) -> int:
    """Write a scene to begin with; return the exit code."""
    name = arguments.name or ("plate" if arguments.mesh is None else "part")
    out = arguments.out or Path(f"{name if arguments.mesh is None else arguments.mesh.stem}.toml")
    text = starter(name, arguments.mesh, out.parent)
    write_new(out, text)
    scene, folder = (quote(name if not name.startswith("-") else f"./{name}") for name in (str(out), out.stem))
    print(f"wrote {out}; go on with")
    print(f"  skfem-peridynamics check {scene}")
    print(f"  skfem-peridynamics run {scene} --out {folder} --report")
    print("and for an editor that completes keys, in the same folder")
    print("  skfem-peridynamics schema --out scene.schema.json")
    return 0


def write_new(path: Path, text: str) -> None:
    """Write a file that is not there yet. Raises :class:`SceneError`."""
    try:
        with open(path, "x", encoding="utf-8", newline="\n") as file:
            file.write(text)
    except FileExistsError:
        raise SceneError(f"{named(path)} is there already; remove it, or name another with --out") from None
