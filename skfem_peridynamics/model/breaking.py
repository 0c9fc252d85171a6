"""Bonds that break for good: the one kind of body that remembers what it has been through."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .._types import Csr, Floats, Longs
from ..bonds.ball_rule import BallRule
from ..bonds.pair_bonds import PairBonds
from ..engine.block import Block
from .dilatation import Dilatation
from .peridynamics import Peridynamics


class Broken(NamedTuple):
    """Some bonds that broke together: what takes samples of a window to differences of their ends, and their pull."""

    C: Csr
    window: slice
    pull: Floats


@dataclass(eq=False)
class BondState:
    """What has happened to the bonds of a body.

    ``broken`` lists, for each block, the numbers of its broken bonds in order; ``lost`` (nsamples,) counts them by
    their ends; ``last`` holds what broke last, ``energy`` what that had stored, ``relief`` (N,) the forces that others
    lost by it, where there is a dilatation.
    """

    broken: list[Longs]
    lost: Floats
    last: list[Broken] = field(default_factory=list)
    energy: float = 0.0
    relief: Floats | None = None

    def work_of_last(self, du: Floats) -> float:
        """Return the work that what broke last would have done against a displacement, (nsamples, dim)."""
        return float(sum(np.vdot(group.pull, group.C @ du[group.window]) for group in self.last))

    @property
    def count(self) -> int:
        """The number of broken bonds."""
        return sum(map(len, self.broken))


@dataclass(frozen=True, eq=False)
class Breaking(Peridynamics):
    """A body whose bonds break for good when their strain passes ``at`` times the critical one, ``S_c``.

    Without it, as in the paper, bonds that have softened are whole again when they close. The operators are those
    of the bonds that are left; schemes call :meth:`force_and_break` once a step, which is the only thing that
    breaks bonds. ``with_`` returns a body that is whole. With ball rules it computes by sparse products.

    A bond that breaks at once when it softens, ``at=1``, has 39 % (exponential law) of the energy that the paper's
    law takes to open it fully: the measured toughness of a body is lower by as much (docs/theory/model.md).

    Parameters
    ----------
    bonds : BondBasis
        As of :class:`Peridynamics`, and so up to ``compiled``.
    material : Material, Composite or Potential
        Constants, or a law.
    no_fail : array_like of int, optional
        Vertices whose bonds stay linear.
    threads : int, optional
        How many work.
    matrix_memory : float, optional
        Bytes that may be kept.
    compiled : bool, optional
        Compiled loops or sparse products.
    at : float
        How many times its critical strain a bond bears, 1 or more.

    Raises
    ------
    ValueError
        For ``at`` below 1, for a law without critical strain, and for one-sided rules.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Breaking(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0), at=2.0)
    >>> body.force_and_break(np.array([0.0, 0.0, 0.0, 5.0, 5.0])).tolist()
    [0.0, 0.0, 0.0, 0.0, 0.0]
    >>> body.state.count, body.energy(np.array([0.0, 0.0, 0.0, 0.1, 0.1]))       # the two halves are free for ever
    (1, 0.0)
    """

    at: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if not (np.isfinite(self.at) and self.at >= 1.0):
            raise ValueError(f"at = {self.at}: bonds break at 1 or more times their critical strain")
        if not self.symmetric:
            raise ValueError(f"rule = {self.bonds.rule.name}: bonds that break need a symmetric rule")
        if not any(np.isfinite(law.inflection) for law in self.laws):
            raise ValueError("a linear law has no critical strain at which its bonds could break")

    @property
    def compiles(self) -> bool:
        return not isinstance(self.bonds.rule, BallRule) and super().compiles

    @cached_property
    def whole(self) -> Peridynamics:
        """The body before any bond broke, of the paper's law."""
        return Peridynamics(self.bonds, self.material, self.no_fail, self.threads, self.matrix_memory, self.compiled)

    @cached_property
    def blocks(self) -> list[Block]:
        """The bonds in computing form; their measures are this body's own, and 0 where a bond is broken."""
        return [block.owned() for block in super().blocks]

    @cached_property
    def state(self) -> BondState:
        """What has happened to the bonds so far."""
        return self._whole()

    @property
    def lost(self) -> Floats:
        """How many bonds each sample has lost, (nsamples,)."""
        return self.state.lost

    @property
    def cut(self) -> float:
        """The measures that the broken bonds had, summed."""
        parts = [
            block.some(np.sort(numbers)).k.sum() for block, numbers in zip(self.blocks, self.state.broken, strict=True)
        ]
        return float(sum(parts))

    def force_and_break(self, u: Floats) -> Floats:
        """Break the bonds that are beyond their limit at u; return the force of the others.

        Parameters
        ----------
        u : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        ndarray, (N,)
            Forces.
        """
        u = self._vector(u)
        F, broken, virial = self.engine.break_and_force(u, self.at, self._pressure)
        self.state.last, self.state.energy, self.state.relief = [], 0.0, None
        if broken:
            self._note(self.inward(u), broken)
            if self.dilatation is not None and virial is not None:
                self._note_dilatation(u, F, broken, virial, self.dilatation)
        return F

    def work_of_last(self, du: Floats) -> float:
        """Return the work that what broke last would have done against a displacement.

        Parameters
        ----------
        du : ndarray, (N,)
            Displacement, numbered as the basis numbers it.

        Returns
        -------
        float
            An energy.
        """
        relief = 0.0 if self.state.relief is None else float(self.state.relief @ du)
        return self.state.work_of_last(self.inward(du)) + relief

    def _note_dilatation(
        self, u: Floats, F: Floats, broken: Sequence[tuple[Block, Longs]], virial: Floats, dilatation: Dilatation
    ) -> None:
        """Add what the dilatation lost by the bonds that broke, and the forces that this changed everywhere."""
        samples, number = self.bonds.samples, {id(block): k for k, block in enumerate(self.blocks)}
        v, lost = self.inward(u), np.zeros(self.bonds.samples.nsamples)
        gone = [self.blocks[number[id(block)]].some(np.sort(which)) for block, which in broken]
        for bonds in gone:
            lost[bonds.window] += bonds.virial(v)
        before = virial + samples.spread(lost)
        self.state.energy += dilatation.energy(before) - dilatation.energy(virial)
        pressure = dilatation.pressure(before)
        p = samples.take(pressure)
        for bonds in gone:
            pull = bonds.rates(bonds.strains(v)) * bonds.pressures(p)
            self.state.last.append(Broken(bonds.incidence(), bonds.window, pull[:, None] * bonds.directions()))
        # what is left is under another pressure than before
        self.state.relief = F - self.engine.force(u, lambda _: pressure)

    def _note(self, v: Floats, broken: Sequence[tuple[Block, Longs]]) -> None:
        number = {id(block): k for k, block in enumerate(self.blocks)}
        for block, which in broken:
            broken_bonds = self._count(number[id(block)], which)
            C, p, k = broken_bonds.incidence(), broken_bonds.directions(), broken_bonds.k
            T = np.einsum("nd,nd->n", C @ v[broken_bonds.window], p)
            pull = (k * broken_bonds.law.gradient(T))[:, None] * p
            self.state.last.append(Broken(C, broken_bonds.window, pull))
            self.state.energy += float(k @ broken_bonds.law.energy(T))

    def _count(self, k: int, which: Longs) -> Block:
        """Count bonds of a block as broken; return them as a block of their own."""
        state, broken_bonds = self.state, self.blocks[k].some(which)
        state.broken[k] = np.concatenate([state.broken[k], which])
        C = broken_bonds.incidence(1.0)
        np.add.at(state.lost, C.indices + broken_bonds.window.start, C.data)
        return broken_bonds

    def kept(self, broken: Sequence[Longs]) -> Sequence[Longs]:
        """Return broken bonds as they are kept in files: by their ends, where these are vertices.

        Parameters
        ----------
        broken : sequence of ndarray of int
            Numbers of bonds, block by block; or what this has returned.

        Returns
        -------
        sequence of ndarray of int
            One array of pairs of vertices, (nbroken, 2), sorted; of other rules the numbers.
        """
        if not self.bonds.samples.at_vertices or isinstance(self.bonds.rule, BallRule) or _are_pairs(broken):
            return broken
        pairs = [self._ends(block.some(np.sort(numbers))) for block, numbers in zip(self.blocks, broken, strict=True)]
        return (sorted_pairs(np.concatenate(pairs)),)

    def numbers_of(self, pairs: Longs) -> list[Longs]:
        """Return the numbers of bonds, block by block, that join these vertices; pairs without a bond are left out.

        Parameters
        ----------
        pairs : ndarray of int, (n, 2)
            Vertices of the mesh.

        Returns
        -------
        list of ndarray of int
            An array a block.
        """
        keys = _keys(pairs, self.bonds.mesh.nvertices)
        every = (_keys(self._ends(block), self.bonds.mesh.nvertices) for block in self.blocks)
        return [np.flatnonzero(np.isin(of_block, keys)) for of_block in every]

    def _ends(self, block: Block) -> Longs:
        """The vertices at the ends of the bonds of a block of pairs, (n, 2)."""
        part = block.part
        assert isinstance(part, PairBonds)
        ends = part.ends if block.which is None else part.ends[block.which]
        found: Longs = self.bonds.samples.vertices[ends + np.int32(part.first), 0].astype(np.int64)
        return found

    def recall(self, broken: Sequence[Longs] | None) -> None:
        """Break the listed bonds: the state of an earlier run.

        Parameters
        ----------
        broken : sequence of ndarray of int, or None
            Numbers of bonds, block by block, or one array of pairs of vertices; None makes all whole.

        Raises
        ------
        ValueError
            If they are not bonds of this body.
        """
        if broken is None or not sum(map(len, broken)):
            broken = self._whole().broken
        if _are_pairs(broken):
            pairs, broken = broken[0], self.numbers_of(broken[0])
            if sum(map(len, broken)) != len(pairs):
                raise ValueError("the broken bonds of the state to start from are not bonds of this body")
        fits = len(broken) == len(self.blocks) and all(
            len(numbers) == 0
            or (0 <= numbers.min() <= numbers.max() < len(block.k) and len(np.unique(numbers)) == len(numbers))
            for numbers, block in zip(broken, self.blocks, strict=True)
        )
        if not fits:
            raise ValueError("the broken bonds of the state to start from are not bonds of this body")
        for block, known in zip(self.blocks, self.state.broken, strict=True):
            known = np.sort(known)
            block.k[known] = block.some(known).k
        self.__dict__["state"] = self._whole()
        for k, numbers in enumerate(broken):
            if len(numbers):
                self._count(k, np.asarray(numbers, dtype=np.int64))
                self.blocks[k].k[numbers] = 0.0

    def _whole(self) -> BondState:
        return BondState([np.zeros(0, dtype=np.int64) for _ in self.blocks], np.zeros(self.bonds.samples.nsamples))


def sorted_pairs(pairs: Longs) -> Longs:
    """Return pairs (n, 2) with the lower number first, in order.

    >>> sorted_pairs(np.array([[3, 1], [0, 2]])).tolist()
    [[0, 2], [1, 3]]
    """
    pairs = np.sort(pairs.reshape(-1, 2), axis=1)
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])], dtype=np.int64)


def _are_pairs(broken: Sequence[Longs]) -> bool:
    return len(broken) == 1 and broken[0].ndim == 2


def _keys(pairs: Longs, nvertices: int) -> Longs:
    """A number for each pair of vertices, whichever comes first."""
    keys: Longs = pairs.min(axis=1, initial=nvertices) * np.int64(nvertices) + pairs.max(axis=1, initial=0)
    return keys
