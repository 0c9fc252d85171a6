"""The command ``skfem-peridynamics``, a module a subcommand."""

from .main import main

__all__ = ["main"]
