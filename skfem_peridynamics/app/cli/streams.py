"""Standard output and errors that never end a command: closed, full, of few letters, or shown on a terminal."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
from collections.abc import Iterator
from typing import TextIO


class Stream(io.TextIOBase):
    r"""Write to a stream as long as it takes anything; ``lost`` is why it took no more.

    What a terminal would obey and not show, in a title or a file name, is shown as ``\x1b``; letters that the
    stream does not have are shown that way, too.

    >>> shown = io.StringIO()
    >>> Stream(shown).write("a\x1b[2Jb\n")
    7
    >>> shown.getvalue()
    'a\\x1b[2Jb\n'
    """

    def __init__(self, stream: TextIO | None) -> None:
        self.stream = stream
        self.lost: OSError | None = None if stream is not None else OSError(errno.EBADF, "it is closed")

    def write(self, text: str) -> int:
        """Write a text, harmless."""
        shown = harmless(text)
        if self.stream is not None and self.lost is None:
            try:
                try:
                    self.stream.write(shown)
                except UnicodeEncodeError:
                    letters = getattr(self.stream, "encoding", None) or "ascii"
                    self.stream.write(shown.encode(letters, "backslashreplace").decode(letters))
            except (OSError, ValueError) as error:
                self._lose(error)
        return len(text)

    def flush(self) -> None:
        """Flush, as far as that goes."""
        if self.stream is not None and self.lost is None:
            try:
                self.stream.flush()
            except (OSError, ValueError) as error:
                self._lose(error)

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        try:
            return self.stream is not None and self.lost is None and self.stream.isatty()
        except ValueError:
            return False

    def _lose(self, error: OSError | ValueError) -> None:
        """Let what is left in the stream, which the interpreter would flush at its end, go nowhere."""
        self.lost = error if isinstance(error, OSError) else OSError(errno.EBADF, "it is closed")
        try:
            assert self.stream is not None
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self.stream.fileno())
            os.close(nowhere)
        except (OSError, ValueError):
            pass


def harmless(text: str) -> str:
    """Return a text with what is not to be shown written out.

    >>> harmless("tab\\tand \\u202e turned")
    'tab\\tand \\\\u202e turned'
    """
    if text.isprintable():
        return text
    return "".join(
        c if c.isprintable() or c in "\n\t" else c.encode("unicode_escape", "surrogatepass").decode() for c in text
    )


@contextlib.contextmanager
def guarded() -> Iterator[tuple[Stream, Stream]]:
    """Put output and errors of the process under guard while this lasts."""
    before = sys.stdout, sys.stderr
    if None in before:  # closed: no file that is opened may take their numbers
        while (nowhere := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass
        os.close(nowhere)
    out, err = Stream(sys.stdout), Stream(sys.stderr)
    sys.stdout, sys.stderr = out, err
    try:
        yield out, err
    finally:
        out.flush()
        err.flush()
        sys.stdout, sys.stderr = before
