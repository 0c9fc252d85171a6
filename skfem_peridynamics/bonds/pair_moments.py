"""Moments of vertex pairs, bond by bond and matrix-free: what conjugate gradients ask of them.

Rows are samples. Columns are the monomials of order three, then four, each times the root of its multinomial
coefficient, so that nothing depends on the axes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from math import factorial, prod
from typing import Any

import numpy as np

from .._compile import available
from .._threads import Threads
from .._types import Floats
from ..geometry.tensors import monomials, powers
from .bond_list import BondList
from .moment_fit import MomentMap, moment_map, summed
from .pair_bonds import PairBonds
from .quadrature import sphere

_TASKS = 2  # of a part of the bonds: their sums are added in order, so that bits do not depend on threads
_NOTHING = 1e-10  # of the largest eigenvalue of the mean over the sphere: combinations of moments that are none


@dataclass(frozen=True, eq=False)
class PairMoments:
    """The moments of order three, and with ``four`` of order four, of a list of vertex pairs.

    Weights and what bonds gather are arrays by part; moments and multipliers (nsamples, columns).
    """

    bonds: BondList
    four: bool

    @property
    def columns(self) -> int:
        return len(self.roots)

    @cached_property
    def three(self) -> int:
        return len(monomials(self.bonds.dim, 3))

    @cached_property
    def roots(self) -> Floats:
        """The root of the multinomial coefficient of each column."""
        return _roots(self.bonds.dim, self.four)

    @cached_property
    def inverse(self) -> Floats:
        """The inverse of the mean of products of the columns over all bonds of a ball, (columns, columns)."""
        dim, n3 = self.bonds.dim, self.three
        e, share = sphere(dim)
        out = np.zeros((self.columns, self.columns))
        for order, part, size in ((3, slice(0, n3), 1.0), (4, slice(n3, None), dim / (dim + 2))):
            m = powers(e, order)[:, : 0 if order == 4 and not self.four else None] * self.roots[part]
            if m.shape[1]:
                out[part, part] = np.linalg.pinv(size * (m * share[:, None]).T @ m, rcond=_NOTHING, hermitian=True)
        return out

    def moments(self, w: list[Floats]) -> Floats:
        """Return the moments of weights, (nsamples, columns)."""
        if not self._compiled:
            total = summed(piece.moments(x) for piece, x in zip(self._maps, w, strict=True))
            return total[self.bonds.samples.vertices[:, 0], : self.columns] * self.roots

        def act(task: _Task) -> Floats:
            out = np.zeros((task.part.width, self.columns))
            scale, shared = 1.0 / self.bonds.horizon, self._shared(task, w)
            _loops().SPREAD[self.bonds.dim](*task.rows, scale, shared, self.four, out)
            return out

        return self._added(act) * self.roots

    def gathered(self, y: Floats) -> list[Floats]:
        """Return what each bond gathers of multipliers: the transpose of :meth:`moments`."""
        y = np.ascontiguousarray(y * self.roots)
        if not self._compiled:
            wide = np.zeros((self.bonds.mesh.nvertices, self.three + len(monomials(self.bonds.dim, 4))))
            wide[self.bonds.samples.vertices[:, 0], : self.columns] = y
            return [piece.gathered(wide) for piece in self._maps]
        out = [np.empty(part.nbonds) for part in self.bonds.parts]

        def act(task: _Task) -> None:
            own = y[task.part.first : task.part.first + task.part.width]
            _loops().GATHER[self.bonds.dim](*task.rows, 1.0 / self.bonds.horizon, own, self.four, out[task.number])

        self._run(act)
        for s, share in zip(out, self._shares, strict=True):
            if share is not None:
                s *= share
        return out

    def own_weights(self) -> list[Floats]:
        """Return the weights of the bonds: the rule's own, unless they are given."""
        parts = self._parts
        if not self._compiled or any(part.given is not None for part in parts):
            return [part.weight for part in parts]
        out = [np.empty(part.nbonds) for part in parts]

        def act(task: _Task) -> None:
            part, window = task.part, slice(task.part.first, task.part.first + task.part.width)
            samples = part.samples
            start, far, x, row = task.rows
            size, volume = samples.size[window], samples.volume[window]
            _loops().own_weights(start, far, x, row, part.reach, size, volume, out[task.number])

        self._run(act)
        return out

    def degree(self, w: list[Floats]) -> Floats:
        """Return ``sum w (J w(x) w(y))^2`` over the bonds at each sample, (nsamples,): the normal equations' scale."""
        shares = [1.0 if share is None else share for share in self._shares]
        if not self._compiled:
            total = np.zeros(self.bonds.samples.nsamples)
            for part, x, share in zip(self._parts, w, shares, strict=True):
                for end in part.ends.T:
                    total += np.bincount(end + part.first, x * share**2, len(total))
            return total

        def act(task: _Task) -> Floats:
            out = np.zeros(task.part.width)
            start, far, _, row = task.rows
            _loops().degree(start, far, row, self._shared(task, w, power=2), out)
            return out

        return self._added(act)

    # ---- how
    @property
    def _compiled(self) -> bool:
        return available()

    @cached_property
    def _parts(self) -> list[PairBonds]:
        return [part for part in self.bonds.parts if isinstance(part, PairBonds)]

    @cached_property
    def _maps(self) -> list[MomentMap]:
        return [moment_map(self.bonds, part) for part in self.bonds.parts]

    @cached_property
    def _shares(self) -> list[Floats | None]:
        """``J w(x) w(y)`` by part; None where they are 1."""
        bonds = self.bonds
        if bonds.plain:
            return [None] * len(bonds.parts)
        return [bonds.influence_of(part) * bonds.boundary_share_of(part) for part in bonds.parts]

    def _shared(self, task: _Task, w: list[Floats], power: int = 1) -> Floats:
        share = self._shares[task.number]
        if share is None:
            return w[task.number]
        out = np.zeros_like(share)  # only what the task reads is made
        out[task.bonds] = w[task.number][task.bonds] * share[task.bonds] ** power
        return out

    @cached_property
    def _tasks(self) -> list[_Task]:
        points, tasks = self.bonds.samples.points, []
        for number, part in enumerate(self._parts):
            x = np.ascontiguousarray(points[part.first : part.first + part.width])
            cuts = np.searchsorted(part.start, np.linspace(0, part.nbonds, _TASKS + 1)[1:-1])
            edges = np.unique([0, *cuts, len(part.start) - 1])
            for low, high in pairwise(edges):
                rows = (part.start[low : high + 1], part.partner, x, part.row + int(low))
                tasks.append(_Task(number, part, rows, slice(int(part.start[low]), int(part.start[high]))))
        return tasks

    def _added(self, act: Callable[[_Task], Floats]) -> Floats:
        """The sum over the tasks, in order; as many at a time as there are threads."""
        total: Floats | None = None
        for task, out in zip(self._tasks, self._run(act), strict=True):
            if total is None:
                total = np.zeros((self.bonds.samples.nsamples, *out.shape[1:]))
            total[task.part.first : task.part.first + task.part.width] += out
        assert total is not None
        return total

    def _run(self, act: Callable[[_Task], Any]) -> list[Any]:
        return list(self._pool.map(act, self._tasks))

    @cached_property
    def _pool(self) -> Threads:
        return Threads(None)


@dataclass(frozen=True, eq=False)
class _Task:
    """Some rows of a part, as the loops take them, and which of its bonds these are."""

    number: int
    part: PairBonds
    rows: tuple[Any, ...]
    bonds: slice


def _loops() -> Any:
    from . import moment_loops

    return moment_loops


def _roots(dim: int, four: bool) -> Floats:
    """Roots of the multinomial coefficients.

    >>> _roots(2, False).round(6).tolist()
    [1.0, 1.732051, 1.732051, 1.0]
    """
    indices = monomials(dim, 3) + (monomials(dim, 4) if four else [])
    return np.sqrt([factorial(len(i)) / prod(map(factorial, Counter(i).values())) for i in indices])
