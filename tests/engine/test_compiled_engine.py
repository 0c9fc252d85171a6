"""Compiled loops against SciPy's sparse products, which share no code with them beyond the bond list."""

import math
import multiprocessing
import os
import shutil
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import skfem

import skfem_peridynamics as peri
from bodies import body_on, box, grid
from skfem_peridynamics import (
    BallRule,
    Exponential,
    Linear,
    PairRule,
    Rational,
    Scalars,
    _compile,
    damage,
    own_potential,
    slit,
)
from skfem_peridynamics.engine.law_loops import exponential, inverse_root
from skfem_peridynamics.engine.sparse_engine import SparseEngine

RULES = {
    1: [PairRule(), PairRule(False), PairRule(points="gauss"), BallRule(2, 4), BallRule(3, 4, "vertices")],
    2: [PairRule(), PairRule(False), PairRule(points="gauss"), BallRule(), BallRule(200), BallRule(3, 8, "vertices")],
    3: [PairRule(), PairRule(False), PairRule(points="gauss"), BallRule(2, 13), BallRule(3, 20, "vertices")],
}  # fmt: skip
ONE_SIDED = [BallRule(2, 4, symmetric=False), BallRule(3, 6, "vertices", symmetric=False)]
SIZE = {1: (20, 0.2), 2: (6, 0.4), 3: (4, 0.6)}
LAWS = [Exponential(2.0, 0.5), Rational(2.0, 0.5), Linear(2.0)]


def close(a, b):
    return np.abs(a - b).max() <= 1e-12 * np.abs(b).max()


def compare(body, seed=0):
    """All operators of both engines; the least and the most that can be kept in memory."""
    rng = np.random.default_rng(seed)
    u, v = 0.05 * rng.standard_normal((2, body.basis.N))
    sparse = body.with_(compiled=False)
    assert isinstance(sparse.engine, SparseEngine)
    for memory in (0.0, 4e9):
        fast = body.with_(compiled=True, matrix_memory=memory)
        assert not isinstance(fast.engine, SparseEngine)
        assert close(fast.force(u), sparse.force(u))
        assert fast.energy(u) == pytest.approx(sparse.energy(u), rel=1e-12)
        for name, more in (("stiffness_operator", ()), ("tangent_operator", (u,))):
            one, other = (getattr(b, name)(*more) for b in (fast, sparse))
            assert close(one @ v, other @ v), name
            assert close(one.rmatvec(v), other.rmatvec(v)), name
        assert close(damage(fast, u).Z, damage(sparse, u).Z)
        assert damage(fast, 9 * u).softened == damage(sparse, 9 * u).softened


@pytest.mark.parametrize("dim", [1, 2, pytest.param(3, marks=pytest.mark.slow)])
def test_every_rule_law_and_weight(dim):
    n, eps = SIZE[dim]
    for k, rule in enumerate(RULES[dim] + ONE_SIDED * (dim < 3)):
        mesh = box(dim, n, ("random", "graded", "structured")[k % 3])
        body = body_on(mesh, eps, LAWS[k % 3], rule=rule)
        compare(body, k)
        compare(body_on(mesh, eps, LAWS[(k + 1) % 3], "conical", rule=rule, no_fail=np.arange(4)))
        compare(body_on(mesh, eps, LAWS[(k + 2) % 3], rule=rule, boundary_function="smooth", no_fail=[0]))
        if rule.symmetric and dim < 3 and not (isinstance(rule, BallRule) and (rule.radial or 0) > 5):
            compare(body.with_(bonds=body.bonds.balanced(), no_fail=np.arange(3)))


def test_rows_longer_than_a_batch():
    """Every vertex sees every other: rows of up to 840 bonds, batches of 512."""
    compare(body_on(grid((1, 28), (1, 28)), 2.0, Exponential(1.0, 0.3)))


def test_slit_bodies_and_bodies_of_one_element():
    mesh = slit(grid((1, 8), (1, 8)), peri.Crack([[0.5, 0.0], [0.5, 0.5]]))
    for rule in (PairRule(), BallRule(3, 8)):
        compare(body_on(mesh, 0.3, Exponential(1.0, 0.1), rule=rule))
    compare(body_on(skfem.MeshTri(), 2.0, Exponential(1.0, 0.1)))


def test_pulled_apart_and_moved_bodies_feel_nothing():
    """Exactly: differences come before products."""
    mesh = slit(grid((1, 8), (1, 8)), peri.Crack([[0.5, 0.0], [0.5, 1.0]]))
    for rule in (PairRule(), BallRule(3, 8), BallRule(3, 16, "vertices")):
        body = body_on(mesh, 0.3, Exponential(1.0, 0.1), rule=rule, compiled=True)
        right = mesh.p[0] > 0.5
        on_cut = np.flatnonzero(mesh.p[0] == 0.5)
        centre = mesh.p[0, mesh.t].mean(axis=0)
        for vertex in on_cut:
            right[vertex] = centre[(mesh.t == vertex).any(axis=0)][0] > 0.5
        u = np.stack([0.1 + 0.7 * right, -0.3 * right], axis=1).ravel()
        assert body.energy(u) == 0.0
        assert not body.force(u).any()


def test_exponential_and_root():
    x = -np.concatenate([[0.0, 1e-320, 1e-17], np.geomspace(1e-15, 708.0, 40_001)])
    mine = np.array([exponential(value) for value in x])
    assert np.abs(mine / np.exp(x) - 1.0).max() < 4.5e-16  # 4.4e-16 measured
    assert exponential(-1e300) == exponential(-708.0) == pytest.approx(3.3e-308, rel=0.01)
    r = np.geomspace(1e-280, 1e280, 40_001)
    assert np.abs(np.array([inverse_root(value) for value in r]) * np.sqrt(r) - 1.0).max() < 5e-16  # 4.4e-16


def test_numbers_that_are_none_show():
    for rule in (PairRule(), BallRule(2, 6)):
        body = body_on(box(2, 6), 0.4, Exponential(1.0, 1.0), rule=rule, compiled=True)
        u = np.zeros(body.basis.N)
        u[30] = np.nan
        assert np.isnan(body.force(u)).any()
        assert np.isnan(body.energy(u))
        assert np.isfinite(body.force(np.zeros(body.basis.N))).all()  # nothing of it is left in working arrays


def test_memory_of_a_bond():
    """All arrays of list and tasks: 4 bytes a pair, 8 more for a kept measure; balls 19, and 32 on a ray cut short."""
    for rule, memory, most in (
        (PairRule(), 0.0, 5), (PairRule(), 1e9, 13), (PairRule(points="gauss"), 0.0, 5), (BallRule(), 0.0, 25),
    ):  # fmt: skip
        body = body_on(
            grid((1, 40), (1, 40)), 0.1, Exponential(1.0, 1.0), rule=rule, matrix_memory=memory, compiled=True
        )
        body.force(np.zeros(body.basis.N))
        arrays = [x for part in body.bonds.parts for x in vars(part).values()]
        arrays += [x for block in body.blocks for x in vars(block).values()]
        arrays += [x for task in body.engine.schedule.tasks for x in vars(task).values()]
        buffers = {}
        for x in arrays:
            if isinstance(x, np.ndarray):
                whole = x if x.base is None or not isinstance(x.base, np.ndarray) else x.base
                buffers[id(whole)] = whole.nbytes
        held = sum(buffers.values()) / body.bonds.nbonds
        print(f"{rule.name}, {'kept' if memory else 'made on the way'}: {held:.1f} bytes a bond")
        assert held < most


# ---- threads, processes
def bits(body):
    u = np.random.default_rng(0).standard_normal(body.basis.N)
    return body.force(u).tobytes(), body.energy(u), (body.stiffness_operator() @ u).tobytes()


@pytest.mark.parametrize("rule", [PairRule(), BallRule(3, 8), BallRule(3, 8, "vertices")], ids=lambda rule: rule.name)
def test_bits_do_not_depend_on_threads(rule, monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.bonds.rule.BLOCK", 3000)
    monkeypatch.setattr("skfem_peridynamics.engine.schedule._LEAST", 700)
    monkeypatch.setattr("skfem_peridynamics.engine.ball_tasks._ELEMENTS", 60)
    monkeypatch.setattr("skfem_peridynamics.engine.pair_tasks._SAMPLES", 60)
    bodies = [body_on(grid((1, 20), (1, 20)), 0.2, Exponential(1.0, 1.0), rule=rule, threads=n) for n in (1, 2, 3, 7)]
    assert len(bodies[0].engine.schedule.tasks) > 8
    assert len({bits(body) for body in bodies for _ in range(5)}) == 1


def test_calls_from_several_threads_do_not_meet():
    body = body_on(grid((1, 30), (1, 30)), 0.2, Exponential(1.0, 1.0), threads=2, compiled=True)
    rng = np.random.default_rng(0)
    us = rng.standard_normal((4, body.basis.N))
    expected, wrong = [body.force(u).tobytes() for u in us], []

    def work(k):
        for _ in range(25):
            if body.force(us[k]).tobytes() != expected[k]:
                wrong.append(k)

    threads = [threading.Thread(target=work, args=(k,)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60.0)
        assert not thread.is_alive()
    assert not wrong


def child(body, expected, queue):
    queue.put(bits(body) == expected)


def test_a_forked_child_neither_hangs_nor_differs():
    """The parent has used its threads, which a fork does not take along."""
    body = body_on(grid((1, 60), (1, 60)), 0.1, Exponential(1.0, 1.0), threads=2, compiled=True)
    expected = bits(body)
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    process = context.Process(target=child, args=(body, expected, queue))
    process.start()
    assert queue.get(timeout=60.0)
    process.join(60.0)
    assert process.exitcode == 0


# ---- laws of the user's own
def test_a_law_of_scalars_and_one_of_arrays():
    class Arrays:
        f = staticmethod(lambda q: 0.5 * -np.expm1(-4.0 * q))
        df = staticmethod(lambda q: 2.0 * np.exp(-4.0 * q))
        d2f = staticmethod(lambda q: -8.0 * np.exp(-4.0 * q))

    scalars = Scalars(
        lambda q: 0.5 * -math.expm1(-4.0 * q), lambda q: 2.0 * math.exp(-4.0 * q), lambda q: -8.0 * math.exp(-4.0 * q)
    )
    named = Exponential(2.0, 0.5)
    rng = np.random.default_rng(0)
    for rule in (PairRule(), BallRule(2, 6)):
        body = body_on(box(2, 6, "random"), 0.4, named, rule=rule, compiled=True)
        u = 0.2 * rng.standard_normal(body.basis.N)
        for law in (own_potential(Arrays()), own_potential(scalars)):
            assert law.inflection == pytest.approx(named.inflection, rel=1e-9)
            compare(body.with_(material=law, no_fail=[1, 2]))
            own = body.with_(material=law)
            assert own.energy(u) == pytest.approx(body.energy(u), rel=1e-12)
            assert close(own.force(u), body.force(u))
            assert close(own.tangent_operator(u) @ u, body.tangent_operator(u) @ u)


def test_scalars_without_numba(monkeypatch):
    monkeypatch.setattr(_compile, "available", lambda: False)
    law = own_potential(Scalars(math.log1p, lambda q: 1 / (1 + q), lambda q: -1 / (1 + q) ** 2))
    assert law.f(np.array([0.0, 1.0])).tolist() == [0.0, math.log(2.0)]
    assert law.limit == math.inf


def test_scalars_that_numba_has_compiled_already():
    import numba

    compiled = numba.njit(lambda q: 1.0 / (1.0 + q))
    law = own_potential(Scalars(math.log1p, compiled, lambda q: -1 / (1 + q) ** 2))
    compare(body_on(box(2, 5), 0.5, law))


# ---- where numba is not, or its cache cannot be
def test_without_numba_the_sparse_products_stand_in(monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.model.peridynamics.available", lambda: False)
    body = body_on(box(2, 4), 0.6)
    assert isinstance(body.engine, SparseEngine)
    with pytest.raises(ValueError, match=r"compiled = True needs numba.*pip install 'skfem-peridynamics\[fast\]'"):
        body.with_(compiled=True).force(np.zeros(body.basis.N))


@pytest.mark.slow
def test_a_numba_that_cannot_be_imported(tmp_path):
    """As after an update of NumPy alone: said once, and the sparse products do."""
    stub = tmp_path / "broken" / "numba"
    stub.mkdir(parents=True)
    (stub / "__init__.py").write_text('raise ImportError("Numba needs NumPy 2.0 or less")')
    code = CACHE.replace(", compiled=True", "") + "assert type(body.engine).__name__ == 'SparseEngine'"
    assert run_with(tmp_path / "cache", code, stub.parent) == pytest.approx(run_with(tmp_path / "cache"), rel=1e-12)


CACHE = """
import numpy as np, skfem
import skfem_peridynamics as peri
mesh = skfem.MeshTri().refined(2)
basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
body = peri.Peridynamics(peri.BondBasis(basis, horizon=0.5), peri.Linear(1.0), compiled=True)
print(repr(float(np.abs(body.force(basis.project(lambda x: x))).sum())))
"""


def run_with(cache, code=CACHE, path=None):
    env = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONWARNINGS": "error"}
    if path is not None:
        env["PYTHONPATH"] = str(path)
    command = [sys.executable, "-c", code]  # not from here: a package in the folder would come first
    result = subprocess.run(command, capture_output=True, text=True, env=env, cwd=cache.parent, check=False)
    assert result.returncode == 0, result.stderr
    return float(result.stdout)


@pytest.mark.slow
def test_caches_that_are_cut_short(tmp_path):
    fresh = run_with(tmp_path)
    files = [file for file in tmp_path.rglob("*") if file.suffix in (".nbi", ".nbc")]
    assert len(files) > 5
    for file in files:
        file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    assert run_with(tmp_path) == fresh


@pytest.mark.slow
def test_code_of_other_loops_is_not_taken_from_a_cache(tmp_path):
    """An update that changes a loop which other files call, and leaves those files and their times alone."""
    package = tmp_path / "new" / "skfem_peridynamics"
    shutil.copytree(Path(peri.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    old = run_with(tmp_path / "cache", path=package.parent)
    law = package / "engine" / "law_loops.py"
    law.write_text(law.read_text().replace("twice = 2.0 * slope", "twice = 4.0 * slope"))
    assert run_with(tmp_path / "cache", path=package.parent) == pytest.approx(2 * old, rel=1e-12)


NO_PLACE = (
    """
from numba.core import caching
caching.CacheImpl._locator_classes = []
"""
    + CACHE
)


@pytest.mark.slow
def test_no_place_for_a_cache(tmp_path):
    """A read-only home, or a package in an archive: numba finds no directory, and says so with a RuntimeError."""
    assert run_with(tmp_path, NO_PLACE) == run_with(tmp_path)


def test_a_cache_that_cannot_be_written(monkeypatch):
    import numba

    @numba.njit(cache=True)
    def twice(x):
        return 2 * x

    def full(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(twice._cache, "save_overload", full)
    _compile._forgive(twice)
    assert twice(2.0) == 4.0


@pytest.mark.parametrize("q", [1e295, np.inf])
def test_the_energy_of_what_is_torn_beyond_all_numbers_is_its_limit(q):
    """``q / (1 + b q)`` is 1/b there, and no infinity over infinity."""
    from skfem_peridynamics.engine.law_loops import RATIONAL, ROOM, K, Q, stored

    W = np.zeros(ROOM)
    W[K], W[Q] = 3.0, q
    assert stored(RATIONAL, 2.0, 1e10, None, W, 1) == pytest.approx(6e-10, rel=1e-12)
