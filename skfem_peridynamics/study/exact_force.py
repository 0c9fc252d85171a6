"""The force of a smooth field on the unit interval, square or cube, by quadrature of high order that knows no mesh.

Rays from a point are cut where they leave the box. Their length is a smooth function of the direction but for kinks
along corners and edges and where a side enters the ball; between those the directions carry Gauss rules.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from .._types import Floats, Longs
from ..material.influence import as_influence
from ..material.material import UNIT_BALL

Profile = Callable[[Floats], Floats]
_CHUNK = 400_000  # evaluations at a time
_PARTS = tuple(0.5**k for k in range(6))  # of the horizon: rays along a side double their length between two breaks


@dataclass(frozen=True)
class Directions:
    """Directions from points of the unit box: number of the point, unit vector, angular weight, reach; by ray."""

    point: Longs
    e: Floats
    weight: Floats
    reach: Floats


def rays(points: Floats, horizon: float, order: int) -> Iterator[Directions]:
    """Yield the rays of points (n, dim), ``order`` Gauss nodes between two kinks."""
    dim = points.shape[1]
    per_point = {1: 2, 2: 12 * order, 3: 200 * order**2}[dim] * order
    for low in range(0, len(points), max(1, _CHUNK // per_point)):
        x = points[low : low + max(1, _CHUNK // per_point)]
        gaps = np.stack([x, 1.0 - x], axis=2)  # to the low and the high side of each axis
        if dim == 1:
            point = np.repeat(np.arange(len(x)), 2)
            e = np.tile([[-1.0], [1.0]], (len(x), 1))
            weight = np.ones(len(e))
        elif dim == 2:
            point, angle, weight = _around(gaps, np.full(len(x), horizon), order)
            e = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        else:
            point, e, weight = _over_sphere(gaps, horizon, order)
        side = np.where(e > 0.0, gaps[point, :, 1], gaps[point, :, 0])
        with np.errstate(divide="ignore", over="ignore"):
            reach = np.minimum(horizon, (side / np.abs(e)).min(axis=1))
        yield Directions(point + low, e, weight, reach)


def _between(breaks: Floats, order: int) -> tuple[Longs, Floats, Floats]:
    """Gauss nodes between the breaks (n, m) of each row: number of the row, node, weight; empty panels left out."""
    nodes, weights = np.polynomial.legendre.leggauss(order)
    breaks = np.sort(breaks, axis=1)
    width = np.diff(breaks, axis=1)
    row, panel = np.nonzero(width > 1e-13)
    half = 0.5 * width[row, panel]
    at = (breaks[row, panel] + half)[:, None] + half[:, None] * nodes
    return np.repeat(row, order), at.ravel(), (half[:, None] * weights).ravel()


def _opening(gap: Floats, reach: Floats) -> Floats:
    """Angle from a side's normal at which a ray cut by the side is of some length; 0 where none is cut so soon."""
    with np.errstate(divide="ignore", invalid="ignore"):
        angle: Floats = np.arccos(np.clip(np.where(gap < reach, gap / reach, 1.0), 0.0, 1.0))
    return angle


def _around(gaps: Floats, radius: Floats, order: int) -> tuple[Longs, Floats, Floats]:
    """Angles about points in a square, kinks where corners lie and where sides enter the circle of some radius."""
    n = len(gaps)
    breaks = [np.full(n, k * pi / 2) for k in range(5)]
    (left, right), (down, up) = gaps[:, 0].T, gaps[:, 1].T
    for across, along in ((right, up), (-left, up), (-left, -down), (right, -down)):
        breaks.append(np.where(np.hypot(across, along) < radius, np.arctan2(along, across) % (2 * pi), 0.0))
    for normal, gap in ((0.0, right), (pi / 2, up), (pi, left), (3 * pi / 2, down)):
        for part in _PARTS:
            half = _opening(gap, part * radius)
            breaks += [(normal + half) % (2 * pi), (normal - half) % (2 * pi)]
    return _between(np.stack(breaks, axis=1), order)


def _over_sphere(gaps: Floats, horizon: float, order: int) -> tuple[Longs, Floats, Floats]:
    """Rays about points in a cube: circles of latitude, each cut by the sides as a circle in a square is."""
    n = len(gaps)
    flat = [gaps[:, axis, side] for axis in (0, 1) for side in (0, 1)]
    flat += [np.hypot(gaps[:, 0, i], gaps[:, 1, j]) for i in (0, 1) for j in (0, 1)]
    point, e, weight = [], [], []
    for side, sign in ((0, -1.0), (1, 1.0)):
        height = gaps[:, 2, side]
        breaks = [np.zeros(n), np.full(n, pi / 4), np.full(n, pi / 2)]
        breaks += [_opening(height, np.full(n, part * horizon)) for part in _PARTS]
        for gap in flat:
            breaks += [np.arcsin(np.minimum(gap / horizon, 1.0)), np.arctan2(gap, height)]
        row, tilt, w_tilt = _between(np.stack(breaks, axis=1), order)
        reach = np.minimum(horizon, height[row] / np.maximum(np.cos(tilt), 1e-300))
        circle, angle, w_angle = _around(gaps[row, :2], reach * np.sin(tilt), order)
        sin = np.sin(tilt)[circle]
        point.append(row[circle])
        e.append(np.stack([sin * np.cos(angle), sin * np.sin(angle), sign * np.cos(tilt)[circle]], axis=1))
        weight.append(w_angle * w_tilt[circle] * sin)
    return np.concatenate(point), np.concatenate(e), np.concatenate(weight)


def _along(
    directions: Directions, points: Floats, layer: float | None, order: int
) -> Iterator[tuple[Any, Floats, Floats]]:
    """Radial nodes: number of the ray, distance, weight.

    Where there is a boundary function its third derivative jumps at depth ``layer``: rays are split there.
    """
    if layer is None:
        nodes, weights = np.polynomial.legendre.leggauss(order)
        for s, ws in zip(0.5 * (nodes + 1.0), 0.5 * weights, strict=True):
            yield slice(None), directions.reach * s, directions.reach * ws
        return
    breaks = [np.zeros(len(directions.e)), directions.reach]
    for plane in (layer, 1.0 - layer):
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            crossing = (plane - points[directions.point]) / directions.e
        inside = (crossing > 0.0) & (crossing < directions.reach[:, None])
        breaks += list(np.where(inside, crossing, 0.0).T)
    yield _between(np.stack(breaks, axis=1), order)


def force_moments(
    points: Floats,
    horizon: float,
    field: Callable[[Floats], Floats],
    terms: int,
    *,
    influence: Any = "constant",
    boundary: Profile | None = None,
    order: int = 8,
) -> Floats:
    """Return ``4 c int w w J (r S^2)^k S e dy`` for k = 0 .. terms - 1 at points (n, dim); shape (terms, n, dim).

    With ``f'(q) = sum a_k q^k`` the force of ``g field`` is ``sum a_k g^(2k+1)`` times these (paper, eq. 2.11).
    ``field`` maps (n, dim) to (n, dim); ``boundary`` is the boundary function w, (n, dim) to (n,).

    >>> x = np.array([[0.5, 0.4]])                             # deep inside: mu (2 grad div + lap), mu = 1/6
    >>> force_moments(x, 0.2, lambda x: np.stack([x[:, 0] ** 2, 0 * x[:, 0]], axis=1), 1).round(9).tolist()
    [[[1.0, 0.0]]]
    """
    dim = points.shape[1]
    J = as_influence(influence)
    here = field(points)
    own = None if boundary is None else boundary(points)
    out = np.zeros((terms, len(points), dim))
    for directions in rays(points, horizon, order):
        first, last = int(directions.point.min()), int(directions.point.max()) + 1
        total = np.zeros((terms, len(directions.e)))
        for ray, r, weight in _along(directions, points, None if boundary is None else horizon, order):
            point, e = directions.point[ray], directions.e[ray]
            there = points[point] + r[:, None] * e
            S = ((field(there) - here[point]) * e).sum(axis=1) / np.maximum(r, 1e-300)
            value = S * J(r / horizon) * r ** (dim - 1) * weight
            if boundary is not None:
                value *= boundary(there)
            q = r * S**2
            for k in range(terms):
                total[k] += value if boundary is None else np.bincount(ray, value, len(directions.e))
                value = value * q
        total *= directions.weight
        for k in range(terms):
            for a in range(dim):
                sums = np.bincount(directions.point - first, total[k] * directions.e[:, a], last - first)
                out[k, first:last, a] += sums
    if own is not None:
        out *= own[:, None]
    scaled: Floats = out * (4.0 / (horizon ** (dim + 1) * UNIT_BALL[dim]))
    return scaled
