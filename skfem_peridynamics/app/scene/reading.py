"""Strict reading of tables into frozen dataclasses: every wrong key or value is named with its path."""

from __future__ import annotations

import contextlib
import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any, TypeVar

from .shown import cut, shown

_T = TypeVar("_T")
# what people write for a key
_SYMBOLS = {
    **{"nu": "poisson", "E": "young", "rho": "density", "G_c": "toughness", "Gc": "toughness", "K_IC": "K_Ic"},
    **{"lambda": "lame", "K": "bulk", "G": "mu", "eps": "horizon", "delta": "horizon", "J": "influence", "dt": "step"},
    **{"T": "until", "t_end": "until", "filename": "file", "u": "displacement", "v": "velocity"},
}
LARGEST = 1e100  # powers of it must stay numbers
LONGEST = 1000  # characters of a text that is no formula: a title, the name of a file or a group
_LISTED = 20  # mistakes told at once
MOST_ROWS = 1000  # rows of an array: corners of a crack


class SceneError(ValueError):
    """Something in a scene is not as it should be; the message names the key, its value and what would be right.

    ``mistakes`` has the sentences one by one, where there are several.
    """

    def __init__(self, message: str, mistakes: tuple[str, ...] = ()) -> None:
        super().__init__(message)
        self.mistakes = mistakes or (message,)

    @classmethod
    def together(cls, errors: list[SceneError]) -> SceneError:
        """Return one error of all.

        >>> print(SceneError.together([SceneError("a is missing"), SceneError("b = 0 must be positive")]))
        2 mistakes: (1) a is missing; (2) b = 0 must be positive
        """
        mistakes = tuple(dict.fromkeys(sentence for error in errors for sentence in error.mistakes))
        if len(mistakes) == 1:
            return cls(mistakes[0])
        listed = "; ".join(f"({k}) {sentence}" for k, sentence in enumerate(mistakes[:_LISTED], 1))
        more = f"; and {len(mistakes) - _LISTED} more" if len(mistakes) > _LISTED else ""
        return cls(f"{len(mistakes)} mistakes: {listed}{more}", mistakes)


class Mistakes:
    """Go on after a mistake, to find the others; :meth:`tell` raises all of them together."""

    def __init__(self) -> None:
        self.errors: list[SceneError] = []

    @contextlib.contextmanager
    def noted(self) -> Iterator[None]:
        """Keep what is raised inside."""
        try:
            yield
        except SceneError as error:
            self.errors.append(error)

    def tell(self) -> None:
        """Raise what was noted. Raises :class:`SceneError`."""
        if self.errors:
            raise SceneError.together(self.errors) from None


def key(read: Callable[[Any, str], Any], default: Any = dataclasses.MISSING) -> Any:
    """Declare a key of a table: how its value is read, and its default (a key without one must be given)."""
    metadata = {"read": read}
    if isinstance(default, (list, dict)):
        raise TypeError("a default must be immutable")
    return dataclasses.field(default=default, metadata=metadata)


def table(kind: type[_T]) -> Callable[[Any, str], _T]:
    """Read a table into a dataclass whose fields were declared with :func:`key`."""

    def read(value: Any, path: str) -> _T:
        if not isinstance(value, Mapping):
            raise SceneError(f"{path} = {shown(value)} must be a table")
        fields = {field.name: field for field in dataclasses.fields(kind) if field.metadata}  # type: ignore[arg-type]
        dot = f"{path}." if path else ""
        refused: Mapping[str, str] = getattr(kind, "refused", {})  # keys that other codes have, and why not here
        mistakes, given = Mistakes(), {}
        for name in value:
            with mistakes.noted():
                if name in refused:
                    raise SceneError(f"{dot}{cut(name)} = {shown(value[name])}: {refused[name]}")
                if name not in fields:
                    near = [_SYMBOLS[name]] if _SYMBOLS.get(name) in fields else get_close_matches(name, fields, n=1)
                    hint = f"did you mean {near[0]!r}?" if near else f"the keys there are {', '.join(fields)}"
                    raise SceneError(f"{dot}{cut(name)} = {shown(value[name])}: there is no such key; {hint}")
                given[name] = fields[name].metadata["read"](value[name], f"{dot}{name}")
        for name, field in fields.items():
            with mistakes.noted():
                if name not in value and field.default is dataclasses.MISSING:
                    raise SceneError(f"{dot}{name} is missing; it must be given")
        mistakes.tell()
        try:
            return kind(**given)
        except ValueError as error:
            raise SceneError(f"{path}: {error}") from None

    return read


def tables(kind: type[_T], most: int) -> Callable[[Any, str], tuple[_T, ...]]:
    """Read an array of tables, ``[[path]]``, of at most so many."""
    read_table = table(kind)

    def read(value: Any, path: str) -> tuple[_T, ...]:
        if not isinstance(value, list):
            raise SceneError(f"{path} must be an array of tables: write [[{path}]]")
        if len(value) > most:
            raise SceneError(f"[[{path}]] is given {len(value)} times; at most {most} are taken")
        mistakes, found = Mistakes(), []
        for k, entry in enumerate(value):
            with mistakes.noted():
                found.append(read_table(entry, f"{path}[{k}]"))
        mistakes.tell()
        return tuple(found)

    return read


def number(value: Any, path: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LARGEST:
        raise SceneError(f"{path} = {shown(value)} must be a finite number")
    return float(value)


def positive(value: Any, path: str) -> float:
    if number(value, path) <= 0.0:
        raise SceneError(f"{path} = {shown(value)} must be a positive number")
    if value < 1.0 / LARGEST:
        raise SceneError(f"{path} = {shown(value)} is too small to compute with; it must be at least {1.0 / LARGEST:g}")
    return float(value)


def count(value: Any, path: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise SceneError(f"{path} = {shown(value)} must be a whole number, 0 or more")
    if value > LARGEST:
        raise SceneError(f"{path} = {shown(value)} is beyond any count")
    return value


def count_up_to(most: int) -> Callable[[Any, str], int]:
    """A whole number with a bound."""

    def read(value: Any, path: str) -> int:
        if count(value, path) > most:
            raise SceneError(f"{path} = {shown(value)} is too many; at most {most} are taken")
        return int(value)

    return read


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


def flag(value: Any, path: str) -> bool:
    if not isinstance(value, bool):
        raise SceneError(f"{path} = {shown(value)} must be true or false")
    return value


def text(value: Any, path: str) -> str:
    if not isinstance(value, str) or not value:
        raise SceneError(f"{path} = {shown(value)} must be a text")
    if len(value) > LONGEST:
        raise SceneError(f"{path} = {shown(value)} has {len(value)} characters; at most {LONGEST} are taken")
    return value


def choice(*options: str) -> Callable[[Any, str], str]:
    def read(value: Any, path: str) -> str:
        if value not in options:
            raise SceneError(f"{path} = {shown(value)} must be one of {', '.join(options)}")
        return str(value)

    return read


def choices(*options: str) -> Callable[[Any, str], tuple[str, ...]]:
    """An array of some of the options."""
    read_choice = choice(*options)

    def read(value: Any, path: str) -> tuple[str, ...]:
        if not isinstance(value, list):
            raise SceneError(f"{path} = {shown(value)} must be an array of {', '.join(map(repr, options))}")
        return tuple(read_choice(entry, f"{path}[{k}]") for k, entry in enumerate(value))

    return read


def numbers(value: Any, path: str) -> tuple[float, ...]:
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {shown(value)} must be an array of numbers")
    return tuple(number(entry, f"{path}[{k}]") for k, entry in enumerate(value))


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


def counts(value: Any, path: str) -> tuple[int, ...]:
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {shown(value)} must be an array of whole numbers")
    return tuple(count(entry, f"{path}[{k}]") for k, entry in enumerate(value))


@contextlib.contextmanager
def blame(path: str) -> Iterator[None]:
    """Turn a ValueError of the library into a SceneError that starts with the path of the key."""
    try:
        yield
    except SceneError:  # it names its key already
        raise
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None
