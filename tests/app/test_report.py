"""What a run measures, its report and its pictures: columns, figures, one page that opens offline, drawn from files."""

import base64
import dataclasses
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import tomllib
from html.parser import HTMLParser
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
import skfem
from scipy.integrate import trapezoid

from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.files.identity import as_tables
from skfem_peridynamics.app.files.results import Results, Snapshot
from skfem_peridynamics.app.problem.domain import cracked_mesh
from skfem_peridynamics.app.problem.starters import starter
from skfem_peridynamics.app.report.body_pictures import plot_damage
from skfem_peridynamics.app.report.deformed_pictures import deformation_scale, moved
from skfem_peridynamics.app.report.figure import new_figure, own_style, save
from skfem_peridynamics.app.report.run_page import page
from skfem_peridynamics.app.report.run_pictures import draw
from skfem_peridynamics.app.report.setup_picture import SetUp, plot_setup
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.app.scene.toml_text import to_toml
from skfem_peridynamics.app.scene.units import UnitsTable

EXAMPLES = Path(__file__).parents[2] / "examples"
TORN = """
title = "Torn <strip> & more"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [32, 16]}
material = {young = 1.0, toughness = 1e-3, density = 1.0, plane = "stress"}
bonds = {horizon = 0.125}
crack = [{points = [[0.5, 0.0], [0.5, 0.125]]}]
fixed = [
    {on = "left", displacement = 0},
    {on = "right", component = "x", velocity = "0.08 * min(t / 0.5, 1)"},
]
no_fail = [{on = "left", width = 0.25}, {on = "right", width = 0.25}]
time = {until = 3.0}
probe = [{at = [0.8, 0.25], name = "gauge"}, {at = [0.2, 0.25]}]
measure = {j_integral = 0.26}
units = {length = "mm", force = "N", time = "ms"}
output = {frames = 6, history = 44, fields = ["stress", "strain"], pictures = true}
"""


def change(old, new, content=TORN):
    assert old in content
    return content.replace(old, new)


@pytest.fixture(scope="module")
def torn(tmp_path_factory):
    out = tmp_path_factory.mktemp("torn")
    return out, run(Scene.parse(TORN), out, with_report=True)


class Page(HTMLParser):
    """Tags with their attributes, and all text."""

    def __init__(self, content):
        super().__init__()
        self.tags, self.open, self.text = [], [], ""
        self.feed(content)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in ("img", "meta", "source"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


# ---- columns
def test_columns_of_what_is_measured(torn):
    out, summary = torn
    history = Results.read(out).history
    assert list(history)[10:] == [
        *("crack_reach", "crack_area", "crack_length", "tips", "tip_x", "tip_y", "cracks", "crushed", "j_integral"),
        *("reaction_left_x", "reaction_left_y", "reaction_right_x", "reaction_right_y"),
        *("probe_gauge_ux", "probe_gauge_uy", "probe_gauge_vx", "probe_gauge_vy"),
        *("probe_1_ux", "probe_1_uy", "probe_1_vx", "probe_1_vy"),
    ]
    assert history["crack_reach"][0] == 0.0
    assert 0.25 < history["crack_reach"][-1] < 0.45  # 0.375 to go through
    assert np.nanmax(np.abs(history["tip_x"] - 0.5)) < 0.2
    assert summary["crack_length"] == history["crack_length"][-1]
    slopes = [np.polyfit(history["t"][k : k + 5], history["crack_reach"][k : k + 5], 1)[0] for k in range(40)]
    assert summary["largest_tip_speed"] == pytest.approx(max(slopes))
    assert summary["energy_per_crack_length"] == pytest.approx(1e-3, rel=0.15)  # 1.12e-3: partly opened bonds beside it
    assert summary["energy_per_crack_area"] == pytest.approx(1e-3, rel=0.05)  # 0.976e-3
    assert summary["elastic"]["toughness"] == pytest.approx(1e-3)


def test_reactions_do_the_work(torn):
    """The right side moves with a known velocity: the power of its reaction is the rate of the work."""
    history = Results.read(torn[0]).history
    t, speed = history["t"], 0.08 * np.minimum(history["t"] / 0.5, 1.0)
    power = history["reaction_right_x"] * speed
    fine = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(t))])
    assert np.abs(fine - history["work"]).max() < 0.03 * history["work"].max()
    assert history["reaction_left_x"].min() < 0.0 < history["reaction_right_x"].max()


def test_probes_are_fields_at_points(torn):
    out, _ = torn
    results = Results.read(out)
    last = results.last
    at = np.argmin(np.linalg.norm(last.mesh.p - [[0.8125], [0.25]], axis=0))
    between = last.fields["displacement"][at, 0]
    beside = last.fields["displacement"][np.argmin(np.linalg.norm(last.mesh.p - [[0.78125], [0.25]], axis=0)), 0]
    probe = results.history["probe_gauge_ux"][-1]
    assert min(between, beside) <= probe <= max(between, beside)
    moved = trapezoid(results.history["probe_gauge_vx"], results.history["t"])
    assert moved == pytest.approx(probe, rel=0.01)  # 8e-4 off: a motion that rings, in 44 rows


def test_reactions_of_a_body_at_rest(tmp_path):
    """Statics, and a load: what holds the left is minus what pulls at the right."""
    scene = Scene.parse("""
    mesh = {box = [[0, 1], [0, 0.5]], divisions = [16, 8]}
    material = {young = 1.0, density = 1.0, plane = "stress", potential = "linear"}
    bonds = {horizon = 0.25}
    fixed = [{on = "left", displacement = 0}]
    load = [{traction = ["1e-3 * t", 0], on = "right"}]
    time = {until = 1.0, scheme = "static", steps = 2}
    probe = [{at = [1.0, 0.25]}]
    output = {frames = 1, history = 3, pictures = false}
    """)
    summary = run(scene, tmp_path)
    history = Results.read(tmp_path).history
    assert list(history)[10:] == ["reaction_left_x", "reaction_left_y", "probe_0_ux", "probe_0_uy"]
    assert np.allclose(history["reaction_left_x"], -0.5e-3 * history["t"], atol=1e-10)
    end = Results.read(tmp_path).last
    corner = np.argmin(np.abs(end.mesh.p - [[1.0], [0.25]]).sum(axis=0))
    assert summary["probe_0_ux"] == pytest.approx(end.fields["displacement"][corner, 0], rel=1e-6)


def test_reactions_are_what_the_momentum_lacks(tmp_path):
    """Pulled at the right from rest, held at the left: momentum is the time integral of load and reaction."""
    scene = Scene.parse("""
    mesh = {box = [[0, 1], [0, 0.5]], divisions = [16, 8]}
    material = {young = 1.0, density = 2.0, plane = "stress", potential = "linear"}
    bonds = {horizon = 0.25}
    fixed = [{on = "left", displacement = 0}]
    load = [{traction = ["1e-3 * min(t, 1)", 0], on = "right"}]
    time = {until = 3.0, safety = 0.1}
    output = {frames = 1, history = 1000, pictures = false}
    """)
    run(scene, tmp_path)
    results = Results.read(tmp_path)
    t, held = results.history["t"], results.history["reaction_left_x"]
    pulled = 0.5e-3 * np.minimum(t, 1.0)
    from skfem_peridynamics.geometry.simplices import vertex_volumes

    last = results.last
    momentum = 2.0 * vertex_volumes(last.mesh) @ last.fields["velocity"][:, 0]
    assert abs(trapezoid(held, t)) > 0.3 * trapezoid(pulled, t)
    assert trapezoid(pulled + held, t) == pytest.approx(momentum, rel=1e-3)


def test_reactions_of_a_body_that_is_carried(tmp_path):
    """All of it moves with acceleration 1 against a load of -1.5: the reaction is its mass and that."""
    run(
        Scene.parse("""
        mesh = {box = [[0, 1], [0, 0.5]], divisions = [8, 4]}
        material = {young = 1.0, density = 2.0, plane = "stress", potential = "linear"}
        bonds = {horizon = 0.3}
        fixed = [{where = "1", component = "x", velocity = "t"}]
        load = [{body = [-3.0, 0]}]
        time = {until = 1.0}
        output = {frames = 0, history = 3, pictures = false}
        """),
        tmp_path,
    )
    assert Results.read(tmp_path).history["reaction_fixed0_x"] == pytest.approx([1.5, 2.5, 2.5], rel=1e-9)


@pytest.mark.parametrize("more", ["", ', breaking = 1.5, compression = "elastic"'])
def test_what_is_measured_goes_on_with_a_run(tmp_path, more):
    """Columns, what is not a number among them, and broken bonds, through checkpoints."""
    from faults import stop

    content = change('plane = "stress"', f'plane = "stress"{more}')
    scene = Scene.parse(change("pictures = true", "pictures = false, checkpoint_every = 5", content))
    for name, steps in (("whole", ()), ("parts", (15, 30))):
        for step in steps:
            stop(scene, tmp_path / name, step, resume=True)
        run(scene, tmp_path / name, resume=True)
    whole, parts = (Results.read(tmp_path / name) for name in ("whole", "parts"))
    assert parts.summary["resumed_at_steps"] != []
    assert not more or whole.history["broken_bonds"][25] > 0
    for file in ("history.csv", "frame_0005.vtu"):
        assert (tmp_path / "whole" / file).read_bytes() == (tmp_path / "parts" / file).read_bytes()


def test_rows_of_other_columns_are_not_gone_on_with(tmp_path):
    import dataclasses

    from faults import stop
    from skfem_peridynamics.app.files.checkpoint import NAME, read_checkpoint, write_checkpoint

    scene = Scene.parse(change("pictures = true", "pictures = false, checkpoint_every = 5"))
    stop(scene, tmp_path, 20)
    known = read_checkpoint(tmp_path / NAME)
    write_checkpoint(tmp_path, dataclasses.replace(known, rows=[row[:-1] for row in known.rows]))
    with pytest.raises(SceneError, match="its rows are none of this scene"):
        run(scene, tmp_path, resume=True)
    breaks = dataclasses.replace(scene, material=dataclasses.replace(scene.material, breaking=2.0))
    stop(breaks, tmp_path, 20, resume=False)
    known = read_checkpoint(tmp_path / NAME)
    forged = dataclasses.replace(known.state, broken=(np.array([10**7]),) * len(known.state.broken))
    write_checkpoint(tmp_path, dataclasses.replace(known, state=forged))
    with pytest.raises(SceneError, match="the broken bonds of the state to start from are not bonds of this body"):
        run(breaks, tmp_path, resume=True)


def test_notes_are_those_of_the_run_itself(tmp_path):
    import logging
    import threading

    from skfem_peridynamics.app.run.logged import logged_warnings

    log = logging.getLogger("skfem_peridynamics")
    with logged_warnings() as notes:
        other = threading.Thread(target=log.warning, args=("theirs",))
        other.start()
        other.join()
        log.warning("ours %d", 1)
    log.warning("later")
    assert notes == ["ours 1"]


def test_breaking_in_a_scene(tmp_path):
    scene = Scene.parse(change('plane = "stress"', 'plane = "stress", breaking = 2.0, compression = "elastic"'))
    summary = run(scene, tmp_path)
    history = Results.read(tmp_path).history
    assert summary["broken_bonds"] == history["broken_bonds"][-1] > 20
    assert (np.diff(history["broken_bonds"]) >= 0).all()
    assert (np.diff(history["dissipated"]) >= 0).all()
    assert summary["dissipated"] > 0.3 * 1e-3 * 0.3
    assert summary["energy_drift"] < 0.01
    assert any("at 2 times the critical strain" in note and "86%" in note for note in summary["notes"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("j_integral = 0.26", "j_integral = 0.2", "j_integral = 0.2: the radius must be at least two horizons, 0.25,"),
        ("at = [0.2, 0.25]", "at = [0.2]", "probe[1].at = [0.2] has 1 coordinates; the body has 2"),
        ("at = [0.2, 0.25]", "at = [2, 0.25]", "probe[1].at: (2, 0.25) is outside of the body; its nearest"),
        ("measure = {", 'measure = {reactions = "yes", ', "measure.reactions = 'yes' must be true or false"),
        ('"stress", "strain"', '"stres"', "output.fields[0] = 'stres' must be one of stress, strain"),
        ('plane = "stress"', 'plane = "stress", breaking = 0.5', "material: at = 0.5: bonds break at 1 or more times"),
        ('length = "mm"', 'lenght = "mm"', "units.lenght = 'mm': there is no such key; did you mean 'length'?"),
        ('plane = "stress"', 'plane = "stress", compression = "no"', "must be one of soften, elastic"),
    ],
)  # fmt: skip
def test_bad_keys(old, new, message, tmp_path):
    with pytest.raises(SceneError) as error:
        run(Scene.parse(change(old, new)), tmp_path / "out")
    assert message in str(error.value)
    assert not (tmp_path / "out").exists()


def test_measures_that_have_no_meaning(tmp_path):
    bar = """
    mesh = {box = [[0, 1]], divisions = [20]}
    material = {young = 1.0, toughness = 1.0, density = 1.0}
    bonds = {horizon = 0.15}
    time = {until = 0.1}
    """
    for measure, message in (
        ("crack = true", "measure.crack = true: a crack in 1D is a point"),
        ("j_integral = 0.5", "measure.j_integral = 0.5: it is computed in 2D"),
        ("reactions = true", "measure.reactions = true: no motion is prescribed"),
    ):
        with pytest.raises(SceneError, match=message):
            run(Scene.parse(bar + f"measure = {{{measure}}}"), tmp_path / "out")
    summary = run(Scene.parse(bar + "output = {pictures = false}"), tmp_path / "out")
    assert "crack_length" not in summary


# ---- frames
def test_fields_of_frames(torn):
    """Every field has its name and a note of its unit; vectors have three components, tensors six."""
    out, _ = torn
    raw = (out / "frame_0005.vtu").read_text()
    root = ElementTree.fromstring(raw)
    arrays = {one.get("Name"): one for one in root.find(".//PointData")}
    assert list(arrays) == ["displacement", "velocity", "damage", "intact", "Z", "stress", "von_mises", "strain"]
    units = {name: one.find("InformationKey").text for name, one in arrays.items()}
    assert units == {
        "displacement": "mm", "velocity": "mm/ms", "damage": "1", "intact": "1", "Z": "1", "stress": "MPa",
        "von_mises": "MPa", "strain": "1",
    }  # fmt: skip
    assert all(one.find("InformationKey").get("name") == "UNITS_LABEL" for one in arrays.values())
    content = meshio.read(out / "frame_0005.vtu")
    shapes = {name: data.shape[1:] for name, data in content.point_data.items()}
    vectors, tensors = dict.fromkeys(("displacement", "velocity"), (3,)), dict.fromkeys(("stress", "strain"), (6,))
    assert shapes == vectors | tensors | dict.fromkeys(("damage", "intact", "Z", "von_mises"), ())
    assert content.point_data["stress"][:, [2, 4, 5]].max() == 0.0
    np.testing.assert_allclose(content.point_data["damage"], 1.0 - content.point_data["intact"], atol=1e-7)
    a, b, _, c, *_ = content.point_data["stress"].T.astype(float)
    np.testing.assert_allclose(content.point_data["von_mises"], np.sqrt(a**2 - a * b + b**2 + 3 * c**2), rtol=1e-5)
    named = [[arrays[name].get(f"ComponentName{k}") for k in range(6)] for name in ("stress", "displacement")]
    assert named == [["xx", "yy", "zz", "xy", "yz", "xz"], ["x", "y", "z", None, None, None]]


def test_frames_tell_which_material_is_where(tmp_path):
    text = (EXAMPLES / "notched_part.toml").read_text()
    scene = Scene.parse(text, EXAMPLES, ["time.until=2e-6", "output={frames=1, pictures=false}"])
    run(scene, tmp_path)
    content = meshio.read(tmp_path / "frame_0000.vtu")
    mesh = cracked_mesh(scene)
    expected = np.zeros(mesh.nelements, dtype=int)
    expected[mesh.subdomains["inclusion"]] = 1
    np.testing.assert_array_equal(content.cell_data["material"][0], expected)
    assert Results.read(tmp_path).last.mesh.nelements == mesh.nelements


# ---- the report
def check_page(content):
    """Well-formed, no address of anything outside, no script, pictures that are pictures."""
    found = Page(content)
    assert found.open == []
    assert not [tag for tag, _ in found.tags if tag in ("script", "link", "iframe", "object")]
    for _, attributes in found.tags:
        for name in ("src", "href", "srcset", "action"):
            assert attributes.get(name, "data:").startswith("data:")
        assert not [name for name in attributes if name.startswith("on")]
    assert "@import" not in content
    assert "url(" not in content
    pictures = [attributes for tag, attributes in found.tags if tag == "img"]
    for one in pictures:
        assert base64.b64decode(one["src"].partition("base64,")[2], validate=True)[:8] == b"\x89PNG\r\n\x1a\n"
        assert one["alt"]
    return found, pictures


def test_a_report_is_one_page(torn):
    out, summary = torn
    found, pictures = check_page((out / "report.html").read_text())
    assert len(pictures) == 7
    phones = [dict(attrs) for tag, attrs in found.tags if tag == "source"]
    assert len(phones) == 7
    assert not {one["srcset"] for one in phones} & {one["src"] for one in pictures}
    text = " ".join(found.text.split())
    for said in (
        "Torn <strip> & more",
        # the strip is torn in one go between two rows: 2.98 of the Rayleigh speed is no speed of a tip
        "Damage has spread over 0.4073 mm, and not as a single crack.",
        "of the Rayleigh speed, which no crack outruns",
        "energy drift",
        f"{summary['energy_drift']:.2e} of the largest energy",
        "not estimated; run --estimate",
        "setup",
        "skfem-peridynamics run scene.toml --out out --report",
        "of G_c",
        summary["run"]["mesh"],
    ):
        assert said in text, said


def test_the_scene_in_the_report_runs(torn):
    out, summary = torn
    content = (out / "report.html").read_text()
    from html import unescape

    text = unescape(re.search(r"<details>.*?<pre>(.*?)</pre>", content, re.S)[1])
    assert as_tables(Scene.parse(text)) == summary["run"]["scene"]


def test_toml_round_trip():
    tables = {
        "title": 'quotes " \\ and \x07 \x7f é',
        "a": {"x": 1e-30, "y": -0.1, "n": 3, "yes": True, "list": [[1.0, 2.0], [3.0, 4.5]], "none": []},
        "many": [{"f": "sin(x) > 0"}, {"g": 1e300}],
    }
    assert tomllib.loads(to_toml(tables)) == tables
    for name in ("glass_branching.toml", "double_cantilever.toml", "block3d.toml", "notched_part.toml"):
        known = as_tables(Scene.read(EXAMPLES / name))
        assert tomllib.loads(to_toml(known)) == known


def test_verdicts(tmp_path):
    """A sentence for every end of a run."""
    from skfem_peridynamics.app.report.headline import verdict

    def of(**summary):
        return verdict(Results(tmp_path, summary, {}, ()))

    assert of() == "The run has not ended; this is what it has written so far."
    assert of(status="finished", largest_Z=0.5) == (
        "No bond has softened; the largest strain of a bond was 0.5 of the critical one."
    )
    assert of(status="stopped: of power", softened_bonds=4).startswith("The run did not finish: of power. Bonds have")
    grown = of(
        status="finished",
        crack_length=0.5,
        crack_reach=0.3,
        tips=2,
        largest_tip_speed=1.0,
        elastic={"rayleigh_speed": 2.0},
    )
    solid = of(status="finished", crack_area=0.5, crack_reach=0.3, largest_tip_speed=0.0, elastic={})
    assert solid == "A crack of 0.5 has opened, 0.3 far."
    assert grown == "The crack grew by 0.5, and has 2 tips; its tip ran at up to 0.50 of the Rayleigh speed."


def test_what_a_stranger_wrote_is_text(tmp_path):
    """Nothing in a summary becomes markup."""
    nasty = "<script>alert(1)</script>"
    summary = {"title": nasty, "status": f"stopped: {nasty}", "notes": [nasty], "seconds": {nasty: 1.0}, "rule": nasty}
    summary["run"] = {"scene": {"title": nasty, "mesh": {"file": nasty}}, "versions": {nasty: nasty}, "mesh": nasty}
    content = page(Results(tmp_path, summary, {}, (), summary["run"]["scene"]), {})
    check_page(content)
    assert "<script>" not in content
    assert content.count("&lt;script&gt;") >= 8


@pytest.mark.slow
def test_an_estimate_stands_in_the_report(tmp_path):
    scene = Scene.parse(change("until = 3.0", "until = 0.1"))
    summary = run(scene, tmp_path, with_estimate=True, with_report=True)
    text = Page((tmp_path / "report.html").read_text()).text
    assert f"{summary['error_estimate']:.2e}: relative L2 error of u" in text
    assert "No bond has softened" in text


def test_a_report_of_a_run_that_breaks_down(tmp_path):
    from skfem_peridynamics import UnstableRun

    wild = change("time = {until = 3.0}", "time = {until = 20.0, step = 0.2, above_limit = true}")
    with pytest.raises(UnstableRun):
        run(Scene.parse(wild), tmp_path, with_report=True)
    text = Page((tmp_path / "report.html").read_text()).text
    assert "The run did not finish: the run became unstable" in text
    assert "is 4" in text or "times the stable limit" in text  # the note says why


def test_plot_draws_from_the_files(torn, tmp_path, capsys):
    out = tmp_path / "copy"
    shutil.copytree(torn[0], out)
    before = {name: (out / name).read_bytes() for name in ("energies.png", "crack.png", "measures.png", "history.csv")}
    for name in ("damage.png", "energies.png", "crack.png", "measures.png", "report.html"):
        (out / name).unlink()
    assert main(["plot", str(out), "--animate"]) == 0
    said = capsys.readouterr().out
    assert "damage.png, deformed.png, stress.png, course.png, energies.png, crack.png, measures.png, anim" in said
    assert {name: (out / name).read_bytes() for name in before} == before  # the same numbers, the same pictures
    from PIL import Image

    with Image.open(out / "animation.gif") as moving:
        assert moving.n_frames == 6
        assert moving.width > 300
    assert not list(out.glob("*.part*"))


def test_an_animation_that_fails_leaves_nothing(torn, tmp_path, monkeypatch):
    from skfem_peridynamics.app.report import deformed_pictures
    from skfem_peridynamics.app.report.run_pictures import draw_animation

    out = tmp_path / "copy"
    shutil.copytree(torn[0], out)
    before = sorted(path.name for path in out.iterdir())
    calls = []

    whole = deformed_pictures.colours

    def draw(axes, body, *more, **options):
        calls.append(body)
        if len(calls) == 3:
            raise MemoryError
        return whole(axes, body, *more, **options)

    monkeypatch.setattr(deformed_pictures, "colours", draw)
    with pytest.raises(MemoryError):
        draw_animation(Results.read(out))
    assert sorted(path.name for path in out.iterdir()) == before


@pytest.mark.slow
def test_reports_in_one_and_three_dimensions(tmp_path):
    for dim, box, divisions in ((1, "[[0, 1]]", "[20]"), (3, "[[0, 1], [0, 0.5], [0, 0.5]]", "[12, 6, 6]")):
        out = tmp_path / str(dim)
        summary = run(
            Scene.parse(f"""
            mesh = {{box = {box}, divisions = {divisions}}}
            material = {{young = 1.0, toughness = 1e-4, density = 1.0}}
            bonds = {{horizon = 0.21}}
            fixed = [{{on = "left", displacement = 0}}, {{on = "right", component = "x", velocity = 0.3}}]
            time = {{until = 1.0}}
            output = {{frames = 2, history = 4}}
            """),
            out,
            with_report=True,
        )
        _, pictures = check_page((out / "report.html").read_text())
        assert len(pictures) == (4 if dim == 1 else 5)  # the set-up is one
        assert ("crack_area" in summary) == (dim == 3)
        assert "crack_length" not in summary
        assert main(["plot", str(out)]) == 0
    assert main(["plot", str(out), "--animate"]) == 2


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("summary.json", "{", "cannot be read"),
        ("summary.json", "[]", "holds no table"),
        ("history.csv", "t,step\n1\n", "rows of several lengths"),
        ("history.csv", "t,step\na,b\n", "could not convert"),
        ("history.csv", "t,step\n1,2\n", "has no column 'kinetic'"),
        ("history.csv", "t,kinetic,intact,softened,total,work\n0,0,0,0,0,inf\n", "'work' that no run writes"),
        ("history.csv", "t,kinetic,intact,softened,total,work\n0,0,0,0,0,1e200\n", "'work' that no run writes"),
        ("summary.json", '{"crack_length": "x"}', "has crack_length = 'x', which is no number"),
        ("summary.json", '{"seconds": [1]}', "has a table seconds that no run writes"),
        ("frames.pvd", "<VTKFile>", "cannot be read"),
        ("frames.pvd", '<VTKFile><DataSet file="../x.vtu" timestep="0"/></VTKFile>', "which is no frame"),
        ("frame_0005.vtu", "hello", "frame_0005.vtu' cannot be read"),
    ],
)
def test_damaged_files_are_named(torn, tmp_path, capsys, file, content, message):
    out = tmp_path / "copy"
    shutil.copytree(torn[0], out)
    (out / file).write_text(content)
    assert main(["plot", str(out)]) == 2
    assert message in capsys.readouterr().err


def test_plot_of_nothing(tmp_path, capsys):
    assert main(["plot", str(tmp_path / "nowhere")]) == 2
    assert "is not a folder; give one that run has written" in capsys.readouterr().err
    assert main(["plot", str(tmp_path)]) == 2
    assert "holds no run: there is neither history.csv nor summary.json" in capsys.readouterr().err


def test_no_matplotlib_no_report(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("skfem_peridynamics.app.report.figure.available", lambda: False)
    with pytest.raises(SceneError, match='a report needs matplotlib: install the extra "plot"'):
        run(Scene.parse(change("pictures = true", "pictures = false")), tmp_path / "out", with_report=True)
    assert not (tmp_path / "out").exists()
    assert main(["plot", str(tmp_path)]) == 2


def test_a_clean_slate_takes_pictures_with_it(torn, tmp_path):
    out = tmp_path / "copy"
    shutil.copytree(torn[0], out)
    (out / "animation.gif").write_bytes(b"GIF")
    run(
        Scene.parse(change("until = 3.0", "until = 0.05").replace("pictures = true", "pictures = false")),
        out,
        resume=False,
    )
    assert not list(out.glob("*.png"))
    assert not list(out.glob("*.gif"))
    assert not list(out.glob("*.html"))


# ---- a browser
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)


def browse(path, room, *words):
    command = [BROWSER, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", f"--user-data-dir={room}"]
    done = subprocess.run([*command, *words, f"file://{path}"], capture_output=True, timeout=120, check=True)
    return done.stdout.decode()


@pytest.mark.skipif(BROWSER is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [390, 1280])
def test_a_browser_shows_it(torn, tmp_path, width):
    """Every picture is loaded, nothing is wider than the window, text is large enough, nothing complains."""
    probe = """<script>addEventListener("load", () => {
      const images = [...document.images], wide = document.documentElement;
      const out = {
        missing: images.filter(i => !i.complete || i.naturalWidth < 100).length, images: images.length,
        overflow: wide.scrollWidth - wide.clientWidth, width: wide.clientWidth,
        small: [...document.querySelectorAll("p,td,th,dd,dt,li,figcaption")]
          .filter(e => parseFloat(getComputedStyle(e).fontSize) < 12).length,
        broad: images.filter(i => i.getBoundingClientRect().right > wide.clientWidth + 0.5).length,
      };
      document.title = "PROBE " + JSON.stringify(out);
    });
    addEventListener("error", e => { document.title = "ERROR " + e.message; });
    addEventListener("securitypolicyviolation", e => { document.title = "BLOCKED " + e.blockedURI; });
    </script>"""
    content = (torn[0] / "report.html").read_text()
    content = content.replace("default-src 'none';", "default-src 'none'; script-src 'unsafe-inline';")
    # headless windows are at least 500 wide: the page is shown in a frame as wide as a phone
    (tmp_path / "page.html").write_text(content.replace("</body>", probe + "</body>"))
    frame = f"""<!doctype html><iframe id="f" src="page.html" style="width:{width}px;height:3000px;border:0"></iframe>
    <script>const f = document.getElementById("f");
    setInterval(() => {{
      try {{ document.title = f.contentDocument.title; }} catch (e) {{ document.title = "" + e; }}
    }}, 50);
    </script>"""
    (tmp_path / "frame.html").write_text(frame)
    found = browse(
        tmp_path / "frame.html", tmp_path / "room", "--allow-file-access-from-files", "--virtual-time-budget=5000",
        f"--window-size={max(width, 600)},3200", "--dump-dom",
    )  # fmt: skip
    title = re.search(r"<title>(.*?)</title>", found)[1]
    assert title.startswith("PROBE "), title
    seen = json.loads(title.removeprefix("PROBE ").replace("&quot;", '"'))
    assert seen == {"missing": 0, "images": 7, "overflow": 0, "width": width, "small": 0, "broad": 0}


# ---- the whole way
def test_from_a_mesh_to_a_report_by_one_command(tmp_path, capsys):
    """A notched part by Gmsh: tagged slit, two materials, named loads, and one command."""
    for name in ("notched_part.msh", "notched_part.toml"):
        shutil.copy(EXAMPLES / name, tmp_path)
    scene = (tmp_path / "notched_part.toml").read_text()
    (tmp_path / "notched_part.toml").write_text(
        change("until = 140e-6", "until = 60e-6", change("history = 71", "history = 31", scene))
    )
    out = tmp_path / "out"
    assert main(["run", str(tmp_path / "notched_part.toml"), "--out", str(out), "--report"]) == 0
    assert "report.html" in capsys.readouterr().out
    _, pictures = check_page((out / "report.html").read_text())
    assert len(pictures) == 7
    history = Results.read(out).history
    began = int(np.flatnonzero(history["crack_reach"] > 0.0)[0])
    # the crack starts when J reaches G_c = 300, at a row of the history or the next, and then turns
    assert history["j_integral"][began - 1] < 300 < history["j_integral"][began + 3]
    assert history["crack_reach"][-1] > 3 * 2.8e-3
    assert 300 < history["j_integral"][-1] < 900
    assert history["reaction_bottom_y"].min() < 0.0
    summary = Results.read(out).summary
    assert 0.2 < summary["largest_tip_speed"] / summary["elastic"]["rayleigh_speed"] < 1.0
    assert os.path.getsize(out / "report.html") < 4_000_000
    assert io.BytesIO(base64.b64decode(pictures[0]["src"].partition("base64,")[2])).getbuffer().nbytes > 20_000


def test_keys_of_earlier_versions_are_read(torn, tmp_path):
    """``dt`` and ``dt_limit`` were the step and its limits: the report of such a run says the same."""
    shutil.copytree(torn[0], tmp_path / "old")
    file = tmp_path / "old" / "summary.json"
    summary = json.loads(file.read_text())
    new = Results.read(torn[0]).summary
    summary["dt"] = summary.pop("step")
    summary["dt_limit"] = {name.removeprefix("by_"): step for name, step in summary.pop("step_limits").items()}
    file.write_text(json.dumps(summary))
    old = Results.read(tmp_path / "old").summary
    assert (old["step"], old["step_limits"]) == (new["step"], new["step_limits"])
    assert "dt" not in old


@pytest.mark.slow
def test_summaries_and_rows_that_no_run_writes(tmp_path):
    """Each entry replaced by each of many others: a report, or a sentence; nothing that cannot be written."""
    from faults import ODD, changed, leaves

    run(Scene.parse(change("pictures = true", "pictures = false")), tmp_path)
    summary, rows = json.loads((tmp_path / "summary.json").read_text()), (tmp_path / "history.csv").read_text()
    table = [line.split(",") for line in rows.splitlines()]
    cases = [
        ("summary.json", json.dumps(changed(summary, path, new)))
        for path in leaves(summary)
        for new in [*ODD, "$^$", "<b>"]
    ]
    for i, k in itertools.product(range(3), range(len(table[0]))):
        for new in ("", "x", "nan", "inf", "1e400", "1" * 131073, "\0", '"', "-1"):
            content = [list(row) for row in table]
            content[i][k] = new
            cases.append(("history.csv", "\n".join(map(",".join, content))))
    whole = {"summary.json": json.dumps(summary), "history.csv": rows}
    refused = 0
    for name, content in cases:
        (tmp_path / name).write_text(content)
        try:
            results = Results.read(tmp_path)
        except SceneError:
            refused += 1
        else:
            assert page(results, {}).encode()
        (tmp_path / name).write_text(whole[name])
    assert refused > 300
    assert len(cases) - refused > 300


def test_logarithmic_axes_are_numbered_without_mathematics(tmp_path):
    """No text is taken for mathematics, so none may be written as such: 0.01, not $10^{-2}$."""
    figure = new_figure(4, 3)
    wide, narrow = figure.subplots(1, 2)
    wide.loglog([1e-3, 1e1], [1.0, 1e4])
    narrow.loglog([0.2, 0.3], [0.02, 0.05])
    save(figure, tmp_path / "axes.png")
    figure.canvas.draw()
    labels = [
        label.get_text()
        for axes in (wide, narrow)
        for axis in (axes.xaxis, axes.yaxis)
        for label in (*axis.get_ticklabels(), *axis.get_ticklabels(minor=True))
    ]
    assert "0.01" in labels
    assert sum(bool(text) for text in labels) > 8
    assert not any("$" in text or "math" in text for text in labels)


# ---- how pictures are read
def texts_of(monkeypatch, draw):
    """Texts of the figures that are saved meanwhile, with their sizes in points over the width of the figure."""
    from skfem_peridynamics.app.report import figure as drawing

    found = {}

    def keep(path, content):
        figure = kept.pop()
        size = figure.get_size_inches()[0]
        figure.canvas.draw()
        texts = [text for text in figure.findobj(lambda artist: hasattr(artist, "get_fontsize")) if text.get_text()]
        found[Path(path).name] = [(text.get_text(), text.get_fontsize() / size) for text in texts if text.get_visible()]

    kept = []
    made = drawing.new_figure

    def remember(*size):
        kept.append(made(*size))
        return kept[-1]

    with monkeypatch.context() as only_here:
        for module in ("body_pictures", "deformed_pictures", "history_pictures", "setup_picture"):
            only_here.setattr(f"skfem_peridynamics.app.report.{module}.new_figure", remember)
        only_here.setattr(drawing, "write_whole", keep)
        draw()
    return found


@pytest.mark.slow
def test_letters_are_read_on_a_phone(torn, monkeypatch):
    """12 px or more where a picture is 361 px wide, a screen of 390; no text shows the mathematics of its making."""
    results = Results.read(torn[0])
    scene = Scene.parse(TORN)

    block = skfem.MeshTet.init_tensor(*[np.linspace(0, 1, 4)] * 3)
    torn_block = Snapshot(block, 0.0, {"displacement": np.zeros((64, 3)), "intact": 1.0 - block.p[0] ** 2})

    def pictures(phone):
        with own_style(phone):
            plot_damage(Path("block.png"), torn_block, "a block", UnitsTable())
        draw(results, course=True, phone=phone)
        plot_setup(Path("setup.png"), SetUp.of(scene, cracked_mesh(scene)), phone=phone)

    for phone in (False, True):
        found = texts_of(monkeypatch, lambda phone=phone: pictures(phone))
        assert len(found) == 9
        for name, texts in found.items():
            assert len(texts) > 3, name
            assert not any("$" in text or "math" in text for text, _ in texts), name
            smallest = min(size for _, size in texts) * 361 / 72
            assert (smallest >= 12.0) == phone, (name, smallest)


def test_what_is_drawn_is_in_the_units_it_is_read_in(torn, monkeypatch):
    units = UnitsTable("m", "N", "s")
    for value, unit, factor in ((0.4, "mm", 1e3), (3e-6, "um", 1e6), (2.0, "m", 1.0), (5e3, "km", 1e-3)):
        assert units.reading("length", value) == (factor, unit)
    assert units.shown("energy", 2.5e-3, dim=2) == "2.5 mJ/m"
    assert units.shown("velocity", 1651.2) == "1651 m/s"
    assert units.shown("length", 0.0) == "0 m"
    assert UnitsTable().shown("length", 0.25) == "0.25"
    scene = torn[1]["run"]["scene"] | {"units": {"length": "m", "force": "N", "time": "s"}}
    results = Results.read(torn[0])
    results = dataclasses.replace(results, scene=scene)
    found = texts_of(monkeypatch, lambda: draw(results, course=True))
    words = {name: {text for text, _ in texts} for name, texts in found.items()}
    assert {"x in m", "y in mm"} & words["damage.png"]
    assert "t in s" in words["energies.png"]


def test_displacements_are_seen_and_open_cracks_are_holes():
    mesh = skfem.MeshTri.init_tensor(np.linspace(0, 10, 11), np.linspace(0, 2, 3))
    u = np.zeros((mesh.nvertices, 3))
    u[:, 0] = np.where(mesh.p[0] > 5.5, 1e-3, 0.0)
    body = Snapshot(mesh, 0.0, {"displacement": u, "intact": np.ones(mesh.nvertices)})
    # vertices are up to 5.5e-4 off the mean: a twentieth of 10 is 917 times that
    assert deformation_scale(body) == 500.0
    p, t = moved(body, 100.0)
    np.testing.assert_allclose(p, mesh.p + 100.0 * u[:, :2].T)
    assert t.shape[1] == mesh.nelements  # stretched by a tenth
    p, t = moved(body, 2000.0)
    middle = mesh.p[0, mesh.t].mean(axis=0)
    assert sorted(map(tuple, t.T)) == sorted(map(tuple, mesh.t[:, (middle < 5) | (middle > 6)].T))
    far = Snapshot(mesh, 0.0, body.fields | {"displacement": 1e4 * u})
    assert deformation_scale(far) == 1.0
    assert deformation_scale(Snapshot(mesh, 0.0, body.fields | {"displacement": 0 * u})) == 1.0


def test_the_drawing_of_a_set_up_names_what_the_scene_says(monkeypatch):
    text = (EXAMPLES / "notched_part.toml").read_text()
    scene = Scene.parse(text, EXAMPLES)
    mesh = cracked_mesh(scene)
    found = texts_of(monkeypatch, lambda: plot_setup(Path("setup.png"), SetUp.of(scene, mesh)))["setup.png"]
    words = {word for word, _ in found}
    for said in (
        "slit", "material inclusion", "held: bottom", "no-fail top", "traction (0, 5e6 * min(t / 10e-6, 1)) on top",
        "probe above the notch", "x in mm",
    ):  # fmt: skip
        assert said in words, said
    bar = Scene.parse(starter("bar"))
    words = {
        word
        for word, _ in texts_of(monkeypatch, lambda: plot_setup(Path("b.png"), SetUp.of(bar, cracked_mesh(bar))))[
            "b.png"
        ]
    }
    assert "held: left" in words
    block = Scene.read(EXAMPLES / "block3d.toml", [("mesh.divisions", [12, 5, 4])])
    words = {
        w
        for w, _ in texts_of(monkeypatch, lambda: plot_setup(Path("c.png"), SetUp.of(block, cracked_mesh(block))))[
            "c.png"
        ]
    }
    assert "slit" in words


@pytest.mark.slow
def test_statics_know_no_speed_and_no_time(tmp_path, monkeypatch):
    """However far t goes, the same equilibria are told the same."""
    scene = Scene.parse(starter("static"), changes=["mesh.divisions=[16, 8]", "bonds.horizon=0.3", "output.frames=2"])
    text = "units = {length = 'm', force = 'N', time = 's'}\n" + starter("static")
    told = []
    for until in (1.0, 1000.0):
        keys = ["mesh.divisions=[16, 8]", "bonds.horizon=0.3", "output.frames=2", "time.steps=4", f"time.until={until}"]
        scene = Scene.parse(text, changes=[*keys, ("fixed[1].displacement", f"1.0 * t / {until}")])
        out = tmp_path / str(until)
        summary = run(scene, out, with_report=True)
        assert summary["softened_bonds"] > 0
        told.append(summary.headline)
        page = Page((out / "report.html").read_text()).text
        assert "fastest tip" not in page
        assert "Rayleigh speed" not in summary.headline
        results = Results.read(out)
        words = {
            word
            for texts in texts_of(monkeypatch, lambda r=results: draw(r, course=True)).values()
            for word, _ in texts
        }
        assert "t" in words
        assert not any("in s" in word or "speed" in word for word in words)
    assert told[0] == told[1]


def test_a_linear_law_has_no_critical_strain(tmp_path):
    out = tmp_path / "bar"
    done = run(Scene.parse(starter("bar"), changes=["mesh.divisions=[40]", "bonds.horizon=0.1"]), out, with_report=True)
    assert done.headline == "The law is linear: no bond can soften."
    page = Page((out / "report.html").read_text()).text
    for word in ("S/S_c", "Rayleigh", "S waves"):
        assert word not in page
    assert "Young's modulus" in page


def test_a_unit_with_an_unlucky_name_is_a_unit():
    units = UnitsTable("wavelength", "N", "timestep")
    assert units.after("length") == " wavelength"
    assert units.after("velocity") == " wavelength/timestep"
    assert UnitsTable("m", "force", "s").after("stress") == ""
    assert UnitsTable("m", "force", "s").after("length") == " m"


def test_stress_out_of_plane_stands_in_the_frames(tmp_path):
    keys = ["mesh.divisions=[16, 8]", "bonds.horizon=0.3", "output={frames=2, pictures=false, fields=['stress']}"]
    done = run(Scene.parse(starter("static"), changes=[*keys, "time.steps=1"]), tmp_path)
    a, b, z, c, *_ = done.frames[-1].fields["stress"].T
    np.testing.assert_allclose(z, 0.25 * (a + b), rtol=1e-5, atol=1e-6 * np.abs(a).max())
    mises = np.sqrt(((a - b) ** 2 + (b - z) ** 2 + (z - a) ** 2) / 2 + 3 * c**2)
    np.testing.assert_allclose(done.frames[-1].fields["von_mises"], mises, rtol=1e-4, atol=1e-6 * mises.max())
