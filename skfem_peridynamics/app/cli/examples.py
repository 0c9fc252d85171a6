"""``skfem-peridynamics examples``: copy the examples out."""

from __future__ import annotations

import argparse
import shutil
import sysconfig
from pathlib import Path

from ..scene.reading import SceneError
from ..scene.shown import named

_ENDINGS = (".toml", ".py", ".msh", ".geo")


def folder_of_examples() -> Path:
    """Return where they are: beside the package in a clone, else with the data of the environment."""
    places = [Path(__file__).parents[3], Path(sysconfig.get_path("data")) / "share" / "skfem-peridynamics"]
    for place in places:
        if (place / "examples" / "glass_branching.toml").is_file():
            return place / "examples"
    raise SceneError(f"the examples were not installed with the package: looked in {' and '.join(map(str, places))}")


def examples(arguments: argparse.Namespace) -> int:
    """List the examples, or copy them into a folder; return the exit code."""
    source = folder_of_examples()
    found = sorted(path for path in source.iterdir() if path.suffix in _ENDINGS)
    if arguments.folder is None:
        for path in found:
            print(f"{path.name:<24}{_first_words(path)}".rstrip())
        print("copy them with  skfem-peridynamics examples FOLDER")
        return 0
    there = [path.name for path in found if (arguments.folder / path.name).exists()]
    if there:
        raise SceneError(f"{named(arguments.folder)} has {', '.join(there)} already; name another folder")
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for path in found:
        shutil.copyfile(path, arguments.folder / path.name)
    print(f"copied {len(found)} files to {arguments.folder}")
    return 0


def _first_words(path: Path) -> str:
    if path.suffix not in (".toml", ".py"):
        return ""
    line = path.read_text(encoding="utf-8").splitlines()[0]
    return line.strip('#" ')
