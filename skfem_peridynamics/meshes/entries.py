"""Words and numbers of mesh files: numbers of nodes and elements are whole, and each of them is for one thing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .._files import read_regular
from .._memory import free_memory
from .._types import Floats, Longs

READING = 20  # bytes of memory a byte of a mesh file: what an .inp takes, the most of all text formats
_WHOLE = 2.0**53  # whole numbers up to here are exact as doubles


def content_of(path: Path) -> bytes:
    """Return what is in a file of a mesh. Raises ``ValueError`` where it cannot be read, or is too large."""
    try:
        return read_regular(path, free_memory() / READING)
    except OSError as error:
        raise ValueError(f"{str(path)!r} cannot be read: {error.strerror}") from None


def decoded(content: bytes) -> str:
    """Return bytes as text: UTF-8, with a mark of it or without, else Latin-1.

    >>> decoded("Träger".encode()) == decoded("Träger".encode("latin-1"))
    True
    """
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def whole(values: ArrayLike, where: str, what: str = "the number of a node or an element") -> Longs:
    """Return whole numbers. Raises ``ValueError`` for any other.

    >>> whole([1.0, 2.0], "line 3: ").tolist()
    [1, 2]
    """
    given = np.asarray(values, dtype=float)
    wrong = given[~((given == np.rint(given)) & (np.abs(given) < _WHOLE))]
    if len(wrong):
        raise ValueError(f"{where}{wrong.flat[0]:.6g} is not {what}")
    return given.astype(np.int64)


def once(numbers: Longs, rows: Longs | Floats, what: str) -> Longs:
    """Return where each number stands first, sorted by number. Raises ``ValueError`` where it comes again, and other.

    >>> once(np.array([7, 3, 7]), np.array([[1.0], [2.0], [1.0]]), "node").tolist()
    [1, 0]
    """
    found, first, inverse = np.unique(numbers, return_index=True, return_inverse=True)
    if len(found) < len(numbers):
        other = numbers[(rows != rows[first[inverse]]).any(axis=1)]
        if len(other):
            raise ValueError(f"{what} {other[0]} is listed twice, and not the same")
    return np.asarray(first, dtype=np.int64)
