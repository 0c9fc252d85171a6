"""Stop a run after the step at hand when it is asked to, at once when it is asked again."""

from __future__ import annotations

import signal
import threading
from types import FrameType, TracebackType
from typing import Any

_STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")


class Interrupted(KeyboardInterrupt):
    """A run was stopped from outside; ``code`` is what a process exits with for that."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


class Signals:
    """While it holds, a signal that would end the process sets ``asked``; one before :attr:`patient` raises.

    Signals that the host program handles itself, or ignores, are left to it, and so are all outside the main thread.
    The second one finds things as they were before: it ends the process.
    """

    def __init__(self) -> None:
        self.asked = 0
        self.patient = False
        self.when = "before its first step"  # what a signal that raises says
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Signals:
        if threading.current_thread() is threading.main_thread():
            for name in _STOPPING:
                number = getattr(signal, name, None)
                if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
                    self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._restore()

    def _restore(self) -> None:
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._restore()
        self.asked = number
        if not self.patient:
            raise self.stop(self.when)

    def stop(self, when: str) -> Interrupted:
        """Return what to raise."""
        return Interrupted(f"{signal.Signals(self.asked).name}: the run was stopped {when}", 128 + self.asked)
