"""A table of forces on the unit box: Chebyshev polynomials between the depths where forces are not smooth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from math import pi

import numpy as np

from .._types import Bools, Floats


@dataclass(frozen=True, eq=False)
class ForceTable:
    """Interpolate ``exact``, points (n, dim) to (terms, n, dim), that is costly and symmetric in the axes.

    ``nodes`` Chebyshev nodes an axis and zone; ``w`` is a factor of ``exact`` that vanishes on the boundary of a body
    that is not ``free``, and is taken out before.

    >>> table = ForceTable(1, 0.2, 12, 1, True, lambda x: np.exp(x)[None], lambda x: np.ones(len(x)))
    >>> float(np.round(table(np.array([[0.3]]))[0, 0, 0] / np.exp(0.3), 12))
    1.0
    """

    dim: int
    horizon: float
    nodes: int
    terms: int
    free: bool
    exact: Callable[[Floats], Floats]
    w: Callable[[Floats], Floats]

    @cached_property
    def _zones(self) -> Floats:
        depth = [self.horizon * k for k in (1, 2) if self.horizon * k < 0.5 - 1e-9]
        if not depth or depth[-1] < 0.5 - 1e-9:
            depth.append(0.5)
        thin = [self.horizon / 64, self.horizon / 8] if self._bent else []  # near the side it has a logarithm
        cuts = [0.0, *thin, *depth]
        return np.array([*cuts, *(1.0 - c for c in reversed(cuts[:-1]))])

    @cached_property
    def _table(self) -> Floats:
        """Values over w at Chebyshev nodes of the zones that the layers of the horizon cut, (terms, m, .., m, dim).

        The force of a field with equal components that is symmetric in the axes is too, so sorted points do.
        """
        axis = self._axis
        grid = np.stack([g.ravel() for g in np.meshgrid(*[axis] * self.dim, indexing="ij")], axis=1)
        order = np.argsort(grid, axis=1, kind="stable")
        sorted_points = np.take_along_axis(grid, order, axis=1)
        unique, back = np.unique(sorted_points, axis=0, return_inverse=True)
        forces = self.exact(unique) / self.w(unique)[:, None]
        values = np.empty((self.terms, *grid.shape))
        sorted_values = forces[:, back.ravel()]
        for k in range(len(values)):
            np.put_along_axis(values[k], order, sorted_values[k], axis=1)
        return values.reshape(self.terms, *[len(axis)] * self.dim, self.dim)

    @cached_property
    def _axis(self) -> Floats:
        low, high = self._zones[:-1, None], self._zones[1:, None]
        share = np.tile(0.5 - 0.5 * self._chebyshev, (len(low), 1))
        if self._bent:
            share[2], share[-3] = 1.0 - (1.0 - share[2]) ** 2, share[-3] ** 2
        return np.asarray(low + (high - low) * share).ravel()

    @property
    def _bent(self) -> bool:
        """In 2D a side enters the ball with the power 3/2 of the depth: zones that end there use its root."""
        return self.dim == 2 and self.free

    @cached_property
    def _chebyshev(self) -> Floats:
        """Nodes of the first kind: none on the boundary, where w is 0."""
        return np.asarray(np.cos(pi * (np.arange(self.nodes) + 0.5) / self.nodes))

    def _values(self, x: Floats) -> Floats:
        """Lagrange's basis of one axis at points (n,), (n, m)."""
        zone = np.clip(np.searchsorted(self._zones, x, side="right") - 1, 0, len(self._zones) - 2)
        low, high = self._zones[zone], self._zones[zone + 1]
        share = np.clip((x - low) / (high - low), 0.0, 1.0)
        if self._bent:
            share = np.where(zone == 2, 1.0 - np.sqrt(1.0 - share), share)
            share = np.where(zone == len(self._zones) - 4, np.sqrt(share), share)
        s = 1.0 - 2.0 * share
        node = self._chebyshev
        c = (-1.0) ** np.arange(self.nodes) * np.sin(pi * (np.arange(self.nodes) + 0.5) / self.nodes)
        gap = s[:, None] - node
        exact: Bools = np.abs(gap) < 1e-14
        ratio = c / np.where(exact, 1.0, gap)
        local = np.where(np.asarray(exact.any(axis=1))[:, None], exact, ratio / ratio.sum(axis=1, keepdims=True))
        out = np.zeros((len(x), len(self._axis)))
        np.put_along_axis(out, zone[:, None] * self.nodes + np.arange(self.nodes), local, axis=1)
        return out

    def __call__(self, x: Floats) -> Floats:
        """Return the function at points (n, dim), (terms, n, dim); near corners in 2D directly."""
        table, terms = self._table, self.terms
        out = np.empty((terms, *x.shape))
        m = len(self._axis)
        for low in range(0, len(x), 20_000):
            run = slice(low, low + 20_000)
            B = [self._values(x[run, a]) for a in range(self.dim)]
            for k in range(terms):
                for a in range(self.dim):
                    value = table[k, ..., a].reshape(m, -1)
                    got = B[0] @ value
                    for b in B[1:]:
                        got = np.einsum("ni,nij->nj", b, got.reshape(len(b), m, -1))
                    out[k, run, a] = got.reshape(-1)
        out *= self.w(x)[:, None]
        if self.dim == 2:  # where a corner enters or leaves the ball the force is not smooth
            corner = np.flatnonzero((np.minimum(x, 1.0 - x) < self.horizon).all(axis=1))
            out[:, corner] = self.exact(x[corner])
        return out
