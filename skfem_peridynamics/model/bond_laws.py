"""Which law each bond has: that of the one material, of two materials, or the linear one of bonds that never fail."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from .._types import Bools, Floats, Longs
from ..bonds.bond_basis import BondBasis
from ..bonds.rule import Part
from ..material.composite import Composite
from ..material.potential import Linear, Potential

Selector: TypeAlias = Callable[[Part], Longs | None]  # the numbers of its bonds of a part, None for all
_ROUND_OFF = 1e-9  # P1 values below this do not count as use of a vertex


def laws_of_bonds(
    bonds: BondBasis, laws: Sequence[Potential], composite: Composite | None, no_fail: npt.ArrayLike | None
) -> list[tuple[Potential, Selector]]:
    """Return the laws of the bonds, each with the function that picks its bonds; those that can fail come first.

    ``laws`` are those of the materials, one where ``composite`` is None.
    """
    shares = [(laws[0], None)] if composite is None else list(_of_materials(bonds, laws, composite))
    if no_fail is None:
        return [(law, _all if which is None else which) for law, which in shares]
    marked = _no_fail_samples(bonds, no_fail)
    can = [(law, _picked(which, lambda part: ~_touches(part, marked))) for law, which in shares]
    cannot = [(Linear(law.slope), _picked(which, lambda part: _touches(part, marked))) for law, which in shares]
    return can + cannot


def _all(part: Part) -> None:
    return None


def _picked(which: Callable[[Part], Longs] | None, among: Callable[[Part], Bools]) -> Selector:
    """Those bonds among ``which`` for which ``among`` is true."""

    def pick(part: Part) -> Longs:
        chosen = among(part)
        if which is None:
            return np.flatnonzero(chosen)
        listed = which(part)
        return listed[chosen[listed]]

    return pick


def _of_materials(
    bonds: BondBasis, laws: Sequence[Potential], composite: Composite
) -> Iterator[tuple[Potential, Callable[[Part], Longs]]]:
    """The laws that bonds of several materials have. A set of materials is an integer, a bit for each."""
    member = composite.member_of(bonds.mesh)
    bit = np.left_shift(np.int64(1), member)
    at_vertices = np.zeros(int(bonds.mesh.nvertices), dtype=np.int64)
    for corner in bonds.mesh.t:
        np.bitwise_or.at(at_vertices, corner, bit)
    samples = bonds.samples
    at_samples = at_vertices[samples.vertices[:, 0]]
    inside = samples.element >= 0
    at_samples[samples.sites[inside]] = bit[samples.element[inside]]

    def sets(part: Part) -> Longs:
        near, far = part.holders(at_samples, bit)
        common = near & far
        return np.where(common > 0, common, near | far)

    sets_of_parts: list[Longs] = [np.unique(sets(part)) for part in bonds.parts]
    for materials in np.unique(np.concatenate(sets_of_parts)):
        members = [k for k in range(len(laws)) if materials >> k & 1]
        yield composite.mixed(laws, members), lambda part, materials=materials: np.flatnonzero(sets(part) == materials)  # type: ignore[misc]


def marked_vertices(no_fail: npt.ArrayLike, nvertices: int) -> Bools:
    """Return which of the vertices are listed, (nvertices,). Raises ``ValueError`` for a list of none, or of others.

    >>> marked_vertices([2], 3).tolist()
    [False, False, True]
    """
    listed = np.asarray(no_fail)
    if listed.dtype.kind not in "iu" or not listed.size or listed.min() < 0 or listed.max() >= nvertices:
        raise ValueError(f"no_fail must list vertices, numbers from 0 to {nvertices - 1}, and not be empty")
    marked = np.zeros(nvertices, dtype=bool)
    marked[listed] = True
    return marked


def _no_fail_samples(bonds: BondBasis, no_fail: npt.ArrayLike) -> Floats:
    """1 at the samples that use a no-fail vertex, else 0."""
    marked = marked_vertices(no_fail, int(bonds.mesh.nvertices)).astype(float)
    return (bonds.samples.take(marked) > 0.0).astype(float)


def _touches(part: Part, marked: Floats) -> Bools:
    """Which bonds have an end where the marked samples are."""
    return (part.near(marked) > 0.0) | (part.far(marked) > _ROUND_OFF)
