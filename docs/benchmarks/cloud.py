"""Balls whose far ends are snapped to a cloud, tried: the Gauss points of the elements, and bonds are pairs of it.

python docs/benchmarks/cloud.py [--counts 32 64] [--kinds random regular]

From each Gauss point half a ball of directions, turned from point to point; the end of each bond is the nearest Gauss
point of its element; balanced as balls are, with the consistent mass. Printed beside the ball rule of the same counts.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

import skfem_peridynamics as peri
from skfem_peridynamics.bonds.pair_bonds import PairBonds
from skfem_peridynamics.bonds.quadrature import half_sphere, radial_rule, turns
from skfem_peridynamics.bonds.rule import Part
from skfem_peridynamics.bonds.samples import Samples, gauss_samples
from skfem_peridynamics.geometry.boxes import unit_box
from skfem_peridynamics.geometry.rays import Tracer
from skfem_peridynamics.model.discretisation import Discretisation
from skfem_peridynamics.study.catalogue import law_of
from skfem_peridynamics.study.manufactured import Manufactured
from skfem_peridynamics.study.measure import prepare

HORIZON = 0.125


@dataclass(frozen=True)
class Cloud:
    """The rule that is tried, for triangles and the constant influence function."""

    radial: int
    angular: int
    symmetric: bool = True
    holds_influence: bool = True

    @property
    def name(self) -> str:
        return f"cloud {self.radial} x {self.angular}"

    def samples(self, mesh) -> Samples:
        return gauss_samples(mesh, with_vertices=False, order=2)

    def estimate(self, mesh, horizon: float) -> int:
        return self.radial * self.angular * self.samples(mesh).nsamples

    def parts(self, mesh, samples: Samples, horizon: float, influence) -> list[Part]:
        n, (e, angle) = samples.nsamples, half_sphere(2, self.angular)
        nodes, W = radial_rule(np.ones_like, 2, self.radial)
        way = np.einsum("nij,kj->nki", turns(2, np.arange(n), 2 * len(e)), e).reshape(-1, 2)
        x, site = np.repeat(samples.points, len(e), axis=0), np.repeat(np.arange(n), len(e))
        rays = Tracer(mesh).march(x, np.repeat(samples.element, len(e)), way, horizon, nodes)
        full = 2.0 * samples.volume[site] * np.tile(angle, n) * rays.reach**2
        of_element = np.argsort(samples.element, kind="stable").reshape(mesh.nelements, -1)
        near, far, weight = [], [], []
        for k, (s, w) in enumerate(zip(nodes, W, strict=True)):
            choice = of_element[rays.element[:, k]]
            y = x + (rays.reach * s)[:, None] * way
            gap = np.linalg.norm(samples.points[choice] - y[:, None], axis=2)
            near.append(site)
            far.append(choice[np.arange(len(y)), gap.argmin(axis=1)])
            weight.append(full * w / s)
        i, j, weight = np.concatenate(near), np.concatenate(far), np.concatenate(weight)
        keep = (i != j) & (weight > 0.0)
        i, j, weight = i[keep], j[keep], weight[keep]
        key, place = np.unique(np.minimum(i, j) * n + np.maximum(i, j), return_inverse=True)
        i, j = key // n, (key % n).astype(np.int32)
        start = np.searchsorted(i, np.arange(n + 1))
        return [PairBonds(samples, 0, n, 0, start, j, 0.0, np.bincount(place, weight))]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--counts", nargs="+", type=int, default=[32, 64])
    parser.add_argument("--kinds", nargs="+", default=["random", "regular"])
    options = parser.parse_args()
    problem = Manufactured(2, HORIZON, law_of(2, HORIZON), None, table=12)
    print("mesh, eps/h, rule, bonds, force in ms, L2, H1")
    for kind in options.kinds:
        for n in options.counts:
            mesh = unit_box(2, n, kind)
            for counts in ((3, 8), (3, 12), (5, 16)):
                rules = peri.BallRule(*counts), Cloud(*counts)
                setups = [prepare(problem, mesh, Discretisation(r, balanced=True, mass="consistent")) for r in rules]
                u = 1e-4 * np.random.default_rng(0).standard_normal(setups[0].basis.N)
                taken: list[list[float]] = [[], []]
                for _ in range(12):  # in turn
                    for setup, row in zip(setups, taken, strict=True):
                        begin = time.perf_counter()
                        setup.body.force(u)
                        row.append(time.perf_counter() - begin)
                for setup, row in zip(setups, taken, strict=True):
                    state, _, _ = setup.run(6.0 / n * setup.limit.dt)
                    l2, h1 = problem.errors(mesh, state.u, state.t)
                    bonds = setup.body.bonds
                    print(
                        f"{kind:8s} {HORIZON * n:4.1f}  {bonds.rule.name.split(',')[0]:14s} {bonds.nbonds:8d} "
                        f"{1e3 * np.median(row[2:]):7.1f}  {l2:.2e} {h1:.2e}",
                        flush=True,
                    )


if __name__ == "__main__":
    main()
