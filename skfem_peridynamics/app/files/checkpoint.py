"""Checkpoints: all that a run needs to go on to the same bits, in one file with a checksum. Two are kept.

A file is a line that names the format, a line of JSON with the numbers, the vectors as doubles, and a line with the
SHA-256 of all that. Nothing is unpickled.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..._files import open_regular, rename, write_all
from ..._files import remove as remove_file
from ..._memory import free_memory
from ..._types import Floats
from ...solve.state import Equilibrium, State, contents, rebuilt
from ..scene.shown import named
from .whole_files import OutputError, aside

NAME, OLDER = "checkpoint.bin", "checkpoint_older.bin"
_FIRST = b"skfem-peridynamics checkpoint 1\n"
_LONGEST = 1 << 26  # bytes of the line of JSON
_SUM = 65  # bytes of the last line
_KINDS: dict[str, type[State] | type[Equilibrium]] = {"state": State, "equilibrium": Equilibrium}


class DamagedCheckpoint(ValueError):
    """A file that is no checkpoint, or no longer; the message names it."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """A state of a run, the rows and the times of the frames written until then, and ``facts`` for JSON."""

    state: State | Equilibrium
    rows: list[tuple[float, ...]]
    frames: list[float]
    facts: dict[str, Any] = field(default_factory=dict)


def write_checkpoint(folder: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint aside and rename it; the one before is kept. Raises ``OutputError``."""
    state, path = checkpoint.state, folder / NAME
    kind = "equilibrium" if isinstance(state, Equilibrium) else "state"
    numbers, vectors, broken = contents(state)
    header: dict[str, Any] = {
        "kind": kind,
        "numbers": numbers,
        "rows": checkpoint.rows,
        "frames": checkpoint.frames,
        "facts": checkpoint.facts,
    }
    if state.memory is not None:
        header["spent"] = numbers.pop("spent")
    if broken is not None:
        header["broken"] = [bonds.tolist() for bonds in broken]
    header["vectors"] = list(vectors)
    with aside(path) as file:
        digest = hashlib.sha256()
        content: list[bytes | memoryview] = [_FIRST, json.dumps(header).encode() + b"\n"]
        content += [np.ascontiguousarray(x, dtype="<f8").data.cast("B") for x in vectors.values()]
        for piece in content:
            digest.update(piece)
            write_all(file, piece)
        write_all(file, digest.hexdigest().encode() + b"\n")
        os.fsync(file.fileno())
        with contextlib.suppress(FileNotFoundError):
            rename(path, OLDER)


def read_checkpoint(path: Path) -> Checkpoint:
    """Read a checkpoint. Raises :class:`DamagedCheckpoint` for a file that is not what was written."""
    try:
        with open_regular(path, free_memory()) as file:
            return _read(file, os.fstat(file.fileno()).st_size)
    except DamagedCheckpoint as error:
        raise DamagedCheckpoint(f"{named(path)} is damaged: {error}") from None
    except OSError as error:
        raise DamagedCheckpoint(f"{named(path)} cannot be read: {error.strerror}") from None
    except (KeyError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError, MemoryError) as error:
        raise DamagedCheckpoint(f"{named(path)} is not a checkpoint that a run wrote: {error}") from None


def _read(file: IO[bytes], size: int) -> Checkpoint:
    if file.readline(len(_FIRST)) != _FIRST:
        raise DamagedCheckpoint("it does not begin as one")
    _check_sum(file, size)
    file.seek(len(_FIRST))
    line = file.readline(_LONGEST)
    header = json.loads(line)
    kind = _KINDS[header["kind"]]
    numbers = {name: float(header["numbers"][name]) for name in kind.NUMBERS if name in header["numbers"]}
    count = len(header["vectors"])
    length, rest = divmod(size - len(_FIRST) - len(line) - _SUM, 8 * count)
    if rest or not np.isfinite(list(numbers.values())).all():
        raise DamagedCheckpoint("its numbers do not fit")
    vectors: dict[str, Floats] = {
        str(name): np.frombuffer(file.read(8 * length), dtype="<f8").astype(float) for name in header["vectors"]
    }
    if not set(vectors) <= {*kind.VECTORS, "tangent"}:
        raise DamagedCheckpoint("its vectors do not fit")
    if "spent" in header:
        numbers["spent"] = int(header["spent"])
    rows = [tuple(value if isinstance(value, int) else float(value) for value in row) for row in header["rows"]]
    state = rebuilt(kind, numbers, vectors, header.get("broken"))
    return Checkpoint(state, rows, [float(t) for t in header["frames"]], dict(header["facts"]))


def _check_sum(file: IO[bytes], size: int) -> None:
    digest, left = hashlib.sha256(), size - _SUM
    file.seek(0)
    while left > 0:
        chunk = file.read(min(left, 1 << 20))
        if not chunk:
            break
        digest.update(chunk)
        left -= len(chunk)
    if file.read(_SUM + 1) != digest.hexdigest().encode() + b"\n":
        raise DamagedCheckpoint("its checksum does not match what it holds")


def latest(folder: Path, report: Callable[[str], None]) -> Checkpoint | None:
    """Return the newest checkpoint that is whole, or None where there is none; ``report`` hears of a damaged one.

    Raises :class:`DamagedCheckpoint` where there are checkpoints and none is whole.
    """
    damaged: list[str] = []
    for name in (NAME, OLDER):
        path = folder / name
        if not path.is_symlink() and not path.exists():
            continue
        try:
            checkpoint = read_checkpoint(path)
        except DamagedCheckpoint as error:
            damaged.append(str(error))
            continue
        for message in damaged:
            report(f"{message}; going on from the older one, of step {checkpoint.state.step}")
            with contextlib.suppress(OSError):  # the next one must not take the place of the one that is whole
                remove_file(folder / NAME)
        return checkpoint
    if damaged:
        raise DamagedCheckpoint(f"{damaged[0]}, and there is no other; remove it to start afresh")
    return None


def remove(folder: Path) -> None:
    """Remove the checkpoints of a run that needs them no more."""
    for name in (NAME, OLDER, NAME + ".part"):
        try:
            remove_file(folder / name)
        except OSError as error:
            raise OutputError(folder / name, error) from error
