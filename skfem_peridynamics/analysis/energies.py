"""The discrete energy of the paper's CFL theorem."""

from __future__ import annotations
