"""Files of the output that are never seen half written; folders, and who writes to them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ... import _files
from ..scene.reading import SceneError
from ..scene.shown import named

LOCK = ".lock"


class OutputError(RuntimeError):
    """A file of the output could not be written; the message names it."""

    def __init__(self, path: Path, error: OSError) -> None:
        super().__init__(f"{named(path)} cannot be written: {error.strerror or error}")


@contextlib.contextmanager
def aside(path: Path, keep_open: bool = False) -> Iterator[IO[bytes]]:
    """Give a new file to write; when that is done it takes its name. Raises :class:`OutputError`, with that name."""
    try:
        with _files.aside(path, keep_open) as file:
            yield file
    except OSError as error:
        raise OutputError(path, error) from error


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is never seen half written. Raises :class:`OutputError`.

    Half of a pair of surrogates, which a file name may have and UTF-8 has not, becomes a question mark.
    """
    with aside(path) as file:
        _files.write_all(file, content.encode(errors="replace") if isinstance(content, str) else content)


def make_folder(folder: Path) -> None:
    """Make an output folder. Raises :class:`SceneError` where that is not possible."""
    check_name(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise SceneError(f"output folder {named(folder)} cannot be written: {error.strerror}") from None


def check_name(folder: Path) -> None:
    """Raise :class:`SceneError` where no folder can be under this name, or something else is."""
    try:
        is_other = folder.exists() and not folder.is_dir()
    except ValueError:
        raise SceneError(f"output folder {named(folder)} is no name of a folder") from None
    except OSError as error:  # too long, or in a folder that cannot be looked into
        raise SceneError(f"output folder {named(folder)} cannot be looked at: {error.strerror}") from None
    if is_other:
        raise SceneError(f"output folder {named(folder)} exists and is not a folder")


@contextlib.contextmanager
def hold(folder: Path) -> Iterator[None]:
    """Keep a folder for one run; the system lets go of it when the process ends, however that happens.

    It is written by its handle as long as this lasts. Raises :class:`SceneError` where another run holds it, or
    nothing can be written there.
    """
    path = folder / LOCK
    with contextlib.ExitStack() as stack:
        try:
            stack.enter_context(_files.held(folder))
            file = _locked(path)
        except BlockingIOError:
            owner = _owner(path)
            raise SceneError(
                f"output folder {named(folder)} is in use by another run{owner}; give this one another"
            ) from None
        except OSError as error:
            raise SceneError(f"output folder {named(folder)} cannot be written: {error.strerror}") from None
        try:
            yield
        finally:
            with contextlib.suppress(OSError):
                if _is(file, path):  # still ours: folders get removed and made again
                    _files.remove(path)
            os.close(file)


def _locked(path: Path) -> int:
    """Return a new file, locked. One that is left of a run that died is locked, too, and removed: never written to."""
    while True:
        with _files.handle_of(path.parent) as folder:
            try:
                file = _files.open_new(path, folder)
            except FileExistsError:
                _remove_left(path, folder)
                continue
            descriptor = os.dup(file.fileno())
            file.close()
        try:
            _lock(descriptor)
            if _is(descriptor, path):
                os.write(descriptor, f"{os.getpid()}\n".encode())
                return descriptor
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)


def _remove_left(path: Path, folder: int | None) -> None:
    """Remove the lock of a run that died. Raises ``BlockingIOError`` where one is alive, ``OSError`` for a link."""
    flags = os.O_RDONLY | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NONBLOCK", 0)
    try:
        file = os.open(path if folder is None else path.name, flags, dir_fd=folder)
    except FileNotFoundError:
        return
    try:
        _lock(file)
        if _is(file, path):
            _files.remove(path)
    except FileNotFoundError:
        pass
    finally:
        os.close(file)


def _is(file: int, path: Path) -> bool:
    """Whether a name stands for an open file."""
    with _files.handle_of(path.parent) as folder:
        there = os.stat(path if folder is None else path.name, dir_fd=folder, follow_symlinks=False)
    return os.path.samestat(os.fstat(file), there)


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
        return f" (process {int(_files.read_regular(path, 100))})"
    return ""
