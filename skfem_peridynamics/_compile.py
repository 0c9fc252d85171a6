"""Compiled loops: numba where the extra ``fast`` is installed, and a plain no where it is not.

Everything that needs numba goes through here. Compiled code is cached on disk; where no cache can be written, or the
one that is there cannot be read, the loops are compiled anew in each process and nothing else changes. Loops release
the interpreter lock and never start threads of their own.
"""

from __future__ import annotations

import importlib.util
import logging
import os
from collections.abc import Callable
from functools import cache
from typing import Any


def installed() -> bool:
    """Return whether numba is there and not switched off. It is not imported to find out."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return False
    return importlib.util.find_spec("numba") is not None


@cache
def available() -> bool:
    """Return whether loops can be compiled; imports numba. One that cannot be imported is none, and is told of once."""
    if not installed():
        return False
    try:
        import numba  # noqa: F401
    except ImportError as error:
        log = logging.getLogger("skfem_peridynamics")
        log.warning("numba is installed and cannot be imported; sparse products stand in: %s", error)
        return False
    return True


def compiled(function: Callable[..., Any], reassociate: bool = False, keep: bool = True) -> Callable[..., Any]:
    """Compile a loop when it is first called; ``reassociate`` lets its sums be taken in any order.

    ``keep`` stores the code on disk. Division by zero gives infinity, as in NumPy.
    """
    import numba

    flags = {"contract", "nsz"} | ({"reassoc"} if reassociate else set())
    options = {"nogil": True, "error_model": "numpy", "fastmath": flags}
    if keep:
        try:
            loop = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # no place to keep it: a read-only home, or a package inside an archive
            pass
        else:
            _forgive(loop)
            return loop  # type: ignore[no-any-return]
    return numba.njit(**options)(function)  # type: ignore[no-any-return]


def unordered(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a loop of sums that may be taken in any order."""
    return compiled(function, reassociate=True)


def _forgive(dispatcher: Any) -> None:
    """Make a cache that is safe to have.

    One that cannot be read or written (disk full, a file cut short) is none. And code is taken from it only if it was
    made from the same loops: numba itself looks at the file of a loop, not at those of the loops that it calls.
    """
    store = getattr(dispatcher, "_cache", None)
    for name in ("load_overload", "save_overload"):
        act = getattr(store, name, None)
        if act is not None:
            setattr(store, name, _forgiving(act))
    key = getattr(store, "_index_key", None)
    if store is not None and key is not None:
        store._index_key = lambda *arguments: (*key(*arguments), _fingerprint())


@cache
def _fingerprint() -> str:
    """A hash of all compiled loops of the package."""
    from hashlib import sha256
    from pathlib import Path

    digest = sha256()
    for file in sorted(Path(__file__).parent.rglob("*_loops.py")):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def _forgiving(act: Callable[..., Any]) -> Callable[..., Any]:
    def attempt(*arguments: Any) -> Any:
        try:
            return act(*arguments)
        except Exception:
            return None  # numba takes None for "not there"

    return attempt


def scalar(function: Any) -> Callable[[float], float]:
    """Compile a user's function of one number, unless it is already."""
    if hasattr(function, "py_func"):
        return function  # type: ignore[no-any-return]
    import inspect

    return compiled(function if inspect.isfunction(function) else _around(function), keep=False)


def on_arrays(function: Any) -> Callable[..., Any]:
    """Return a function of one number as one of arrays, compiled where that can be."""
    if available():
        import inspect

        import numba

        plain = getattr(function, "py_func", function)
        vectorised: Callable[..., Any] = numba.vectorize(plain if inspect.isfunction(plain) else _around(plain))
        return vectorised
    import numpy as np

    return np.vectorize(function, otypes=[float])


def _around(function: Any) -> Callable[[float], float]:
    """A function of Python around one of C, such as ``math.log1p``: numba compiles no other."""
    return lambda q: function(q)
