import csv
import json
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import meshio
import numpy as np
import pytest
import skfem

from bodies import vector_basis
from skfem_peridynamics import Frames, Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.scene.reading import SceneError
from small_scenes import GOOD, change

KEYS = [
    "nodes",
    "bonds",
    "step",
    "step_limits",
    "steps",
    "energy_drift",
    "seconds",
    "seconds_per_step",
    "peak_memory_mb",
    "rule",
    "scheme",
    "version",
]


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    out = tmp_path_factory.mktemp("run") / "deep" / "out"
    summary = run(Scene.parse(change("pictures = false", "pictures = true")), out)
    return out, summary


def test_files_of_a_run(finished):
    out, _ = finished
    assert sorted(p.name for p in out.iterdir()) == [
        "damage.png", "energies.png", "frame_0000.vtu", "frame_0001.vtu", "frames.pvd", "history.csv",
        "measures.png", "summary.json",
    ]  # fmt: skip


def test_summary(finished):
    out, summary = finished
    stored = json.loads((out / "summary.json").read_text())
    assert set(KEYS) <= set(stored)
    assert stored["status"] == "finished"
    assert set(stored["step_limits"]) == {"by_eigenvalue", "by_nodal_bound", "by_closed_form", "by_row_sum"}
    assert set(stored["seconds"]) == {"setup", "cfl", "steps", "output"}
    assert stored["nodes"] == 17 * 9 + 8
    assert stored["step"] * stored["steps"] == pytest.approx(0.5, rel=1e-12)
    assert stored["step"] <= 0.9 * max(stored["step_limits"]["by_eigenvalue"], stored["step_limits"]["by_nodal_bound"])
    per_step = stored["seconds"]["steps"] / stored["steps"]  # seconds are rounded to a microsecond
    assert stored["seconds_per_step"] == pytest.approx(per_step, abs=0.51e-6 / stored["steps"])
    assert summary["bonds"] == stored["bonds"]


def test_history_balances_and_has_no_clock(finished):
    out, summary = finished
    with open(out / "history.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5
    assert not {"seconds", "time", "date", "rate"} & set(rows[0])
    assert " ".join(rows[0]) == (
        "t step kinetic intact softened total work imbalance softened_bonds largest_Z "
        "crack_reach crack_area crack_length tips tip_x tip_y cracks crushed reaction_left_x reaction_left_y"
    )
    assert [int(row["step"]) for row in rows][0::4] == [0, summary["steps"]]
    v = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    assert v["total"] == pytest.approx(v["kinetic"] + v["intact"] + v["softened"], rel=1e-14)
    assert v["imbalance"] == pytest.approx(v["total"] - v["work"] - v["total"][0], abs=1e-18)
    assert summary["energy_drift"] == pytest.approx(np.abs(v["imbalance"]).max() / v["total"].max(), rel=1e-12)
    assert summary["energy_drift"] < 0.02  # 0.0131 measured: sudden loads on 17 x 9 vertices
    assert v["total"][0] == pytest.approx(0.5 * 1e-6 * 0.5**3 / 3, rel=0.02)  # the initial velocity (0, 1e-3 y)


def test_frames_hold_what_paraview_wants(finished):
    out, _ = finished
    frame = meshio.read(out / "frame_0001.vtu")
    assert frame.points.shape == (161, 3)
    assert [c.type for c in frame.cells] == ["triangle"]
    assert {name: data.shape for name, data in frame.point_data.items()} == {
        "displacement": (161, 3), "velocity": (161, 3), "damage": (161,), "intact": (161,), "Z": (161,),
    }  # fmt: skip
    sets = ET.parse(out / "frames.pvd").getroot().findall("./Collection/DataSet")
    assert [s.get("file") for s in sets] == ["frame_0000.vtu", "frame_0001.vtu"]
    assert [float(s.get("timestep")) for s in sets] == pytest.approx([0.0, 0.5], rel=1e-12)


def test_pictures_are_pictures(finished):
    out, _ = finished
    for name in ("damage.png", "energies.png"):
        assert (out / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        assert (out / name).stat().st_size > 10_000


@pytest.mark.parametrize("dim", [1, 3])
def test_pictures_and_frames_in_1d_and_3d(dim, tmp_path):
    box = {1: "[[0, 1]]", 3: "[[0, 1], [0, 0.4], [0, 0.4]]"}[dim]
    divisions = {1: "[20]", 3: "[10, 4, 4]"}[dim]
    scene = Scene.parse(f"""
    mesh = {{box = {box}, divisions = {divisions}}}
    material = {{young = 1.0, toughness = 1e-4, density = 1.0}}
    bonds = {{horizon = {0.15 if dim == 1 else 0.25}}}
    fixed = [{{on = "left", displacement = 0}}, {{on = "right", component = "x", velocity = 0.3}}]
    time = {{until = 1.0}}
    output = {{frames = 2, history = 4}}
    """)
    summary = run(scene, tmp_path)
    assert summary["softened_bonds"] > 0
    assert (tmp_path / "damage.png").stat().st_size > 10_000
    frame = meshio.read(tmp_path / "frame_0001.vtu")
    assert frame.point_data["displacement"].shape == (summary["nodes"], 3)
    assert frame.point_data["displacement"][:, 0].max() == pytest.approx(0.3, rel=1e-6)


def test_same_input_same_bytes(tmp_path):
    scene = Scene.parse(GOOD)
    for name in ("a", "b"):
        run(scene, tmp_path / name)
    for file in ("history.csv", "frame_0001.vtu", "frames.pvd"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_a_second_run_replaces_the_first_where_it_is_asked_to(tmp_path, caplog):
    first = run(Scene.parse(change("frames = 2", "frames = 4")), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(SceneError, match="holds a finished run of another scene: output.frames is 2 and was 4; give"):
        run(Scene.parse(GOOD), tmp_path)
    assert run(Scene.parse(change("frames = 2", "frames = 4")), tmp_path)["seconds"] == first["seconds"]
    assert "is finished: there is nothing to go on with; --overwrite makes it anew" in caplog.text
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
    run(Scene.parse(GOOD), tmp_path, resume=False)
    assert len(list(tmp_path.glob("frame_*.vtu"))) == 2
    (tmp_path / "mine.txt").write_text("stays")
    run(Scene.parse(change("frames = 2", "frames = 0")), tmp_path, resume=False)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["history.csv", "mine.txt", "summary.json"]


@pytest.mark.parametrize("name", ["summary.json", "history.csv", "frame_0000.vtu", "report.html"])
def test_a_file_that_no_run_wrote_is_not_overwritten(name, tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(GOOD)
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text('{"mine": 1}')
    command = ["run", str(tmp_path / "scene.toml"), "--out", str(out), "--quiet"]
    assert main(command) == 2
    assert f"holds {name}, which no run has written: give the run another folder, or say --overwrite" in (
        capsys.readouterr().err
    )
    assert [(path.name, path.read_text()) for path in out.iterdir()] == [(name, '{"mine": 1}')]
    assert main([*command, "--overwrite"]) == 0
    assert main(command) == 0  # the same again: it is there


def test_an_estimate_is_made_up_for(tmp_path):
    """A finished run without one gets its estimate, and nothing is run again for another report."""
    scene = Scene.parse(GOOD)
    first = run(scene, tmp_path)
    rows = (tmp_path / "history.csv").read_bytes()
    later = run(scene, tmp_path, with_estimate=True)
    assert 0.0 < later["error_estimate"] < 1.0
    assert json.loads((tmp_path / "summary.json").read_text())["error_estimate"] == later["error_estimate"]
    assert later["seconds"] == first["seconds"]
    assert (tmp_path / "history.csv").read_bytes() == rows


def test_titles_are_text_not_formulas(tmp_path):
    content = change("pictures = false", "pictures = true").replace(
        'title = "small"', 'title = "cost $\\\\frac$ \u88c2"'
    )
    assert run(Scene.parse(content), tmp_path)["status"] == "finished"


def test_cfl_of_a_scene_and_of_a_mesh_file(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(GOOD)
    assert main(["cfl", str(tmp_path / "scene.toml"), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["stable_step"] <= numbers["step_limits"]["by_eigenvalue"]
    assert numbers["stable_step"] >= numbers["step_limits"]["by_nodal_bound"]
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 1, 17), np.linspace(0, 0.5, 9))
    mesh.save(str(tmp_path / "plate.vtu"))
    flags = [
        "--mesh",
        str(tmp_path / "plate.vtu"),
        "--horizon",
        "0.13",
        "--young",
        "1",
        "--density",
        "1",
        "--plane",
        "stress",
    ]
    assert main(["cfl", *flags, "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["nodes"] == 153
    assert plain["stable_step"] == pytest.approx(numbers["stable_step"], rel=0.02)  # the crack changes little
    assert main(["cfl", *flags]) == 0
    table = capsys.readouterr().out
    for word in ("limit", "eigenvalue", "nodal bound", "closed form", "row sum"):
        assert word in table
    for wrong, message in (
        ([], "cfl needs a scene, or a mesh file with --mesh"),
        (
            [str(tmp_path / "scene.toml"), "--young", "2"],
            "--young is for a mesh file; with a scene, change the scene instead",
        ),
        ([*flags[:5], "-1", *flags[6:]], "--young -1.0 must be a positive number"),
        (flags[:-2], "cfl of a mesh in 2D needs --plane stress or --plane strain"),
        (flags[:6], "with --density as well"),
    ):
        assert main(["cfl", *wrong]) == 2
        assert message in capsys.readouterr().err


def test_progress_on_a_pipe(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(GOOD)
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0
    told = capsys.readouterr().out
    assert "small: setting up" in told
    for word in ("steps/s", "s left", "energy", "of critical", "energy drift", "per step", "MB"):
        assert word in told


def test_groups_of_a_gmsh_like_file_are_names(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]], dtype=float)
    cells = [
        ("triangle", np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])),
        ("line", np.array([[0, 1], [2, 3]])),
    ]
    data = {
        "gmsh:physical": [np.array([3, 3, 3, 3]), np.array([1, 2])],
        "gmsh:geometrical": [np.array([1, 1, 1, 1]), np.array([1, 2])],
    }
    field = {"floor": np.array([1, 1]), "roof": np.array([2, 1]), "core": np.array([3, 2])}
    meshio.Mesh(points, cells, cell_data=data, field_data=field).write(
        tmp_path / "part.msh", file_format="gmsh22", binary=False
    )
    (tmp_path / "scene.toml").write_text("""
    mesh = {file = "part.msh"}
    material = {young = 1.0, toughness = 1.0, density = 1.0, plane = "strain"}
    bonds = {horizon = 1.5}
    fixed = [{on = "floor", displacement = 0}]
    load = [{traction = [0, 1], on = "roof"}]
    no_fail = [{region = "core"}]
    time = {until = 0.1}
    output = {frames = 0, pictures = false}
    """)
    summary = run(Scene.read(tmp_path / "scene.toml"), tmp_path / "out")
    assert summary["nodes"] == 5


def test_frames_refuse_fields_of_another_length(tmp_path):
    frames = Frames(tmp_path, vector_basis(skfem.MeshTri()))
    with pytest.raises(ValueError, match=r"field 'Z' has shape \(3,\); it needs \(4,\), \(8,\) or \(4, 6\)"):
        frames.write(0.0, Z=np.zeros(3))
    assert not list(tmp_path.glob("*.vtu*"))


SPARE = """
import sys
import skfem
import skfem_peridynamics as peri
heavy = {"meshio", "matplotlib", "tomllib", "pyamg", "numba", "rich", "scipy.integrate", "scipy.spatial"}
assert not heavy & set(sys.modules), heavy & set(sys.modules)
assert not any(name.startswith("skfem_peridynamics.app") for name in sys.modules)
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.model import peridynamics
calls = []
for owner, name in ((peridynamics.Peridynamics, "tangent"), (peridynamics.Peridynamics, "stiffness"),
                    (peridynamics.Peridynamics, "tangent_operator"), (peridynamics.Peridynamics, "assemble")):
    original = getattr(owner, name)
    def counted(*args, _name=name, _original=original, **keys):
        calls.append(_name)
        return _original(*args, **keys)
    setattr(owner, name, counted)
kinds = []
from skfem_peridynamics.app.problem import problem
original_mass = problem.mass_matrix
def counted_mass(*args, kind="lumped", **keys):
    kinds.append(kind)
    return original_mass(*args, kind=kind, **keys)
problem.mass_matrix = counted_mass
summary = peri.run(peri.Scene.read(sys.argv[1]), sys.argv[2])
assert summary["status"] == "finished"
assert calls == [], calls
assert kinds == ["lumped"], kinds
loaded = {"meshio", "matplotlib", "pyamg", "numba", "rich"} & set(sys.modules)
assert not loaded, loaded
"""


def test_what_a_scene_does_not_need_is_neither_built_nor_imported(tmp_path):
    """No tangent, no consistent mass, no pictures, no frames: asserted by calls and imports in a fresh interpreter."""
    (tmp_path / "scene.toml").write_text(change("frames = 2", "frames = 0"))
    result = subprocess.run(
        [sys.executable, "-c", SPARE, str(tmp_path / "scene.toml"), str(tmp_path / "out")],
        capture_output=True, text=True, env={**os.environ, "PYTHONWARNINGS": "error"}, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr


def test_python_m(tmp_path):
    (tmp_path / "scene.toml").write_text(GOOD)
    result = subprocess.run(
        [sys.executable, "-m", "skfem_peridynamics", "check", str(tmp_path / "scene.toml")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0
    assert "dimension, nodes" in result.stdout


def test_the_time_left_is_that_of_the_steps(monkeypatch, capsys):
    """A first step that loads what it calls, 10 s, says nothing of the others; a pace that changes is followed."""
    from skfem_peridynamics.app.run import progress

    now = [0.0]
    monkeypatch.setattr(progress.time, "perf_counter", lambda: now[0])
    line = progress.Line()
    line.begin("x", 1000)
    for step in range(1001):
        now[0] += 10.0 if step == 1 else 0.02 if step < 500 else 0.08
        line.advance(step, 1.0, 1.0)
    said = [re.search(r"step (\d+)/1000, .* (\d+) s left", row) for row in capsys.readouterr().out.splitlines()]
    left = {int(found[1]): float(found[2]) for found in said if found}
    assert left[200] == pytest.approx(800 * 0.02, abs=1.0)  # as it looks then
    assert left[900] == pytest.approx(100 * 0.08, abs=1.0)
    assert left[100] < 900 * 0.02 * 1.5


def test_packed_arrays_have_the_sizes_that_they_say():
    """Blocks, their length, that of the last, and packed lengths, as VTK reads them; meshio looks at no last length."""
    import base64
    import struct
    import zlib

    from skfem_peridynamics.app.files.vtu_writer import _BLOCK, _packed

    for count in (1, 10, _BLOCK // 4, _BLOCK // 4 + 3, _BLOCK):
        values = np.arange(count, dtype=np.float32)
        text = _packed(values)
        blocks = -(-4 * count // _BLOCK)
        size = 4 * (3 + blocks)
        length = 4 * -(-size // 3)
        found, whole, last, *lengths = struct.unpack(f"<{3 + blocks}I", base64.b64decode(text[:length]))
        content, parts = base64.b64decode(text[length:]), []
        for at in np.cumsum([0, *lengths[:-1]]):
            parts.append(zlib.decompressobj().decompress(content[at:]))
        assert (found, whole) == (blocks, _BLOCK)
        assert [len(part) for part in parts] == [_BLOCK] * (blocks - 1) + [last or _BLOCK]
        assert b"".join(parts) == values.tobytes()
