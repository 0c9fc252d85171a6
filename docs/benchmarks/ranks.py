"""A body over one and two processes: seconds of a force, in turn, and memory a rank.

python docs/benchmarks/ranks.py [--divisions 300] [--turns 7]      with the extra mpi, on an idle machine

Strong: the same plate; weak: twice the plate over twice the processes. Each process has one thread. What is printed is
the median of the ratios of neighbours in time; memory is that of mesh, bonds and vectors, above what libraries take.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

EPS = 4.0  # vertices per horizon


def child(width: int, height: int, overlap: bool) -> None:
    import skfem

    import skfem_peridynamics as peri
    from skfem_peridynamics._memory import resident_memory
    from skfem_peridynamics.ranks.distributed import distributed
    from skfem_peridynamics.ranks.world import world

    comm = world()
    material = peri.Material.from_elastic(young=1.0, toughness=1e-3, density=1.0, plane="stress")
    small = skfem.MeshTri.init_tensor(np.linspace(0, 1, 9), np.linspace(0, 1, 9))
    warm = distributed(small, 0.3, material, threads=1)
    warm.force(np.zeros(warm.share.own * 2))
    warm.close()
    before = resident_memory()
    axes = np.linspace(0, width / height, width + 1), np.linspace(0, 1, height + 1)
    body = distributed(
        skfem.MeshTri.init_tensor(*axes) if comm.rank == 0 else None, EPS / height, material, threads=1, overlap=overlap
    )
    u = 1e-4 * np.random.default_rng(comm.rank).standard_normal(body.share.own * 2)
    body.force(u)
    taken = []
    for _ in range(15):
        comm.Barrier()
        begin = time.perf_counter()
        body.force(u)
        taken.append(time.perf_counter() - begin)
    slowest = max(comm.allgather(float(np.median(taken))))
    memory = comm.allgather(resident_memory() - before)
    bonds = comm.allgather(body.nbonds)
    body.close()
    if comm.rank == 0:
        print(json.dumps({"seconds": slowest, "memory": memory, "bonds": bonds}))


def measured(ranks: int, width: int, height: int, overlap: bool = False) -> dict:
    beside = Path(sys.executable).with_name("mpiexec")
    launcher = str(beside) if beside.exists() else shutil.which("mpiexec")
    command = [
        launcher,
        "-n",
        str(ranks),
        sys.executable,
        __file__,
        "--child",
        str(width),
        str(height),
        str(int(overlap)),
    ]
    environment = os.environ | {"OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return json.loads(done.stdout.splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--divisions", type=int, default=300)
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--child", nargs=3, type=int)
    options = parser.parse_args()
    if options.child:
        width, height, overlap = options.child
        child(width, height, bool(overlap))
        return
    n = options.divisions
    found: dict[str, list[float]] = {}
    for _ in range(options.turns):
        one = measured(1, n, n)
        for name, overlap in (("", False), (", overlapped", True)):
            two, twice = measured(2, n, n, overlap), measured(2, 2 * n, n, overlap)
            found.setdefault(f"strong efficiency{name}", []).append(one["seconds"] / (2.0 * two["seconds"]))
            found.setdefault(f"weak efficiency{name}", []).append(one["seconds"] / twice["seconds"])
            if not overlap:
                plain = two
    load = os.getloadavg()[0]
    print(f"{n}^2 plate, {sum(one['bonds'])} bonds; load of the machine {load:.1f}")
    for name, ratios in sorted(found.items()):
        print(f"{name}: {np.median(ratios):.3f} (from {min(ratios):.3f} to {max(ratios):.3f})")
    two = plain
    shares = [f"{x / one['memory'][0]:.2f}" for x in two["memory"]]
    print(f"memory {one['memory'][0] / 1e6:.0f} MB of one rank; of two, as parts of that: {', '.join(shares)}")
    print(f"bonds of two ranks: {two['bonds'][0]} and {two['bonds'][1]}")


if __name__ == "__main__":
    main()
