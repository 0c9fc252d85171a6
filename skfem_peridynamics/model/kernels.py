"""Blocks of bonds, the unit in which the model computes.

With ``T = B U`` the scaled strains of the bonds (``T = sqrt(r) S``, linear in the nodal values), every operator is

    energy   sum k F1(T)          force  -B^T (k F1'(T))          tangent  B^T diag(k F1''(T)) B

so a block holds the sparse matrix B of its bonds, the measures k and its law. B is stored once; its transpose is
the same memory read by columns. Blocks are fixed at set-up, each writes to a window of its own and the windows are
added in order: the result has the same bits for any number of threads. SciPy's products and NumPy's loops release
the interpreter lock, so blocks run in threads.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import scipy.sparse as sparse

from .._types import Csr, Floats, Longs
from ..bonds.bond_basis import BondBasis
from ..material.potential import Potential

BLOCK = 1 << 17  # bonds: large enough to outweigh the calls, small enough to stay in cache

_T = TypeVar("_T")


@dataclass(frozen=True, eq=False)
class Block:
    """Some bonds of one law. ``first`` is the first degree of freedom (internal order) of its window."""

    law: Potential
    first: int
    B: Csr
    BT: sparse.csc_matrix
    k: Floats

    @property
    def window(self) -> slice:
        return slice(self.first, self.first + self.B.shape[1])

    def strains(self, u: Floats) -> Floats:
        """Scaled strains T of the bonds for all nodal values u (internal order)."""
        T: Floats = self.B @ u[self.window]
        return T

    def energy(self, u: Floats) -> float:
        return float(self.k @ self.law.energy(self.strains(u)))

    def force(self, u: Floats) -> Floats:
        g = self.law.gradient(self.strains(u))
        g *= self.k
        F: Floats = self.BT @ g
        return F

    def product(self, weight: Floats, v: Floats) -> Floats:
        """``B^T diag(weight) B v`` on the window."""
        T = self.strains(v)
        T *= weight
        out: Floats = self.BT @ T
        return out

    def ends(self, dim: int) -> tuple[Longs, Longs]:
        """Internal numbers of the two vertices of each bond."""
        column = self.B.indices.reshape(-1, 2 * dim)
        first = self.first // dim
        return column[:, 0] // dim + first, column[:, 1] // dim + first

    def directions(self, dim: int) -> Floats:
        """``e / sqrt(r)`` of each bond, (nbonds, dim)."""
        data: Floats = self.B.data.reshape(-1, dim, 2)[:, :, 1]
        return data


def make_blocks(bonds: BondBasis, law: Potential, which: Longs | None = None) -> Iterator[Block]:
    """Yield the blocks of a law over some bonds (all, when ``which`` is None); bonds of zero measure are left out."""
    count = bonds.nbonds if which is None else len(which)
    dim = bonds.dim
    for start in range(0, count, BLOCK):
        part: slice | Longs = slice(start, min(start + BLOCK, count))
        if which is not None:
            part = which[part]
        k = bonds.measure(part)
        i, j, xi = bonds.bonds.i[part], bonds.bonds.j[part], bonds.vectors(part)
        live = k > 0.0
        if not live.all():
            k, i, j, xi = k[live], i[live], j[live], xi[:, live]
        if not len(k):
            continue
        low, high = int(min(i.min(), j.min())), int(max(i.max(), j.max()))
        # T = sqrt(r) S = xi.(u_j - u_i) / r^(3/2)
        xi = xi / (xi * xi).sum(axis=0) ** 0.75
        # component by component, -x before y: a translation then cancels exactly, not to round-off
        columns = np.empty((len(k), dim, 2), dtype=np.int32)
        for side, end in enumerate((i, j)):
            columns[:, :, side] = (end - low)[:, None] * dim + np.arange(dim, dtype=np.int32)
        B = sparse.csr_matrix(
            (
                np.stack([-xi, xi], axis=2).swapaxes(0, 1).ravel(),
                columns.ravel(),
                np.arange(len(k) + 1, dtype=np.int32) * (2 * dim),
            ),
            shape=(len(k), (high - low + 1) * dim),
        )
        yield Block(law, low * dim, B, B.T, k)


def block_bytes(nbonds: int, dim: int) -> int:
    """Return the memory that blocks of so many bonds take.

    >>> block_bytes(1000, dim=2)
    60000
    """
    return nbonds * (2 * dim * (8 + 4) + 4 + 8)


class Team:
    """Run a function over blocks, in threads where there are several, results in block order."""

    def __init__(self, threads: int) -> None:
        if threads < 1:
            raise ValueError(f"threads = {threads} must be at least 1")
        self.threads = threads
        self._pool: ThreadPoolExecutor | None = None

    def map(self, function: Callable[[Block], _T], blocks: Sequence[Block]) -> Iterator[_T]:
        def quiet(block: Block) -> _T:
            # a run that has become unstable overflows; who steps it looks at the numbers, and says so in words
            with np.errstate(over="ignore", invalid="ignore"):
                return function(block)

        if self.threads == 1 or len(blocks) < 2:
            return map(quiet, blocks)
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads)
        return self._pool.map(quiet, blocks)
