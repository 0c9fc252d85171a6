"""The force of a smooth field on the unit square, by polar Gauss quadrature: no mesh, no code of the package."""

import numpy as np


def panels(x, y, eps):
    """Angles between which the ray length is smooth: corners, and where a side enters or leaves the ball; (14, n)."""
    ends = [np.full_like(x, 0.0), np.full_like(x, 2 * np.pi)]
    for cx, cy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        ends.append(np.arctan2(cy - y, cx - x) % (2 * np.pi))
    for normal, gap in ((0.0, 1 - x), (np.pi / 2, 1 - y), (np.pi, x), (3 * np.pi / 2, y)):
        half = np.arccos(np.clip(gap / eps, -1, 1))
        ends += [(normal + half) % (2 * np.pi), (normal - half) % (2 * np.pi)]
    return np.sort(np.array(ends), axis=0)


def force_on_square(points, eps, field, slope_of_f, J=lambda s: np.ones_like(s), w=None, n=12):
    """``P(u)`` at points (2, m): ``4 c int w w J f'(r S^2) S e dy`` over the ball inside the square, (2, m)."""
    gauss, weight = np.polynomial.legendre.leggauss(n)
    out = np.zeros_like(points)
    for low in range(0, points.shape[1], 400):
        x, y = points[:, low : low + 400]
        ends = panels(x, y, eps)
        width = np.diff(ends, axis=0)
        angle = ends[:-1, None] + 0.5 * width[:, None] * (gauss[:, None] + 1)  # (panel, node, point)
        angle_weight = 0.5 * width[:, None] * weight[:, None]
        e = np.array([np.cos(angle), np.sin(angle)])
        with np.errstate(divide="ignore", invalid="ignore"):
            to_x = np.where(e[0] > 0, 1 - x, x) / np.abs(e[0])
            to_y = np.where(e[1] > 0, 1 - y, y) / np.abs(e[1])
        reach = np.minimum(eps, np.minimum(np.nan_to_num(to_x), np.nan_to_num(to_y)))
        here, own = field(np.array([x, y])), 1.0 if w is None else w(np.array([x, y]))
        total = np.zeros((2, *angle.shape))
        for s, ws in zip(gauss, weight, strict=True):
            r = reach * 0.5 * (s + 1)
            there = np.array([x + r * e[0], y + r * e[1]])
            S = np.divide(((field(there) - here[:, None, None]) * e).sum(axis=0), r, out=np.zeros_like(r), where=r > 0)
            value = J(r / eps) * slope_of_f(r * S**2) * S * (0.5 * ws * reach * r)
            if w is not None:
                value = value * own * w(there)
            total += value * e
        out[:, low : low + 400] = (total * angle_weight).sum(axis=(1, 2))
    return out * 4 / (eps**3 * np.pi)
