"""What a study found."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from .._version import __version__
from .measure import Row
from .rates import rate


@dataclass
class Result:
    """What a study found: rows of runs, and tables of (heading, columns, rows)."""

    name: str
    what: str
    quick: bool
    rows: list[Row] = field(default_factory=list)
    tables: list[tuple[str, tuple[str, ...], list[tuple[Any, ...]]]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def as_json(self) -> str:
        from ..app.files.history import _plain
        from .measure import as_dict

        content = {
            "study": self.name,
            "what": self.what,
            "quick": self.quick,
            "version": __version__,
            "rows": [_plain(as_dict(row)) for row in self.rows],
            "tables": [
                {"heading": heading, "columns": list(columns), "rows": [[_plain(x) for x in row] for row in rows]}
                for heading, columns, rows in self.tables
            ],
            "notes": self.notes,
        }
        return json.dumps(content, indent=2, allow_nan=False) + "\n"


def rates(rows: Sequence[Row], attribute: str = "error_l2") -> list[float]:
    """Return the observed orders of one scheme's runs, coarse to fine."""
    chosen = sorted(rows, key=lambda row: row.n)
    return [float(x) for x in rate([1.0 / row.n for row in chosen], [getattr(row, attribute) for row in chosen])]
