"""What following the crack, and bonds that break for good, cost in the branching plate: docs/howto/results.md."""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

from skfem_peridynamics import Scene, run

ROUNDS = 3
PLATE = Path(__file__).parent.parent.parent / "examples" / "glass_branching.toml"


def main() -> None:
    """Print the median seconds of steps and output, and their ratio to the plain run."""
    plain = PLATE.read_text().replace("[output]", "[output]\npictures = false") + "\n[measure]\ncrack = false\n"
    switches = 'plane = "stress"\ncompression = "elastic"\nbreaking = 3.0'
    scenes = {
        "plain": plain,
        "crack followed": plain.replace("crack = false", "crack = true"),
        "breaking, elastic in compression": plain.replace('plane = "stress"', switches),
    }
    seconds: dict[str, list[tuple[float, float]]] = {name: [] for name in scenes}
    for _ in range(ROUNDS):
        for name, content in scenes.items():
            with tempfile.TemporaryDirectory() as room:
                spent = run(Scene.parse(content), Path(room) / "out")["seconds"]
            seconds[name].append((spent["steps"], spent["output"]))
    for name, some in seconds.items():
        steps, output = (statistics.median(one) for one in zip(*some, strict=True))
        ratio = statistics.median(a[0] / b[0] for a, b in zip(some, seconds["plain"], strict=True))
        print(f"{name}: steps {steps:.2f} s ({ratio:.2f} of plain), output {output:.2f} s")


if __name__ == "__main__":
    main()
