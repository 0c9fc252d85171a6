"""The text of Abaqus and CalculiX input files: keywords with their parameters, and rows of numbers below them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .entries import content_of, decoded

_DEEPEST = 8  # of files that include each other
_FILES = 100  # that are included, again or not


@dataclass
class Section:
    """A keyword with its parameters, its data lines and where it stands."""

    keyword: str
    parameters: dict[str, str]
    line: int
    folder: Path
    data: list[str] = field(default_factory=list)

    def __getitem__(self, name: str) -> str:
        """Return a parameter that must be there."""
        if not self.parameters.get(name):
            raise ValueError(f"line {self.line}: *{self.keyword} has no {name}=")
        return self.parameters[name]

    def only(self, *names: str) -> None:
        """Raise ``ValueError`` for a parameter that is not one of these."""
        for name in self.parameters:
            if name not in names:
                raise ValueError(
                    f"line {self.line}: *{self.keyword} has the parameter {name[:60]}, which is not read; "
                    f"{', '.join(names)} are"
                )

    def fields(self) -> list[str]:
        """Return the entries of all data lines, without quotes and without empty ones at the ends of lines."""
        entries = (entry.strip().strip('"') for line in self.data for entry in line.split(","))
        return [entry for entry in entries if entry]


def sections(path: Path) -> Iterator[Section]:
    """Yield the keywords of a file and of those it includes, each with all its data lines."""
    yield from _sections(path, 0, [0])


def _sections(path: Path, depth: int, included: list[int]) -> Iterator[Section]:
    included[0] += 1
    if not path.is_file():
        raise ValueError(f"it includes {str(path)!r}, which is not a file")
    if depth > _DEEPEST:
        raise ValueError(f"it includes files more than {_DEEPEST} deep, the last is {str(path)!r}")
    if included[0] > _FILES:
        raise ValueError(f"it includes more than {_FILES} files, the last is {str(path)!r}")
    current: Section | None = None
    lines = iter(enumerate(decoded(content_of(path)).splitlines(), 1))
    for number, line in lines:
        text = line.strip()
        if not text or text.startswith("**"):
            continue
        if not text.startswith("*"):
            if current is None:
                raise ValueError(f"line {number} stands before the first keyword")
            current.data.append(text)
            continue
        if current is not None:
            yield current
        while text.endswith(","):  # a keyword line that goes on
            more = next(lines, None)
            if more is None:
                raise ValueError(f"line {number}: the file ends in a keyword line that goes on")
            text += more[1].strip()
        current = _section(text, number, path.parent)
        if current.keyword == "INCLUDE":
            yield from _sections(path.parent / current["INPUT"], depth + 1, included)
            current = None
        elif current.keyword in ("NODE", "ELEMENT") and "INPUT" in current.parameters:
            included[0] += 1
            if included[0] > _FILES:
                raise ValueError(f"it includes more than {_FILES} files, the last by line {number}")
            current.data += _rows_elsewhere(current)
    if current is not None:
        yield current


def _section(text: str, number: int, folder: Path) -> Section:
    """A keyword line, taken apart."""
    word, *options = (entry.strip() for entry in text[1:].split(","))
    parameters = {}
    for option in options:
        name, _, value = option.partition("=")
        if name.strip().isdigit():
            raise ValueError(f"line {number}: *{word} goes on into a row of numbers: its line ends in a comma")
        parameters[name.strip().upper()] = value.strip().strip('"')
    return Section(" ".join(word.upper().split()), parameters, number, folder)


def _rows_elsewhere(section: Section) -> list[str]:
    """The data lines of the file that INPUT= names."""
    path = section.folder / section["INPUT"]
    if not path.is_file():
        raise ValueError(
            f"line {section.line}: *{section.keyword} has INPUT={section['INPUT'][:60]}, which is not a file"
        )
    lines = (line.strip() for line in decoded(content_of(path)).splitlines())
    rows = [line for line in lines if line and not line.startswith("**")]
    if any(row.startswith("*") for row in rows):
        raise ValueError(f"{str(path)!r} has keywords; INPUT= of *{section.keyword} names a file of rows of numbers")
    return rows


def numbers_of(text: str, line: int) -> list[float]:
    """Return a row of numbers; an empty entry is 0, but for the comma that ends a line."""
    try:
        entries = text.rstrip(", \t").split(",")
        return [float(entry.replace("D", "E").replace("d", "e")) if entry.strip() else 0.0 for entry in entries]
    except ValueError as error:
        raise ValueError(f"below line {line}: {text[:60]!r} is not a row of numbers ({error})") from None


def rows_of(section: Section) -> list[list[float]]:
    """Return the data lines of a section as rows of numbers, of the lengths that they have."""
    rows = [row.rstrip(", \t").split(",") for row in section.data]
    lengths = [len(row) for row in rows]
    try:
        flat = np.array([entry for row in rows for entry in row], dtype=float).tolist()
    except ValueError:  # an empty entry, an exponent of Fortran's, or no number
        return [numbers_of(text, section.line) for text in section.data]
    ends = np.cumsum(lengths).tolist()
    return [flat[end - length : end] for end, length in zip(ends, lengths, strict=True)]
