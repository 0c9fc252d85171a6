"""What a Poisson ratio other than that of bonds alone costs: forces on the same bonds, with and without, in turn.

python docs/benchmarks/dilatation.py [--repeat 15]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import skfem

from skfem_peridynamics import BallRule, BondBasis, Material, PairRule, Peridynamics
from skfem_peridynamics.bonds.rule import Rule
from skfem_peridynamics.model.space import vector_basis


def bodies(dim: int, n: int, threads: int, rule: Rule) -> tuple[Peridynamics, Peridynamics]:
    """The same bonds with lambda = mu, and with another ratio."""
    axis = np.linspace(0.0, 1.0, n + 1)
    mesh = (skfem.MeshTri if dim == 2 else skfem.MeshTet).init_tensor(*[axis] * dim)
    bonds = BondBasis(vector_basis(mesh), 4.0 / n, rule=rule)
    plane = "stress" if dim == 2 else None
    alone, other = (
        Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane=plane, poisson=nu) for nu in (None, 0.22)
    )
    return Peridynamics(bonds, alone, threads=threads), Peridynamics(bonds, other, threads=threads)


def main() -> None:
    """Print the medians and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=15)
    options = parser.parse_args()
    print("| body | bonds | threads | force, ms | with dilatation, ms | ratio |\n|---|---|---|---|---|---|")
    for dim, n, rule in ((2, 150, PairRule()), (3, 28, PairRule()), (2, 100, BallRule(3, 8)), (3, 12, BallRule(3, 13))):
        for threads in (1, 2):
            pair = bodies(dim, n, threads, rule)
            u = 1e-3 * np.random.default_rng(0).standard_normal(pair[0].basis.N) / n
            for body in pair:
                body.force(u)
            times: list[list[float]] = [[], []]
            for _ in range(options.repeat):
                for body, record in zip(pair, times, strict=True):
                    start = time.perf_counter()
                    body.force(u)
                    record.append(1e3 * (time.perf_counter() - start))
            alone, other = (float(np.median(record)) for record in times)
            ratio = float(np.median(np.array(times[1]) / np.array(times[0])))
            where = f"{dim}D, {n}^{dim}, {rule.name.split(',')[0]} | {pair[0].bonds.nbonds:,}"
            print(f"| {where} | {threads} | {alone:.2f} | {other:.2f} | {ratio:.2f} |")


if __name__ == "__main__":
    main()
