"""What the cases are held against: sums over all pairs and closed forms that share no code with the package."""

from __future__ import annotations

from math import factorial, gamma, pi

import numpy as np
from scipy import integrate

from .._types import Floats, Mesh


def energy_of_pairs(mesh: Mesh, horizon: float, slope: float, u: Floats) -> float:
    """Return the linear energy of vertex pairs with partial volumes, J = 1, by one dense table of all pairs."""
    p, t = mesh.p, mesh.t
    dim, n = p.shape
    edges = p[:, t[1:]] - p[:, t[:1]]
    volume = np.abs(np.linalg.det(edges.transpose(2, 0, 1))) / factorial(dim)
    own, mean, count = np.zeros(n), np.zeros(n), np.zeros(n)
    for corner in t:
        np.add.at(own, corner, volume / (dim + 1))
        np.add.at(mean, corner, volume)
        np.add.at(count, corner, 1.0)
    h = (factorial(dim) * mean / count) ** (1.0 / dim)
    total = 0.0
    U = u.reshape(n, dim)
    for i in range(n):
        xi = p.T - p[:, i]
        r = np.sqrt((xi**2).sum(axis=1))
        r[i] = np.inf
        share = 0.5 * (np.clip((horizon - r) / h + 0.5, 0, 1) + np.clip((horizon - r) / h[i] + 0.5, 0, 1))
        s = ((U - U[i]) * xi).sum(axis=1)
        s[i] = 0.0
        total += own[i] * float((own * share * slope * s**2 / r**3).sum())
    return float(total / (horizon ** (dim + 1) * pi ** (dim / 2) / gamma(dim / 2 + 1)))


def energy_of_a_stretch(dim: int, horizon: float) -> float:
    """Return the energy of u = (x, 0, 0) on the unit interval, square or cube for f'(0) = 1, J = 1, any horizon.

    Differences of two points of the unit box have the density ``prod 2^dim (1 - |xi_k|)``; integrated in polar
    coordinates, where the integrand is a polynomial of the length.

    >>> round(2 * energy_of_a_stretch(2, 0.25), 12), round(2 * energy_of_a_stretch(3, 0.25), 10)
    (0.388591539836, 0.2195222382)
    """

    def ray(e: tuple[float, ...]) -> float:
        reach = min(horizon, 1.0 / max(e))
        polynomial = np.polynomial.Polynomial([1.0])
        for component in e:
            polynomial *= np.polynomial.Polynomial([1.0, -component])
        # r S^2 = r e_x^4, and r^(dim - 1) of the coordinates
        whole = (polynomial * np.polynomial.Polynomial([0.0] * dim + [1.0])).integ()
        return float(e[0] ** 4 * whole(reach) * 2**dim)

    if dim == 1:
        value = ray((1.0,))
    elif dim == 2:
        value = sum(
            integrate.quad(lambda a: ray((np.cos(a), np.sin(a))), low, high, epsabs=1e-15, epsrel=1e-13)[0]
            for low, high in ((0.0, pi / 4), (pi / 4, pi / 2))
        )
    else:

        def turn(phi: float) -> float:  # where the longest component changes
            return float(np.arctan(1.0 / max(np.cos(phi), np.sin(phi))))

        def over(theta: float, phi: float) -> float:
            sine = np.sin(theta)
            return float(sine * ray((sine * np.cos(phi), sine * np.sin(phi), np.cos(theta))))

        value = 0.0
        for low, high in ((0.0, pi / 4), (pi / 4, pi / 2)):
            for below, above in ((0.0, turn), (turn, pi / 2)):
                value += integrate.dblquad(over, low, high, below, above, epsabs=1e-13, epsrel=1e-9)[0]
    return float(value / (horizon ** (dim + 1) * pi ** (dim / 2) / gamma(dim / 2 + 1)))


def zero_modes(K: Floats) -> int:
    """Return how many eigenvalues of a symmetric matrix, scaled to a unit diagonal, are zero to round-off."""
    scale = 1.0 / np.sqrt(np.diag(K))
    lam = np.linalg.eigvalsh(scale[:, None] * K * scale)
    return int((np.abs(lam) < 1e-12 * len(lam)).sum())
