"""The ledger of a run: energies, work, what was dissipated, and whether they balance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Floats


@dataclass(frozen=True)
class Energies:
    """Energies at one time.

    Parameters
    ----------
    kinetic : float
        ``v.M v / 2``.
    elastic : float
        ``PD(u)``.
    work : float
        That of loads and prescribed motions so far.
    initial : float
        The first total.
    dissipated : float, optional
        What bonds have taken with them that broke for good.

    Examples
    --------
    >>> Energies(kinetic=1.0, elastic=2.0, work=1.5, initial=1.0).imbalance
    0.5
    """

    kinetic: float
    elastic: float
    work: float
    initial: float
    dissipated: float = 0.0

    @property
    def total(self) -> float:
        return self.kinetic + self.elastic

    @property
    def imbalance(self) -> float:
        """``kinetic + elastic + dissipated - work - initial``, 0 for the exact motion."""
        return self.kinetic + self.elastic + self.dissipated - self.work - self.initial


def total(body: object, part: float) -> float:
    """Return a sum over the whole body: itself, but where each rank of a body over several has a ``part`` of it."""
    over_ranks = getattr(body, "total", None)
    return part if over_ranks is None else float(over_ranks(part))


def trapezoid(before: Floats | None, after: Floats | None, du: Floats) -> float:
    """Return the work along du of a force that goes from ``before`` to ``after``; 0 where there is none.

    >>> trapezoid(np.array([1.0]), np.array([3.0]), np.array([0.5])), trapezoid(None, None, np.array([0.5]))
    (1.0, 0.0)
    """
    return 0.0 if before is None or after is None else 0.5 * inner(before + after, du)


def inner(a: Floats, b: Floats) -> float:
    """Return ``a.b``, summed pairwise.

    >>> inner(np.array([1.0, 2.0]), np.array([3.0, 4.0]))
    11.0
    """
    # BLAS splits a dot product by how many threads it has: the same bits only for the same number
    return float(np.add.reduce(a * b))
