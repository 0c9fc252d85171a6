"""What is free: of the machine, of a control group, of the process; and what a scene says of its size."""

import resource

import pytest

from faults import small
from skfem_peridynamics import _memory as memory
from skfem_peridynamics._memory import _of_group, free_memory
from skfem_peridynamics.app.problem import cost, problem
from skfem_peridynamics.app.run.check import check
from skfem_peridynamics.app.scene.reading import SceneError


def test_a_control_group_and_those_above_it(tmp_path):
    table = tmp_path / "cgroup"
    table.write_text("1:name=systemd:/x\n0::/a/b\n")
    (tmp_path / "a" / "b").mkdir(parents=True)
    assert _of_group(tmp_path, table) == float("inf")
    (tmp_path / "a" / "memory.max").write_text("1000\n")
    (tmp_path / "a" / "memory.current").write_text("400\n")
    (tmp_path / "a" / "b" / "memory.max").write_text("max\n")
    (tmp_path / "a" / "b" / "memory.current").write_text("300\n")
    assert _of_group(tmp_path, table) == 600.0
    (tmp_path / "a" / "b" / "memory.max").write_text("350\n")
    assert _of_group(tmp_path, table) == 50.0
    assert _of_group(tmp_path, tmp_path / "nothing") == float("inf")


def test_a_limit_of_the_process(monkeypatch):
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    page = resource.getpagesize()
    with open("/proc/self/statm") as file:
        taken = int(file.read().split()[0]) * page
    resource.setrlimit(resource.RLIMIT_AS, (taken + (1 << 29), hard))
    try:
        assert 0.4e9 < free_memory() < 0.6e9
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
    for name in ("_of_machine", "_of_group", "_of_process"):
        with monkeypatch.context() as patch:
            patch.setattr(memory, name, lambda: 7.0)
            assert free_memory() == 7.0


def test_too_large_is_refused_by_check_and_run_alike(monkeypatch, tmp_path):
    monkeypatch.setattr(cost, "free_memory", lambda: 1e8)
    for act in (lambda: check(small()), lambda: problem.Problem(small()).bonds):
        with pytest.raises(
            SceneError, match=r"makes about .* bonds, which need 0.121 GB; 0.1 GB are free: take a smaller"
        ):
            act()


def test_check_tells_what_a_run_will_take():
    rows = dict(check(small()))
    assert list(rows)[:3] == ["dimension, nodes", "bonds", "steps"]
    for word in ("set-up", "step limit", "steps", "output"):
        assert f"{word} " in rows["time"]
    assert rows["time"].startswith("about ")
    assert rows["output"].endswith("12 rows, a checkpoint every 5 steps")
    assert "MB of" in rows["memory"]
