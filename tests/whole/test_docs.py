"""Commands that the documents name: files are there, tests have the names, options and subcommands are known."""

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

import skfem_peridynamics as peri
from skfem_peridynamics.app.cli.main import make_parser

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
KEYWORDS = {"and", "or", "not"}
BEGINS = ("python ", "pytest", "skfem-peridynamics", "tests/", ".ci/", "docs/", "examples/")


def spans():
    """Code between backquotes, and lines of code blocks, that begin like commands or files of this repository."""
    for path in DOCUMENTS:
        text = path.read_text()
        blocks = re.findall(r"^```(?:sh|bash|console)?\n(.*?)^```", text, re.S | re.M)
        lines = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
        for span in (*re.findall(r"`([^`\n]+)`", text), *lines):
            for part in re.split(r"&&|;|\|", span):
                if part.strip().startswith(BEGINS):
                    yield path.relative_to(ROOT).as_posix(), part.strip()


SPANS = sorted(set(spans()))


def names_of(path):
    """Names of the tests of a file or folder, with the texts of their parameters."""
    found = []
    for file in [path] if path.is_file() else sorted(path.rglob("test_*.py")):
        tree = ast.parse(file.read_text())
        found += [node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
        found += [
            node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)
        ]
    return " ".join([path.name, *found])


def test_there_are_commands():
    assert len(SPANS) > 60


@pytest.mark.parametrize(("document", "span"), SPANS)
def test_a_command_of_the_documents_is_there(document, span):
    words = shlex.split(span.replace("(", " ").replace(")", " "), posix=True)
    files = [word.split("::")[0].rstrip(":,") for word in words if "/" in word and not word.startswith("-")]
    for file in files:
        if re.match(r"(tests|docs|examples|\.ci)/", file) and not re.search(r"[*{<]|\.\.\.", file):
            assert (ROOT / file).exists(), f"{document}: {span}: {file} is not there"
    if "pytest" in words or words[0].startswith("tests/"):
        where = [ROOT / file for file in files if file.startswith("tests")] or [ROOT / "tests"]
        chosen = words[words.index("-k") + 1] if "-k" in words else words[1] if words[0].endswith(".py:") else ""
        names = " ".join(names_of(path) for path in where)
        for word in set(re.findall(r"\w+", chosen)) - KEYWORDS:
            assert word in names, f"{document}: {span}: no test is called {word}"
    if words[0] == "skfem-peridynamics" and len(words) > 1:
        subcommands = make_parser()._subparsers._group_actions[0].choices
        assert words[1] in subcommands, f"{document}: {span}: there is no such subcommand"
        known = subcommands[words[1]].format_help()
        for word in words[2:]:
            assert not word.startswith("--") or word in known, f"{document}: {span}: there is no {word}"


def blocks_of_python():
    for path in DOCUMENTS:
        for k, block in enumerate(re.findall(r"^```python\n(.*?)^```", path.read_text(), re.S | re.M)):
            yield path.relative_to(ROOT).as_posix(), k, block


BLOCKS = list(blocks_of_python())


@pytest.mark.parametrize(
    ("document", "block"), [(name, block) for name, _, block in BLOCKS], ids=lambda text: text[:30]
)
def test_the_code_of_the_documents_is_that_of_the_package(document, block):
    """It is Python, and every public name and method that it calls is there."""
    tree = ast.parse(block)
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "peri":
            assert hasattr(peri, node.attr), f"{document}: there is no peri.{node.attr}"
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("skfem_peridynamics"):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, name.name) for name in node.names), f"{document}: {node.module}"


def test_the_first_form_prints_what_its_page_says(capsys):
    page = "docs/start/first_form.md"
    names = {}
    for document, _, block in BLOCKS:
        if document == page:
            exec(compile(block, page, "exec"), names)
    said = capsys.readouterr().out
    told = re.search(r"^prints `(.*)`", (ROOT / page).read_text(), re.M)[1]
    assert said.splitlines()[0] == told
    assert "Peridynamics: Exponential law; BondBasis: " in said


def test_every_public_name_is_in_the_reference():
    listed = re.findall(r"^   (\w+)$", (ROOT / "docs/api/index.rst").read_text(), re.M)
    assert sorted(listed) == sorted([*(set(peri.__all__) - {"__version__"}), "distributed"])


def test_every_page_is_reached_from_the_front():
    """By a table of contents of the front page, or of the reference; benchmarks and tables of studies are not pages."""
    front = (ROOT / "docs/index.md").read_text()
    entries = set(re.findall(r"^([\w/]+)$", front, re.M))
    pages = {
        path.relative_to(ROOT / "docs").with_suffix("").as_posix()
        for path in (ROOT / "docs").rglob("*.md")
        if not {"study", "learn", "made"} & set(path.relative_to(ROOT / "docs").parts)
    }
    assert pages - {"index"} <= entries
    assert {entry for entry in entries if not entry.startswith(("learn", "api"))} <= pages
