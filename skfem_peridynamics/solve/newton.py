"""Newton's method for equilibria and implicit steps: a minimum of an energy, on its exact Hessian.

An equilibrium makes ``PD(u) - b.u`` stationary, a Newmark step that plus the inertia ``shift/2 |u - centre|^2`` in the
norm of the mass. Bonds that soften make the Hessian indefinite. SciPy's conjugate gradients then stop at the first
direction of negative curvature, and the line search goes down along it; it also keeps Newton from running uphill to a
state that is stationary and no minimum.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, cg

from .._types import Floats, Longs
from ..model.led_body import LedBody
from ..model.peridynamics import Peridynamics
from .mass_solver import MassSolver
from .preconditioner import Preconditioner

_EPS = float(np.finfo(float).eps)
MOST = 60  # iterations of Newton's method
_POWERS = (0.0, 0.5, 1.0)  # of the stiffness that forces are divided by to be compared
# Of the scaled strain at which a bond's force is largest: bonds below the first hold, and come nearer by the second at
# most. Measured in docs/evidence/stability.md.
_HOLDS, _NEARER = 2.0, 0.7
_AWAY = 1e3  # sizes of the body
_INNER = 3000  # products of one linear solve
_SUFFICIENT, _CURVATURE = 1e-4, 0.9  # of the line search


class NotConverged(RuntimeError):
    """No equilibrium or no end of an implicit step was found; ``state`` is the last one that was, a copy.

    Examples
    --------
    >>> NotConverged("cut too often").state is None
    True
    """

    def __init__(self, message: str, state: Any = None) -> None:
        super().__init__(message)
        self.state = state


@dataclass(frozen=True, eq=False)
class Objective:
    """``PD(u) - load.u + shift/2 (u - centre).M (u - centre)``, its gradient and Hessian on the ``free`` unknowns.

    ``stiffness`` (N,), positive, is what holds each unknown, bonds and inertia. Forces are compared as they are, over
    that, and over its root: the first does not let a stiff part drift on soft bonds, the second a soft part hide behind
    the forces of a stiff one.
    """

    body: Peridynamics
    free: Longs
    stiffness: Floats
    load: Floats | None = None
    shift: float = 0.0
    mass: MassSolver | None = None
    centre: Floats | None = None

    def value(self, u: Floats) -> tuple[float, float]:
        """Return the value, and the sum of what it was made of, for its round-off."""
        parts = [self.body.energy(u)]
        if self.load is not None:
            parts.append(-float(self.load @ u))
        if self.mass is not None and self.centre is not None:
            d = u - self.centre
            parts.append(0.5 * self.shift * float(d @ self.mass.times(d)))
        return sum(parts), sum(map(abs, parts))

    def gradient(self, u: Floats) -> tuple[Floats, Floats]:
        """Return the gradient at the free unknowns, and the sizes of the forces it is a difference of."""
        force = self.body.force(u)
        g, of = -force, [self._sizes(force, self.stiffness)]
        if self.load is not None:
            g -= self.load
            of.append(self._sizes(self.load, self.stiffness))
        if self.mass is not None and self.centre is not None:
            inertia = self.shift * self.mass.times(u - self.centre)
            g += inertia
            of.append(self._sizes(inertia, self.stiffness))
        return g[self.free], np.max(of, axis=0)

    def _sizes(self, force: Floats, stiffness: Floats) -> Floats:
        return np.array([np.linalg.norm(force / stiffness**power) for power in _POWERS])

    def excess(self, g: Floats, sizes: Floats, u: Floats, tolerance: float) -> float:
        """Return how many times a gradient is larger than a tolerance of the forces, or than round-off, allows."""
        extent = float(np.abs(u).max(initial=0.0))
        if self.centre is not None:
            extent = max(extent, float(np.abs(self.centre).max(initial=0.0)))
        scale = self.stiffness[self.free]
        floor = _EPS * extent * self._sizes(scale, scale)
        allowed = np.maximum(np.maximum(tolerance * sizes, floor), np.finfo(float).tiny)
        return float((self._sizes(g, scale) / allowed).max())

    def hessian(self, u: Floats) -> Callable[[Floats], Floats]:
        """Return the product with the Hessian on the free unknowns."""
        K = self.body.stiffness_operator() if self.body.linear else self.body.tangent_operator(u)
        full = np.zeros(len(u))

        def apply(x: Floats) -> Floats:
            full[self.free] = x
            y: Floats = K @ full
            if self.mass is not None:
                y = y + self.shift * self.mass.times(full)
            return y[self.free]

        return apply

    def reach(self, u: Floats, d: Floats) -> float:
        """Return how far a step along d may go, in lengths of d: no bond that holds comes nearer to breaking by more.

        Newton's step out of an unstable state is as long as the state is far from the next one. Taken whole it breaks
        bonds on the way that would have held. What has long broken may go where it will.
        """
        full = np.zeros(len(u))
        full[self.free] = d
        largest = largest_move(self.body, u, full, _HOLDS)
        return _NEARER / largest if largest > 0.0 else np.inf


def largest_move(body: Peridynamics, u: Floats, d: Floats, below: float) -> float:
    """Return the largest ``|S| / S_c`` by d, (N,) as u is, of the bonds whose own at u is ``below``; 0 without any."""
    if isinstance(body, LedBody):
        return body.largest_move(u, d, below)
    holds = list(body.each_block(u, lambda block, T: block.law.severity(T) < below))
    moves = body.each_block(d, lambda block, T: block.law.severity(T))
    most = (float(move[hold].max(initial=0.0)) for move, hold in zip(moves, holds, strict=True))
    return max(most, default=0.0)


@dataclass
class Effort:
    """What solving has cost so far.

    Parameters
    ----------
    iterations : int
        Of Newton's method.
    products : int
        With the Hessian.
    evaluations : int
        Of the energy.
    negative : int
        Directions of negative curvature that were met.

    Examples
    --------
    >>> Effort(iterations=2).products
    0
    """

    iterations: int = 0
    products: int = 0
    evaluations: int = 0
    negative: int = 0


class _Negative(Exception):
    """A direction of negative curvature."""


def _descend(
    apply: Callable[[Floats], Floats],
    g: Floats,
    inverse: LinearOperator,
    stiffness: Floats,
    rtol: float,
    effort: Effort,
) -> tuple[Floats, bool, int]:
    """Return a direction of descent, whether it has negative curvature, and the products it took.

    The unknowns are scaled to a unit diagonal, so that the residual that SciPy's CG looks at is one of soft parts too.
    """
    candidates: list[Floats] = []
    so_far: list[Floats] = [np.zeros_like(g)]
    before, root = effort.products, np.sqrt(stiffness)

    def product(p: Floats) -> Floats:
        effort.products += 1
        Ap = apply(p / root) / root
        if not float(p @ Ap) > 0.0 and p.any():
            candidates.append(p.copy())
            raise _Negative
        return Ap

    def keep(x: Floats) -> None:
        so_far[0] = x

    shape = (len(g), len(g))
    A = LinearOperator(shape, matvec=product, dtype=np.dtype(float))
    P = LinearOperator(shape, matvec=lambda x: root * (inverse @ (root * x)), dtype=np.dtype(float))
    try:
        d, _ = cg(A, -g / root, rtol=rtol, maxiter=_INNER, M=P, callback=keep)
    except _Negative:
        effort.negative += 1
        p, x = candidates[0], so_far[0]
        if not x.any():
            return p / root, True, effort.products - before
        # down along p as well, as far again as the positive part went
        reach = float(np.linalg.norm(x) / np.linalg.norm(p))
        return (x + reach * p) / root, True, effort.products - before
    return d / root, False, effort.products - before


def minimise(
    objective: Objective, u: Floats, inverse: Preconditioner, *, tolerance: float, effort: Effort, most: int = MOST
) -> Floats:
    """Return a minimum of the objective near u; the unknowns that are not free stay as they are.

    Converged is a gradient of ``tolerance`` times the forces it is the difference of, or round-off; see
    :class:`Objective` for how forces are compared. Raises
    :class:`NotConverged`.
    """
    if not len(objective.free):
        return u
    with np.errstate(all="ignore"):  # what runs off to infinity is told from its numbers
        return _minimise(objective, u, inverse, tolerance, effort, most)


def _minimise(
    objective: Objective, u: Floats, inverse: Preconditioner, tolerance: float, effort: Effort, most: int
) -> Floats:
    linear = objective.body.linear
    # bonds that soften bound the forces: what has moved by a thousand bodies is not coming back
    farthest = (
        np.inf if linear else float(np.abs(u).max()) + _AWAY * float(np.ptp(objective.body.bonds.mesh.p, axis=1).max())
    )
    value, parts = objective.value(u)
    g, size = objective.gradient(u)
    excess = first = objective.excess(g, size, u, tolerance)
    for iteration in range(most + 1):
        if not np.isfinite(value) or not np.isfinite(excess):
            raise NotConverged("the forces are no longer finite")
        if excess <= 1.0:
            return u
        if iteration == most:
            break
        effort.iterations += 1
        rtol = max(0.3 / excess, 1e-13)  # of the residual; a linear system is solved at once
        if not linear:
            rtol = max(rtol, min(0.1, float(np.sqrt(excess / first))))
        apply, stiffness = objective.hessian(u), objective.stiffness[objective.free]
        d, negative, cost = _descend(apply, g, inverse.at(objective.shift), stiffness, rtol, effort)
        slope = float(g @ d)
        if not np.isfinite(slope):
            raise NotConverged("the displacements run off")
        if not slope < 0.0:  # round-off in a solve that has nothing left to gain
            d = -(inverse.at(objective.shift) @ g)
            slope = float(g @ d)
        if not linear:
            inverse.learn(cost, u)
        reach = np.inf if linear else objective.reach(u, d)
        u, value, parts, g, size = _search(objective, u, d, slope, value, parts, negative, reach, effort)
        excess = objective.excess(g, size, u, tolerance)
        if float(np.abs(u).max()) > farthest:
            raise NotConverged("the displacements run off")
    raise NotConverged(
        f"Newton's method has not converged in {most} iterations: the residual is {excess * tolerance:.3g} of the "
        "forces"
    )


def _search(
    objective: Objective,
    u: Floats,
    d: Floats,
    slope: float,
    value: float,
    parts: float,
    negative: bool,
    reach: float,
    effort: Effort,
) -> tuple[Floats, float, float, Floats, Floats]:
    """Return the next point along d with its value and gradient: far enough down, told apart from round-off."""
    noise = 8.0 * _EPS * parts
    length, best = min(1.0, reach), None
    for _ in range(60):
        trial = u.copy()
        trial[objective.free] += length * d
        now, its_parts = objective.value(trial)
        effort.evaluations += 1
        down = np.isfinite(now) and now <= value + _SUFFICIENT * length * slope
        if best is not None and not (down and now < best[1]):
            break
        if down or (np.isfinite(now) and now <= value + noise):
            g, size = objective.gradient(trial)
            steep = float(g @ d)
            # where the energies differ by round-off, their slopes tell
            if down or abs(steep) <= _CURVATURE * abs(slope):
                best = trial, now, its_parts, g, size
            # where the curvature is negative there is more to gain
            if best is not None and not (down and negative and steep < _CURVATURE * slope and 2.0 * length <= reach):
                break
        if best is not None:
            length *= 2.0
            continue
        # the lowest point of the parabola through what is known, between a tenth and a half
        bend = now - value - slope * length
        guess = -0.5 * slope * length**2 / bend if np.isfinite(bend) and bend > 0.0 else 0.0
        length = min(0.5 * length, max(0.1 * length, guess))
    if best is None:
        raise NotConverged("no way down was found along the search direction")
    return best
