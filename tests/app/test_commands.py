"""Commands that help to begin: starters, what a mesh has, keys set from outside, the schema, completion, the bar."""

import io
import json
import tomllib
from pathlib import Path

import numpy as np
import pytest
import skfem

from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.cli.examples import folder_of_examples
from skfem_peridynamics.app.cli.main import main, make_parser
from skfem_peridynamics.app.problem.mesh_info import MeshInfo
from skfem_peridynamics.app.problem.starters import NAMES, starter
from skfem_peridynamics.app.run.check import check
from skfem_peridynamics.app.run.progress import Bar, Line, shown
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.app.scene.schema import scene_schema

ROOT = Path(__file__).resolve().parents[2]
PART = ROOT / "examples" / "notched_part.msh"
SMALL = """
mesh = {box = [[0, 1]], divisions = [10]}
material = {young = 1.0, toughness = 1.0, density = 1.0}
bonds = {horizon = 0.2}
initial = {velocity = ["1e-3*x"]}
time = {until = 1.0}
output = {frames = 0, pictures = false}
load = [{body = ["0.0"]}, {body = ["1.0"]}]
"""


# ---- keys from outside
@pytest.mark.parametrize(
    ("change", "read"),
    [
        ("time.until=2e-5", lambda scene: scene.time.until == 2e-5),
        ("title=a = b", lambda scene: scene.title == "a = b"),
        ('title="1"', lambda scene: scene.title == "1"),
        ("output.frames=3", lambda scene: scene.output.frames == 3),
        ("load[1].body=['2*x']", lambda scene: [str(load.body[0].text) for load in scene.load] == ["0.0", "2*x"]),
        ("mesh.box[0][1]=4", lambda scene: scene.mesh.box == ((0.0, 4.0),)),
        ("measure.crack=true", lambda scene: scene.measure.crack is True),
        ("fixed=[{on='left'}]", lambda scene: [fixed.on for fixed in scene.fixed] == ["left"]),
    ],
)
def test_keys_are_set_from_outside(change, read):
    assert not read(Scene.parse(SMALL))
    assert read(Scene.parse(SMALL, changes=[change]))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("time.until", "must be KEY=VALUE"),
        ("=3", "must be KEY=VALUE"),
        ("time..until=3", "is no key"),
        ("load[2].body=['0']", "there is no entry [2]; it has 2"),
        ("load[2]=3", "there is no entry [2]; it has 2"),
        ("time[0].until=3", "it is no array"),
        ("time.until.x=3", "is not a key of a table"),
        ("load.body=3", "is not a key of a table"),
        ("time.untl=3", "did you mean 'until'?"),
        ("time.until=soon", "must be a finite number"),
    ],
)
def test_keys_that_make_no_sense_are_refused(change, said):
    with pytest.raises(SceneError) as caught:
        Scene.parse(SMALL, changes=[change])
    assert said in str(caught.value)


@pytest.mark.parametrize(
    "change", [("bonds.horizon", np.float32(0.25)), ("mesh.divisions", (12,)), ("mesh.divisions", np.array([12]))]
)
def test_values_of_numpy_are_numbers(change):
    assert Scene.parse(SMALL, changes=[change]) != Scene.parse(SMALL)


@pytest.mark.parametrize("changes", ["bonds.horizon=1", {"bonds.horizon": 1}, [None], [(1, 2)], [("x",)], [["a", 1]]])
def test_changes_that_are_none_are_refused(changes):
    with pytest.raises(SceneError, match=r"must be a list|must be a text KEY=VALUE"):
        Scene.parse(SMALL, changes=changes)


def test_half_a_character_is_refused():
    with pytest.raises(SceneError, match="half a character"):
        Scene.parse(SMALL, changes=[("title", "a\udcff")])


def test_a_run_keeps_the_keys_that_were_set(tmp_path):
    """In the summary, so that it can be run again; another value is another run."""
    scene = tmp_path / "scene.toml"
    scene.write_text(SMALL)
    command = ["run", str(scene), "-o", str(tmp_path / "out"), "-q"]
    assert main([*command, "--set", "time.until=0.5", "--set", "title=half"]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["title"] == "half"
    assert summary["run"]["scene"]["time"]["until"] == 0.5
    assert main(command) == 2  # the folder holds another run


def test_check_in_json(tmp_path, capsys):
    scene = tmp_path / "scene.toml"
    scene.write_text(SMALL)
    assert main(["check", str(scene), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["sound"] is True
    assert found["found"]["dimension, nodes"] == ["1, 11"]
    assert main(["check", str(scene), "--json", "--set", "time.untl=1", "--set", "bonds.horizon=-1"]) == 2
    found = json.loads(capsys.readouterr().out)
    assert found["sound"] is False
    assert len(found["mistakes"]) == 2
    assert "bonds.horizon = -1" in found["mistakes"][0]


# ---- starters
@pytest.mark.parametrize("name", [name for name in NAMES if name != "part"])
def test_starters_are_sound_and_run(name, tmp_path):
    """Rough and short here; as they stand they are checked to the step limit."""
    text = starter(name)
    assert text.startswith("#:schema scene.schema.json\n# ")
    check(Scene.parse(text))
    coarse = {
        "plate": ("[40, 16]", "2e-3", "1e-2"),
        "bar": ("[50]", "0.01", "0.08"),
        "static": ("[16, 8]", "0.13", "0.3"),
    }
    divisions, horizon, longer = coarse[name]
    changes = [f"mesh.divisions={divisions}", f"bonds.horizon={longer}", "output.frames=1", "output.pictures=false"]
    changes += ["time.steps=1"] if name == "static" else []
    assert f"horizon = {horizon}" in text
    summary = run(Scene.parse(text, changes=changes), tmp_path / "out")
    assert summary["status"] == "finished"


def test_a_starter_for_a_mesh_has_its_groups(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["init", "--from", str(PART), "-o", "deep/part.toml"]) == 2  # no such folder
    assert "deep" in capsys.readouterr().err
    assert main(["init", "--from", str(PART)]) == 0
    assert "skfem-peridynamics run notched_part.toml --out notched_part --report" in capsys.readouterr().out
    scene = Scene.read(tmp_path / "notched_part.toml")
    assert [crack.facets for crack in scene.crack] == ["slit"]  # facets inside
    assert [fixed.on for fixed in scene.fixed] == ["bottom"]
    assert (scene.folder / scene.mesh.file).resolve() == PART
    text = (tmp_path / "notched_part.toml").read_text()
    assert '# on = "top"' in text
    assert '# region = "inclusion"' in text
    assert "matrix" not in text  # what [material] is of
    check(scene)
    assert main(["init", "--from", str(PART)]) == 2
    assert "is there already" in capsys.readouterr().err
    assert (tmp_path / "notched_part.toml").read_text() == text
    assert main(["init", "plate", "-o", "a b.toml"]) == 0
    assert "check 'a b.toml'" in capsys.readouterr().out
    assert main(["init", "part"]) == 2
    assert "--from" in capsys.readouterr().err
    assert main(["init", "bar", "--from", str(PART)]) == 2


def test_a_group_with_nothing_in_it_is_left_out(tmp_path):
    mesh = skfem.MeshTri().refined(2).with_boundaries({"left": lambda x: x[0] == 0.0})
    info = MeshInfo.of(mesh.with_boundaries({"mid": np.zeros(0, dtype=np.int32)}))
    assert info.boundaries["mid"] == 0
    assert "mid" not in info.inner


def test_a_name_that_toml_would_read_otherwise_is_written_so_that_it_does_not(tmp_path):
    mesh = tmp_path / 'a "b" \\ ${x}.vtk'
    skfem.MeshTri().refined(2).save(str(mesh))
    scene = Scene.parse(starter("part", mesh, tmp_path), tmp_path)
    assert scene.mesh.file == mesh.name
    assert scene.title == mesh.stem
    check(scene)


# ---- what a mesh has
def test_the_numbers_of_a_mesh_are_those_of_its_shapes(tmp_path, capsys):
    """By hand: halves of squares, and a regular tetrahedron."""
    info = MeshInfo.of(skfem.MeshTri.init_tensor(np.linspace(0, 2, 5), np.linspace(-1, 0, 3)).with_defaults())
    assert info.box == ((0.0, 2.0), (-1.0, 0.0))
    assert info.edges == pytest.approx((0.5, 0.5, 0.5 * 2**0.5))
    assert info.quality == pytest.approx((0.75**0.5,) * 3)
    assert info.volume == pytest.approx(2.0)
    assert info.boundaries == {"left": 2, "bottom": 4, "right": 2, "top": 4}
    assert info.horizon == 2.0  # four vertices, half a unit apart
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1.0]]).T
    one = MeshInfo.of(skfem.MeshTet(corners, np.arange(4)[:, None]))
    assert one.quality == pytest.approx((1.0,) * 3)
    assert one.edges == pytest.approx((8.0**0.5,) * 3)
    assert main(["info", str(PART), "--scale", "1e-3", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["box"] == [[0.0, pytest.approx(0.06)], [0.0, pytest.approx(0.04)]]
    assert found["inner"] == ["slit"]
    assert main(["info", str(PART)]) == 0
    assert "slit (26 facets inside)" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "none.msh")]) == 2
    assert main(["info", str(PART), "--scale", "0"]) == 2
    assert "--scale 0.0 must be" in capsys.readouterr().err


def test_cfl_of_a_mesh_takes_what_a_scene_does(capsys, tmp_path):
    part = tmp_path / "part.vtk"
    skfem.MeshTri().refined(3).save(str(part))
    flags = ["--mesh", str(part), "--scale", "1e-3", "--horizon", "3e-4", "--young", "3e9", "--density", "1e3"]
    flags += ["--plane", "stress", "--rule", "ball", "--balanced", "--mass", "consistent", "--json"]
    assert main(["cfl", *flags]) == 0
    found = json.loads(capsys.readouterr().out)
    scene = tmp_path / "scene.toml"
    scene.write_text(
        f"mesh = {{file = '{part}', scale = 1e-3}}\n"
        'material = {young = 3e9, density = 1e3, plane = "stress", potential = "linear"}\n'
        'bonds = {horizon = 3e-4, rule = "ball", balanced = true}\ntime = {until = 1.0, mass = "consistent"}\n'
    )
    assert main(["cfl", str(scene), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["stable_step"] == found["stable_step"]
    assert main(["cfl", *flags, "--set", "time.until=1"]) == 2
    assert main(["cfl", str(scene), "--balanced"]) == 2
    rule = flags.index("--rule") + 1
    assert main(["cfl", *flags[:rule], "auto", *flags[rule + 1 :]]) == 2
    assert "does not go with rule = 'auto'" in capsys.readouterr().err


# ---- examples, schema, completion
def test_examples_are_copied_once(tmp_path, capsys):
    assert folder_of_examples() == ROOT / "examples"
    assert main(["examples"]) == 0
    assert "glass_branching.toml" in capsys.readouterr().out
    assert main(["examples", str(tmp_path / "mine")]) == 0
    for path in (tmp_path / "mine").iterdir():
        assert path.read_bytes() == (ROOT / "examples" / path.name).read_bytes()
    assert (tmp_path / "mine" / "notched_part.msh").exists()
    Scene.read(tmp_path / "mine" / "glass_branching.toml")
    assert main(["examples", str(tmp_path / "mine")]) == 2
    assert "already" in capsys.readouterr().err


def scenes():
    found = [*(ROOT / "examples").glob("*.toml"), *(ROOT / "examples" / "validation").glob("*.toml")]
    return [*found, ROOT / "tests" / "data" / "small.toml"]


def test_the_schema_takes_what_scenes_are(tmp_path, capsys):
    """All scenes of the repository, and none of these with a key or a value that is none."""
    jsonschema = pytest.importorskip("jsonschema")
    judge = jsonschema.Draft202012Validator(scene_schema())
    judge.check_schema(scene_schema())
    for text in [*(path.read_text() for path in scenes()), *(starter(n) for n in NAMES if n != "part"), SMALL]:
        judge.validate(tomllib.loads(text))
    good = tomllib.loads(SMALL)
    for change in (
        "time.untl=3", "bonds.horizon=-1", "bonds.horizon=0",
        "bonds.horizon='x'", "bonds.rule='bal'", "output.frames=-1", "load=[{a=1}]",
        "output.frames=100000", "material.plane='both'", "mesh.box=[3]", "fixed={on='left'}", "output.fields=['x']",
    ):  # fmt: skip
        key, _, value = change.partition("=")
        tables = json.loads(json.dumps(good))
        place = tables
        *above, last = key.split(".")
        for name in above:
            place = place.setdefault(name, {})
        place[last] = tomllib.loads(f"v = {value}")["v"]
        assert not judge.is_valid(tables), change
        with pytest.raises(SceneError):
            Scene.of(tables)
    for missing in scene_schema()["required"]:
        assert not judge.is_valid({name: entry for name, entry in good.items() if name != missing})
    out = tmp_path / "scene.schema.json"
    assert main(["schema", "-o", str(out)]) == 0
    assert main(["schema", "-o", str(out)]) == 0  # the same already
    assert json.loads(out.read_text()) == scene_schema()
    out.write_bytes(b"\xff\x00mine")
    assert main(["schema", "-o", str(out)]) == 2
    assert out.read_bytes() == b"\xff\x00mine"
    capsys.readouterr()
    assert main(["schema"]) == 0
    assert json.loads(capsys.readouterr().out) == scene_schema()


def test_completion_knows_the_commands(capsys):
    pytest.importorskip("shtab")
    assert main(["completion", "bash"]) == 0
    said = capsys.readouterr().out
    for word in ("init", "stability", "--overwrite", "--horizon"):
        assert word in said


def test_every_argument_is_explained():
    """A line for each, and examples that parse."""
    parser = make_parser()
    commands = next(action for action in parser._actions if action.dest == "command").choices
    assert set(commands) == {
        "init", "run", "check", "cfl", "info", "plot", "study", "stability", "examples", "schema", "completion"
    }  # fmt: skip
    shown_lines = parser.epilog.splitlines()[1:]
    for command in commands.values():
        assert all(action.help for action in command._actions), command.prog
        shown_lines += command.epilog.splitlines()[1:]
    for line in shown_lines:
        words = line.split(">")[0].split("   ")[0].split()[1:]
        assert parser.parse_args(words).command == words[0]


# ---- the bar
class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_the_bar_tells_pace_energy_and_strain(monkeypatch):
    pytest.importorskip("rich")
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "140")
    said = {}
    for name in ("plain", "coloured"):
        monkeypatch.delenv("NO_COLOR", raising=False)
        if name == "plain":
            monkeypatch.setenv("NO_COLOR", "1")
        screen = Terminal()
        monkeypatch.setattr("sys.stdout", screen)
        bar = shown()
        assert isinstance(bar, Bar)
        bar.begin("[red]a title\x1b[2J that is longer than there is room", 40, " J")
        bar.advance(20)
        bar.advance(30, 1.25, 0.5)
        bar.advance(40, 2.5, 3.0)
        bar.end()
        said[name] = screen.getvalue()
        assert "energy 2.5 J, bonds break, at 3 times critical" in said[name]
        assert "40/40" in said[name]
        assert "[red]a title[2J that is…"[:20] in said[name]
        assert "\x1b[2J" not in said[name]
    assert "\x1b[3" in said["coloured"]
    assert "\x1b[3" not in said["plain"].replace("\x1b[39", "")
    monkeypatch.setattr("sys.stdout", io.StringIO())
    assert isinstance(shown(), Line)


def test_a_run_shows_a_bar_where_it_is_asked_to(tmp_path, capsys):
    run(Scene.parse(SMALL), tmp_path / "out", progress=True)
    said = capsys.readouterr().out
    assert "step 8/8, " in said
    assert "energy 0.5" in said
