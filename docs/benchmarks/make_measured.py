"""Make skfem_peridynamics/study/measured.csv, the table behind rule = "auto", from study.csv files.

    python docs/benchmarks/make_measured.py out/smooth-1d/study.csv out/smooth-2d/study.csv out/smooth-3d/study.csv

Only regular and random meshes are used: graded meshes and the other studies are kept to judge the choice.
"""

import csv
import sys
from pathlib import Path

from skfem_peridynamics.study.choose_rule import CANDIDATES

COLUMNS = ("dim", "mesh", "scheme", "per_horizon", "error", "setup", "step")
known = {scheme.name for schemes in CANDIDATES.values() for scheme in schemes}
target = Path(__file__).parents[2] / "skfem_peridynamics" / "study" / "measured.csv"
with open(target, "w", newline="") as out:
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS)
    for name in sys.argv[1:]:
        with open(name) as file:
            for x in csv.DictReader(file):
                if x["scheme"] not in known or x["mesh"] not in ("regular", "random"):
                    continue
                nodes, steps = float(x["nodes"]), float(x["steps"])
                numbers = (
                    float(x["error_l2"]),
                    float(x["seconds_setup"]) / nodes,
                    float(x["seconds_steps"]) / nodes / steps,
                )
                writer.writerow(
                    [x["dim"], x["mesh"], x["scheme"], f"{float(x['per_horizon']):.4g}"]
                    + [f"{number:.4g}" for number in numbers]
                )
