"""Compiled search for pairs: points sorted into cells as wide as the reach, neighbours looked for in touching cells."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._compile import compiled
from .._types import Floats, Ints, Longs

_ROWS = 4096  # searched at a time
_MOST_CELLS = 4  # a point: where points are far apart in a wide body, cells are widened


@dataclass(frozen=True, eq=False)
class Cells:
    """Points sorted into cells, as wide as the reach or wider: whatever is within reach lies in touching ones.

    ``order`` are the points cell by cell, and those of cell k are from ``start[k]`` to ``start[k + 1]``.
    """

    low: Floats
    side: float
    shape: Longs
    order: Ints
    start: Longs

    @classmethod
    def of(cls, points: Floats, reach: float) -> Cells:
        """Return the cells of points (n, 3)."""
        low, extent = points.min(axis=0), np.ptp(points, axis=0)
        side = reach
        while True:
            shape = np.floor(extent / side).astype(np.int64) + 1
            if shape.astype(float).prod() <= _MOST_CELLS * len(points) + 27:
                break
            # wider cells search more points than needed, and stay right
            side *= 1.5
        cell = np.minimum(((points - low) / side).astype(np.int64), shape - 1)
        number = (cell[:, 0] * shape[1] + cell[:, 1]) * shape[2] + cell[:, 2]
        order = np.argsort(number, kind="stable").astype(np.int32)
        start = np.searchsorted(number[order], np.arange(int(shape.prod()) + 1))
        return cls(low, side, shape, order, start)

    def cell_of(self, points: Floats) -> Longs:
        """Return the cell of points (n, 3) along each axis, also of those beside all cells."""
        cell: Longs = np.floor((points - self.low) / self.side).astype(np.int64)
        return cell


def pairs(x: Floats, reach: float) -> Iterator[tuple[Longs, Longs, Floats]]:
    """Yield ``(i, j, distance)`` of all pairs i < j of points (dim, n) with ``0 < distance <= reach``, row by row."""
    dim, n = x.shape
    points = np.zeros((n, 3))
    points[:, :dim] = x.T
    cells = Cells.of(points, reach)
    cell, shape, order, start = (
        np.minimum(cells.cell_of(points), cells.shape - 1),
        cells.shape,
        cells.order,
        cells.start,
    )
    count, room = np.zeros(_ROWS, dtype=np.int64), 1 << 16
    for first in range(0, n, _ROWS):
        last = min(n, first + _ROWS)
        while True:
            far, r = np.empty(room, dtype=np.int64), np.empty(room)
            npairs = _rows(points, cell, shape, order, start, first, last, reach, count, far, r)
            if npairs <= room:
                break
            # the loop has counted what did not fit: once more, with room
            room = npairs + (npairs >> 2)
        yield np.repeat(np.arange(first, last), count[: last - first]), far[:npairs], r[:npairs]


@compiled
def _rows(
    x: Any,
    cell: Any,
    shape: Any,
    order: Any,
    start: Any,
    first: int,
    last: int,
    reach: float,
    count: Any,
    far: Any,
    r: Any,
) -> int:
    """Neighbours of some points, sorted, and their distances; return how many there are, or would be with room."""
    npairs, limit = 0, reach * reach
    for i in range(first, last):
        begin = npairs
        x0, x1, x2 = x[i, 0], x[i, 1], x[i, 2]
        for a in range(max(cell[i, 0] - 1, 0), min(cell[i, 0] + 2, shape[0])):
            for b in range(max(cell[i, 1] - 1, 0), min(cell[i, 1] + 2, shape[1])):
                row = (a * shape[1] + b) * shape[2]
                # cells along the last axis follow one another
                low = start[row + max(cell[i, 2] - 1, 0)]
                high = start[row + min(cell[i, 2] + 2, shape[2])]
                for k in range(low, high):
                    j = order[k]
                    if j > i:
                        d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
                        square = d0 * d0 + d1 * d1 + d2 * d2
                        if 0.0 < square <= limit:
                            # go on counting when the room is used up
                            if npairs < len(far):
                                far[npairs] = j
                            npairs += 1
        count[i - first] = npairs - begin
        if npairs <= len(far):
            far[begin:npairs].sort()
            for k in range(begin, npairs):
                j = far[k]
                d0, d1, d2 = x[j, 0] - x0, x[j, 1] - x1, x[j, 2] - x2
                r[k] = np.sqrt(d0 * d0 + d1 * d1 + d2 * d2)
    return npairs
