"""Whatever comes in, a command runs or ends with exit 2 and one sentence: in 10 seconds and 1 GB, and in its folder.

Scenes by a grammar and mutated; damaged mesh files, formulas, command lines and checkpoints. The short form is part of
the suite; 10,000 cases are  pytest -m long tests/whole/test_fuzz.py -s
"""

import contextlib
import io
import os
import random
import re
import resource
import shutil
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path

import meshio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from faults import SMALL, small, stop
from skfem_peridynamics import Scene, run
from skfem_peridynamics.app.cli.main import main
from skfem_peridynamics.app.files.checkpoint import NAME, OLDER
from skfem_peridynamics.app.scene.reading import SceneError

SECONDS, MEMORY = 10.0, 1 << 30
STEPS = 300  # a scene of more is checked, not run
seen: Counter = Counter()


class TooLong(BaseException):
    """A case that takes more than its ten seconds."""


@contextlib.contextmanager
def limits():
    """Ten seconds and one gigabyte more than there is now."""

    def late(number, frame):
        raise TooLong

    page = os.sysconf("SC_PAGE_SIZE")
    taken = int(Path("/proc/self/statm").read_text().split()[0]) * page
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    before = signal.signal(signal.SIGALRM, late)
    resource.setrlimit(resource.RLIMIT_AS, (taken + MEMORY, hard))
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def everything(folder):
    return {
        str(path.relative_to(folder)) for path in folder.rglob("*") if "out" not in path.relative_to(folder).parts[:1]
    }


def judge(kind, folder, *argv):
    """Run a command in a folder whose ``out`` it may write to, and nothing else; return exit code and what it said."""
    before, here = everything(folder), os.getcwd()
    out, err = io.StringIO(), io.StringIO()
    begin = time.monotonic()
    os.chdir(folder)
    try:
        with limits(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main(list(argv))
            except SystemExit as error:  # argparse
                code = error.code
    finally:
        os.chdir(here)
    said = [line for line in err.getvalue().splitlines() if not line.startswith("note: ")]
    assert code in (0, 2), (code, argv, said)
    if code == 2:
        assert said, argv
        if said[0].startswith("usage:"):
            assert "error: " in said[-1], said
        else:
            assert len(said) == 1, said
            assert said[0].startswith("skfem-peridynamics: "), said
            assert len(said[0]) < 3000, said
    assert "Traceback" not in err.getvalue() + out.getvalue()
    assert time.monotonic() - begin < SECONDS
    assert everything(folder) == before, everything(folder) - before
    seen[kind, "all"] += 1
    seen[kind, f"exit {code}"] += 1
    return code, out.getvalue(), said


def scene_of(kind, folder, content):
    """Check a scene and, where it is sound and short, run it."""
    (folder / "scene.toml").write_text(content)
    seen[kind, "inputs"] += 1
    with contextlib.suppress(SceneError):
        Scene.parse(content)
        seen[kind, "past parsing"] += 1
    code, told, _ = judge(kind, folder, "check", "scene.toml")
    if code:
        return
    steps = re.search(r"^  steps +(?:at most about )?(\d+)", told, re.M)
    if steps is None or int(steps[1]) > STEPS:
        seen[kind, "checked only"] += 1
        return
    seen[kind, "run"] += judge(kind, folder, "run", "scene.toml", "--out", "out", "--quiet")[0] == 0


@contextlib.contextmanager
def folder():
    place = Path(tempfile.mkdtemp())
    try:
        yield place
    finally:
        shutil.rmtree(place)


# --- a grammar of scenes: every table and key, values mostly sensible, some far out, some of the wrong kind

WILD = st.sampled_from(
    [
        "0",
        "-1",
        "1e-300",
        "1e300",
        "1e99",
        "1e-9",
        "nan",
        "inf",
        '"x"',
        "true",
        "[]",
        "{}",
        "9" * 400,
        "1e18",
        "''",
        "7",
    ]
)
plain = st.floats(0.05, 5.0).map(repr)


def mostly(sensible, wild=WILD, part=90):
    """A sensible value, and once in so many times, at most, a wild one."""
    return st.integers(0, part).flatmap(lambda k: wild if k == part // 2 + 3 else sensible)


atoms = st.sampled_from(["x", "t", "0.5", "pi", "1e-3", "y", "-2", "z", "e"])
formulas = st.recursive(
    atoms,
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "^", "<", ">="]), inner).map(
            "({0[0]} {0[1]} {0[2]})".format
        ),
        st.tuples(st.sampled_from(["sin", "exp", "sqrt", "step", "abs", "log", "tanh"]), inner).map(
            "{0[0]}({0[1]})".format
        ),
        st.tuples(inner, inner).map("min({0[0]}, {0[1]})".format),
    ),
    max_leaves=5,
)
HOSTILE = st.sampled_from(
    [
        "__import__('os').system('touch canary')",
        "open('canary', 'w')",
        "().__class__.__bases__",
        "x if x else y",
        "lambda: 0",
        "9**9**9**9",
        "(" * 300 + "x" + ")" * 300,
        "x" * 3000,
        "1e999",
        "eval(x)",
        "${HOME}",
        "x;y",
        "-" * 500 + "x",
        "\\u0000",
    ]
)
formula = mostly(formulas.map(lambda text: f'"{text}"'), HOSTILE.map(lambda text: f'"{text}"'))
side = st.sampled_from(["left", "right", "top", "bottom", "front", "back"])
name = mostly(
    side.map(lambda one: f'"{one}"'), st.sampled_from(['"../up"', '"/etc/passwd"', '"slit"', '"\\u88c2"', "3"])
)


def table(optional, **keys):
    """An inline table; of the optional keys each is there or not, of the others all but once in forty times."""
    some = {key: value.map(lambda text, key=key: f"{key} = {text}") for key, value in keys.items()}
    more = {key: value.map(lambda text, key=key: f"{key} = {text}") for key, value in optional.items()}
    return st.fixed_dictionaries(some, optional=more).map(lambda found: "{" + ", ".join(found.values()) + "}")


def vector(dim, entry):
    return mostly(st.lists(entry, min_size=dim, max_size=dim).map(lambda all_: f"[{', '.join(all_)}]"))


@st.composite
def scenes(draw):
    dim = draw(st.integers(1, 3))
    n = {1: 12, 2: 6, 3: 3}[dim]
    sides = ", ".join(f"[{draw(mostly(st.sampled_from(['0', '-1', '0.5']), part=160))}, 1]" for _ in range(dim))
    divisions = ", ".join(
        draw(mostly(st.integers(2, n).map(str), st.sampled_from(["0", "-3", "1000000", "1.5"]))) for _ in range(dim)
    )
    plane = {"plane": st.sampled_from(['"stress"', '"strain"'])} if dim == 2 else {}
    lines = [
        f"mesh = {{box = [{sides}], divisions = [{divisions}]}}",
        "material = "
        + draw(
            table(
                {
                    "potential": st.sampled_from(['"exponential"', '"rational"']),
                    "calibrate": mostly(st.sampled_from(['"continuum"', '"discrete"'])),
                    "compression": mostly(st.sampled_from(['"soften"', '"elastic"'])),
                    "breaking": mostly(st.floats(1.0, 4.0).map(repr)),
                },
                young=mostly(plain),
                toughness=mostly(plain),
                density=mostly(plain),
                **plane,
            )
        ),
        "bonds = "
        + draw(
            table(
                {
                    "influence": st.sampled_from(['"constant"', '"conical"', '"gaussian"']),
                    "rule": st.sampled_from(['"pairs"', '"pairs"', '"ball"', '"gauss_pairs"', '"auto"']),
                    "boundary_function": mostly(st.just('"smooth"')),
                },
                horizon=mostly(st.floats(0.4, 1.2).map(repr)),
            )
        ),
    ]
    scheme = draw(st.sampled_from(["", "", "", ', scheme = "newmark", step = 0.3', ', scheme = "static", steps = 3']))
    lines.append(f"time = {{until = {draw(mostly(plain))}{scheme}}}")
    if draw(st.booleans()):
        loads = table({"layer": mostly(plain)}, traction=vector(dim, formula), on=name)
        lines.append(f"load = [{draw(st.one_of(loads, table({}, body=vector(dim, formula))))}]")
    if draw(st.booleans()):
        lines.append(
            "fixed = ["
            + draw(
                table(
                    {"component": mostly(st.sampled_from(['"x"', '"all"', '"y"'])), "width": mostly(plain)},
                    on=name,
                    displacement=formula,
                )
            )
            + "]"
        )
    if draw(st.booleans()):
        lines.append("initial = " + draw(table({}, velocity=vector(dim, formula))))
    if dim == 2 and draw(st.booleans()):
        ends = draw(st.lists(st.sampled_from(["0", "0.5", "1", "0.25", "2"]), min_size=4, max_size=4))
        lines.append(f"crack = [{{points = [[{ends[0]}, {ends[1]}], [{ends[2]}, {ends[3]}]]}}]")
    if draw(st.integers(0, 9)) == 0:
        lines.append(
            "inclusion = " + draw(mostly(table({"young": mostly(plain)}, where=formula).map(lambda one: f"[{one}]")))
        )
    if draw(st.booleans()):
        radius = mostly(st.floats(0.8, 3.0).map(repr))
        keys = {"crack": st.sampled_from(["true", "false"]), "reactions": st.sampled_from(["true", "false"])}
        lines.append("measure = " + draw(table(keys | ({"j_integral": radius} if dim == 2 else {}))))
    if draw(st.integers(0, 4)) == 0:
        place = vector(dim, mostly(st.floats(0.5, 1.0).map(repr)))
        lines.append("probe = [" + draw(table({"name": name}, at=place)) + "]")
    if draw(st.integers(0, 4)) == 0:
        lines.append("units = " + draw(table({"length": name, "force": name, "time": name})))
    output = {
        "fields": mostly(st.sampled_from(["[]", '["stress"]', '["strain", "stress"]']), st.just('["u"]')),
        "frames": mostly(st.integers(0, 3).map(str), st.sampled_from(["-1", "1000000000000", "1.5"])),
        "history": mostly(st.integers(0, 9).map(str), st.sampled_from(["-1", "1000000000000", '"many"'])),
        "checkpoint_every": mostly(
            st.sampled_from(["0", "1", "3", '"1 s"', '"2 steps"']),
            st.sampled_from(['"-1 s"', '"1e9 s"', '"soon"', "true", '"0 s"']),
        ),
    }
    lines.append("output = " + draw(table(output, pictures=st.just("false"))))
    title = draw(mostly(st.just("fuzz"), st.sampled_from(["../../up", "$(touch canary)", "\\u0000", "a" * 5000])))
    return "\n".join([f'title = "{title}"', *draw(st.permutations(lines))])


@st.composite
def mutated(draw, content):
    """Bytes with some of them changed, taken away, doubled, or cut off."""
    seed = draw(st.integers(0, 2**32))
    return mutate(content, random.Random(seed))


def mutate(content, rng):
    found = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        at, what = rng.randrange(len(found) + 1), rng.randrange(6)
        if what == 0:
            del found[at:]
        elif what == 1 and at < len(found):
            found[at] = rng.randrange(256)
        elif what == 2:
            del found[at : at + rng.randrange(20)]
        elif what == 3:
            found[at:at] = rng.choice(
                [b"9" * 9, b"-1", b"\n", b"nan", b"1e999", b"\x00", b"\xff", b"$End", b"[", b"{", b"="]
            )
        elif what == 4 and found:
            found[at:at] = found[at : at + rng.randrange(200)]
        else:
            lines = bytes(found).split(b"\n")
            lines.insert(rng.randrange(len(lines) + 1), lines.pop(rng.randrange(len(lines))))
            found = bytearray(b"\n".join(lines))
    return bytes(found)


MESH_SCENE = """
mesh = {{file = "{file}"}}
material = {{young = 1.0, toughness = 1.0, density = 1.0, plane = "strain"}}
bonds = {{horizon = 0.9}}
time = {{until = 0.5}}
output = {{frames = 1, history = 2, pictures = false}}
"""


def mesh_seeds():
    """Small valid files of the formats people have; also those whose readers loop at an unexpected end."""
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0.5, 0]], dtype=float)
    mesh = meshio.Mesh(points, [("triangle", np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))])
    made = {}
    with folder() as place, contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        for file, form, keys in (
            ("a.msh", "gmsh22", {"binary": False}), ("b.msh", "gmsh22", {"binary": True}),
            ("c.msh", "gmsh", {"binary": False}), ("d.msh", "gmsh", {"binary": True}), ("a.inp", "abaqus", {}),
            ("a.vtu", "vtu", {}), ("a.vtk", "vtk", {}), ("a.mesh", "medit", {}),
            ("a.vol", "netgen", {}), ("a.obj", "obj", {}), ("a.stl", "stl", {}),
        ):  # fmt: skip
            mesh.write(place / file, file_format=form, **keys)
            # the same bytes every day
            made[file] = re.sub(rb"\d{4}-\d\d-\d\dT[\d:.]+", b"one day", (place / file).read_bytes())
    return made


SEEDS = mesh_seeds()
OPTIONS = [
    "run", "check", "cfl", "study", "stability", "--out", "out", "--quiet", "--resume", "--restart", "scene.toml",
    "--mesh", "a.msh", "--horizon", "0.9", "nan", "-1", "--young", "1", "--density", "--plane", "stress", "--json",
    "--list", "", "--only", "nothing", "../x", "--bogus", "\x00", "/", "out/../../up", "--influence", "conical",
]  # fmt: skip


def fuzz_scenes(content):
    with folder() as place:
        scene_of("scenes", place, content)
        assert not (place / "canary").exists()


def fuzz_mutated_scenes(content):
    with folder() as place:
        scene_of(
            "mutated scenes", place, content.decode("utf-8", "surrogateescape").encode("utf-8", "replace").decode()
        )


def fuzz_meshes(file, content):
    with folder() as place:
        (place / file).write_bytes(content)
        (place / "scene.toml").write_text(MESH_SCENE.format(file=file))
        seen["meshes", "inputs"] += 1
        code, told, said = judge("meshes", place, "check", "scene.toml")
        seen["meshes", "past parsing"] += "cannot be read as a mesh" not in " ".join(said)
        steps = re.search(r"^  steps +(?:at most about )?(\d+)", told, re.M)
        if code == 0 and steps is not None and int(steps[1]) <= STEPS:
            seen["meshes", "run"] += judge("meshes", place, "run", "scene.toml", "--out", "out", "--quiet")[0] == 0


def fuzz_command_lines(words):
    if "study" in words or "stability" in words:
        words = [word for word in words if word not in ("scene.toml",)]  # those that exist would take minutes
    if words[:1] == ["stability"] and "--only" not in words:
        words = [*words, "--only", "nothing"]
    with folder() as place:
        (place / "scene.toml").write_text(SMALL.replace("until = 3.0", "until = 0.2"))
        (place / "a.msh").write_bytes(SEEDS["a.msh"])
        if not any(word in ("../x", "/", "out/../../up") for word in words):
            seen["command lines", "inputs"] += 1
            code, _, said = judge("command lines", place, *words)
            seen["command lines", "past parsing"] += code == 0 or not said[0].startswith("usage:")


class Stock:
    """A folder with two checkpoints, made once."""

    files: dict[str, bytes] = {}  # noqa: RUF012 (made once)

    @classmethod
    def get(cls):
        if not cls.files:
            with folder() as place:
                stop(small(), place / "out", 14)
                cls.files.update({path.name: path.read_bytes() for path in (place / "out").iterdir()})
        return cls.files


def fuzz_checkpoints(seed):
    """One or both damaged; sometimes with a checksum that is right again, so that what is inside is looked at."""
    import hashlib

    rng, files = random.Random(seed), dict(Stock.get())
    for one in rng.choice([[NAME], [OLDER], [NAME, OLDER]]):
        content = mutate(files[one], rng)
        if rng.random() < 0.6 and len(content) > 65:
            content = content[:-65] + hashlib.sha256(content[:-65]).hexdigest().encode() + b"\n"
        files[one] = content
    with folder() as place:
        (place / "scene.toml").write_text(SMALL)
        (place / "out").mkdir()
        for one, content in files.items():
            (place / "out" / one).write_bytes(content)
        command = ("run", "scene.toml", "--out", "out", "--quiet", *rng.choice([[], ["--resume"]]))
        seen["checkpoints", "inputs"] += 1
        _, _, said = judge("checkpoints", place, *command)
        seen["checkpoints", "past parsing"] += " is damaged" not in " ".join(said)


class Finished:
    """A folder with the files of a run, made once."""

    files: dict[str, bytes] = {}  # noqa: RUF012 (made once)

    @classmethod
    def get(cls):
        if not cls.files:
            with folder() as place:
                run(small(), place / "out")
                cls.files.update({path.name: path.read_bytes() for path in (place / "out").iterdir()})
        return cls.files


def fuzz_results(seed):
    """One file of a run damaged, and its pictures drawn again."""
    rng, files = random.Random(seed), dict(Finished.get())
    one = rng.choice(["history.csv", "summary.json", "frames.pvd", "frame_0005.vtu"])
    files[one] = mutate(files[one], rng)
    with folder() as place:
        (place / "out").mkdir()
        for name_, content in files.items():
            (place / "out" / name_).write_bytes(content)
        seen["results", "inputs"] += 1
        _, _, said = judge("results", place, "plot", "out")
        seen["results", "past parsing"] += "cannot be read" not in " ".join(said)


def fuzz(scale):
    """Run all kinds; ``scale`` is 1 for about 500 commands."""
    keep = {"deadline": None, "suppress_health_check": list(HealthCheck), "database": None, "derandomize": True}

    def many(count, function, *strategies):
        seen_here = settings(max_examples=count * scale, **keep)(given(*strategies)(function))
        seen_here()

    seen.clear()
    many(290, fuzz_scenes, scenes())
    many(30, fuzz_mutated_scenes, mutated(SMALL.replace("until = 3.0", "until = 0.3").encode()))
    many(
        80,
        lambda pair: fuzz_meshes(*pair),
        st.sampled_from(sorted(SEEDS)).flatmap(lambda f: st.tuples(st.just(f), mutated(SEEDS[f]))),
    )
    verbs = st.sampled_from(["run", "check", "cfl", "cfl", "study", "stability", "", "--out"])
    options = st.lists(st.sampled_from(OPTIONS), max_size=7)
    many(70, fuzz_command_lines, st.tuples(verbs, options).map(lambda one: [one[0], *one[1]]))
    many(70, fuzz_checkpoints, st.integers(0, 2**32))
    many(6, fuzz_results, st.integers(0, 2**32))
    kinds = sorted({kind for kind, _ in seen})
    print()
    for kind in kinds:
        print(f"{kind}: " + ", ".join(f"{what} {count}" for (one, what), count in sorted(seen.items()) if one == kind))

    def total(what):
        return sum(count for (_, one), count in seen.items() if one == what)

    print(f"{total('inputs')} inputs, {total('past parsing')} past parsing, {total('all')} commands")
    return total("inputs"), total("past parsing")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="needs the limits and the /proc of Linux")
def test_whatever_comes_in():
    inputs, past = fuzz(1)
    assert inputs >= 500
    assert past >= inputs / 2


@pytest.mark.long
def test_ten_thousand_things_come_in():
    inputs, past = fuzz(20)
    assert inputs >= 10_000
    assert past >= inputs / 2


@pytest.mark.parametrize(
    "file",
    ["a.off", *(pytest.param(f"a.{kind}", marks=pytest.mark.slow) for kind in ("wkt", "ply", "dat", "node", "nas"))],
)
def test_readers_that_never_end_are_ended(file, tmp_path, monkeypatch):
    """Files cut short, in formats whose readers loop there: each was seen to."""
    monkeypatch.setattr("skfem_peridynamics.meshes.guarded_reader._SECONDS", 1.5)
    triangle = b"((0.0 0.0 0.0, 1.0 0.0 0.0, 0.5 0.5 0.0, 0.0 0.0 0.0)), "
    content = {
        "a.off": b"OFF\n",
        "a.wkt": b"TIN (" + 3 * triangle + b"((0.0 1.0 0.0 0.0, 0.5 0.5 0.0, 0.0 1.0 0.0)))",
        "a.ply": b"ply\nformat binary_little_endian 1.0\nelement vertex 5\nproperty double x\n",
        "a.dat": b'VARIABLES = "X", "Y"\nZONE NODES = 5, ELEMENTS = 4,\n'
        b"DATAPACKING = BLOCK, ZONETYPE = FETRIANGLE\n0 1\n0 0\n",
        "a.node": b"# Thted ",
        "a.nas": b"BEGIN BULK",
    }[file]
    (tmp_path / file).write_bytes(content)
    (tmp_path / "scene.toml").write_text(MESH_SCENE.format(file=file))
    code, _, said = judge("foreign", tmp_path, "check", "scene.toml")
    assert code == 2
    assert f"{file}': it cannot be read as a mesh: its reader has not come to an end in 2 s" in said[0]


def test_elements_and_vertices_that_are_nowhere(tmp_path):
    (tmp_path / "scene.toml").write_text(MESH_SCENE.format(file="a.obj"))
    for old, new, told in (
        (b"f 3 4 5", b"f 3 4 9", "a triangle has vertex 8; the file has 5 vertices"),
        (b"v 0.0 1.0 0.0", b"v 1e200 1.0 0.0", "its vertex 3 is at (1e+200, 1, 0)"),
        (b"f 4 1 5", b"f", "its elements are not all of as many vertices"),
        (b"v 0.0 1.0 0.0", b"v nan 1.0 0.0", "its vertex 3 is at (nan, 1, 0)"),
    ):
        assert old in SEEDS["a.obj"]
        (tmp_path / "a.obj").write_bytes(SEEDS["a.obj"].replace(old, new))
        code, _, said = judge("meshes", tmp_path, "check", "scene.toml")
        assert code == 2
        assert told in said[0]
