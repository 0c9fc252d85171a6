"""What balancing costs beside a force on the same bonds, with the same threads, and what memory it takes meanwhile.

python docs/benchmarks/balancing.py [--large]       vertex pairs of a square of 64^2 and a cube of 16^3; a cube of 50^3
"""

from __future__ import annotations

import argparse
import threading
import time

import numpy as np

import skfem_peridynamics as peri
from skfem_peridynamics._memory import resident_memory
from skfem_peridynamics.bonds.facet_targets import facet_targets
from skfem_peridynamics.geometry.boxes import unit_box
from skfem_peridynamics.model.space import vector_basis


class Highest:
    """The largest resident memory while it lasts, above that at its begin."""

    def __enter__(self) -> Highest:
        self.begin = self.most = resident_memory()
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self._watch)
        self.thread.start()
        return self

    def _watch(self) -> None:
        while not self.ended.wait(0.005):
            self.most = max(self.most, resident_memory())

    def __exit__(self, *error: object) -> None:
        self.ended.set()
        self.thread.join()


def seconds(act, times: int) -> float:
    act()
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        act()
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--large", action="store_true")
    cases = [(2, 64, 8.0), (2, 64, 4.0), (3, 16, 3.0)]
    if parser.parse_args().large:
        cases = [(3, 50, 3.0)]
    peri.BondBasis(vector_basis(unit_box(3, 5, "random")), 0.5).balanced(exact=True)  # compiled by now
    print("dim mesh   half bonds  force ms  targets  balanced  exact (forces)  seconds  bytes a half bond")
    for dim, n, per_horizon in cases:
        for kind in ("random", "regular"):
            bonds = peri.BondBasis(vector_basis(unit_box(dim, n, kind)), per_horizon / n)
            body = peri.Peridynamics(bonds, peri.Linear(1.0))
            u = np.random.default_rng(0).standard_normal(body.basis.N)
            force = seconds(lambda body=body, u=u: body.force(u), 9)
            times = 5 if bonds.nbonds < 1e6 else 1
            targets = seconds(lambda bonds=bonds: facet_targets(bonds, dim == 2), times)
            with Highest() as memory:
                balanced = seconds(bonds.balanced, times)
            exact = seconds(lambda bonds=bonds: bonds.balanced(exact=True), times)
            print(
                f"{dim}   {n:3d} {kind:8s} {bonds.nbonds:9d}  {1e3 * force:8.2f} {targets / force:8.0f} "
                f"{balanced / force:9.0f} {exact / force:6.0f} {'':8s} {balanced:8.3f} "
                f"{(memory.most - memory.begin) / bonds.nbonds:8.0f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
