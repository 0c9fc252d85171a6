"""Pair rules of the double integral: all pairs of one point set within the horizon."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .._types import Floats, Ints, Longs, Mesh
from ..geometry.pieces import connected
from ..geometry.simplices import describe_point, vertex_sizes
from ..geometry.visibility import sight
from ..material.influence import Influence
from . import parts
from .neighbours import RIM, estimate_pairs, pairs_within
from .parts import PairPart, Part
from .samples import Samples, gauss_samples, vertex_samples


class Rule(Protocol):
    """A quadrature of the double integral over D x D.

    Bonds of a ``symmetric`` rule stand for both orders of their ends; the others are directed, from x to y.
    """

    @property
    def name(self) -> str: ...

    @property
    def symmetric(self) -> bool: ...

    def samples(self, mesh: Mesh) -> Samples: ...

    def estimate(self, mesh: Mesh, horizon: float) -> int: ...

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]: ...


@dataclass(frozen=True)
class PairRule:
    """All pairs of points within the horizon, each point standing for its share of the elements.

    ``points`` are the ``"vertices"`` (the classical meshfree method) or the ``"gauss"`` points of the elements.
    ``partial_volume`` scales the weight of a pair near the rim by the part of the neighbour's cell that lies in the
    ball, ``clip((horizon + h/2 - r)/h, 0, 1)`` with h the neighbour's size, averaged over the two ends so that the
    form stays symmetric. Without it a pair counts fully up to the horizon, rim included.

    >>> import skfem
    >>> mesh, rule = skfem.MeshLine(np.linspace(0, 1, 5)), PairRule()
    >>> part, = rule.parts(mesh, rule.samples(mesh), 0.25, Influence("constant", np.ones_like))
    >>> part.weight.tolist()                                     # half of each neighbour is in the ball
    [0.03125, 0.0625, 0.0625, 0.03125]
    """

    partial_volume: bool = True
    points: str = "vertices"

    def __post_init__(self) -> None:
        if self.points not in ("vertices", "gauss"):
            raise ValueError(f'points = {self.points!r} must be "vertices" or "gauss"')

    @property
    def name(self) -> str:
        kind = "vertex pairs" if self.points == "vertices" else "Gauss-point pairs"
        return f"{kind}, partial volume" if self.partial_volume else kind

    @property
    def symmetric(self) -> bool:
        return True

    def samples(self, mesh: Mesh) -> Samples:
        """Return the point set."""
        return vertex_samples(mesh) if self.points == "vertices" else gauss_samples(mesh, with_vertices=False)

    def _reach(self, horizon: float, size: Floats) -> float:
        return horizon + (0.5 * float(size.max()) if self.partial_volume else 0.0)

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        """Return about how many bonds there will be, before any is made."""
        samples = self.samples(mesh)
        return estimate_pairs(samples.points.T, self._reach(horizon, samples.size))

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds, ends sorted.

        Raises ``ValueError`` for a point that is left without a bond, or when the bonds fall into more pieces than the
        mesh.
        """
        made = list(self._parts(mesh, samples, horizon))
        degree = np.zeros(samples.nsamples, dtype=np.int64)
        for part in made:
            window = slice(part.first, part.first + part.width)
            degree[window] += np.bincount(part.ends.ravel(), minlength=part.width)
        lonely = np.flatnonzero(degree == 0)
        if len(lonely):
            vertex = samples.vertices[lonely[0], 0]
            at = mesh.p[:, vertex] if self.points == "vertices" else samples.points[lonely[0]]
            what = f"vertex {vertex}" if self.points == "vertices" else "the Gauss point"
            raise ValueError(
                f"horizon = {horizon:g} leaves {what} at {describe_point(at)} without a "
                f"bond ({len(lonely)} of {samples.nsamples} points); the mesh size there is "
                f"{vertex_sizes(mesh)[vertex]:.3g}: take a larger horizon or a finer mesh"
            )
        ends = np.concatenate([part.ends + np.int32(part.first) for part in made])
        pieces, bonded = connected(mesh.t, mesh.nvertices)[0], connected(ends.T, samples.nsamples)[0]
        if bonded > pieces:
            raise ValueError(
                f"horizon = {horizon:g} leaves the bonds in {bonded} separate pieces, the mesh has {pieces}: in some "
                "direction the mesh is coarser than the horizon; take a larger horizon or a finer mesh"
            )
        return list(made)

    def _parts(self, mesh: Mesh, samples: Samples, horizon: float) -> Iterator[PairPart]:
        held: list[tuple[Ints, Floats]] = []
        count = 0
        for ends, weight in self._chunks(mesh, samples, horizon):
            held.append((ends, weight))
            count += len(weight)
            if count >= parts.BLOCK:
                ends, weight = (np.concatenate(column) for column in zip(*held, strict=True))
                whole = count - count % parts.BLOCK
                for low in range(0, whole, parts.BLOCK):
                    part = slice(low, low + parts.BLOCK)
                    yield _part(samples, ends[part], weight[part])
                held, count = [(ends[whole:], weight[whole:])], count - whole
        if count:
            yield _part(samples, *(np.concatenate(column) for column in zip(*held, strict=True)))

    def _chunks(self, mesh: Mesh, samples: Samples, horizon: float) -> Iterator[tuple[Ints, Floats]]:
        volume, size, points = samples.volume, samples.size, samples.points.T
        reach = self._reach(horizon, size)
        if self.points == "vertices":
            see, number = sight(mesh, reach), samples.vertices[:, 0].astype(np.int64)
        else:
            see, number = sight(mesh, reach, points, size), np.arange(samples.nsamples)
        for i, j, r in pairs_within(np.ascontiguousarray(points), reach):
            share = self._share(r, size, i, j, horizon)
            keep = np.flatnonzero(share > RIM)
            keep = keep[~see.blocked(number[i[keep]], number[j[keep]])]
            i, j = i[keep], j[keep]
            yield np.stack([i, j], axis=1).astype(np.int32), 2.0 * volume[i] * volume[j] * share[keep]

    def _share(self, r: Floats, size: Floats, i: Longs, j: Longs, horizon: float) -> Floats:
        if not self.partial_volume:
            return np.ones_like(r)
        share = np.zeros_like(r)
        for end in (i, j):
            h = size[end]
            share += 0.5 * np.clip((horizon + 0.5 * h - r) / h, 0.0, 1.0)
        return share


def _part(samples: Samples, ends: Ints, weight: Floats) -> PairPart:
    first = int(ends.min())
    width = int(ends.max()) + 1 - first
    return PairPart(samples, first, width, np.ascontiguousarray(ends - np.int32(first)), np.ascontiguousarray(weight))
