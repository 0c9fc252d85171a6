"""Memory: how much is free for this process, and how much it has held."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

_UNLIMITED = float("inf")


def free_memory() -> float:
    """Return the bytes that this process can still take: of the machine, its control group and its own limit.

    Infinity where the system does not tell.
    """
    return max(0.0, min(_of_machine(), _of_group(), _of_process()))


def check_room(needed: float, what: str, instead: str) -> None:
    """Raise ``ValueError`` where so many bytes are not free, before they are taken.

    >>> check_room(1e18, "a matrix", "take a smaller one")
    Traceback (most recent call last):
    ValueError: a matrix takes some 1e+09 GB, more than is free: take a smaller one
    """
    if needed > free_memory():
        raise ValueError(f"{what} takes some {needed / 1e9:.3g} GB, more than is free: {instead}")


def peak_memory_mb() -> float:
    """Return the largest memory this process has held, in MB (nan where the system does not tell)."""
    try:
        import resource
    except ImportError:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def _of_machine() -> float:
    try:
        with open("/proc/meminfo") as table:
            for line in table:
                if line.startswith("MemAvailable"):
                    return 1024.0 * float(line.split()[1])
    except OSError:
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return _UNLIMITED


def _of_group(root: Path = Path("/sys/fs/cgroup"), table: Path = Path("/proc/self/cgroup")) -> float:
    """What the control group (version 2) and those above it leave."""
    free = _UNLIMITED
    with contextlib.suppress(OSError, ValueError, IndexError):
        name = next(line for line in table.read_text().splitlines() if line.startswith("0::"))[3:].strip("/")
        group = root / name
        while True:
            with contextlib.suppress(OSError, ValueError):
                most, taken = ((group / name).read_text() for name in ("memory.max", "memory.current"))
                free = min(free, float(most) - float(taken))
            if group == root:
                break
            group = group.parent
    return free


def _of_process() -> float:
    """What the limit of address space (``ulimit -v``) leaves."""
    try:
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit == resource.RLIM_INFINITY:
            return _UNLIMITED
        return float(limit) - _pages(0)
    except (ImportError, OSError, ValueError, IndexError):
        return _UNLIMITED


def resident_memory() -> float:
    """The bytes that this process holds in memory now."""
    return _pages(1)


def _pages(column: int) -> float:
    """A column of the kernel's table of this process, in bytes: its address space, its resident memory."""
    with open("/proc/self/statm") as table:
        return float(table.read().split()[column]) * os.sysconf("SC_PAGE_SIZE")
