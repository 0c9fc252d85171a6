"""Files that are never seen half written: made aside, flushed to the disk, renamed. Folders, and who writes to them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ..scene.reading import SceneError

LOCK = ".lock"


class OutputError(RuntimeError):
    """A file of the output could not be written; the message names it."""

    def __init__(self, path: Path, error: OSError) -> None:
        super().__init__(f"{str(path)!r} cannot be written: {error.strerror or error}")


def open_new(path: Path) -> IO[bytes]:
    """Open a file that must be new, unbuffered: a symbolic link that waits there is not followed."""
    return open(path, "xb", buffering=0)


@contextlib.contextmanager
def aside(path: Path) -> Iterator[Path]:
    """Give the path to write a file to; when that is done it is flushed and takes its final name.

    Raises :class:`OutputError`, with the final name, for any failure of the system; nothing is left behind then.

    >>> import tempfile
    >>> place = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with aside(place) as part:
    ...     _ = part.write_text("whole")
    ...     place.exists()
    False
    >>> place.read_text()
    'whole'
    """
    part = path.with_name(path.name + ".part")
    try:
        part.unlink(missing_ok=True)
        yield part
        with open(part, "rb") as file:
            os.fsync(file.fileno())
        os.replace(part, path)
        _flush_folder(path.parent)
    except BaseException as error:
        with contextlib.suppress(OSError):
            part.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise OutputError(path, error) from error
        raise


def _flush_folder(folder: Path) -> None:
    """Have the names in a folder written to the disk, where the system can."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def write_whole(path: Path, content: str) -> None:
    """Write a text file so that it is never seen half written. Raises :class:`OutputError`."""
    with aside(path) as part, open_new(part) as file:
        write_all(file, content.encode())


def write_all(file: IO[bytes], content: bytes | memoryview) -> None:
    """Write to an unbuffered file until all is written."""
    left = memoryview(content).cast("B")
    while left:
        left = left[file.write(left) :]


def make_folder(folder: Path) -> None:
    """Make an output folder. Raises :class:`SceneError` where that is not possible."""
    if folder.exists() and not folder.is_dir():
        raise SceneError(f"output folder {str(folder)!r} exists and is not a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r} cannot be written: {error.strerror}") from None


@contextlib.contextmanager
def hold(folder: Path) -> Iterator[None]:
    """Keep a folder for one run; the system lets go of it when the process ends, however that happens.

    Raises :class:`SceneError` where another run holds it, or nothing can be written there.
    """
    path = folder / LOCK
    try:
        file = _locked(path)
    except BlockingIOError:
        owner = _owner(path)
        raise SceneError(
            f"output folder {str(folder)!r} is in use by another run{owner}; give this one another"
        ) from None
    except OSError as error:
        raise SceneError(f"output folder {str(folder)!r} cannot be written: {error.strerror}") from None
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            if os.path.samestat(os.fstat(file), os.stat(path)):  # still ours: folders get removed and made again
                os.unlink(path)
        os.close(file)


def _locked(path: Path) -> int:
    """Open and lock a file; again where it was removed in between by the run that had it."""
    while True:
        file = os.open(path, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0), 0o644)
        try:
            _lock(file)
            if os.path.samestat(os.fstat(file), os.stat(path)):
                os.ftruncate(file, 0)
                os.write(file, f"{os.getpid()}\n".encode())
                return file
            os.close(file)
        except FileNotFoundError:
            os.close(file)
        except BaseException:
            os.close(file)
            raise


def _lock(file: int) -> None:
    try:
        import fcntl
    except ImportError:  # Windows
        import msvcrt

        try:
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined]
        except OSError:
            raise BlockingIOError from None
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _owner(path: Path) -> str:
    with contextlib.suppress(OSError, ValueError):
        return f" (process {int(path.read_text())})"
    return ""
