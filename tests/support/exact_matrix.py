"""The stiffness of P1 on the unit square by brute force: split triangles outside, rays inside, no code of the rules."""

import numpy as np
from scipy.sparse import csr_matrix

# the seven points of degree five on a triangle (Radon), and what they weigh
_A, _B = (6 - np.sqrt(15)) / 21, (6 + np.sqrt(15)) / 21
_SEVEN = np.array(
    [[1 / 3, 1 / 3], *[(_A, _A), (1 - 2 * _A, _A), (_A, 1 - 2 * _A)], *[(_B, _B), (1 - 2 * _B, _B), (_B, 1 - 2 * _B)]]
)
_SHARES = np.array([9 / 40, *[(155 - np.sqrt(15)) / 1200] * 3, *[(155 + np.sqrt(15)) / 1200] * 3])


def _split(m):
    """Points and shares on the reference triangle cut into m^2."""
    upright = [(_SEVEN + np.array([i, j])) / m for i in range(m) for j in range(m - i)]
    turned = [([i + 1, j + 1] - _SEVEN) / m for i in range(m) for j in range(m - i - 1)]
    return np.concatenate(upright + turned), np.tile(_SHARES, m * m) / m**2


def _hats(n, number, points):
    """Vertices (3, ...) and P1 values at points of the grid of n x n squares, cut from lower left to upper right."""
    cell = np.clip((points * n).astype(int), 0, n - 1)
    s, t = points * n - cell
    below = s >= t
    middle = np.where(below, number[cell[0] + 1, cell[1]], number[cell[0], cell[1] + 1])
    vertices = np.stack([number[cell[0], cell[1]], middle, number[cell[0] + 1, cell[1] + 1]])
    return vertices, np.stack([1 - np.maximum(s, t), np.abs(s - t), np.minimum(s, t)])


def matrix_on_square(mesh, n, eps, m, rays, nodes):
    """``K = 2 c int int (J / r) (rise . e) (rise . e)^T`` of the linear law with ``f' = 1`` and J = 1."""
    number = np.zeros((n + 1, n + 1), dtype=int)
    number[tuple(np.rint(mesh.p * n).astype(int))] = np.arange(mesh.p.shape[1])
    inner, share = _split(m)
    gauss, weight = np.polynomial.legendre.leggauss(nodes)
    turn = 2 * np.pi * (np.arange(rays) + 0.5) / rays
    e = np.stack([np.cos(turn), np.sin(turn)])
    K = np.zeros((2 * mesh.p.shape[1],) * 2)
    for corner in mesh.p[:, mesh.t].transpose(2, 0, 1):
        sides = corner[:, 1:] - corner[:, :1]
        x = corner[:, :1] + sides @ inner.T
        room = np.where(e[:, None] > 0, 1 - x[:, :, None], x[:, :, None]) / np.abs(e[:, None])
        reach = np.minimum(eps, room.min(axis=0))
        r = reach[..., None] * 0.5 * (1 + gauss)
        there = np.clip(x[:, :, None, None] + r * e[:, None, :, None], 0, 1).reshape(2, -1)
        here = np.broadcast_to(x[:, :, None, None], (2, *r.shape)).reshape(2, -1)
        (far, up), (near, down) = _hats(n, number, there), _hats(n, number, here)
        vertices, values = np.concatenate([far, near]), np.concatenate([up, -down])
        along = np.broadcast_to(e[:, None, :, None], (2, *r.shape)).reshape(2, -1)
        columns = np.concatenate([2 * vertices + k for k in range(2)])
        rise = csr_matrix(
            (np.concatenate([values * a for a in along]).T.ravel(), columns.T.ravel(), np.arange(r.size + 1) * 12),
            shape=(r.size, K.shape[0]),
        )
        area = 0.5 * abs(np.linalg.det(sides))
        measure = (area * share)[:, None, None] * reach[..., None] * 0.5 * weight * (2 * np.pi / rays)
        K += (rise.T @ rise.multiply(measure.reshape(-1, 1))).toarray()
    return K * 2 / (np.pi * eps**3)
