"""What `check` expects of five scenes beside what happens: seconds, memory, megabytes a frame, as ratios.

python docs/benchmarks/estimates.py [--without-fast]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = {  # and how much shorter they are made
    "glass_branching.toml": 1.0,
    "notched_part.toml": 1.0,
    "double_cantilever.toml": 1.0,
    "block3d.toml": 0.2,
    "waves, balls": 1.0,
}
WAVES = """
title = "waves, balls"
mesh = {box = [[0, 1], [0, 1]], divisions = [80, 80]}
material = {young = 1.0, density = 1.0, plane = "stress", potential = "linear"}
bonds = {horizon = 0.05, rule = "ball"}
initial = {velocity = ["sin(6.28*x)", "0"]}
time = {until = 1.0}
output = {frames = 8}
"""


def shortened(text: str, part: float) -> str:
    """The scene with its end after a part of its time."""
    return re.sub(r"until = ([-+.0-9e]+)", lambda found: f"until = {part * float(found[1]):g}", text, count=1)


def row(name: str, part: float, environment: dict[str, str]) -> tuple[str, float, float, float]:
    """Expected over found: seconds, memory, megabytes a frame."""
    with tempfile.TemporaryDirectory() as room:
        text = WAVES if name not in os.listdir(EXAMPLES) else (EXAMPLES / name).read_text()
        scene = EXAMPLES / "estimate_of_a_scene.toml"
        scene.write_text(shortened(text, part))
        try:
            command = [sys.executable, "-m", "skfem_peridynamics"]
            told = subprocess.run(
                [*command, "check", str(scene)], env=environment, capture_output=True, text=True, check=True
            ).stdout
            out = Path(room) / "out"
            subprocess.run(
                [*command, "run", str(scene), "--out", str(out), "--quiet"],
                env=environment,
                check=True,
                capture_output=True,
            )
        finally:
            scene.unlink()
        summary = json.loads((out / "summary.json").read_text())
        frames = [path.stat().st_size for path in out.glob("frame_*.vtu")]
    seconds = float(re.search(r"about ([.0-9e+]+) s: ", told)[1])
    memory = float(re.search(r"memory\s+about ([0-9]+) MB", told)[1])
    frame = float(re.search(r"frames of about ([.0-9e-]+) MB", told)[1])
    spent = sum(value for phase, value in summary["seconds"].items() if phase != "estimate")
    return (
        summary["kernels"],
        seconds / spent,
        memory / summary["peak_memory_mb"],
        frame * 1e6 * len(frames) / sum(frames),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--without-fast", action="store_true", help="as if numba were not installed")
    environment = dict(os.environ)
    if parser.parse_args().without_fast:
        environment["NUMBA_DISABLE_JIT"] = "1"
    print("| scene | kernels | seconds | memory | a frame | (expected over found)\n|---|---|---|---|---|")
    for name, part in SCENES.items():
        kernels, *ratios = row(name, part, environment)
        print(f"| {name} | {kernels} | " + " | ".join(f"{ratio:.2f}" for ratio in ratios) + " |", flush=True)


if __name__ == "__main__":
    main()
