"""What computes the operators of a body: by sparse products, or by compiled loops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Protocol

from .._threads import Threads
from .._types import Floats, Longs
from ..bonds.bond_basis import BondBasis
from .block import _T, Beside, Block, Pressure
from .sparse_engine import SparseEngine


class Engine(Protocol):
    """What computes the operators of a body from its blocks; vectors are nodal, (N,).

    ``each`` runs a function on every block and the scaled strains of its bonds, and yields results in block order.
    ``break_and_force`` breaks the bonds beyond ``at`` times their critical strain, and returns them, in order, too.
    ``product`` applies ``a_l``, or with weights (one array per block) ``X^T diag(weights) B``. ``virial`` is
    ``sum k sqrt(r) F1'(T) / 2`` over the bonds that end at each vertex, by P1 values, (nvertices,); a ``pressure`` that
    is made of it, and what stands ``beside`` the bonds in a product, belong to an energy of volumetric strains.
    """

    def energy(self, u: Floats) -> float: ...

    def force(self, u: Floats, pressure: Pressure | None = None) -> Floats: ...

    def virial(self, u: Floats) -> Floats: ...

    def product(
        self, weights: Sequence[Floats] | None, v: Floats, transposed: bool = False, beside: Beside | None = None
    ) -> Floats: ...

    def each(self, u: Floats, function: Callable[[Block, Floats], _T]) -> Iterator[_T]: ...

    def break_and_force(
        self, u: Floats, at: float, pressure: Pressure | None = None
    ) -> tuple[Floats, list[tuple[Block, Longs]], Floats | None]: ...


def make_engine(bonds: BondBasis, blocks: Sequence[Block], pool: Threads, compiled: bool) -> Engine:
    """Return the engine of some blocks; compiled loops, and numba with them, are loaded only where they are used."""
    sparse_engine = SparseEngine(bonds, blocks, pool)
    if not compiled:
        return sparse_engine
    from .compiled_engine import CompiledEngine

    return CompiledEngine(sparse_engine)
