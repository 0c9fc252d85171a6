"""Change one operator or number of the package at a time and see whether a test fails; list what no test caught.

python tests/mutate.py --count 300 --seed 0 [--rooms bonds engine ...] [--skip 100]

A copy of the repository is changed, and the tests of the same name, of the same room, then those of model, engine,
stability and study are run until the first fails. Survivors are changes without a test, or changes of nothing: they
are for a person to tell apart.
"""

from __future__ import annotations

import argparse
import ast
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGE = "skfem_peridynamics"
ROOMS = ("bonds", "engine", "model", "solve", "analysis")
SWAPS: dict[type, str] = {
    **{ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "*", ast.Pow: "*"},
    **{ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "=="},
    **{ast.And: "or", ast.Or: "and", ast.BitAnd: "|", ast.BitOr: "&"},
}


def changes(path: Path) -> list[tuple[int, int, int, str]]:
    """Changes of a file: line, columns from and to, and the new text."""
    text = path.read_text()
    lines = text.splitlines()
    found = []
    for node in _computing(ast.parse(text)):
        if isinstance(node, ast.BinOp | ast.Compare | ast.BoolOp):
            first = node.left if isinstance(node, ast.BinOp | ast.Compare) else node.values[0]
            second = {ast.BinOp: "right", ast.Compare: "comparators", ast.BoolOp: "values"}[type(node)]
            other = getattr(node, second)
            other = other if isinstance(other, ast.expr) else other[1 if isinstance(node, ast.BoolOp) else 0]
            op = node.ops[0] if isinstance(node, ast.Compare) else node.op
            new = SWAPS.get(type(op))
            if new is None or first.end_lineno != other.lineno:
                continue
            between = lines[other.lineno - 1].encode()[first.end_col_offset : other.col_offset].decode()
            if "(" in between or ")" in between:
                continue
            found.append((other.lineno, first.end_col_offset, other.col_offset, f" {new} "))
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float) and node.lineno == node.end_lineno:
            new = "1" if node.value == 0 else f"({node.value!r} * 2)"
            found.append((node.lineno, node.col_offset, node.end_col_offset, new))
    return found


def _computing(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes but those of annotations, and of numbers that a module names: limits and tolerances have room."""
    yield node
    for name, value in ast.iter_fields(node):
        named = isinstance(node, ast.Module) and name == "body"
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or name in ("annotation", "returns"):
                continue
            if named and isinstance(child, ast.Assign) and isinstance(child.value, ast.Constant):
                continue
            yield from _computing(child)


def sites(rooms: tuple[str, ...]) -> list[tuple[Path, tuple[int, int, int, str]]]:
    """All changes of the rooms, but for those in annotations and the texts of messages."""
    out = []
    for room in rooms:
        for path in sorted((ROOT / PACKAGE / room).glob("*.py")):
            lines = path.read_text().splitlines()
            for change in changes(path):
                if not lines[change[0] - 1].lstrip().startswith(("raise", 'f"', '"', "_log", "from", "import", "@")):
                    out.append((path, change))
    return out


def caught(copy: Path, path: Path, change: tuple[int, int, int, str]) -> str:
    """Name of the first test that fails with the change, or nothing."""
    line, start, end, new = change
    target = copy / path.relative_to(ROOT)
    before = target.read_text()
    lines = before.splitlines(keepends=True)
    content = lines[line - 1].encode()
    lines[line - 1] = (content[:start] + new.encode() + content[end:]).decode()
    target.write_text("".join(lines))
    room = path.parent.name
    own = [test.relative_to(copy).as_posix() for test in (copy / "tests" / room).glob(f"test_*{path.stem[:5]}*.py")]
    near = [f"tests/{room}", f"{PACKAGE}/{room}"]
    far = [tests for tests in ("tests/model", "tests/engine", "tests/stability", "tests/study") if tests not in near]
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "2", "-p", "no:cacheprovider"]
    try:
        for tests in filter(None, (own, near, far)):
            ended = subprocess.run(
                [*command, *tests], cwd=copy, capture_output=True, timeout=1800, check=False, text=True
            )
            if ended.returncode != 0:
                failed = [text for text in ended.stdout.splitlines() if text.startswith(("FAILED", "ERROR"))]
                return failed[0].split(" - ")[0] if failed else f"pytest ended with {ended.returncode}"
        return ""
    except subprocess.TimeoutExpired:
        return "the tests did not end"
    finally:
        target.write_text(before)


def main() -> None:
    """Print each change and what became of it, and the share that was caught."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", nargs="+", default=ROOMS)
    parser.add_argument("--skip", type=int, default=0, help="begin after so many, where an earlier run ended")
    options = parser.parse_args()
    chosen = random.Random(options.seed).sample(found := sites(tuple(options.rooms)), min(options.count, len(found)))
    chosen, dead = chosen[options.skip :], 0
    with tempfile.TemporaryDirectory() as room:
        copy = Path(room) / "copy"
        shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".git", ".venv", "__pycache__", "out"))
        for number, (path, change) in enumerate(chosen, 1):
            test = caught(copy, path, change)
            dead += bool(test)
            line = path.read_text().splitlines()[change[0] - 1].strip()
            where = f"{path.relative_to(ROOT).as_posix()}:{change[0]}:{change[1]}"
            print(f"{'caught  ' if test else 'SURVIVED'} {where} {line!r} ->{change[3]!r} {test}", flush=True)
            print(f"{dead} of {number} caught", file=sys.stderr, flush=True)
    print(f"{dead} of {len(chosen)} caught, {dead / max(len(chosen), 1):.0%}")


if __name__ == "__main__":
    main()
