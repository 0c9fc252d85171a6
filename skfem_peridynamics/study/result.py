"""What a study found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from .measure import Row
from .rates import rate

Table: TypeAlias = tuple[str, tuple[str, ...], list[tuple[Any, ...]]]  # heading, columns, rows


@dataclass(frozen=True)
class Level:
    """A scene on one of its meshes: vertices, seconds of set-up and steps, and its estimated error."""

    nodes: int
    seconds: float
    error: float


@dataclass
class Result:
    """What a study found: rows of runs, tables of (heading, columns, rows), and of a scene its levels."""

    name: str
    what: str
    quick: bool
    rows: list[Row] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    levels: list[Level] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def rates(rows: Sequence[Row], attribute: str = "error_l2") -> list[float]:
    """Return the observed orders of one scheme's runs, coarse to fine."""
    chosen = sorted(rows, key=lambda row: row.n)
    return [float(x) for x in rate([1.0 / row.n for row in chosen], [getattr(row, attribute) for row in chosen])]
