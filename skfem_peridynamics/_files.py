"""Files of the disk: only regular ones are read, and nothing is written through a name that was there before.

A folder that is held (:func:`held`) is written by its handle: whoever puts a link in its place, or under a name that
is about to be written, is told of and gets nothing. A file that is written appears under its name when it is whole.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import IO

_HANDLES = os.open in os.supports_dir_fd and hasattr(os, "O_DIRECTORY")  # not on Windows: names stand in
_SAFE = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_CLOEXEC", 0) | getattr(os, "O_NOCTTY", 0)
_KINDS = {stat.S_IFIFO: "a pipe", stat.S_IFSOCK: "a socket", stat.S_IFDIR: "a folder"}
_held: dict[str, int] = {}  # folders that this process holds, by their absolute names, and their handles
MB = 1 << 20


def open_regular(path: str | Path, most: float = float("inf")) -> IO[bytes]:
    """Open a file to read. Raises ``OSError`` for pipes, devices and folders, and beyond ``most`` bytes; never waits.

    >>> open_regular(os.devnull)
    Traceback (most recent call last):
    ...
    OSError: [Errno 22] it is a device, not a file
    """
    flags = (
        os.O_RDONLY
        | getattr(os, "O_NONBLOCK", 0)
        | getattr(os, "O_BINARY", 0)
        | (_SAFE & ~getattr(os, "O_NOFOLLOW", 0))
    )
    descriptor = os.open(path, flags)
    try:
        found = os.fstat(descriptor)
        if not stat.S_ISREG(found.st_mode):
            kind = _KINDS.get(stat.S_IFMT(found.st_mode), "a device")
            raise OSError(errno.EINVAL, f"it is {kind}, not a file")
        if found.st_size > most:
            raise OSError(errno.EFBIG, f"it has {found.st_size / MB:.0f} MB, more than {most / MB:.0f} MB")
    except BaseException:
        os.close(descriptor)
        raise
    return open(descriptor, "rb")


def read_regular(path: str | Path, most: float = float("inf")) -> bytes:
    """Return what is in a file. Raises ``OSError`` as :func:`open_regular` does."""
    with open_regular(path, most) as file:
        return file.read()


@contextlib.contextmanager
def held(folder: Path) -> Iterator[None]:
    """Hold a folder: as long as this lasts it is written by its handle."""
    if not _HANDLES:
        yield
        return
    name, handle = os.path.abspath(folder), os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    before = _held.get(name)
    _held[name] = handle
    try:
        yield
    finally:
        if before is None:
            del _held[name]
        else:
            _held[name] = before
        os.close(handle)


@contextlib.contextmanager
def handle_of(folder: Path) -> Iterator[int | None]:
    """Give the handle of a folder, None where the system has none.

    Raises ``OSError`` where another folder, or a link to one, has taken the place of one that is held.
    """
    if not _HANDLES:
        yield None
        return
    handle = _held.get(os.path.abspath(folder))
    if handle is not None:
        if not os.path.samestat(os.stat(folder), os.fstat(handle)):
            raise OSError(errno.ESTALE, "another folder has taken the place of the one that was begun with")
        yield handle
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        yield handle
    finally:
        os.close(handle)


def open_new(path: Path, folder: int | None, append: bool = False) -> IO[bytes]:
    """Open a file that must be new, unbuffered; a link that waits under its name is not followed."""
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | _SAFE | getattr(os, "O_BINARY", 0) | (os.O_APPEND if append else 0)
    name = path if folder is None else path.name
    return open(os.open(name, flags, 0o666, dir_fd=folder), "ab" if append else "wb", buffering=0)


@contextlib.contextmanager
def aside(path: Path, keep_open: bool = False) -> Iterator[IO[bytes]]:
    """Give a new file to write, unbuffered; when that is done it is flushed to the disk and takes its name.

    Raises ``OSError``; nothing is left behind then, and what was there before stays. ``keep_open`` leaves the file to
    the caller, to append to.

    >>> import tempfile
    >>> place = Path(tempfile.mkdtemp()) / "a.txt"
    >>> with aside(place) as file:
    ...     _ = file.write(b"whole")
    ...     place.exists()
    False
    >>> place.read_text()
    'whole'
    """
    part = path.with_name(path.name + ".part")
    with handle_of(path.parent) as folder:
        _unlink(part, folder)
        file = open_new(part, folder, keep_open)
        try:
            yield file
            os.fsync(file.fileno())
            _check_ours(file, part, folder)
            if folder is None and not keep_open:
                file.close()  # Windows renames no open file
            names = (part, path) if folder is None else (part.name, path.name)
            os.replace(*names, src_dir_fd=folder, dst_dir_fd=folder)
            with contextlib.suppress(OSError):
                if folder is not None:
                    os.fsync(folder)
        except BaseException:
            file.close()
            with contextlib.suppress(OSError):
                _unlink(part, folder)
            raise
        if not keep_open:
            file.close()


def _check_ours(file: IO[bytes], path: Path, folder: int | None) -> None:
    """Raise ``OSError`` where a name stands no longer for the file that was opened, or others stand for it, too."""
    there, ours = (
        os.stat(path if folder is None else path.name, dir_fd=folder, follow_symlinks=False),
        os.fstat(file.fileno()),
    )
    if not os.path.samestat(there, ours) or ours.st_nlink > 1:
        raise OSError(errno.ESTALE, "another file has taken its place while it was written")


def write_all(file: IO[bytes], content: bytes | memoryview) -> None:
    """Write to an unbuffered file until all is written."""
    left = memoryview(content).cast("B")
    while left:
        left = left[file.write(left) :]


def remove(path: Path) -> None:
    """Remove a file, or a link itself, where there is one. Raises ``OSError``."""
    try:
        with handle_of(path.parent) as folder:
            _unlink(path, folder)
    except FileNotFoundError:
        pass


def rename(path: Path, name: str) -> None:
    """Give a file another name in its folder. Raises ``OSError``."""
    with handle_of(path.parent) as folder:
        names = (path, path.with_name(name)) if folder is None else (path.name, name)
        os.replace(*names, src_dir_fd=folder, dst_dir_fd=folder)


def _unlink(path: Path, folder: int | None) -> None:
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path if folder is None else path.name, dir_fd=folder)
