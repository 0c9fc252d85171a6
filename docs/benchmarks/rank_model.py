"""What a step would cost on many cores: constants measured here, a network that is assumed, and the sum of both.

python docs/benchmarks/rank_model.py [--bonds 1e9] [--horizon 3] [--threads 8]          with the extra fast

Measured on one core: seconds a bond of vertex pairs in 3D, seconds a vertex of a step's vectors, seconds of a step
without either. Assumed: cubes of vertices, a rank of some threads each, that share out its bonds; nodes of 64 cores
with 25 GB/s between them, shared by the ranks of a node; 2 us a message, 26 neighbours, ghosts out and sums back; bonds
5 % more than their share on the slowest rank; an exchange is waited for. All ghosts of a rank's mesh are exchanged: the
horizon, a vertex and the longest edge.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import skfem

import skfem_peridynamics as peri

NODE, BANDWIDTH, LATENCY, NEIGHBOURS, IMBALANCE = 64, 25e9, 2e-6, 26, 1.05
CORES = (64, 256, 1024, 4096, 10240)


def seconds(work, turns: int = 9) -> float:
    work()
    taken = []
    for _ in range(turns):
        begin = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def measured(horizon: float) -> tuple[float, float, float, float]:
    """Seconds of a bond, of a vertex, of a step; bonds of a vertex."""

    def body(n: int) -> tuple[peri.Peridynamics, np.ndarray]:
        axis = np.linspace(0.0, 1.0, n + 1)
        mesh = skfem.MeshTet.init_tensor(axis, axis, axis)
        basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTetP1()))
        stone = peri.Material.from_elastic(young=1.0, toughness=1e-3, density=1.0)
        made = peri.Peridynamics(peri.BondBasis(basis, 1.005 * horizon / n), stone, threads=1)
        return made, peri.mass_matrix(basis).diagonal()

    class Loose:
        """A body without bonds: what is left of a step are its vectors."""

        def __init__(self, size: int) -> None:
            self.rest = np.zeros(size)

        def force(self, u: np.ndarray) -> np.ndarray:
            return self.rest

    def step(one: object, m: np.ndarray) -> float:
        states = peri.central_difference(one, m, dt=1e-9, until=1.0, watch=0)
        next(states)
        return seconds(lambda: next(states), 25)

    large, small = body(40), body(int(horizon) + 1)
    u = 1e-5 * np.random.default_rng(0).standard_normal(large[0].basis.N)
    force, nvertices = seconds(lambda: large[0].force(u)), large[0].bonds.mesh.nvertices
    fixed, vectors = step(*small), step(Loose(len(large[1])), large[1])
    bonds = large[0].bonds.nbonds
    inner = 2.0 * bonds / nvertices
    return force / bonds, vectors / nvertices, fixed, inner


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bonds", type=float, default=1e9)
    parser.add_argument("--horizon", type=float, default=3.0, help="vertices per horizon")
    parser.add_argument("--threads", type=int, default=8, help="cores of a rank")
    options = parser.parse_args()
    bond, vertex, fixed, degree = measured(options.horizon)
    nvertices = 2.0 * options.bonds / degree
    layers = options.horizon + 1.0 + np.sqrt(3.0)
    print(f"measured: {bond * 1e9:.2f} ns a bond, {vertex * 1e9:.1f} ns a vertex, {fixed * 1e6:.0f} us a step")
    print(
        f"{options.bonds:.3g} bonds, {nvertices:.3g} vertices, {3 * nvertices:.3g} unknowns, {degree:.0f} ends a vertex"
    )
    print("cores  ranks  ghosts a vertex  ms a step  bonds  vectors  exchange  fixed  efficiency")
    for cores in CORES:
        ranks = cores / options.threads
        own = nvertices / ranks
        ghosts = (own ** (1 / 3) + 2.0 * layers) ** 3 - own
        work = IMBALANCE * bond * options.bonds / cores
        vectors = vertex * own  # by one thread
        per_rank = BANDWIDTH / (NODE / options.threads)
        way = NEIGHBOURS * LATENCY + 24.0 * ghosts / per_rank
        exchange = 2.0 * way
        step = work + vectors + exchange + fixed
        ideal = (bond * options.bonds + vertex * nvertices) / cores
        print(
            f"{cores:5d}  {ranks:5.0f}  {ghosts / own:15.2f}  {step * 1e3:9.2f}  {work / step:5.0%}  "
            f"{vectors / step:7.0%}  {exchange / step:8.0%}  {fixed / step:5.0%}  {ideal / step:10.0%}"
        )


if __name__ == "__main__":
    main()
