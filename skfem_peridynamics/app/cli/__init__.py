"""The command ``skfem-peridynamics``, a module a subcommand."""

from __future__ import annotations

import sys
from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit code. An interrupt while it is loaded ends it in a word, too."""
    try:
        from .main import main as run

        return run(argv)
    except KeyboardInterrupt:
        print("skfem-peridynamics: interrupted", file=sys.stderr)
        return 130


__all__ = ["main"]
