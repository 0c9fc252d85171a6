"""The tables of docs/evidence/error_against_run_time.md, from the rows of docs/evidence/study that the studies left.

python docs/benchmarks/study_tables.py [folder]
"""

from __future__ import annotations

import csv
import dataclasses
import sys
from pathlib import Path

from skfem_peridynamics.app.report.study_page import by_scheme, reach_table, shown
from skfem_peridynamics.study.measure import Row
from skfem_peridynamics.study.result import rates

FOLDER = Path(__file__).parents[1] / "evidence" / "study"
RACES = ("smooth-1d", "smooth-2d", "smooth-3d", "layer-2d", "layer-3d", "waves-2d")
RATES = (
    ("smooth-1d", "regular"),
    ("layer-1d", "regular"),
    *((f"smooth-{d}d", kind) for d in (2, 3) for kind in ("regular", "random", "graded")),
)
SHORT = {
    "vertex pairs, partial volume; lumped mass": "classical",
    "vertex pairs, partial volume, balanced; lumped mass": "vertex pairs, balanced",
    "corner pairs of the mesh, balanced; lumped mass": "corner pairs, balanced",
    "Gauss-point pairs, partial volume; consistent mass": "Gauss pairs",
}


def short(name: str) -> str:
    name = SHORT.get(name, name)
    name = name.replace(", Gauss points outside", ", Gauss").replace(", vertices outside", ", vertices")
    if name.startswith(("ball 3 x", "ball 2 x", "ball 4 x", "ball 5 x", "ball of")):
        name = name.replace("; consistent mass", "")
        name = name if "Gauss" in name else name.replace("; lumped mass", "")
    return name


def rows_of(folder: Path, name: str) -> list[Row]:
    kinds = {f.name: {"str": str, "int": int, "float": float}[str(f.type)] for f in dataclasses.fields(Row)}
    with open(folder / f"{name}.csv", newline="") as file:
        return [Row(**{key: kind(line[key]) for key, kind in kinds.items()}) for line in csv.DictReader(file)]


def table(columns: tuple, rows: list) -> None:
    print("| " + " | ".join(columns) + " |\n|" + "---|" * len(columns))
    for row in rows:
        print("| " + " | ".join(shown(x) for x in row) + " |")
    print()


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    out = []
    for name in RACES:
        rows = rows_of(folder, name)
        for kind in dict.fromkeys(row.mesh for row in rows):
            for line in reach_table([row for row in rows if row.mesh == kind])[1]:
                cost, error, classical, pairs, which, ball, which_ball, gain = line
                if pairs == ball == classical == "not reached":
                    continue
                best = [f"{shown(x)} {short(y)}".rstrip(" -") for x, y in ((pairs, which), (ball, which_ball))]
                out.append((f"{name}, {kind}", cost, error, classical, *best, gain))
    columns = ("study, meshes", "seconds of", "error", "classical", "best other pairs", "best ball", "times cheaper")
    table(columns, out)
    for name, kind in RATES:
        rows = [row for row in rows_of(folder, name) if row.mesh == kind]
        sizes = sorted({row.per_horizon for row in rows})
        print(f"{name}, {kind}, by vertices per horizon\n")
        lines = []
        interpolation = {row.per_horizon: row.interpolation for row in rows}
        lines.append(("(interpolation)", *(interpolation[m] for m in sizes), "", ""))
        for scheme, mine in by_scheme(rows):
            errors = {row.per_horizon: row.error_l2 for row in mine}
            slopes = ", ".join(shown(x) for x in rates(mine))
            last = rates(mine, "error_h1")[-1:] or [float("nan")]
            lines.append((short(scheme), *(errors.get(m, "") for m in sizes), slopes, last[0]))
        table(("scheme", *(f"{m:g}" for m in sizes), "rates", "H1, last rate"), lines)


if __name__ == "__main__":
    main()
