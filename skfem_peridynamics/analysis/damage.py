"""Softened bonds, what is left of a point, and where the energy sits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from .._types import Floats, Longs
from ..engine.block import Block
from ..model.breaking import Breaking
from ..model.peridynamics import Peridynamics

_USED = 1e-9  # P1 values below this are round-off: the bond does not use the vertex


@dataclass(frozen=True)
class Census:
    """Bonds counted over the whole body: the largest strain, softened bonds, and where the energy sits.

    Parameters
    ----------
    Z : float
        The largest ``|S| / S_c``.
    softened : int
        Bonds with Z above 1.
    energy_intact : float
        Energy of the other bonds.
    energy_softened : float
        Energy of the softened ones.
    area : float, optional
        Of the flat crack (its length in 2D) that cuts as many bonds as have softened or are broken.
    broken : int, optional
        Bonds broken for good.
    soft : tuple of ndarray of int, optional
        The softened bonds of each block.

    Examples
    --------
    >>> Census(Z=0.5, softened=0, energy_intact=2.0, energy_softened=1.0).elastic
    3.0
    """

    Z: float
    softened: int
    energy_intact: float
    energy_softened: float
    area: float = 0.0
    broken: int = 0
    soft: tuple[Longs, ...] = field(repr=False, compare=False, default=())

    @property
    def elastic(self) -> float:
        """The energy of all bonds, ``PD(u)``."""
        return self.energy_intact + self.energy_softened


@dataclass(frozen=True, eq=False)
class Damage:
    """The state of the bonds at the vertices under one displacement.

    A bond that ends inside an element is a bond of its vertices, by their P1 values. Bonds broken for good are no
    bonds any more, and not intact; no-fail bonds are intact.

    Parameters
    ----------
    Z : ndarray, (nvertices,)
        ``max |S| / S_c`` over the bonds of a vertex, 0 where none can fail.
    intact : ndarray, (nvertices,)
        Fraction of a vertex's bonds with ``|S| <= S_c``.
    softened : int
        How many bonds of the body are beyond.

    Examples
    --------
    >>> float(Damage(Z=np.array([2.0, 0.0]), intact=np.array([0.5, 1.0]), softened=1).intact.min())
    0.5
    """

    Z: Floats
    intact: Floats
    softened: int


def census(body: Peridynamics, u: Floats) -> Census:
    """Count bonds and energies of a displacement, in one pass.

    Parameters
    ----------
    body : Peridynamics
        The body.
    u : ndarray, (N,)
        Displacement, numbered as the basis numbers it.

    Returns
    -------
    Census
        The counts.

    References
    ----------
    Paper, section 2.1.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0))
    >>> torn = census(body, np.array([0.0, 0.0, 0.0, 5.0, 5.0]))         # between the third and fourth vertex
    >>> torn.softened, torn.energy_intact, round(torn.energy_softened, 12)
    (1, 0.0, 0.5)
    """

    return _census(body, body.each_block(u, _count_bonds), u)


def census_and_damage(body: Peridynamics, u: Floats) -> tuple[Census, Damage]:
    """Return what :func:`census` and :func:`damage` do, from one pass over the strains.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0))
    >>> count, hurt = census_and_damage(body, np.array([0.0, 0.0, 0.0, 5.0, 5.0]))
    >>> count.softened, hurt.intact.tolist()
    (1, [1.0, 1.0, 0.5, 0.5, 1.0])
    """
    count, tally = census_and_tally(body, u)
    return count, tally.damage()


def census_and_tally(body: Peridynamics, u: Floats) -> tuple[Census, Tally]:
    """Return the census, and of each vertex what :class:`Damage` is made of, from one pass over the strains."""
    rows = list(body.each_block(u, lambda block, T: (_count_bonds(block, T), _bonds_of_samples(block, T))))
    return _census(body, (counted for counted, _ in rows), u), _tally(body, (sampled for _, sampled in rows))


def _count_bonds(block: Block, T: Floats) -> tuple[float, Longs, float, float, float]:
    """Largest Z, softened bonds, energy of the intact and of the softened ones, and the measure of those."""
    energy = block.law.energy(T)
    energy *= block.k
    Z = block.law.severity(T)
    Z *= block.k > 0.0  # a bond of zero measure is none
    largest = float(Z.max(initial=0.0))
    soft = np.flatnonzero(Z > 1.0) if largest > 1.0 else np.zeros(0, dtype=np.int64)
    lost, cut = 0.0, 0.0
    if len(soft):
        lost, cut = float(energy[soft].sum()), float(block.k[soft].sum())
        energy[soft] = 0.0
    return largest, soft, float(energy.sum()), lost, cut


def _census(body: Peridynamics, counted: Iterable[tuple[float, Longs, float, float, float]], u: Floats) -> Census:
    """Add up what the blocks counted, block by block."""
    rows = list(counted)
    dilatation = 0.0 if body.dilatation is None else body.dilatation.energy(body.engine.virial(u))
    return Census(
        max((row[0] for row in rows), default=0.0),
        sum(len(row[1]) for row in rows),
        sum(row[2] for row in rows) + dilatation,
        sum(row[3] for row in rows),
        (sum(row[4] for row in rows) + (body.cut if isinstance(body, Breaking) else 0.0)) / body.crossing,
        body.state.count if isinstance(body, Breaking) else 0,
        tuple(row[1] for row in rows),
    )


class Intact:
    """What is left of the bonds of the vertices, from a census: the cost is that of the bonds that have softened.

    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0))
    >>> Intact(body).after(census(body, np.array([0.0, 0.0, 0.0, 5.0, 5.0]))).tolist()
    [1.0, 1.0, 0.5, 0.5, 1.0]
    """

    def __init__(self, body: Peridynamics) -> None:
        self.body = body
        samples = body.bonds.samples
        every = body.lost.copy() if isinstance(body, Breaking) else np.zeros(samples.nsamples)
        for block in body.blocks:
            every[block.window] += block.incidence(1.0).T @ (block.k > 0.0).astype(float)
        self.every = np.maximum(samples.spread(every), np.finfo(float).tiny)

    def after(self, count: Census) -> Floats:
        """Return the fraction of each vertex's bonds that have neither softened nor broken, (nvertices,)."""
        body = self.body
        gone = body.lost.copy() if isinstance(body, Breaking) else np.zeros(body.bonds.samples.nsamples)
        for block, soft in zip(body.blocks, count.soft, strict=True):
            if len(soft):
                softened = block.some(soft)
                gone[softened.window] += softened.incidence(1.0).T @ np.ones(len(soft))
        intact: Floats = 1.0 - body.bonds.samples.spread(gone) / self.every
        return intact


def damage(body: Peridynamics, u: Floats) -> Damage:
    """Return what each vertex sees of the state of its bonds.

    Parameters
    ----------
    body : Peridynamics
        The body.
    u : ndarray, (N,)
        Displacement, numbered as the basis numbers it.

    Returns
    -------
    Damage
        The state at the vertices.

    References
    ----------
    Paper, section 2.1.

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Exponential
    >>> basis = skfem.Basis(skfem.MeshLine(np.linspace(0, 1, 5)), skfem.ElementVector(skfem.ElementLineP1()))
    >>> body = Peridynamics(BondBasis(basis, horizon=0.25), Exponential(slope=1.0, limit=1.0))
    >>> d = damage(body, np.array([0.0, 0.0, 0.0, 5.0, 5.0]))
    >>> d.softened, d.intact.tolist(), round(float(d.Z[2]), 6)          # Z = S sqrt(2 b r), S = 20, r = 1/4
    (1, [1.0, 1.0, 0.5, 0.5, 1.0], 14.142136)
    """
    return _tally(body, body.each_block(u, _bonds_of_samples)).damage()


def _bonds_of_samples(block: Block, T: Floats) -> tuple[slice, Floats, Floats, Floats, int]:
    """Of the samples that a block reads: largest Z, bonds, softened bonds; and how many of these there are."""
    C, ratio, live = block.incidence(1.0), block.law.severity(T), block.k > 0.0
    soft = (ratio > 1.0) & live
    largest = np.zeros(block.part.width)
    used = C.data.ravel() > _USED
    np.maximum.at(largest, C.indices[used], np.repeat(ratio * live, np.diff(C.indptr))[used])
    lost = C.T @ soft.astype(float) if soft.any() else np.zeros_like(largest)
    return block.window, largest, C.T @ live.astype(float), lost, int(soft.sum())


@dataclass(frozen=True, eq=False)
class Tally:
    """Of each vertex the largest Z of its bonds, how many there are and how many are gone; softened ones in all."""

    Z: Floats
    every: Floats
    gone: Floats
    softened: int

    def damage(self) -> Damage:
        """Return what is left of the vertices."""
        return Damage(self.Z, 1.0 - self.gone / np.maximum(self.every, np.finfo(float).tiny), self.softened)


def _tally(body: Peridynamics, sampled: Iterable[tuple[slice, Floats, Floats, Floats, int]]) -> Tally:
    """Carry what the blocks say of their samples to the vertices."""
    samples = body.bonds.samples
    Z, every, gone = np.zeros(samples.nsamples), np.zeros(samples.nsamples), np.zeros(samples.nsamples)
    softened = 0
    if isinstance(body, Breaking):
        every, gone = every + body.lost, gone + body.lost
    for window, largest, count, lost, number in sampled:
        np.maximum(Z[window], largest, out=Z[window])
        every[window] += count
        gone[window] += lost
        softened += number
    every, gone = samples.spread(every), samples.spread(gone)
    if samples.at_vertices:
        return Tally(samples.spread(Z), every, gone, softened)
    # a vertex sees the largest Z of all samples that use it, not their mean
    at_vertices = np.zeros(len(every))
    used = samples.values > _USED
    np.maximum.at(at_vertices, samples.vertices[used], np.broadcast_to(Z[:, None], used.shape)[used])
    return Tally(at_vertices, every, gone, softened)
