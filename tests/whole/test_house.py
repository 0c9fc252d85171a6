"""The house: imports run one way and in no circle, rooms stay small, public docstrings say what a caller needs."""

import ast
import inspect
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

import skfem_peridynamics as peri

ROOT = Path(peri.__file__).parent
# a room imports from rooms of a lower number; modules at the top serve all
RANK = {
    "geometry": 0, "material": 0, "meshes": 1, "bonds": 1, "engine": 2, "model": 3, "solve": 4, "analysis": 4,
    "study": 5, "stability": 5, "ranks": 5, "app.scene": 6, "app.problem": 7, "app.files": 7, "app.report": 8,
    "app.run": 9, "app.ranks": 10, "app.cli": 11,
}  # fmt: skip
MOST_FILES = 20
# the public names of version 0.1.0
NAMES = """
BallRule BondBasis Breaking Census Composite Crack CrackPath Damage Effort Elastic Energies Equilibrium
Exponential Frames Influence Linear Material NotConverged PairRule Peridynamics Potential Prescribed Rational
Scalars Scene State StepLimit UnstableRun __version__ body_force boundary_function census central_difference
collar conical constant crack_path damage discrete_energy dispersion gaussian interpolate j_integral
layer_traction load_state mass_matrix newmark own_potential project region run save_state slit
stable_time_step static strain stress traction
"""


def modules():
    return [path for path in ROOT.rglob("*.py") if path.name != "__init__.py"]


def room(parts):
    """The room of a module, given its names below the package; nothing for what stands at the top."""
    if len(parts) < 2:
        return ""
    return ".".join(parts[:2]) if parts[0] == "app" else parts[0]


@cache
def imports():
    """Every import within the package, wherever it stands: module -> modules, as tuples of names."""
    names = {path.relative_to(ROOT).with_suffix("").parts for path in modules()}
    edges = {}
    for path in modules():
        here = path.relative_to(ROOT).with_suffix("").parts
        edges[here] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = (*here[: len(here) - node.level], *(node.module.split(".") if node.module else ()))
                for alias in node.names:
                    edges[here] |= {target for target in ((*base, alias.name), base) if target in names}
    return edges


def test_imports_are_found():
    """What the other tests stand on: known imports, at the top of a file and inside a function."""
    assert ("bonds", "bond_list") in imports()["bonds", "bond_basis"]
    assert ("engine", "compiled_engine") in imports()["engine", "engine"]
    assert sum(map(len, imports().values())) > 400


def test_imports_run_one_way():
    wrong = [
        (".".join(here), ".".join(there))
        for here, targets in imports().items()
        for there in targets
        if room(here) and room(there) and room(here) != room(there) and RANK[room(there)] >= RANK[room(here)]
    ]
    assert wrong == []


def test_imports_have_no_circle():
    reached, edges = {}, imports()

    def visit(here, path):
        assert here not in path, " -> ".join(".".join(names) for names in (*path, here))
        if here not in reached:
            reached[here] = True
            for there in edges[here]:
                visit(there, (*path, here))

    for here in edges:
        visit(here, ())


def test_rooms_are_small():
    counts = {}
    for path in modules():
        counts[path.parent] = counts.get(path.parent, 0) + 1
    assert max(counts.values()) <= MOST_FILES, counts


def test_no_room_hides_a_public_name():
    """Importing a folder of the package makes it an attribute, which would take the place of a function."""
    rooms = {path.name for path in ROOT.iterdir() if path.is_dir()}
    assert not rooms & set(peri.__all__)


def test_every_module_says_what_it_is_for():
    wordless = [str(path) for path in ROOT.rglob("*.py") if not ast.get_docstring(ast.parse(path.read_text()))]
    assert wordless == []


def test_tests_do_not_import_each_other():
    files = [path for path in Path(__file__).parents[1].rglob("*.py")]
    assert len(files) > 50
    assert not [path for path in files if re.search(r"^\s*(from|import) test_", path.read_text(), re.M)]


def test_public_names():
    """More may come, none may go."""
    names = NAMES.split()
    assert set(names) <= set(peri.__all__)
    assert all(hasattr(peri, name) for name in names)


def public_objects():
    """Public functions and classes, and the methods of these that are not a property and have no leading bar."""
    for name in sorted(set(peri.__all__) - {"__version__"}):
        thing = getattr(peri, name)
        if not (inspect.isclass(thing) or inspect.isfunction(thing)):
            continue  # an instance, described by its class
        yield name, thing
        if inspect.isclass(thing):
            for key, member in vars(thing).items():
                function = member.__func__ if isinstance(member, classmethod | staticmethod) else member
                if inspect.isfunction(function) and not key.startswith("_"):
                    yield f"{name}.{key}", function


PUBLIC = dict(public_objects())


def parameters(thing):
    """The names a caller may give."""
    if inspect.isclass(thing) and issubclass(thing, Exception):
        return []
    names = inspect.signature(thing).parameters.values()
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    return [stars.get(p.kind, "") + p.name for p in names if p.name not in ("self", "cls") and p.name[0] != "_"]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_docstrings_have_their_sections(name):
    """Parameters by name, order and type, returns, raises, and an example with a number, as numpydoc reads them."""
    from numpydoc.docscrape import NumpyDocString

    thing = PUBLIC[name]
    text = inspect.getdoc(thing)
    assert text, f"{name} has no docstring"
    doc = NumpyDocString(text)
    assert doc["Summary"], name
    documented = [key.strip() for entry in doc["Parameters"] for key in entry.name.split(",")]
    assert documented == parameters(thing)
    for entry in (*doc["Parameters"], *doc["Returns"], *doc["Yields"]):
        assert entry.desc, f"{name}: {entry.name or entry.type} is not described"
    assert all(entry.type for entry in doc["Parameters"] if not entry.name.startswith("*")), (
        f"{name}: a type is missing"
    )
    source = inspect.getsource(thing)
    if inspect.isfunction(thing):
        returns = thing.__annotations__.get("return")
        if returns not in (None, "None"):
            assert doc["Returns"] or doc["Yields"], f"{name} says nothing of what it returns"
        if re.search(r"^\s+raise \w+", source, re.M) and "NotImplementedError" not in source:
            assert doc["Raises"], f"{name} raises and does not say so"
    if "." not in name:
        assert ">>>" in text, f"{name} has no example"


def test_the_oldest_versions_tested_are_the_oldest_promised():
    """.ci/oldest.txt is what the job for the oldest versions installs."""
    top = Path(__file__).parents[2]
    project = tomllib.loads((top / "pyproject.toml").read_text())["project"]
    promised = {}
    for entry in project["dependencies"] + project["optional-dependencies"]["test"]:
        name, version = re.match(r"([\w-]+)>=([\d.]+)", entry).groups()
        promised[name] = version
    lines = (top / ".ci" / "oldest.txt").read_text().splitlines()
    tested = dict(re.match(r"([\w-]+)==([\d.]*\d)", line).groups() for line in lines if not line.startswith("#"))
    assert set(tested) == set(promised)
    for name, version in tested.items():
        assert version == promised[name] or re.fullmatch(re.escape(promised[name]) + r"(\.0)+", version), name
