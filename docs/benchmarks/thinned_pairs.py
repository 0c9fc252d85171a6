"""Tried and set aside: vertex pairs thinned at random to so many a vertex, then balanced (error_against_run_time.md).

    python docs/benchmarks/thinned_pairs.py

Prints errors on the study's motion in 2D beside those of all pairs. About a minute.
"""

from dataclasses import dataclass

import numpy as np

from skfem_peridynamics import PairRule
from skfem_peridynamics.geometry.boxes import unit_box
from skfem_peridynamics.model.discretisation import Discretisation
from skfem_peridynamics.study.catalogue import STUDIES
from skfem_peridynamics.study.measure import measure, time_constant


@dataclass(frozen=True)
class ThinnedPairs(PairRule):
    """Keep a pair with a probability that leaves about ``keep`` a vertex, all pairs nearer than two mesh sizes."""

    keep: float = 30.0

    @property
    def name(self):
        return f"pairs thinned to {self.keep:g}"

    def _chunks(self, mesh, samples, horizon):
        random = np.random.default_rng(0)
        for ends, weight in super()._chunks(mesh, samples, horizon):
            i, j = ends.T
            r = np.linalg.norm(mesh.p.T[samples.vertices[i, 0]] - mesh.p.T[samples.vertices[j, 0]], axis=1)
            h = 0.5 * (samples.size[i] + samples.size[j])
            share = np.minimum(1.0, self.keep / (0.5 * np.pi * (horizon / h + 0.5) ** 2))
            share = np.where(r < 2.0 * h, 1.0, share)
            kept = random.random(len(r)) < share
            yield ends[kept], weight[kept] / share[kept]


if __name__ == "__main__":
    motion = STUDIES["smooth-2d"].race.motion()
    constant = time_constant(motion)
    for kind in ("regular", "random"):
        for rule, n in ((PairRule(), 32), (PairRule(), 64), (ThinnedPairs(), 64), (ThinnedPairs(keep=45.0), 64)):
            row = measure(motion, "", kind, unit_box(2, n, kind), n, Discretisation(rule, balanced=True), constant)
            each = row.bonds / row.nodes
            print(
                f"{kind}, {row.scheme}, eps/h = {row.per_horizon:g}, {each:.0f} a vertex: {row.error_l2:.1e}",
                flush=True,
            )
