"""``skfem-peridynamics completion``: what a shell needs to complete the command."""

from __future__ import annotations

import argparse

from ..scene.reading import SceneError


def completion(arguments: argparse.Namespace) -> int:
    """Print a script for a shell; return the exit code."""
    try:
        import shtab  # brought by the extra cli
    except ImportError:
        raise SceneError("completion needs shtab: pip install 'skfem-peridynamics[cli]'") from None
    from .main import make_parser

    print(shtab.complete(make_parser(), arguments.shell))
    return 0
