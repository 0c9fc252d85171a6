"""What a message repeats of an input: enough to find it, never all of it."""

from __future__ import annotations

from typing import Any

MOST, MOST_OF_A_NAME = 120, 200  # characters


def shown(value: Any) -> str:
    """Return a value as it is written, cut where that is long; numbers of thousands of digits are told by their size.

    >>> shown("a" * 300)[:5], len(shown("a" * 300)), shown(1 << 20000)
    ("'aaaa", 120, 'a whole number of 20001 bits')
    """
    if isinstance(value, int) and value.bit_length() > 400:
        return f"a whole number of {value.bit_length()} bits"
    if isinstance(value, str):
        return cut(repr(value[: 2 * MOST]))
    if isinstance(value, (list, tuple)):
        inside = ", ".join(shown(entry) for entry in value[:20]) + (", ..." if len(value) > 20 else "")
        return cut(f"[{inside}]")
    if isinstance(value, dict):
        return cut(
            "{" + ", ".join(f"{cut(str(name))} = {shown(entry)}" for name, entry in list(value.items())[:9]) + "}"
        )
    return cut(repr(value))


def named(path: Any) -> str:
    """Return the name of a file or a folder in quotes, cut beyond 200 characters.

    >>> named("out"), len(named("y" * 5000))
    ("'out'", 200)
    """
    return cut(repr(str(path)), MOST_OF_A_NAME)


def cut(text: str, most: int = MOST) -> str:
    """Return a text of at most so many characters, its beginning and its end.

    >>> cut("abcdefghij", 9)
    'abc...hij'
    """
    return text if len(text) <= most else f"{text[: (most - 3) // 2]}...{text[-((most - 3) - (most - 3) // 2) :]}"
