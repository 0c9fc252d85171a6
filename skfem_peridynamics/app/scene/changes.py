"""Keys of a scene that are changed from outside it: ``time.until=1e-5``."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

from .reading import SceneError
from .shown import cut, shown

_PART = re.compile(r"(\w+)((?:\[\d{1,4}\])*)", re.ASCII)


Change: TypeAlias = str | tuple[str, Any]


def changed(tables: Mapping[str, Any], changes: Sequence[Change]) -> dict[str, Any]:
    """Return the tables of a scene with some keys set anew: each ``path=value``, whose value is TOML or else a text,
    or a path with a value.

    Tables that are not there are made; entries of arrays are ``load[0].layer``. Raises :class:`SceneError`.

    >>> changed({"time": {"until": 1.0}}, ["time.until=1e-5", "title=shorter", "bonds.rule=\\"ball\\""])
    {'time': {'until': 1e-05}, 'title': 'shorter', 'bonds': {'rule': 'ball'}}
    """
    if isinstance(changes, str | Mapping):
        raise SceneError(f'changes = {shown(changes)} must be a list, as in ["time.until=1e-5"]')
    out: dict[str, Any] = _copied(tables)
    for change in changes:
        path, value, change = _parted(change)
        *above, last = _steps(path, change)
        place: Any = out
        for step in above:
            place = _below(place, step, change)
        if isinstance(last, int):
            _below(place, last, change)
        elif not isinstance(place, dict):
            raise SceneError(f"--set {shown(change)}: {cut(str(last))} is not a key of a table")
        place[last] = value
    return out


def _parted(change: Change) -> tuple[str, Any, str]:
    """The path, the value, and the text of a change."""
    if isinstance(change, tuple) and len(change) == 2 and isinstance(change[0], str):
        return change[0], _copied(change[1]), f"{change[0]}={change[1]!r}"
    if not isinstance(change, str):
        raise SceneError(f"the change {shown(change)} must be a text KEY=VALUE, or a key with its value")
    path, equals, text = change.partition("=")
    if not equals or not path.strip():
        raise SceneError(f"--set {shown(change)} must be KEY=VALUE, as in time.until=1e-5")
    return path.strip(), _value(text.strip()), change


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _copied(entry) for name, entry in value.items()}
    if hasattr(value, "tolist"):  # NumPy's numbers and arrays
        value = value.tolist()
    return [_copied(entry) for entry in value] if isinstance(value, list | tuple) else value


def _steps(path: str, change: str) -> list[str | int]:
    steps: list[str | int] = []
    for part in path.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise SceneError(f"--set {shown(change)}: {shown(path)} is no key; write it as time.until or load[0].layer")
        steps += [match[1], *(int(number) for number in re.findall(r"\d+", match[2]))]
    return steps


def _below(place: Any, step: str | int, change: str) -> Any:
    if isinstance(step, int):
        if not isinstance(place, list) or step >= len(place):
            there = f"it has {len(place)}" if isinstance(place, list) else "it is no array"
            raise SceneError(f"--set {shown(change)}: there is no entry [{step}]; {there}")
        return place[step]
    if not isinstance(place, dict):
        raise SceneError(f"--set {shown(change)}: {cut(step)} is not a key of a table")
    return place.setdefault(step, {})


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"] if "\n" not in text else text
    except (ValueError, RecursionError):
        return text
