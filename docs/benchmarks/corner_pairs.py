"""Corner pairs beside all vertex pairs, both balanced: bonds, a force, the error of a smooth motion, its rate.

python docs/benchmarks/corner_pairs.py [--kinds random regular graded] [--counts 32 64 96] [--space]
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import skfem_peridynamics as peri
from skfem_peridynamics.geometry.boxes import unit_box
from skfem_peridynamics.model.discretisation import Discretisation
from skfem_peridynamics.study.catalogue import law_of
from skfem_peridynamics.study.manufactured import Manufactured
from skfem_peridynamics.study.measure import prepare

# horizon, divisions, and steps of so much of the limit over the divisions: the error of the time step stays behind
PLANE, SPACE = (2, 0.125, [32, 64, 96], 6.0), (3, 0.25, [12, 16, 24], 5.0)


def seconds(act, times: int = 15) -> list[float]:
    taken = []
    for _ in range(times):
        begin = time.perf_counter()
        act()
        taken.append(time.perf_counter() - begin)
    return taken


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kinds", nargs="+", default=["random", "regular", "graded"])
    parser.add_argument("--counts", nargs="+", type=int)
    parser.add_argument("--space", action="store_true", help="in three dimensions")
    options = parser.parse_args()
    dim, horizon, counts, part = SPACE if options.space else PLANE
    tables = {"order": 6, "table": 6} if options.space else {"table": 12}
    problem = Manufactured(dim, horizon, law_of(dim, horizon), None, **tables)
    print("mesh, eps/h, rule, bonds a vertex, force in ms, of all, set-up in forces, L2, H1, limit")
    for kind in options.kinds:
        for n in options.counts or counts:
            mesh = unit_box(dim, n, kind)
            rules = peri.PairRule(), peri.CornerRule()
            setups = [prepare(problem, mesh, Discretisation(rule, balanced=True)) for rule in rules]
            u = np.random.default_rng(0).standard_normal(setups[0].basis.N) * 1e-4
            for setup in setups:
                setup.body.force(u)
            # in turn, so that both meet the same moments of the machine
            pairs = [[seconds(lambda s=setup: s.body.force(u), 1)[0] for setup in setups] for _ in range(25)]
            forces = np.median(pairs, axis=0)
            for setup, force in zip(setups, forces, strict=True):
                bonds = setup.body.bonds
                state, _, _ = setup.run(part / n * setup.limit.dt)
                l2, h1 = problem.errors(mesh, state.u, state.t)
                print(
                    f"{kind:8s} {horizon * n:5.1f}  {bonds.rule.name:27s} {bonds.nbonds / mesh.nvertices:14.0f} "
                    f"{1e3 * force:10.2f} {force / forces[0]:7.2f} {setup.seconds / force:15.0f}  {l2:.2e} {h1:.2e} "
                    f"{setup.limit.dt:.4f}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
