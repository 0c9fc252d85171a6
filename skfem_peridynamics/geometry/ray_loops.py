"""Compiled march of rays, one after the other; the same steps as :meth:`~.rays.Tracer._walk`, in the same order."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._compile import compiled


@compiled
def walk(
    x: Any, element: Any, way: Any, length: Any, at: Any, gradient: Any, base: Any, neighbour: Any, extent: float,
    parallel: float, still: float, most_turns: int, reach: Any, crossed: Any, stuck: Any,
) -> None:  # fmt: skip
    """Reach of each ray and the elements at distances ``at``; marks those that keep turning as ``stuck``."""
    corners, dim, nnodes = gradient.shape[1], gradient.shape[2], at.shape[1]
    for ray in range(len(element)):
        here, s, node, turns = element[ray], 0.0, 0, 0
        scale = min(length[ray], extent)
        while True:
            facet, out = 0, np.inf
            rest = 1.0
            for k in range(corners - 1, -1, -1):
                slope, value, steep = 0.0, 0.0, 0.0
                for a in range(dim):
                    g = gradient[here, k, a]
                    slope += g * way[ray, a]
                    value += g * (x[ray, a] - base[here, a])
                    steep += g * g
                if k == 0:
                    value = rest
                else:
                    rest -= value
                if slope < 0.0 and slope * slope > parallel * parallel * steep:
                    leaves = max(-value / slope, s)
                    if leaves <= out:  # of several the first corner's, as argmin takes it
                        facet, out = k, leaves
            follow = neighbour[here, facet]
            over = follow < 0 or out >= length[ray]
            while node < nnodes and (over or at[ray, node] <= out):
                crossed[ray, node] = here
                node += 1
            if over:
                reach[ray] = min(out, length[ray])
                break
            turns = 0 if out > s + still * scale else turns + 1
            here, s = follow, out
            if turns > most_turns:
                stuck[ray] = True
                break


@compiled
def first_elements(vertex: Any, direction: Any, local: Any, element: Any, start: Any, gradient: Any, least: float,
                   out: Any) -> None:  # fmt: skip
    """The element at each vertex in whose cone the direction lies deepest, -1 where it lies in none."""
    corners, dim = gradient.shape[1], gradient.shape[2]
    for n in range(len(vertex)):
        best, chosen = -np.inf, -1
        for place in range(start[vertex[n]], start[vertex[n] + 1]):
            here, depth = element[place], np.inf
            for k in range(corners):
                if k != local[place]:
                    slope, square = 0.0, 0.0
                    for a in range(dim):
                        g = gradient[here, k, a]
                        slope += g * direction[n, a]
                        square += g * g
                    depth = min(depth, slope / np.sqrt(square))
            if depth > best:
                best, chosen = depth, here
        out[n] = chosen if best >= least else -1
