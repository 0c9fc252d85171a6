"""Vectors that users give."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ._types import Floats


def real_vector(u: npt.ArrayLike, name: str = "u") -> Floats:
    """Return an array of doubles. Raises ``ValueError`` for complex numbers, whose imaginary part would be lost.

    >>> real_vector([1, 2]).tolist()
    [1.0, 2.0]
    """
    if np.iscomplexobj(u):
        raise ValueError(f"{name} is complex: the operators are real, apply them to its two parts")
    return np.asarray(u, dtype=float)
