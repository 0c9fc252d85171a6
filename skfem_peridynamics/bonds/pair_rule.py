"""Pair rules of the double integral: all pairs of one point set within the horizon."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .._types import Floats, Ints, Longs, Mesh
from ..geometry.connected import connected
from ..geometry.neighbours import RIM, estimate_pairs, pairs_within
from ..geometry.simplices import describe_point, longest_edge, vertex_sizes
from ..geometry.visibility import sight
from ..material.influence import Influence
from . import rule as bond_parts
from .pair_bonds import PairBonds, rim_share
from .rule import Part, rows_of
from .samples import Samples, gauss_samples, vertex_samples


@dataclass(frozen=True)
class PairRule:
    """All pairs of points within the horizon, each point standing for its share of the elements.

    Parameters
    ----------
    partial_volume : bool
        Scale the weight of a pair near the rim by the part of the neighbour's cell that lies in the ball,
        ``clip((horizon + h/2 - r)/h, 0, 1)`` with h the neighbour's size, averaged over the two ends so that the
        form stays symmetric. Without it a pair counts fully up to the horizon, rim included.
    points : {"vertices", "gauss"}
        The vertices (the classical meshfree method), or the Gauss points of the elements.

    Raises
    ------
    ValueError
        For other points.

    Examples
    --------
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
        """Return the point set.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.

        Returns
        -------
        Samples
            The points where the rule reads the displacement.
        """
        return vertex_samples(mesh) if self.points == "vertices" else gauss_samples(mesh, with_vertices=False)

    def _reach(self, horizon: float, size: Floats) -> float:
        return horizon + (0.5 * float(size.max()) if self.partial_volume else 0.0)

    def estimate(self, mesh: Mesh, horizon: float) -> int:
        """Return about how many bonds there will be, before they are made.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        horizon : float
            A length.

        Returns
        -------
        int
            Number of bonds.
        """
        samples = self.samples(mesh)
        return estimate_pairs(samples.points.T, self._reach(horizon, samples.size))

    def parts(self, mesh: Mesh, samples: Samples, horizon: float, influence: Influence) -> list[Part]:
        """Return the bonds, ends sorted.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        samples : Samples
            The points of the rule on that mesh.
        horizon : float
            A length.
        influence : Influence
            The influence function.

        Returns
        -------
        list of PairBonds
            The bonds, a part of them at a time.

        Raises
        ------
        ValueError
            When a vertex has no bond.
        """
        parts = list(self._parts(mesh, samples, horizon))
        # each bond is listed at one of its ends: count it at both
        degree = np.zeros(samples.nsamples, dtype=np.int64)
        for part in parts:
            window = slice(part.first, part.first + part.width)
            degree[window] += np.bincount(part.partner, minlength=part.width)
            degree[part.first + part.row :][: len(part.start) - 1] += np.diff(part.start)
        lonely = np.flatnonzero(degree == 0)
        if len(lonely):
            vertex = samples.vertices[lonely[0], 0]
            at = mesh.p[:, vertex] if self.points == "vertices" else samples.points[lonely[0]]
            point = f"vertex {vertex}" if self.points == "vertices" else "the Gauss point"
            raise ValueError(
                f"horizon = {horizon:g} leaves {point} at {describe_point(at)} without a "
                f"bond ({len(lonely)} of {samples.nsamples} points); the mesh size there is "
                f"{vertex_sizes(mesh)[vertex]:.3g}: take a larger horizon or a finer mesh"
            )
        if self.points == "vertices" and longest_edge(mesh) <= horizon:
            return list(parts)  # every edge of an element is a bond: the bonds hang together as the mesh does
        ends = np.concatenate([part.ends + np.int32(part.first) for part in parts])
        # otherwise a row of thin or long elements can cut the bonds in two without a vertex that has none
        pieces, bonded = connected(mesh.t, mesh.nvertices)[0], connected(ends.T, samples.nsamples)[0]
        if bonded > pieces:
            raise ValueError(
                f"horizon = {horizon:g} leaves the bonds in {bonded} separate pieces, the mesh has {pieces}: in some "
                "direction the mesh is coarser than the horizon; take a larger horizon or a finer mesh"
            )
        return list(parts)

    def _parts(self, mesh: Mesh, samples: Samples, horizon: float) -> Iterator[PairBonds]:
        """Rows of about a block of bonds at a time."""
        reach = horizon if self.partial_volume else 0.0
        near: list[Longs] = []
        far: list[Ints] = []
        row, count = 0, 0
        for i, j in self.ends_within(mesh, samples, horizon):
            near, far, count = [*near, i], [*far, j], count + len(i)
            if count >= bond_parts.BLOCK:
                # enough for a part: cut at rows, and keep the last run, which the next chunk may go on with
                i, j = np.concatenate(near), np.concatenate(far)
                start = np.searchsorted(i, np.arange(row, int(i[-1]) + 2))
                runs = rows_of(start, bond_parts.BLOCK)
                for run in runs[:-1]:
                    yield _part(samples, row + run.start, start[run.start : run.stop + 1], j, reach)
                row += runs[-1].start  # the last run may go on
                near, far = [i[start[runs[-1].start] :]], [j[start[runs[-1].start] :]]
                count = len(near[0])
        if count:
            i, j = np.concatenate(near), np.concatenate(far)
            start = np.searchsorted(i, np.arange(row, samples.nsamples + 1))
            for run in rows_of(start, bond_parts.BLOCK):
                if start[run.start] < start[run.stop]:
                    yield _part(samples, row + run.start, start[run.start : run.stop + 1], j, reach)

    def ends_within(self, mesh: Mesh, samples: Samples, horizon: float) -> Iterator[tuple[Longs, Ints]]:
        """Yield near and far ends of the bonds, sample numbers, sorted; all of a row come together.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.
        samples : Samples
            The points of the rule on that mesh.
        horizon : float
            A length.

        Yields
        ------
        tuple of ndarray of int
            Near and far ends.
        """
        size, points = samples.size, samples.points.T
        reach = self._reach(horizon, size)
        if self.points == "vertices":
            see, number = sight(mesh, reach), samples.vertices[:, 0].astype(np.int64)
        else:
            see, number = sight(mesh, reach, points, size), np.arange(samples.nsamples)
        for i, j, r in pairs_within(np.ascontiguousarray(points), reach):
            if self.partial_volume:
                # the search went half a cell beyond the horizon; ends whose cells lie outside the ball are no bonds
                keep = np.flatnonzero(rim_share(r, horizon, size, i, j) > 2.0 * RIM)
                i, j = i[keep], j[keep]
            keep = np.flatnonzero(~see.blocked(number[i], number[j]))
            yield i[keep], j[keep].astype(np.int32)


def _part(samples: Samples, row: int, start: Longs, far: Ints, reach: float) -> PairBonds:
    far = far[start[0] : start[-1]]
    first = min(row, int(far.min()))
    last = max(row + len(start) - 2, int(far.max()))
    return PairBonds(samples, first, last + 1 - first, row - first, start - start[0], far - np.int32(first), reach)
