"""A double integral of one's own in a plain scikit-fem script: a strip of two materials, pulled.

The package knows one material. Here the stiffness of a bond is the harmonic mean of those at its two ends, written as
an ordinary ``@BilinearForm``: displacements come in pairs, at x and at y, and ``w`` holds ``x, y, xi, r``. Assembly,
the clamped end and the solution are scikit-fem's own.

python examples/own_form.py
"""

import time

import numpy as np
import skfem
from skfem.helpers import dot

import skfem_peridynamics as peri

HORIZON, WIDTH, PULL = 0.04, 0.2, 1.0
SOFT, STIFF = 1.0, 4.0  # Lame constants lambda = mu, left and right of x = 1/2


def lame(x):
    return np.where(x[0] < 0.5, SOFT, STIFF)


@skfem.BilinearForm
def two_materials(u1, u2, v1, v2, w):
    mean = 2 * lame(w.x) * lame(w.y) / (lame(w.x) + lame(w.y))
    slope = mean / (1 / 2 * 1 / 3)  # f'(0) = lambda (d + 2) / (2 M_d), M_2 = 1/3
    c = 1 / (HORIZON**3 * np.pi)
    return 2 * c * slope * dot(u2 - u1, w.xi) * dot(v2 - v1, w.xi) / w.r**3


def main(per_horizon: int = 4) -> dict[str, float]:
    begin = time.perf_counter()
    h = HORIZON / per_horizon
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, round(1 / h) + 1), np.linspace(0, WIDTH, round(WIDTH / h) + 1))
    mesh = mesh.with_defaults()
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    bonds = peri.BondBasis(basis, HORIZON, rule=peri.BallRule(radial=3, angular=8, outer="vertices"))

    K = skfem.asm(two_materials, bonds)
    b = peri.layer_traction(basis, "right", [PULL, 0.0], width=HORIZON)
    clamped = peri.collar(mesh, "left", HORIZON)
    u = skfem.solve(*skfem.condense(K, b, D=np.concatenate([2 * clamped, 2 * clamped + 1]))).reshape(-1, 2)

    def strain(low: float, high: float) -> float:
        start, end = (u[np.abs(mesh.p[0] - x) < 0.01 * h, 0].mean() for x in (low, high))
        return (end - start) / (high - low)

    # a free strip of a plane body with nu = 1/3: E = 8/3 lambda. Bonds that end at its edges are missing, so it is
    # a little softer than that, by about one horizon over the width
    soft, stiff = strain(0.2, 0.4) * 8 / 3 * SOFT / PULL, strain(0.6, 0.8) * 8 / 3 * STIFF / PULL
    return {
        "strain of the soft half over elastic": soft,
        "strain of the stiff half over elastic": stiff,
        "bonds": bonds.nbonds,
        "seconds": time.perf_counter() - begin,
    }


if __name__ == "__main__":
    for name, value in main().items():
        print(f"{name:>38}  {value:.6g}")
