"""Inputs that a coverage-guided fuzzer makes, for the readers of scenes, formulas, meshes and checkpoints.

python tests/guided_fuzz.py scene|formula|gmsh|abaqus|vtu|checkpoint [--seconds 600]

It needs atheris (the extra ``fuzz``). What a reader may do with bytes is read them or refuse them in words; anything
else ends the run, and the input is kept under out/fuzz.
"""

from __future__ import annotations

import argparse
import contextlib
import logging
import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOM = Path(tempfile.mkdtemp())
SEEDS = Path(__file__).parent / "data"
READERS = {
    "scene": "*.toml",
    "formula": None,
    "gmsh": "meshes/*.msh",
    "abaqus": "meshes/*.inp",
    "vtu": "meshes/*.vtu",
    "checkpoint": None,
}


def readers(instrumented: Any) -> dict[str, Callable[[bytes], None]]:
    """The readers by name, imported so that the fuzzer sees which lines they run."""
    with instrumented(include=["skfem_peridynamics"]):
        from skfem_peridynamics.app.files.checkpoint import DamagedCheckpoint, read_checkpoint
        from skfem_peridynamics.app.scene.formula import Formula, FormulaError
        from skfem_peridynamics.app.scene.reading import SceneError
        from skfem_peridynamics.app.scene.scene import Scene
        from skfem_peridynamics.meshes.read_mesh import read_mesh

    def scene(content: bytes) -> None:
        with contextlib.suppress(SceneError):
            Scene.parse(content.decode(errors="replace"))

    def formula(content: bytes) -> None:
        import numpy as np

        with contextlib.suppress(FormulaError):
            Formula(content.decode(errors="replace"))(np.ones((2, 3)), 0.5)

    def mesh(suffix: str) -> Callable[[bytes], None]:
        path = ROOM / f"a{suffix}"

        def read(content: bytes) -> None:
            path.write_bytes(content)
            with contextlib.suppress(ValueError):
                read_mesh(path)

        return read

    def checkpoint(content: bytes) -> None:
        """With its beginning and its checksum made right: nine of ten would go no farther."""
        import hashlib

        whole = b"skfem-peridynamics checkpoint 1\n" + content
        (ROOM / "checkpoint.bin").write_bytes(whole + hashlib.sha256(whole).hexdigest().encode() + b"\n")
        with contextlib.suppress(DamagedCheckpoint):
            read_checkpoint(ROOM / "checkpoint.bin")

    meshes = {name: mesh(suffix) for name, suffix in (("gmsh", ".msh"), ("abaqus", ".inp"), ("vtu", ".vtu"))}
    return {"scene": scene, "formula": formula, "checkpoint": checkpoint, **meshes}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("reader", choices=READERS)
    parser.add_argument("--seconds", type=int, default=600)
    options = parser.parse_args()
    import atheris

    read, seeds = readers(atheris.instrument_imports)[options.reader], READERS[options.reader]
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    corpus, kept = ROOM / "corpus", Path("out/fuzz")
    corpus.mkdir()
    kept.mkdir(parents=True, exist_ok=True)
    for k, path in enumerate(sorted(SEEDS.glob(seeds)) if seeds else []):
        (corpus / str(k)).write_bytes(path.read_bytes())
    if options.reader == "formula":
        (corpus / "0").write_text("2*x^-1 + min(sin(y), step(t - 1e-3)) >= pi/(e + 1)")
    if options.reader == "checkpoint":
        (corpus / "0").write_bytes(
            b'{"kind": "state", "numbers": {"t": 1, "step": 2, "dt": 0.5, "work": 0, "initial": 0, "dissipated": 0}, '
            b'"rows": [[0, 1]], "frames": [0.0], "facts": {}, "vectors": ["u", "v", "a"]}\n' + bytes(48)
        )
    limits = [f"-max_total_time={options.seconds}", "-rss_limit_mb=2000", "-timeout=10", "-print_final_stats=1"]
    atheris.Setup([sys.argv[0], *limits, f"-artifact_prefix={kept}/{options.reader}-", str(corpus)], read)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
