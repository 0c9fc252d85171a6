"""Every wrong input ends in one sentence that names the key and its value, exit code 2, and leaves nothing behind."""

import tomllib

import meshio
import numpy as np
import pytest
import skfem

from skfem_peridynamics import Scene, traction
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.problem.problem import Problem
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.solve.constraints import check_fixed
from small_scenes import GOOD, change, complaint


def test_the_good_one_runs(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(GOOD)
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    assert "the scene is sound" in capsys.readouterr().out


BAD = {
    "unknown key": (
        change("young = 1.0", "yong = 1.0"),
        "material.yong = 1.0: there is no such key; did you mean 'young'?",
    ),
    "unknown table": (
        GOOD + "[sponge]\na = 1",
        "sponge = {a = 1}: there is no such key; the keys there are mesh, material",
    ),
    "missing key": (change("young = 1.0, ", ""), "material: give one of young = None and lame = None"),
    "missing horizon": (change("horizon = 0.13", ""), "bonds.horizon is missing; it must be given"),
    "negative constant": (
        change("young = 1.0", "young = -1.0"),
        "material.young = -1.0 must be a positive number",
    ),
    "not a number": (change("young = 1.0", "young = nan"), "material.young = nan must be a finite number"),
    "text for a number": (
        change("density = 1.0", 'density = "heavy"'),
        "material.density = 'heavy' must be a finite number",
    ),
    "true for a number": (change("density = 1.0", "density = true"), "material.density = True must be"),
    "zero horizon": (change("0.13}\ncrack", "0}\ncrack"), "bonds.horizon = 0 must be a positive number"),
    "no bonds": (change("horizon = 0.13", "horizon = 0.02"), "leaves vertex 0 at (0, 0) without a bond"),
    "poisson": (
        change('plane = "stress"', 'plane = "stress", poisson = 1.3'),
        "material: poisson = 1.3: in plane stress Poisson's ratio lies between -1 and 1",
    ),
    "no plane": (change(', plane = "stress"', ""), "material: plane = None: a body in 2D is in plane"),
    "crack outside": (
        change("[[0.0, 0.25], [0.5, 0.25]]", "[[2.0, 0.25], [3.0, 0.25]]"),
        "crack[0].points: crack from (2, 0.25) to (3, 0.25) lies outside the body, which reaches from (0, 0)",
    ),
    "crack off the mesh lines": (change("0.25], [0.5, 0.25]", "0.26], [0.5, 0.26]"), "facets must follow it"),
    "crack of one point": (
        change("[[0.0, 0.25], [0.5, 0.25]]", "[[0.0, 0.25]]"),
        "crack[0].points: a crack in 2D needs at least 2 points",
    ),
    "crack in 3D": (
        change("[[0.0, 0.25], [0.5, 0.25]]", "[[0,0,0],[1,0,0],[1,1,0]]"),
        "crack[0].points: crack points have 3 coordinates, the mesh has 2",
    ),
    "unknown boundary": (
        change('on = "left"', 'on = "lift"'),
        "fixed[0].on: boundary 'lift' is not in the mesh; its named boundaries are: left, right",
    ),
    "unknown load boundary": (
        change('on = "bottom"', 'on = "botom"'),
        "load[1]: boundary 'botom' is not in the mesh",
    ),
    "empty fixed set": (
        change('on = "left"', 'where = "x > 7"'),
        "fixed[0] selects no vertex: the set is empty",
    ),
    "unknown region": (
        change('on = "left"', 'region = "core"'),
        "fixed[0].region: subdomain 'core' is not in the mesh",
    ),
    "two selections": (
        change('on = "left"', 'on = "left", where = "x"'),
        "fixed[0]: give one of on, region and where",
    ),
    "width without on": (
        change('on = "left"', 'where = "0.1 - x", width = 0.1'),
        "fixed[0]: width = 0.1 goes with on",
    ),
    "component": (
        change('component = "x"', 'component = "z"'),
        "fixed[0].component = 'z': the body has 2 dimensions",
    ),
    "both motions": (
        change("displacement = 0}", "displacement = 0, velocity = 1}"),
        "fixed[0]: give one of displacement and velocity",
    ),
    "fixed twice": (
        change("fixed = [", 'fixed = [{on = "bottom", displacement = "0.1*t"}, '),
        "fixed[0] and fixed[1] both move x of vertex 0 at (0, 0), and not the same: displacement 0.0185 and "
        "displacement 0 at t = 0.185",
    ),
    "NaN initial data": (
        change("1e-3*y", "log(y - 0.1)"),
        "initial.velocity: formula 'log(y - 0.1)' is nan at x = 0, y = 0, t = 0",
    ),
    "formula that calls": (
        change("1e-3*y", "open(y)"),
        "initial.velocity[1]: formula \"open(y)\": 'open' is not a name it knows",
    ),
    "formula in z": (
        change("1e-3*y", "z"),
        "initial.velocity: formula 'z' uses z, but the body has 2 dimensions",
    ),
    "components": (
        change('["0", "1e-3*y"]', '["0"]'),
        "initial.velocity has 1 components; the body has 2 dimensions",
    ),
    "load components": (change("[0, 0.01]", "[0, 0.01, 0]"), "load[0].traction has 3 components"),
    "load that is not finite": (
        change("[0, 0.01]", '[0, "1/x"]'),
        "load[0].traction: formula '1/x' is inf at x = 0",
    ),
    "time": (change("until = 0.5", "until = -0.5"), "time.until = -0.5 must be a positive number"),
    "frames": (change("frames = 2", "frames = 2.5"), "output.frames = 2.5 must be a whole number"),
    "box": (
        change("[0, 0.5]]", "[0.5, 0]]"),
        "mesh: box = [[0.0, 1.0], [0.5, 0.0]]: each axis is [low, high] with low < high",
    ),
    "divisions": (change("[16, 8]", "[16]"), "mesh: box has 2 axes and divisions 1"),
    "huge": (change("[16, 8]", "[100000, 100000]"), "makes 1e+10 vertices with about 5.31e+18 bonds, which need"),
    "mesh file": (
        change("{box = [[0, 1], [0, 0.5]], divisions = [16, 8]}", '{file = "none.msh"}'),
        "none.msh' is not a file",
    ),
    "box and file": (change("{box", '{file = "a.msh", box'), "mesh: give one of file and box"),
    "not a table": (change("bonds = {horizon = 0.13}", "bonds = 3"), "bonds = 3 must be a table"),
    "not an array of tables": (change("no_fail = [", "no_fail = 3 #"), "no_fail must be an array of tables"),
    "potential": (
        change("young = 1.0", 'potential = "cubic", young = 1.0'),
        "material.potential = 'cubic' must be one of exponential, rational, linear",
    ),
    "boundary function": (
        change("horizon = 0.13", 'horizon = 0.13, boundary_function = "rough"'),
        "must be one of smooth",
    ),
    "an integer of 400 digits": (
        change("density = 1.0", "density = 1" + "0" * 400),
        "material.density = a whole number of 1329 bits must be a finite number",
    ),
    "deep": ("a = " + "[" * 3000 + "]" * 3000, "nested too deeply"),
    "horizon of another world": (change("0.13}\ncrack", "1e200}\ncrack"), "bonds.horizon = 1e+200 must be a finite"),
    "endless": (change("until = 0.5", "until = 1e50, step = 1e-10"), "that would never end"),
    "a box that numbers cannot tell": (change("[0, 0.5]]", "[1e18, 1.0000000001e18]]"), "low < high, and not so close"),
    "initial data of t": (change("1e-3*y", "t"), "initial: velocity = 't' must not depend on t"),
    "crack on the boundary": (
        change("crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]", 'crack = [{facets = "left"}]'),
        "skfem-peridynamics: crack: facets = ['left'] lie on the boundary already",
    ),
    "not TOML": ("title = ", "not TOML"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input(name, tmp_path, capsys):
    content, message = BAD[name]
    assert message in complaint(capsys, tmp_path, content)


def test_a_mesh_with_other_elements(tmp_path, capsys):
    points, cell = np.random.default_rng(1).random((8, 3)), np.arange(8)[None]
    meshio.Mesh(points, [("VTK_LAGRANGE_CURVE", cell)]).write(tmp_path / "curves.vtu")
    capsys.readouterr()
    content = change("{box = [[0, 1], [0, 0.5]], divisions = [16, 8]}", '{file = "curves.vtu"}')
    said = complaint(capsys, tmp_path, content)
    assert "cells of VTK's type 68 (VTK_LAGRANGE_CURVE) with 8 vertices, which are not read: save lines, " in said


def test_a_mesh_file_that_is_none(tmp_path, capsys):
    (tmp_path / "text.msh").write_text("hello")
    content = change("{box = [[0, 1], [0, 0.5]], divisions = [16, 8]}", '{file = "text.msh"}')
    assert "cannot be read as a mesh" in complaint(capsys, tmp_path, content)


def test_no_matplotlib_is_said_before_anything_is_made(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.app.report.figure.available", lambda: False)
    told = complaint(capsys, tmp_path, change("pictures = false", "pictures = true"))
    assert 'output.pictures = true needs matplotlib: install the extra "plot"' in told


def test_more_bonds_than_memory_holds(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("skfem_peridynamics.app.problem.cost.free_memory", lambda: 1e6)
    assert "bonds.horizon = 0.13 makes about" in complaint(capsys, tmp_path, GOOD)


def test_a_scene_that_is_not_there(tmp_path, capsys):
    assert main(["check", str(tmp_path / "no.toml")]) == 2
    assert "cannot be read: No such file" in capsys.readouterr().err
    (tmp_path / "latin.toml").write_bytes(b'title = "\xff"')
    assert main(["check", str(tmp_path / "latin.toml")]) == 2
    assert "is not UTF-8" in capsys.readouterr().err


def test_the_output_must_be_a_folder(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(GOOD)
    (tmp_path / "out").write_text("mine")
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 2
    assert "exists and is not a folder" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"


def test_a_step_beyond_the_limit_stops_with_step_and_limit(tmp_path, capsys):
    for step, factor in (("step = 0.4", "4.78"), ("safety = 5", "4.9")):
        (tmp_path / "scene.toml").write_text(change("until = 0.5", f"until = 200, {step}"))
        for command in (["check"], ["run", "--out", str(tmp_path / "out"), "--quiet"]):
            assert main([command[0], str(tmp_path / "scene.toml"), *command[1:]]) == 2
            told = capsys.readouterr().err
            assert f"{factor}" in told
            assert "times the stable limit" in told
            assert "time.above_limit = true" in told
            assert not (tmp_path / "out").exists()
    (tmp_path / "scene.toml").write_text(change("until = 0.5", "until = 200, step = 0.4, above_limit = true"))
    code = main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"])
    told = capsys.readouterr().err
    assert code == 2
    assert "the run became unstable by step 10 " in told
    assert "times the stable limit" in told
    import json

    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"].startswith("stopped: the run became")


def test_a_load_that_stops_being_a_number_is_the_scenes_fault(tmp_path, capsys):
    (tmp_path / "scene.toml").write_text(change("[0, 0.01]", '["sqrt(0.3 - t)", 0]'))
    code = main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"])
    told = capsys.readouterr().err
    assert code == 2
    assert "formula 'sqrt(0.3 - t)' is nan at x = 0, y = 0" in told
    import json

    assert json.loads((tmp_path / "out" / "summary.json").read_text())["status"].startswith("stopped: formula")


def test_check_refuses_what_run_refuses(tmp_path, capsys):
    for content, message in (
        (BAD["no bonds"][0], "without a bond"),
        (BAD["poisson"][0], "Poisson's ratio lies between"),
        (
            change('plane = "stress"', 'plane = "stress", calibrate = "discrete"').replace("0.13}", "0.4}"),
            "no vertex lies",
        ),
    ):
        (tmp_path / "scene.toml").write_text(content)
        assert main(["check", str(tmp_path / "scene.toml")]) == 2
        assert message in capsys.readouterr().err


def test_what_looks_like_a_slip_of_units_is_noted(tmp_path, capsys, caplog):
    for content, note in (
        (change("young = 1.0", "young = 1e-9"), "the run ends after 1 steps: time.until = 0.5 is"),
        (
            change("until = 0.5", "until = 0.5, step = 0.25, above_limit = true"),
            "the step of 0.25 is 2.99 times the stable limit",
        ),
        (change("until = 0.5", "until = 5e6"), "steps; are the units of time.until = 5e+06 what you mean?"),
    ):
        (tmp_path / "scene.toml").write_text(content)
        assert main(["check", str(tmp_path / "scene.toml")]) == 0
        assert note in capsys.readouterr().out
    (tmp_path / "scene.toml").write_text(change("0.13}\ncrack", "1.3}\ncrack"))
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    assert "bonds.horizon = 1.3 is larger than the body, which measures 1" in caplog.text


def test_a_run_of_one_step_under_a_growing_load_is_no_alarm(tmp_path, capsys):
    content = (
        change("young = 1.0", "young = 1e-9")
        .replace("[0, 0.01]", '[0, "0.01*t"]')
        .replace("[0, -0.01]", '[0, "-0.01*t"]')
    )
    (tmp_path / "scene.toml").write_text(content.replace('initial = {velocity = ["0", "1e-3*y"]}', ""))
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out")]) == 0
    assert "no bond came near its critical strain" in capsys.readouterr().out


def test_a_surface_in_space_is_no_body(tmp_path, capsys):
    import meshio

    flat = skfem.MeshTri().refined(2)
    points = np.vstack([flat.p, flat.p[0] ** 2]).T
    meshio.Mesh(points, [("triangle", flat.t.T)]).write(tmp_path / "shell.vtu")
    content = change("{box = [[0, 1], [0, 0.5]], divisions = [16, 8]}", '{file = "shell.vtu"}')
    assert "a surface or a curve in space is not a body" in complaint(capsys, tmp_path, content)


def test_our_own_fault_is_exit_1(tmp_path, capsys, monkeypatch):
    def broken(*args):
        raise ZeroDivisionError("oops")

    monkeypatch.setattr("skfem_peridynamics.app.problem.problem.census", broken)
    (tmp_path / "scene.toml").write_text(GOOD)
    assert main(["run", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "out"), "--quiet"]) == 1
    assert "a fault of the program, please report it: ZeroDivisionError: oops" in capsys.readouterr().err


def test_the_same_dataclasses_are_the_python_interface():
    scene = Scene.parse(GOOD)
    assert scene.material.young == 1.0
    assert scene.load[0].traction[1].text == 0.01
    assert scene.fixed[0].component == "x"
    assert tomllib.loads(GOOD)["title"] == scene.title
    with pytest.raises(SceneError, match="time.until is missing"):
        Scene.parse(GOOD.replace("time = {until = 0.5}", "time = {}"))


def test_time_dependent_loads_and_motions_agree_with_the_library():
    content = change('[0, 0.01], on = "top", layer = 0.13', '[0, "0.01*cos(3*t)*x"], on = "top"').replace(
        "displacement = 0}", 'velocity = "t*y"}'
    )
    problem = Problem(Scene.parse(content))
    x, y = problem.mesh.p
    F0, F1 = problem.load(0.0).reshape(-1, 2), problem.load(1.0).reshape(-1, 2)
    still = (
        Problem(Scene.parse(change('[0, 0.01], on = "top", layer = 0.13', '[0, 0], on = "top"')))
        .load(0.0)
        .reshape(-1, 2)
    )
    assert F1 - still == pytest.approx(np.cos(3) * (F0 - still), abs=1e-15)
    assert (F0 - still)[:, 1].sum() == pytest.approx(0.005, rel=1e-12)
    left = np.flatnonzero(x == 0)
    assert problem.fixed[0].mean_velocity(1.0, 3.0) == pytest.approx(2.0 * y[left])


def test_a_box_on_a_map(tmp_path, capsys):
    """Two metres at coordinates of millions: bonds, sides and step are those of the same box at the origin."""
    there = change("box = [[0, 1], [0, 0.5]]", "box = [[5400000, 5400001], [300000, 300000.5]]")
    there = there.replace("[[0.0, 0.25], [0.5, 0.25]]", "[[5400000.0, 300000.25], [5400000.5, 300000.25]]")
    counts = []
    for content in (GOOD, there.replace("1e-3*y", "1e-3*(y-300000)")):
        (tmp_path / "scene.toml").write_text(content)
        assert main(["check", str(tmp_path / "scene.toml")]) == 0
        counts.append([line for line in capsys.readouterr().out.splitlines() if "nodes" in line or "bonds" in line])
    assert counts[0] == counts[1]


def test_one_vertex_per_horizon_is_noted(tmp_path, caplog, capsys):
    (tmp_path / "scene.toml").write_text(change("horizon = 0.13", "horizon = 0.065"))
    assert main(["check", str(tmp_path / "scene.toml")]) == 0
    assert "bonds.horizon = 0.065 spans 1 vertices" in capsys.readouterr().out


@pytest.mark.parametrize(
    "how", ['traction = [{}, 0], on = "right"', 'traction = [{}, 0], on = "right", layer = 0.2', "body = [{}, 0]"]
)
def test_a_load_is_the_same_whether_its_formula_names_the_time_or_not(how):
    """Both are sums of the field at the vertices; on facets that is exact for linear tractions."""
    loads = []
    for formula in ("y^2", "y^2 + 0*t"):
        content = change('traction = [0, 0.01], on = "top", layer = 0.13', how.format(f'"{formula}"'))
        problem = Problem(Scene.parse(content))
        loads.append(problem.load(0.7))
    assert np.abs(loads[0]).max() > 0.0
    assert loads[1] == pytest.approx(loads[0], rel=1e-13, abs=1e-18)
    if "layer" not in how and "body" not in how:
        exact = traction(problem.full_basis, "right", lambda x: np.stack([x[1] ** 2, 0 * x[1]]))
        exact += traction(problem.full_basis, "bottom", [0.0, -0.01])
        assert loads[1] == pytest.approx(exact, rel=1e-13, abs=1e-18)


def test_all_mistakes_of_a_scene_come_together(tmp_path, capsys):
    content = (
        change("young = 1.0", "young = -1.0, nu = 0.3")
        .replace("horizon = 0.13}", "horizont = 0.13}")
        .replace("time = {until = 0.5}", "time = {}")
        .replace('component = "x", displacement = 0', 'component = "w"')
    )
    told = complaint(capsys, tmp_path, content)
    assert "6 mistakes: (1) material.young = -1.0 must be a positive number; (2) material.nu = 0.3: " in told
    assert "there is no such key; did you mean 'poisson'?" in told
    assert "did you mean 'horizon'?" in told
    assert "bonds.horizon is missing" in told
    assert "fixed[0].component = 'w' must be one of all, x, y, z" in told
    assert "time.until is missing" in told


def test_mistakes_that_only_the_mesh_shows_come_together(tmp_path, capsys):
    content = (
        change('on = "top", layer = 0.13', 'on = "roof", layer = 0.13')
        .replace('{on = "left", component = "x"', '{on = "west", component = "x"')
        .replace("1e-3*y", "1/y")
    )
    told = complaint(capsys, tmp_path, content)
    for words in ("3 mistakes", "boundary 'roof' is not in the mesh", "boundary 'west' is not", "formula '1/y' is inf"):
        assert words in told
    assert main(["check", str(tmp_path / "scene.toml")]) == 2
    assert "3 mistakes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("symbol", "table", "name"),
    [("nu", "material", "poisson"), ("E", "material", "young"), ("rho", "material", "density"), ("dt", "time", "step")],
)
def test_symbols_point_to_their_keys(symbol, table, name, tmp_path, capsys):
    told = complaint(capsys, tmp_path, change(f"{table} = {{", f"{table} = {{{symbol} = 1.0, "))
    assert f"{table}.{symbol} = 1.0: there is no such key; did you mean {name!r}?" in told


def test_fixed_sets_that_meet_with_one_value_are_no_conflict():
    """Two sides in a corner; a table without a value holds what it names."""
    sides = 'fixed = [{on = "bottom"}, {on = "left", displacement = "0*t"}, '
    problem = Problem(Scene.parse(change("fixed = [", sides)))
    held = [prescribed.dofs for prescribed in problem.fixed]
    assert [len(dofs) for dofs in held] == [34, 20, 10]  # the mouth of the slit has two vertices
    assert len(np.intersect1d(held[0], held[1])) == 2
    assert problem.fixed[0].start(0.0).tolist() == [0.0] * 34
    assert check_fixed(problem.fixed, problem.basis.N).tolist() == sorted(
        set(np.concatenate(held).tolist()), key=np.concatenate(held).tolist().index
    )
