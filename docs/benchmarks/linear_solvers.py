"""Which preconditioner an implicit step should have: seconds and products of each, on bodies that differ.

    python docs/benchmarks/linear_solvers.py [--large]

Each line is one linear body, loaded at once and at rest before: one implicit step of so many times the stable explicit
one, or one equilibrium ("static"). Seconds are those of the whole step with what it has to make first, and of a second
step, which has it already.
"""

import sys
import time

import numpy as np
import skfem

import skfem_peridynamics as peri
from skfem_peridynamics.solve.newton import Effort


def square(n, dim):
    grid = np.linspace(0.0, 1.0, n + 1)
    mesh = skfem.MeshTri.init_tensor(grid, grid) if dim == 2 else skfem.MeshTet.init_tensor(grid, grid, grid)
    stiff = np.flatnonzero((np.floor(4 * mesh.p[:, mesh.t].mean(axis=1)).sum(axis=0) % 2) == 1)
    return mesh.with_subdomains({"stiff": stiff})


def main():
    large = "--large" in sys.argv
    print(f"{'body':<10}{'unknowns':>9}{'contrast':>9}{'step':>9}{'by':>8}{'first s':>9}{'next s':>9}{'products':>10}")
    sizes = ((2, (20, 40, 80, 160)), (3, (6, 10, 16)))
    for dim, ns in ((2, (*sizes[0][1], 320)), (3, (*sizes[1][1], 24))) if large else sizes:
        for n in ns:
            mesh = square(n, dim)
            basis = skfem.Basis(mesh, skfem.ElementVector((skfem.ElementTriP1, skfem.ElementTetP1)[dim - 2]()))
            bonds = peri.BondBasis(basis, horizon=(4.0 if dim == 2 else 2.0) / n)
            for contrast in (1.0, 1e6):
                soft = peri.Material.from_elastic(
                    lame=1.0, density=1.0, plane="strain" if dim == 2 else None, potential="linear"
                )
                body = peri.Peridynamics(bonds, peri.Composite(soft, {"stiff": soft.with_(lame=contrast)}))
                M = peri.mass_matrix(basis)
                limit = peri.stable_time_step(body, M).dt
                b = M.diagonal() * np.tile(np.eye(dim)[0], mesh.nvertices)
                left = np.flatnonzero(mesh.p[0] < 3.0 / n)
                held = peri.Prescribed((left[:, None] * dim + np.arange(dim)).ravel(), displacement=0.0)
                for factor in (10.0, 100.0, 1000.0, np.inf):
                    for kind in ("blocks", "amg", "direct"):
                        if kind == "direct" and (60_000 if dim == 2 else 8_000) < basis.N:
                            continue
                        effort, seconds, begin = Effort(), [], time.perf_counter()
                        options = {"load": lambda t, b=b: t * b, "fixed": [held], "linear": kind, "effort": effort}
                        if np.isinf(factor):
                            run = peri.static(body, steps=2, **options)
                        else:
                            dt = factor * limit
                            run = peri.newmark(body, M, dt=dt, until=2 * dt, **options)
                        try:
                            for _ in run:
                                seconds.append(time.perf_counter() - begin)
                                begin = time.perf_counter()
                        except peri.NotConverged as error:
                            print(
                                f"{dim}D {n:<7}{basis.N:>9}{contrast:>9.0e}{factor:>9.0f}{kind:>8}  {str(error)[:60]}"
                            )
                            continue
                        print(
                            f"{dim}D {n:<7}{basis.N:>9}{contrast:>9.0e}{factor:>9.0f}{kind:>8}"
                            f"{sum(seconds[:2]):>9.3f}{seconds[2]:>9.3f}{effort.products:>10}",
                            flush=True,
                        )


if __name__ == "__main__":
    main()
