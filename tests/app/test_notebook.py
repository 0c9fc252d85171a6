"""What scripts and notebooks get: short reprs, runs that can be read and drawn, pictures on axes, sweeps."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import skfem

import skfem_peridynamics as peri
from bodies import body_on, box
from skfem_peridynamics.app.report.plot import field_of
from skfem_peridynamics.app.scene.reading import SceneError

TABLES = {
    "title": "<torn>",
    "mesh": {"box": [[0, 1], [0, 1]], "divisions": [8, 8]},
    "material": {"young": 1.0, "toughness": 1e-4, "density": 1.0, "plane": "strain"},
    "bonds": {"horizon": 0.3},
    "crack": [{"points": [[0.0, 0.5], [0.5, 0.5]]}],
    "initial": {"velocity": ["0", "0.05*(y - 0.5)"]},
    "time": {"until": 1.0},
    "output": {"frames": 3, "pictures": False, "fields": ["stress"]},
}


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    return peri.run(peri.Scene.of(TABLES), tmp_path_factory.mktemp("run") / "out")


# ---- reprs
def test_reprs_are_a_line_and_compute_nothing():
    body = body_on(box(2, 8), 0.3, peri.Exponential(1.0, 1.0), compiled=False)
    assert repr(body.bonds) == "BondBasis: bonds not made yet, horizon/h 2.4, vertex pairs, partial volume, J constant"
    assert "parts" not in body.bonds.__dict__
    n, count = body.bonds.nbonds, body.bonds.mesh.nvertices
    assert f"BondBasis: {n:,} bonds, {n / count:.0f} a vertex, horizon/h 2.4" in repr(body.bonds)
    assert repr(body) == f"Peridynamics: Exponential law; {body.bonds!r}"
    assert ", balanced, J constant" in repr(body.bonds.balanced())
    glass = peri.Material.from_elastic(young=72e9, toughness=135.0, density=2440.0, plane="stress")
    made = peri.Peridynamics(body.bonds, glass, no_fail=[1, 2])
    assert repr(made).startswith(
        "Peridynamics: exponential law, young 7.2e+10, toughness 135, density 2440, 2 no-fail vertices; BondBasis: "
    )
    two = peri.Composite(glass, {"fibre": glass})
    assert "materials matrix, fibre" in repr(peri.Peridynamics(body.bonds, two))
    state = next(peri.central_difference(body, peri.mass_matrix(body.basis), dt=0.01, until=0.05))
    assert repr(state) == "State: t = 0, step 0 of 0.01, |u| up to 0, |v| up to 0"
    assert "energies" not in state.__dict__
    still = next(peri.static(body, steps=1, fixed=[peri.Prescribed(np.arange(body.basis.N), 0.0)]))
    assert repr(still).startswith("Equilibrium: t = ")
    for thing in (body, body.bonds, made):
        assert thing._repr_html_().count("<svg") == 1
        assert len(repr(thing)) < 200
    assert "<svg" not in body_on(box(3, 2), 0.9)._repr_html_()  # scikit-fem draws none in space


# ---- runs
def test_a_run_is_a_dict_that_knows_its_files(done):
    assert isinstance(done, dict)
    assert json.loads((done.folder / "summary.json").read_text())["nodes"] == done["nodes"] == 85
    with open(done.folder / "history.csv") as file:
        rows = list(csv.reader(file))
    assert list(done.history) == rows[0]
    assert done.history["t"].tolist() == [float(row[0]) for row in rows[1:]]
    assert len(done.frames) == 3
    assert [shot.t for shot in done.frames] == [done.frames[k].t for k in range(3)]
    assert done.frames[-1].t == 1.0
    assert [shot.t for shot in done.frames[1:]] == [done.frames[1].t, 1.0]
    with pytest.raises(IndexError):
        done.frames[3]
    assert done.headline in done._repr_html_()
    again = peri.FinishedRun(done.folder)
    assert again == json.loads((done.folder / "summary.json").read_text())
    assert again.headline == done.headline
    with pytest.raises(SceneError):
        peri.FinishedRun(done.folder / "nothing")


def test_a_finished_run_is_given_back(done):
    """As the same kind of thing, without running."""
    again = peri.run(peri.Scene.of(TABLES), done.folder)
    assert isinstance(again, peri.FinishedRun)
    assert again["seconds"] == json.loads((done.folder / "summary.json").read_text())["seconds"]


def test_a_report_of_a_run(done):
    pytest.importorskip("matplotlib")
    path = done.report()
    assert path == done.folder / "report.html"
    assert "&lt;torn&gt;" in path.read_text()


# ---- pictures
def axes():
    pytest.importorskip("matplotlib")
    from matplotlib.figure import Figure

    return Figure().add_subplot()


def test_a_picture_shows_the_numbers_that_were_asked_for():
    stiff = peri.Material.from_elastic(young=1.0, toughness=1e-2, density=1.0, plane="stress")
    body = peri.Peridynamics(body_on(box(2, 6), 0.4).bonds, stiff)
    p, dim = body.bonds.mesh.p, 2
    u = np.where(p[0] > 0.55, 0.5, 0.0)[:, None] * np.array([1.0, 0.0])
    shown = peri.plot(body, u.ravel(), ax=axes(), scale=2.0)
    np.testing.assert_array_equal(shown.collections[0].get_array(), 1.0 - peri.damage(body, u.ravel()).intact)
    assert shown.collections[0].get_clim() == (0.0, 1.0)
    low, high = shown.get_xlim()
    assert low < 0.0 < 2.0 < high < 2.2  # moved by twice the displacement
    shown = peri.plot(body, u.ravel(), "displacement", ax=axes())
    np.testing.assert_allclose(shown.collections[0].get_array(), np.linalg.norm(u, axis=1))
    small = 1e-6 * np.array([[2.0, 1.0], [0.0, 3.0]])
    sheared = (p.T @ small.T).ravel()
    tensor = np.zeros((len(p.T), 3, 3))
    tensor[:, :dim, :dim] = peri.stress(body, sheared)
    a, b, c = tensor[:, 0, 0], tensor[:, 1, 1], tensor[:, 0, 1]
    mises = np.sqrt(a**2 - a * b + b**2 + 3 * c**2)
    largest = (a + b) / 2 + np.sqrt(((a - b) / 2) ** 2 + c**2)
    for of, expected in (("von Mises", mises), ("largest principal", largest), (p[1], p[1])):
        shown = peri.plot(body, sheared, of, ax=axes(), cmap="gray")
        np.testing.assert_allclose(shown.collections[0].get_array(), expected, rtol=1e-9, atol=1e-18)
        assert shown.collections[0].get_cmap().name == "gray"


def test_a_bar_is_a_curve():
    body = body_on(box(1, 6), 0.4)
    u = 0.1 * body.bonds.mesh.p[0]
    line = peri.plot(body, u, "displacement", ax=axes()).lines[0]
    order = np.argsort(body.bonds.mesh.p[0])
    np.testing.assert_allclose(line.get_xdata(), (1.1 * body.bonds.mesh.p[0])[order])
    np.testing.assert_allclose(line.get_ydata(), u[order])


def test_pictures_that_cannot_be_are_refused(done):
    body, space = body_on(box(2, 3), 0.9), body_on(box(3, 2), 0.9)
    for call, said in (
        (lambda: peri.plot(space), "view"),
        (lambda: peri.plot(body, np.zeros(3)), r"u has shape \(3,\); the mesh has 32 unknowns"),
        (lambda: peri.plot(body, of="stres"), "must be one of 'damage'"),
        (lambda: peri.plot(body, of=np.zeros(3)), r"of has shape \(3,\); the mesh has 16 vertices"),
        (lambda: peri.plot(body.bonds.mesh), "needs a body"),
        (lambda: peri.plot(body.bonds.mesh, of="von Mises"), "needs a body"),
        (lambda: peri.plot(body, of="von Mises"), "one Poisson "),
        (lambda: peri.plot(skfem.MeshQuad()), "must be a body, or a mesh of lines or triangles"),
        (lambda: peri.plot(body.basis), "must be a body"),
    ):
        with pytest.raises(ValueError, match=said):
            call()


def test_a_frame_is_drawn_from_its_fields(done):
    shown = done.plot(ax=axes())
    np.testing.assert_allclose(shown.collections[0].get_array(), done.frames[-1].broken)
    assert done.frames[-1].broken.max() > 0.3
    of_frame = done.plot("von Mises", frame=1, ax=axes()).collections[0].get_array()
    a, b, _, c, *_ = done.frames[1].fields["stress"].T
    z = 0.25 * (a + b)  # plane strain, the ratio of bonds alone
    mises = np.sqrt(((a - b) ** 2 + (b - z) ** 2 + (z - a) ** 2) / 2 + 3 * c**2)
    np.testing.assert_allclose(of_frame, mises, rtol=1e-5, atol=1e-6 * mises.max())
    np.testing.assert_allclose(done.frames[1].fields["damage"], done.frames[1].broken, atol=1e-6)


def test_a_body_in_space_is_seen_through_where_it_is_cracked():
    pyvista = pytest.importorskip("pyvista", reason="pyvista (the extra view) is not installed")
    from skfem_peridynamics.app.report.view import grid_of

    body = body_on(box(3, 4), 0.6, peri.Exponential(1.0, 1e-2))
    p = body.bonds.mesh.p
    u = (np.where(p[0] > 0.55, 0.5, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])).ravel()
    grid = grid_of(body, u, "damage", scale=2.0)
    assert grid.n_cells == body.bonds.mesh.nelements
    np.testing.assert_allclose(grid.points, p.T + 2.0 * u.reshape(-1, 3))
    np.testing.assert_allclose(grid["damage"], field_of(body, u, "damage", {}))
    volumes = np.abs(grid.compute_cell_sizes()["Volume"])
    assert volumes.sum() == pytest.approx(2.0, rel=1e-6)  # a unit cube pulled out by one
    for options, actors in (({}, 2), ({"crack": False}, 1), ({"slices": True}, 2)):
        plotter = peri.view(body, u, off_screen=True, **options)
        assert isinstance(plotter, pyvista.Plotter)
        assert len(plotter.actors) - len(plotter.scalar_bars) == actors
        plotter.close()


# ---- sweeps
def test_a_sweep_goes_on_where_it_was(tmp_path):
    """A row a combination, in order; finished runs are not made again; one that fails says why."""
    tables = TABLES | {"output": {"frames": 0, "pictures": False}}
    over = {"bonds.horizon": [0.3, np.float64(0.4)], "load": [[], [{"body": ("0", "sqrt(0.5 - t)")}]]}
    rows = peri.sweep(tables, tmp_path / "out", over, columns=["nodes", "status", "elastic.young"])
    assert [row["bonds.horizon"] for row in rows] == [0.3, 0.3, 0.4, 0.4]
    assert [row["status"] for row in rows] == ["finished", None] * 2
    assert [row["elastic.young"] for row in rows] == [1.0, None] * 2
    assert [bool(row["mistake"]) for row in rows] == [False, True] * 2
    assert "sqrt" in rows[1]["mistake"]
    with open(tmp_path / "out" / "sweep.csv") as file:
        table = list(csv.DictReader(file))
    assert [row["bonds.horizon"] for row in table] == ["0.3", "0.3", "0.4", "0.4"]
    assert table[0]["nodes"] == "85"
    first = Path(rows[0]["folder"])
    assert first.name.startswith("horizon=0.3_load=_")
    before = (first / "history.csv").stat().st_mtime_ns
    # other values first: each is found by its own; and by a scene in place of its tables
    for scene in (tables, peri.Scene.of(tables)):
        again = peri.sweep(scene, tmp_path / "out", {"bonds.horizon": [0.5, 0.3], "load": [[]]}, columns=["bonds"])
        assert [row["mistake"] for row in again] == ["", ""]
        assert again[0]["bonds"] > again[1]["bonds"]
        assert again[1]["folder"] == rows[0]["folder"]
        assert (first / "history.csv").stat().st_mtime_ns == before
    # another scene is another run
    other = tables | {"time": {"until": 0.5}}
    changed = peri.sweep(other, tmp_path / "out", {"bonds.horizon": [0.3], "load": [[]]}, columns=["steps"])
    assert changed[0]["folder"] != rows[0]["folder"]
    assert changed[0]["steps"] < peri.FinishedRun(first)["steps"]


def test_a_sweep_that_makes_no_table_is_refused(tmp_path):
    tables = TABLES | {"output": {"frames": 0, "pictures": False}}
    good = {"bonds.horizon": [0.3]}
    for over, options, said in (
        ({"bonds.horizn": [1.0]}, {}, "did you mean 'horizon'?"),
        ({}, {}, "must have a key"),
        ({"bonds.horizon": []}, {}, "a value or more"),
        ({"bonds.horizon": 0.2}, {}, "a value or more"),
        ({"title": "abc"}, {}, "a value or more"),
        ({"bonds.horizon": [0.3], "bonds": [{"horizon": 0.4}]}, {}, "one is a part of the other"),
        (good, {"columns": "bonds"}, "must be a list of keys"),
        (good, {"columns": ["bonds.horizon"]}, "none of those in over"),
        (good, {"processes": 0}, "1 or more"),
        (good, {"processes": 1.5}, "1 or more"),
    ):
        with pytest.raises(SceneError) as caught:
            peri.sweep(tables, tmp_path / "none", over, **options)
        assert said in str(caught.value)
    assert not (tmp_path / "none").exists()
    with pytest.raises(SceneError, match="the summary has no 'bondz'"):
        peri.sweep(tables, tmp_path / "typo", good, columns=["bondz"])


def test_a_run_that_was_written_over_is_not_read(tmp_path):
    tables = TABLES | {"output": {"frames": 2, "pictures": False}}
    one = peri.run(peri.Scene.of(tables), tmp_path / "out")
    assert one.frames[-1].t == 1.0
    two = peri.run(peri.Scene.of(tables | {"time": {"until": 0.5}}), tmp_path / "out", resume=False)
    assert two.frames[-1].t == 0.5
    for read in (lambda: one.frames[-1], lambda: one.history):
        with pytest.raises(SceneError, match="has another run by now"):
            read()
    with pytest.raises(IndexError, match="frame 2 of 2"):
        two.frames[2]


@pytest.mark.slow
def test_a_sweep_over_processes_is_that_of_one(tmp_path):
    tables = TABLES | {"output": {"frames": 0, "pictures": False}}
    over = {"bonds.horizon": [0.3, 0.4, 0.5]}
    one, two = (peri.sweep(tables, tmp_path / str(n), over, processes=n) for n in (1, 2))
    drop = ("folder", "energy_drift")
    assert [{k: v for k, v in row.items() if k not in drop} for row in one] == [
        {k: v for k, v in row.items() if k not in drop} for row in two
    ]


def test_pictures_are_loaded_late():
    """Neither matplotlib, nor pyvista, nor rich is loaded with the package and its scenes."""
    code = (
        "import sys, skfem_peridynamics as p; p.run, p.Scene, p.FinishedRun; "
        "assert not {'matplotlib', 'pyvista', 'rich'} & set(sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
