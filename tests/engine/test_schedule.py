"""Tasks that meet run in one order; neighbours and rays found by compiled loops are those that SciPy and NumPy find."""

import threading
import time

import numpy as np
import pytest

from bodies import box, grid
from skfem_peridynamics import Crack, slit
from skfem_peridynamics._threads import Threads
from skfem_peridynamics.engine.schedule import Schedule
from skfem_peridynamics.geometry import neighbours, rays
from skfem_peridynamics.geometry.neighbours import curve_order, pairs_within
from skfem_peridynamics.geometry.rays import Tracer


def random_marks(seed, tasks=40, places=25):
    return list(np.random.default_rng(seed).random((tasks, places)) < 0.06)


@pytest.mark.parametrize("places", [4096, 7])
@pytest.mark.parametrize("seed", range(5))
def test_tasks_that_meet_never_overlap_and_keep_their_order(seed, places, monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.engine.schedule._PLACES", places)
    marks = random_marks(seed)
    made = Schedule.from_tasks(range(len(marks)), [np.flatnonzero(mark) for mark in marks], 25)
    assert sorted(made.tasks) == list(range(len(marks)))
    seen, running, lock = [], set(), threading.Lock()

    def task(number):
        with lock:
            assert not any((marks[number] & marks[other]).any() for other in running)
            running.add(number)
        time.sleep(np.random.default_rng(number + seed).uniform(0, 2e-3))
        with lock:
            running.remove(number)
            seen.append(number)

    rank = {number: n for n, number in enumerate(made.tasks)}
    for threads in (1, 4):
        seen.clear()
        made.run(task, Threads(threads))
        assert sorted(seen) == sorted(made.tasks)
        for n, one in enumerate(seen):
            for other in seen[n + 1 :]:
                if (marks[one] & marks[other]).any():
                    assert rank[one] < rank[other]


def test_a_task_that_fails_is_heard_and_nothing_hangs():
    marks = random_marks(0)
    made = Schedule.from_tasks(range(len(marks)), [np.flatnonzero(mark) for mark in marks], 25)

    def task(number):
        if number == made.tasks[7]:
            raise MemoryError("no room")

    with pytest.raises(MemoryError, match="no room"):
        made.run(task, Threads(3))
    made.run(lambda number: None, Threads(3))


@pytest.mark.parametrize("dim", [1, 2, 3])
def test_compiled_pairs_are_those_of_the_tree(dim, monkeypatch):
    rng = np.random.default_rng(dim)
    lattice = grid(*[(1.0, {1: 300, 2: 24, 3: 7}[dim])] * dim).p  # many pairs exactly at the reach
    lattice[-1] += 0.0
    twice = np.hstack([rng.random((dim, 150)), np.full((dim, 2), 0.5)])  # two in one place
    far = np.hstack([rng.random((dim, 40)), 1e4 + rng.random((dim, 40))])  # two clusters far apart
    for x, reach in ((lattice, 3 / {1: 300, 2: 24, 3: 7}[dim]), (twice, 0.3), (twice, 9.0), (far, 0.4)):
        found = []
        for many in (10**9, 0):
            monkeypatch.setattr(neighbours, "_MANY", many)
            monkeypatch.setattr("skfem_peridynamics.geometry.neighbour_loops._ROWS", 37)
            found.append([np.concatenate(part) for part in zip(*pairs_within(x, reach), strict=True)])
        assert np.array_equal(found[0][0], found[1][0])
        assert np.array_equal(found[0][1], found[1][1])
        assert found[1][2] == pytest.approx(found[0][2], rel=1e-15)


def test_the_curve_is_an_ordering_of_compact_runs():
    x = np.random.default_rng(0).random((4096, 3))
    order = curve_order(x)
    assert sorted(order) == list(range(4096))
    spread = [np.ptp(x[order[low : low + 64]], axis=0).prod() for low in range(0, 4096, 64)]
    assert np.median(spread) < 4 / 64  # a compact run of 64 of 4096 points fills 1/64 of the cube
    assert curve_order(np.zeros((3, 2))).tolist() == [0, 1, 2]


@pytest.mark.parametrize(("dim", "n"), [(1, 30), (2, 10), (3, 4)])
@pytest.mark.parametrize("kind", ["structured", "random", "graded"])
def test_compiled_rays_go_where_the_others_go(dim, n, kind, monkeypatch):
    """From vertices along axes and edges too, where a ray turns around vertices without advancing."""
    mesh = box(dim, n, kind)
    if dim == 2 and kind == "structured":
        mesh = slit(mesh, Crack([[0.5, 0.2], [0.5, 0.7]]))
    tracer, rng = Tracer(mesh), np.random.default_rng(0)
    ways = np.vstack([rng.standard_normal((7, dim)), np.eye(dim), -np.eye(dim), np.ones((1, dim))])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    vertex = np.repeat(np.arange(mesh.nvertices), len(ways))
    way = np.tile(ways, (mesh.nvertices, 1))
    x = mesh.p.T[vertex]
    found = []
    for many in (10**9, 0):
        monkeypatch.setattr(rays, "_MANY", many)
        start = tracer.first_elements(vertex, way)
        found.append((start, tracer.march(x, start, way, 0.4, np.array([0.1, 0.5, 0.9]), np.array([0.3, 0.6, 1.0]))))
    (start, slow), (again, fast) = found
    assert np.mean(start == again) > 0.98  # where two cones are equally deep, round-off chooses
    assert np.array_equal(start < 0, again < 0)
    same = np.abs(fast.reach - slow.reach) < 1e-12
    assert same.mean() > 0.999
    for k, nodes in enumerate(((0.1, 0.3), (0.5, 0.6), (0.9, 1.0))):
        cut = fast.reach < 0.4
        y = x + (fast.reach * np.where(cut, nodes[1], nodes[0]))[:, None] * way
        inside = tracer.barycentric(fast.element[:, k], y).min(axis=1)
        assert inside[again >= 0].min() > -1e-9


def test_rays_that_keep_turning_are_finished_by_the_others(monkeypatch):
    monkeypatch.setattr(rays, "_TURNS", 0)
    tracer = Tracer(box(2, 8))
    x, way = np.full((3, 2), 0.25), np.array([[1.0, 0.0], [0.0, 1.0], [2**-0.5, 2**-0.5]])
    start = tracer.first_elements(np.full(3, np.flatnonzero((tracer.mesh.p == 0.25).all(axis=0))[0]), way)
    for many in (10**9, 0):
        monkeypatch.setattr(rays, "_MANY", many)
        assert tracer.march(x, start, way, 5.0, np.array([0.5])).reach == pytest.approx([0.75, 0.75, 0.75 * 2**0.5])


def test_only_those_are_waited_for_that_no_other_has_waited_for():
    """Tasks that all touch one place run one after the other, each waiting for the one before it alone."""
    schedule = Schedule.from_tasks(range(5), [np.array([0])] * 5, size=1)
    assert [sorted(waited) for waited in schedule.waits] == [[], [0], [1], [2], [3]]
