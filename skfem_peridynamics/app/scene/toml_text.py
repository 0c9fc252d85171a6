"""Tables back to TOML, for the standard library only reads it: the scene of a run, to be run again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def to_toml(tables: Mapping[str, Any]) -> str:
    """Return TOML text that reads back to the same tables of numbers, texts, flags and arrays.

    >>> print(to_toml({"title": "a", "mesh": {"box": [[0.0, 1.0]]}, "crack": [{"facets": "slit"}]}))
    title = "a"
    <BLANKLINE>
    [mesh]
    box = [[0.0, 1.0]]
    <BLANKLINE>
    [[crack]]
    facets = "slit"
    <BLANKLINE>
    """
    lines = [f"{name} = {_value(entry)}" for name, entry in tables.items() if not _is_table(entry)]
    for name, entry in tables.items():
        if not _is_table(entry):
            continue
        many = isinstance(entry, list)
        for element in entry if many else [entry]:
            lines += ["", f"[[{name}]]" if many else f"[{name}]"]
            lines += [f"{key} = {_value(value)}" for key, value in element.items()]
    return "\n".join(lines) + "\n"


def _is_table(entry: Any) -> bool:
    is_array = isinstance(entry, list) and bool(entry)
    return isinstance(entry, Mapping) or (is_array and all(isinstance(element, Mapping) for element in entry))


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")  # JSON's escapes are TOML's
    if isinstance(value, list):
        return "[" + ", ".join(map(_value, value)) + "]"
    return repr(value)
