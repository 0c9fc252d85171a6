"""Readers of single values: each refuses what makes no sense, and has the JSON Schema of what it takes."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable
from typing import Any, TypeVar

from .reading import SceneError
from .shown import shown

_F = TypeVar("_F", bound=Callable[[Any, str], Any])
LARGEST = 1e100  # powers of it must stay numbers
LONGEST = 1000  # characters of a text that is no formula: a title, the name of a file or a group
MOST_ROWS = 1000  # rows of an array: corners of a crack
_NUMBER: dict[str, Any] = {"type": "number"}
_COUNT: dict[str, Any] = {"type": "integer", "minimum": 0}


def takes(**schema: Any) -> Callable[[_F], _F]:
    """Say with JSON Schema what a reader takes; :func:`schema_of` reads it back."""

    def mark(read: _F) -> _F:
        read.__dict__["schema"] = schema
        return read

    return mark


def schema_of(read: Callable[[Any, str], Any]) -> dict[str, Any]:
    """Return the JSON Schema of what a reader takes.

    >>> schema_of(positive)
    {'type': 'number', 'exclusiveMinimum': 0}
    """
    return dict(read.__dict__["schema"])


@takes(type="number")
def number(value: Any, path: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
        raise SceneError(f"{path} = {shown(value)} must be a finite number")
    return float(value)


@takes(type="number", exclusiveMinimum=0)
def positive(value: Any, path: str) -> float:
    if number(value, path) <= 0.0:
        raise SceneError(f"{path} = {shown(value)} must be a positive number")
    if value < 1.0 / LARGEST:
        raise SceneError(f"{path} = {shown(value)} is too small to compute with; it must be at least {1.0 / LARGEST:g}")
    return float(value)


@takes(**_COUNT)
def count(value: Any, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise SceneError(f"{path} = {shown(value)} must be a whole number, 0 or more")
    if value > LARGEST:
        raise SceneError(f"{path} = {shown(value)} is beyond any count")
    return value


def count_up_to(most: int) -> Callable[[Any, str], int]:
    """A whole number with a bound."""

    @takes(type="integer", minimum=0, maximum=most)
    def read(value: Any, path: str) -> int:
        if count(value, path) > most:
            raise SceneError(f"{path} = {shown(value)} is too many; at most {most} are taken")
        return int(value)

    return read


@takes(anyOf=[_COUNT, {"type": "string"}])
def interval(value: Any, path: str) -> int | str:
    """A number of steps (0: never), or a text such as ``"30 s"``, ``"10 min"``, ``"1 h"``, ``"500 steps"``."""
    if isinstance(value, str):
        _ = Every.read(value, path)
        return value
    return count(value, path)


@dataclasses.dataclass(frozen=True)
class Every:
    """How often something is done: after so many steps, or seconds; one of them is 0.

    >>> Every.read("2 min"), Every.read(500)
    (Every(steps=0, seconds=120.0), Every(steps=500, seconds=0.0))
    """

    steps: int = 0
    seconds: float = 0.0

    @classmethod
    def read(cls, value: int | str, path: str = "interval") -> Every:
        """Read a number of steps or a text. Raises :class:`SceneError`."""
        if isinstance(value, int):
            return cls(steps=value)
        match = re.fullmatch(r"\s*(\d{1,12}|\d{0,12}\.\d{1,12})\s*(s|min|h|steps)\s*", value, re.ASCII)
        if match is None or float(match[1]) == 0.0 or (match[2] == "steps" and "." in match[1]):
            raise SceneError(
                f'{path} = {shown(value)} must be a number of steps, or a text like "30 s", "10 min" or "1 h"'
            )
        if match[2] == "steps":
            return cls(steps=int(match[1]))
        return cls(seconds=float(match[1]) * {"s": 1.0, "min": 60.0, "h": 3600.0}[match[2]])


@takes(type="boolean")
def flag(value: Any, path: str) -> bool:
    if not isinstance(value, bool):
        raise SceneError(f"{path} = {shown(value)} must be true or false")
    return value


@takes(type="string", minLength=1, maxLength=LONGEST)
def text(value: Any, path: str) -> str:
    if not isinstance(value, str) or not value:
        raise SceneError(f"{path} = {shown(value)} must be a text")
    if len(value) > LONGEST:
        raise SceneError(f"{path} = {shown(value)} has {len(value)} characters; at most {LONGEST} are taken")
    if any("\ud800" <= c <= "\udfff" for c in value):
        raise SceneError(f"{path} = {shown(value)} is no text: it has half a character in it")
    return value


def choice(*options: str) -> Callable[[Any, str], str]:
    @takes(enum=list(options))
    def read(value: Any, path: str) -> str:
        if value not in options:
            raise SceneError(f"{path} = {shown(value)} must be one of {', '.join(options)}")
        return str(value)

    return read


def choices(*options: str) -> Callable[[Any, str], tuple[str, ...]]:
    """An array of some of the options."""
    read_choice = choice(*options)

    @takes(type="array", items={"enum": list(options)})
    def read(value: Any, path: str) -> tuple[str, ...]:
        if not isinstance(value, list):
            raise SceneError(f"{path} = {shown(value)} must be an array of {', '.join(map(repr, options))}")
        return tuple(read_choice(entry, f"{path}[{k}]") for k, entry in enumerate(value))

    return read


@takes(type="array", items=_NUMBER, minItems=1)
def numbers(value: Any, path: str) -> tuple[float, ...]:
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {shown(value)} must be an array of numbers")
    return tuple(number(entry, f"{path}[{k}]") for k, entry in enumerate(value))


@takes(type="array", items={"type": "array", "items": _NUMBER, "minItems": 1}, minItems=1, maxItems=MOST_ROWS)
def rows(value: Any, path: str) -> tuple[tuple[float, ...], ...]:
    """An array of arrays of numbers, as long as each other."""
    if not isinstance(value, list) or not value or not all(isinstance(row, list) and row for row in value):
        raise SceneError(f"{path} = {shown(value)} must be an array of arrays of numbers")
    if len(value) > MOST_ROWS:
        raise SceneError(f"{path} has {len(value)} rows; at most {MOST_ROWS} are taken")
    read = tuple(
        tuple(number(entry, f"{path}[{i}][{k}]") for k, entry in enumerate(row)) for i, row in enumerate(value)
    )
    if len({len(row) for row in read}) > 1:
        raise SceneError(f"{path} = {shown(value)} must have rows of one length")
    return read


@takes(type="array", items=_COUNT, minItems=1)
def counts(value: Any, path: str) -> tuple[int, ...]:
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {shown(value)} must be an array of whole numbers")
    return tuple(count(entry, f"{path}[{k}]") for k, entry in enumerate(value))
