"""Scenes: strict reading of TOML into frozen dataclasses."""

from .scene import Scene

__all__ = ["Scene"]
