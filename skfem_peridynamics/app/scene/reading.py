"""Strict reading of tables into frozen dataclasses: every wrong key or value is named with its path."""

from __future__ import annotations

import contextlib
import dataclasses
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
_LISTED = 20  # mistakes told at once


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

    read.__dict__["kind"] = kind
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

    read.__dict__.update(kind=kind, most=most)
    return read


@contextlib.contextmanager
def blame(path: str) -> Iterator[None]:
    """Turn a ValueError of the library into a SceneError that starts with the path of the key."""
    try:
        yield
    except SceneError:  # it names its key already
        raise
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None
