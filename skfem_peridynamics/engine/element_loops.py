"""Compiled loops between elements and what lies in them: the motion of a P1 field, and forces on their way back.

E has a row ``corner, u0, G`` for each element, the field there is ``u0 + G (y - corner)``; M has a row of summed forces
and of their moments about the corner. ``axes`` is a tuple as long as the dimension.
"""

from __future__ import annotations

from typing import Any

from .._compile import compiled


@compiled
def tabulate(axes: Any, corners: Any, gradient: Any, u: Any, low: int, high: int, E: Any) -> None:
    """Fill in u0 and G of some elements from nodal values; ``gradient`` is that of the barycentric coordinates."""
    dim = len(axes)
    for e in range(low, high):
        base = corners[0, e]
        for a in range(dim):
            u0 = u[base, a]
            E[e, dim + a] = u0
            for b in range(dim):
                slope = 0.0
                for k in range(1, dim + 1):
                    # differences to the corner: a translation leaves no slope, to the last bit
                    slope += (u[corners[k, e], a] - u0) * gradient[e, k, b]
                E[e, 2 * dim + a * dim + b] = slope


@compiled
def settle(axes: Any, x: Any, own: Any, E: Any, sites: Any) -> None:
    """Write places and displacements of the sites, the latter from the elements that hold them."""
    dim = len(axes)
    for i in range(len(own)):
        at = own[i]
        for a in range(dim):
            sites[i, a] = x[i, a]
            moved = 0.0
            for b in range(dim):
                moved += E[at, 2 * dim + a * dim + b] * (x[i, b] - E[at, b])
            sites[i, 4 + a] = E[at, dim + a] + moved


@compiled
def give_back(axes: Any, x: Any, own: Any, E: Any, forces: Any, times: float, M: Any) -> None:
    """Add forces at the sites to the elements that hold them."""
    dim = len(axes)
    for i in range(len(own)):
        at = own[i]
        for a in range(dim):
            # the force, and its moment about the corner: what the values at all corners need
            f = times * forces[i, a]
            M[at, a] += f
            for b in range(dim):
                M[at, dim + a * dim + b] += f * (x[i, b] - E[at, b])


@compiled
def hand_over(axes: Any, corners: Any, gradient: Any, M: Any, low: int, high: int, F: Any) -> None:
    """Add what some elements have summed to nodal forces, by P1 values at their corners; empty the sums."""
    dim = len(axes)
    for e in range(low, high):
        for a in range(dim):
            rest = M[e, a]
            M[e, a] = 0.0
            for k in range(1, dim + 1):
                part = 0.0
                for b in range(dim):
                    part += M[e, dim + a * dim + b] * gradient[e, k, b]
                F[corners[k, e], a] += part
                # the P1 values sum to 1: the base corner gets what the others leave, so that no momentum is lost
                rest -= part
            for b in range(dim):
                M[e, dim + a * dim + b] = 0.0
            F[corners[0, e], a] += rest
