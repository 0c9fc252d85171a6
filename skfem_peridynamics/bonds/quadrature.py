"""Quadrature of the ball: radial Gauss rules for the influence function, directions of half the sphere."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from .._types import Floats, Longs
from ..geometry.tensors import powers

# Lebedev degrees with positive weights only (13, 25 and 27 have negative ones), and angles by which each is turned.
# The length of a ray that a plane face cuts has a kink where the ray runs along the face, and unturned rules put
# directions right on the kinks of faces normal to the axes. Of 2,500 turns these integrate |e_x|, |e_y| and |e_z|
# times the monomials of order four best: degree 7 to 0.017 of the largest in place of 0.114, degree 15 to 0.002 in
# place of 0.021.
_LEBEDEV = {
    5: (0.69, 1.31, 0.87),
    7: (0.23, 0.91, 0.76),
    9: (0.28, 0.39, 1.25),
    11: (0.26, 1.50, 0.32),
    15: (0.97, 0.20, 0.61),
    17: (0.70, 1.40, 0.81),
    19: (0.53, 0.88, 0.96),
    21: (0.40, 0.71, 1.06),
    23: (0.45, 1.28, 0.24),
    29: (0.05, 0.11, 1.21),
    31: (1.02, 0.67, 0.49),
}
FINE, FINER = 0.15, 0.6  # edge over distance, squared, from which a triangle is seen in 4 and in 16 parts
_GOLDEN, _ROOT = 0.6180339887498949, 1.2207440846057596
_TABLE = 4096  # of cumulative moments
_PANELS, _DENSE = 16, 24  # the fine rule that stands for the integral of J


def radial_rule(influence: Callable[[Floats], Floats], power: int, n: int) -> tuple[Floats, Floats]:
    """Return nodes and weights of the n-point Gauss rule on (0, 1) for the weight ``J(s) s^power``.

    Exact for polynomials of degree 2n - 1, so the moments ``M_power ..`` come out exactly; weights are positive.
    Built from the three-term recurrence of the orthogonal polynomials (Stieltjes) and its eigenvalues (Golub, Welsch).

    >>> s, W = radial_rule(lambda s: np.ones_like(s), power=2, n=1)
    >>> s.round(12).tolist(), W.round(12).tolist()                     # M_3/M_2 = (1/4)/(1/3), M_2 = 1/3
    ([0.75], [0.333333333333])
    """
    from scipy.linalg import eigh_tridiagonal

    if n < 1:
        raise ValueError(f"radial = {n} must be at least 1")
    x, w = np.polynomial.legendre.leggauss(_DENSE)
    s = ((np.arange(_PANELS)[:, None] + 0.5 * (x + 1.0)) / _PANELS).ravel()
    weight = np.tile(0.5 * w / _PANELS, _PANELS) * s**power * influence(s)
    a, b = np.zeros(n), np.zeros(n)
    before, now = np.zeros_like(s), np.ones_like(s)
    total = weight.sum()
    now /= np.sqrt(total)
    for k in range(n):  # orthonormal polynomials at the fine nodes
        a[k] = weight @ (s * now * now)
        after = (s - a[k]) * now - (b[k] * before if k else 0.0)
        norm = np.sqrt(weight @ (after * after))
        before, now = now, after / norm
        if k + 1 < n:
            b[k + 1] = norm
    nodes, vectors = eigh_tridiagonal(a, b[1:])
    return nodes, total * vectors[0] ** 2


def half_sphere(dim: int, at_least: int) -> tuple[Floats, Floats]:
    """Return directions (n, dim), one of each antipodal pair, and weights (n,) that sum to half the unit sphere.

    2D: equispaced, with their antipodes exact to degree 2n - 1. 3D: the smallest Lebedev rule (SciPy's) of positive
    weights with so many, turned. 1D: the one direction there is.

    >>> for dim, n in ((1, 8), (2, 8), (3, 8)):
    ...     e, w = half_sphere(dim, n)
    ...     print(len(e), round(float(w.sum()), 12))
    1 1.0
    8 3.14159265359
    13 6.28318530718
    """
    if at_least < dim + (dim > 1):  # the elastic constants are moments of order four
        raise ValueError(f"angular = {at_least} is too few: {dim}D needs at least {dim + (dim > 1)} directions")
    if dim == 1:
        return np.ones((1, 1)), np.ones(1)
    if dim == 2:
        angle = (np.arange(at_least) + 0.5) * pi / at_least
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), np.full(at_least, pi / at_least)
    from scipy.integrate import lebedev_rule

    for degree in _LEBEDEV:
        e, w = lebedev_rule(degree)
        if e.shape[1] >= 2 * at_least:
            break
    else:
        raise ValueError(f"angular = {at_least} is too many: the largest rule in 3D has {e.shape[1] // 2} directions")
    e = _turn(*_LEBEDEV[degree]) @ e
    upper = e[2] > 0.0
    return np.ascontiguousarray(e[:, upper].T), w[upper]


def turns(dim: int, numbers: Longs, count: int) -> Floats:
    """Return rotations (n, dim, dim) of which no few that follow each other are alike, in two or three dimensions.

    ``numbers`` (n,) are their places in the sequence.

    Angles by the golden ratio within one of ``count`` equal parts of the circle; in 3D quaternions by three irrational
    numbers (Shoemake; the sequence by the root of g^4 = g + 1).

    >>> R = turns(3, np.arange(5), 26)
    >>> bool(np.allclose(R @ R.transpose(0, 2, 1), np.eye(3)) and (np.linalg.det(R) > 0).all())
    True
    """
    if dim == 2:
        angle = (numbers * _GOLDEN) % 1.0 * (2.0 * pi / count)
        c, s = np.cos(angle), np.sin(angle)
        return np.moveaxis(np.array([[c, -s], [s, c]]), 2, 0)
    u = ((numbers[:, None] + 1) / _ROOT ** np.arange(1, 4)) % 1.0
    a, b = np.sqrt(1.0 - u[:, 0]), np.sqrt(u[:, 0])
    x, y = a * np.sin(2.0 * pi * u[:, 1]), a * np.cos(2.0 * pi * u[:, 1])
    z, w = b * np.sin(2.0 * pi * u[:, 2]), b * np.cos(2.0 * pi * u[:, 2])
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def largest_half_sphere() -> int:
    """Return the number of directions of the largest rule in 3D.

    >>> largest_half_sphere()
    175
    """
    from scipy.integrate import lebedev_rule

    return int(lebedev_rule(max(_LEBEDEV))[0].shape[1]) // 2


def _turn(a: float, b: float, c: float) -> Floats:
    """The rotation by a about x, then b about y, then c about z."""
    ca, sa, cb, sb, cc, sc = np.cos(a), np.sin(a), np.cos(b), np.sin(b), np.cos(c), np.sin(c)
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, ca, -sa], [0.0, sa, ca]])
    about_y = np.array([[cb, 0.0, sb], [0.0, 1.0, 0.0], [-sb, 0.0, cb]])
    about_z = np.array([[cc, -sc, 0.0], [sc, cc, 0.0], [0.0, 0.0, 1.0]])
    turn: Floats = about_z @ about_y @ about_x
    return turn


def sphere_mean(dim: int, order: int) -> Floats:
    """Return the means of all monomials of an order over the unit sphere.

    >>> abs(sphere_mean(2, 4)).round(12).tolist()                      # of x^4, x^3 y, x^2 y^2, x y^3, y^4
    [0.375, 0.0, 0.125, 0.0, 0.375]
    """
    e, angle = sphere(dim)
    mean: Floats = angle @ powers(e, order)
    return mean


def sphere(dim: int) -> tuple[Floats, Floats]:
    """Return directions (n, dim) and shares (n,) that integrate polynomials up to degree 15 over the unit sphere."""
    e, angle = half_sphere(dim, {1: 1, 2: 16, 3: 61}[dim])
    return np.concatenate([e, -e]), np.concatenate([angle, angle]) / (2.0 * angle.sum())


class Cumulative:
    """``int_0^a J(s) s^power ds`` for many a.

    >>> round(float(Cumulative(np.ones_like, 1)(np.array([0.5]))[0]), 9)
    0.125
    """

    def __init__(self, influence: Callable[[Floats], Floats], power: int) -> None:
        x, w = np.polynomial.legendre.leggauss(8)
        self.grid = np.linspace(0.0, 1.0, _TABLE + 1)
        s = self.grid[:-1, None] + 0.5 * (x + 1.0) / _TABLE
        pieces = (influence(s) * s**power) @ (0.5 * w / _TABLE)
        self.table = np.concatenate([[0.0], np.cumsum(pieces)])

    def __call__(self, a: Floats) -> Floats:
        value: Floats = np.interp(a, self.grid, self.table)
        return value
