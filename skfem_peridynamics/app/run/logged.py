"""What a run says besides its numbers: kept for its summary."""

from __future__ import annotations

import contextlib
import logging
import threading
from collections.abc import Iterator

_log = logging.getLogger("skfem_peridynamics")


class _Keeper(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.notes: list[str] = []
        self.of = threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self.of:  # another run may go on in another thread
            self.notes.append(record.getMessage())


@contextlib.contextmanager
def logged_warnings() -> Iterator[list[str]]:
    """Collect the warnings that this thread logs meanwhile."""
    keeper = _Keeper()
    _log.addHandler(keeper)
    try:
        yield keeper.notes
    finally:
        _log.removeHandler(keeper)
