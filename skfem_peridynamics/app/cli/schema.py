"""``skfem-peridynamics schema``: the JSON Schema of scenes."""

from __future__ import annotations

import argparse
import json

from ..scene.schema import scene_schema
from .init import write_new


def schema(arguments: argparse.Namespace) -> int:
    """Print the schema, or write it to a file; return the exit code."""
    text = json.dumps(scene_schema(), indent=1) + "\n"
    if arguments.out is None:
        print(text, end="")
    elif not arguments.out.is_file() or arguments.out.read_bytes() != text.encode():
        write_new(arguments.out, text)
    return 0
