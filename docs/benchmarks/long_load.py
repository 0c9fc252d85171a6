"""Ten minutes of twelve million bonds with frames and checkpoints on: memory, seconds a step, what checkpoints cost.

    python docs/benchmarks/long_load.py [--minutes 10] [--divisions 52]

prints a line for each minute and, at the end, growth after the first minute and the share of the checkpoints.
"""

import argparse
import os
import statistics
import tempfile
import time
from dataclasses import replace
from itertools import pairwise

import skfem_peridynamics as peri
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.run.progress import Silent

SCENE = """
title = "load"
mesh = {{ box = [[0, 1], [0, 1], [0, 1]], divisions = [{n}, {n}, {n}] }}
material = {{ young = 1.0, toughness = 1e-4, density = 1.0 }}
bonds = {{ horizon = {horizon} }}
fixed = [{{ on = "left", displacement = 0 }}, {{ on = "right", component = "x", velocity = "1e-4 * sin(t / 5)" }}]
time = {{ until = 1.0 }}
output = {{ frames = 10, history = 200, pictures = false, checkpoint_every = "10 s" }}
"""


class Meter(Silent):
    """Resident memory and the time of each step."""

    def __init__(self) -> None:
        self.page, self.times, self.memory = os.sysconf("SC_PAGE_SIZE"), [], []

    def advance(self, step, energy=None, largest_Z=None):
        self.times.append(time.monotonic())
        with open("/proc/self/statm") as table:
            self.memory.append(int(table.read().split()[1]) * self.page / 1e6)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--divisions", type=int, default=52)
    given = parser.parse_args()
    scene = peri.Scene.parse(SCENE.format(n=given.divisions, horizon=3.05 / given.divisions))
    problem = Problem(scene)
    limit, force, u = problem.limit, problem.body.force, problem.mesh.p.T.ravel() * 0.0
    force(u)
    begin = time.monotonic()
    for _ in range(10):
        force(u)
    step = (time.monotonic() - begin) / 10.0
    steps = round(60.0 * given.minutes / (1.15 * step))
    print(f"{problem.mesh.nvertices} vertices, {problem.bonds.nbonds} bonds, {steps} steps of {1e3 * step:.1f} ms")
    scene = replace(scene, time=replace(scene.time, until=steps * 0.9 * limit.dt))
    del problem, force
    meter = Meter()
    with tempfile.TemporaryDirectory() as folder:
        summary = peri.run(scene, folder, meter)
    first, gaps = meter.times[0], [b - a for a, b in pairwise(meter.times)]
    minutes: dict[int, list[int]] = {}
    for k, t in enumerate(meter.times[1:]):
        minutes.setdefault(int((t - first) // 60.0), []).append(k)
    print("minute  ms a step (median)  largest MB")
    for minute, some in minutes.items():
        median = 1e3 * statistics.median(gaps[k] for k in some)
        print(f"{minute:6}  {median:18.2f}  {max(meter.memory[k + 1] for k in some):10.1f}")
    whole = [some for some in minutes.values() if len(some) > 10]
    most = [max(meter.memory[k + 1] for k in some) for some in whole]
    seconds = summary["seconds"]
    spent = sum(seconds.values())
    print(f"growth after the first minute: {most[-1] - most[min(1, len(most) - 1)]:.1f} MB of {max(most):.0f} MB")
    print(f"checkpoints: {100.0 * seconds['checkpoints'] / spent:.2f} % of {spent:.0f} s")
    print(f"energy drift {summary['energy_drift']:.1e}")


if __name__ == "__main__":
    main()
