"""Run all cases, and write docs/evidence/validation.md with its pictures; with --quick or named cases only print."""

from __future__ import annotations

import argparse
import importlib
import logging
import sys
import time
from pathlib import Path

CASES = ("waves", "toughness", "static_crack", "mode_one", "branching", "kalthoff", "beam", "poisson")
DOCS = Path(__file__).parents[2] / "docs" / "evidence"
HEAD = """# Validation

What the package predicts, beside closed forms, experiments and other simulations: eight cases, each a script (and where
it is a run, a scene) in `examples/validation/`. `python examples/validation/run_all.py` runs all and writes this page;
the name of a case prints that one. Error estimates in the last table of a case are the distance to the exact figure
where there is one, and the energy drift of a run elsewhere.
"""


def main() -> int:
    """Run the cases; return 1 where a figure does not hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"some of {', '.join(CASES)}; all by default")
    parser.add_argument(
        "--quick", action="store_true", help="coarse versions of waves, toughness, static_crack, kalthoff and poisson"
    )
    arguments = parser.parse_args()
    wrong = [name for name in arguments.cases if name not in CASES]
    if wrong:
        parser.error(f"there is no case {wrong[0]!r}; the cases are {', '.join(CASES)}")
    logging.disable(logging.WARNING)
    sys.path.insert(0, str(Path(__file__).parent))
    whole = not arguments.cases and not arguments.quick
    start, pages = time.perf_counter(), []
    for name in arguments.cases or CASES:
        print(f"{name}:", flush=True)
        pages.append(importlib.import_module(name).run(DOCS / "validation" if whole else Path("out"), arguments.quick))
    good = sum(one.holds for page in pages for one in page.figures)
    count = sum(len(page.figures) for page in pages)
    said = f"{good} of {count} figures hold, {time.perf_counter() - start:.0f} s."
    print(said)
    if whole:
        rows = []
        for one in pages:
            anchor = one.title.lower().replace(" ", "-").replace("'", "")
            held = sum(figure.holds for figure in one.figures)
            rows.append(f"| [{one.title}](#{anchor}) | {held} of {len(one.figures)} | {one.seconds:.0f} |")
        table = "\n".join(["| case | figures that hold | seconds |", "|---|---|---|", *rows])
        text = "\n".join([HEAD, said, "", table, "", *(page.markdown() for page in pages)])
        (DOCS / "validation.md").write_text(text)
    else:
        print("\n".join(page.markdown() for page in pages))
    return int(good < count)


if __name__ == "__main__":
    raise SystemExit(main())
