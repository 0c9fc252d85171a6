"""Vectors that users give, checked once: initial values and loads."""

from __future__ import annotations

import numpy as np

from .._types import Floats, Load
from .._vectors import real_vector


def initial_vector(x: Floats | None, size: int, name: str) -> Floats:
    """Return an array of our own, zeros for None. Raises ``ValueError`` for another length and what is not finite."""
    if x is None:
        return np.zeros(size)
    x = real_vector(x, name).copy()
    if x.shape != (size,):
        raise ValueError(f"{name} has shape {x.shape}; the body has {size} degrees of freedom")
    bad = np.flatnonzero(~np.isfinite(x))
    if len(bad):
        raise ValueError(f"{name}[{bad[0]}] = {x[bad[0]]} is not finite ({len(bad)} of {size} values are not)")
    return x


def checked_load(b: Floats, size: int, t: float) -> Floats:
    """Return the load as an array of our own: the caller may fill the same one each time."""
    b = real_vector(b, f"load({t:g})").copy()
    if b.shape != (size,):
        raise ValueError(f"load({t:g}) has shape {b.shape}; the body has {size} degrees of freedom")
    if not np.isfinite(b).all():
        bad = np.flatnonzero(~np.isfinite(b))
        raise ValueError(f"load({t:g})[{bad[0]}] = {b[bad[0]]} is not finite ({len(bad)} of {size} values are not)")
    return b


def check_start(u: Floats, size: int) -> None:
    """Raise ``ValueError`` for a state to start from that is one of another body."""
    if u.shape != (size,):
        raise ValueError(f"the state to start from has {len(u)} degrees of freedom; the body has {size}")


def check_load(load: Load | None) -> None:
    """Raise ``ValueError`` for a load that is no function of time."""
    if load is not None and not callable(load):
        raise ValueError("load must be a function of t that gives a vector: for a constant one, load=lambda t: vector")
