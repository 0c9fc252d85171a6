"""Run a scene into a folder."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from .._types import Floats
from .._version import __version__
from ..analysis.clock import Clock
from ..analysis.damage import Census, census, damage
from ..model.rigidity import check_rigid
from ..solve.state import State
from ..solve.static import Equilibrium
from . import plot
from .build import Problem
from .formula import FormulaError
from .march import march, notes
from .meshes import blame
from .output import Frames, History, clear, write_summary
from .reading import SceneError
from .scene import Scene

_log = logging.getLogger("skfem_peridynamics")
COLUMNS = (
    "t",
    "step",
    "kinetic",
    "intact",
    "softened",
    "total",
    "work",
    "imbalance",
    "softened_bonds",
    "largest_Z",
)


class Progress(Protocol):
    """What a run tells while it goes on."""

    def begin(self, what: str, steps: int) -> None: ...

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None: ...

    def end(self) -> None: ...


class Silent:
    """A progress that says nothing."""

    def begin(self, what: str, steps: int) -> None:
        pass

    def advance(self, step: int, energy: float | None = None, largest_Z: float | None = None) -> None:
        pass

    def end(self) -> None:
        pass


def peak_memory_mb() -> float:
    """Return the largest memory this process has held, in MB (nan where the system does not tell)."""
    try:
        import resource
    except ImportError:
        return float("nan")
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0


def marks(steps: int, count: int) -> set[int]:
    """Return ``count`` steps spread over a run, the first and the last among them.

    >>> sorted(marks(10, 3))
    [0, 5, 10]
    """
    if count < 2:
        return {steps} if count else set()
    return {round(k * steps / (count - 1)) for k in range(count)}


def run(
    scene: Scene, out: str | Path, progress: Progress | None = None, *, with_estimate: bool = False
) -> dict[str, Any]:
    """Run a scene, write its files into ``out`` and return the summary.

    Everything the scene says is checked before the folder is made. The files: ``frame_*.vtu`` and ``frames.pvd``,
    ``history.csv``, ``damage.png`` and ``energies.png``, and last ``summary.json``.

    What an earlier run left there under these names is removed first. Raises :class:`SceneError` for a scene that
    makes no sense and ``UnstableRun`` when the energy balance breaks; what was written until then stays, and the
    summary says why the run stopped.
    """
    progress = progress or Silent()
    out, clock = Path(out), Clock("setup", "cfl", "steps", "output")
    problem = Problem(scene)
    pictures = plot.available() if scene.output.pictures is None else scene.output.pictures
    if pictures and not plot.available():
        raise SceneError('output.pictures = true needs matplotlib: install the extra "plot", or set it to false')
    if out.exists() and not out.is_dir():
        raise SceneError(f"output folder {str(out)!r} exists and is not a folder")
    with clock.phase("setup"):
        for part in (
            ("load", "fixed", "u0", "v0") if scene.time.scheme == "static" else ("load", "fixed", "u0", "v0", "mass")
        ):
            getattr(problem, part)
        blocks = len(problem.resting.blocks)
        with blame("bonds"):
            check_rigid(problem.resting)
    with clock.phase("cfl"):
        limit, dt = problem.limit if problem.explicit else None, problem.dt
    with clock.phase("setup"):
        states = march(problem, dt)
    for note in notes(problem):
        _log.warning(note)
    steps = round(scene.time.until / dt)
    summary: dict[str, Any] = {
        "title": scene.title,
        "version": __version__,
        "status": "running",
        "rule": problem.bonds.rule.name,
        "scheme": problem.scheme,
        "nodes": int(problem.mesh.nvertices),
        "bonds": int(problem.bonds.nbonds),
        **_balance(problem),
        "blocks": blocks,
        "kernels": "compiled" if problem.body.compiles else "sparse products",
        "dt": dt,
        **({"dt_limit": limit.steps()} if limit is not None else {}),
        "steps": steps,
    }
    try:
        out.mkdir(parents=True, exist_ok=True)
        clear(out)
        history = History(out / "history.csv", COLUMNS)
    except OSError as error:
        raise SceneError(f"output folder {str(out)!r} cannot be written: {error.strerror}") from None
    frames = Frames(out, problem.basis) if scene.output.frames else None
    at_frame, at_row = marks(steps, scene.output.frames), marks(steps, max(2, scene.output.history))
    progress.begin(scene.title, steps)
    state: State | Equilibrium | None = None
    try:
        with clock.phase("steps"):
            for state in states:
                # an implicit step may be cut: whole ones are counted, and others written nowhere
                now = state.step if problem.explicit else _whole(state.t / dt)
                if now in at_row:
                    with clock.phase("output"):
                        row = _row(state, census(problem.body, state.u))
                        history.add(*row)
                        progress.advance(now, row[5], row[9])
                elif now is not None:
                    progress.advance(now)
                if frames is not None and now in at_frame:
                    with clock.phase("output"):
                        hurt = damage(problem.body, state.u)
                        fields = {
                            "displacement": state.u,
                            **({"velocity": state.v} if isinstance(state, State) else {}),
                            "intact": hurt.intact,
                            "Z": hurt.Z,
                        }
                        frames.write(state.t, **fields)
        assert state is not None
        if pictures:
            with clock.phase("output"):
                _pictures(out, problem, state.u, history)
        if with_estimate:
            from .estimate import estimate

            with clock.phase("estimate"):
                summary |= estimate(problem)
        summary["status"] = "finished"
    except FormulaError as error:  # a load or a motion that is no number at some later time
        summary["status"] = f"stopped: {error}"
        raise SceneError(str(error)) from None
    except BaseException as error:
        summary["status"] = f"stopped: {str(error) or type(error).__name__}"
        raise
    finally:
        history.close()
        progress.end()
        if state is not None:
            summary["steps"] = state.step
            total, imbalance = history.column("total"), history.column("imbalance")
            peak = max(float(np.max(total, initial=0.0)), np.finfo(float).tiny)
            if scene.time.scheme == "static":  # what cracks that ran away have lost
                summary["energy_lost"] = -float(np.min(imbalance, initial=0.0)) / peak
                imbalance = np.maximum(imbalance, 0.0)
            if not problem.explicit:
                summary |= {
                    "newton_iterations": problem.effort.iterations,
                    "hessian_products": problem.effort.products,
                }
            summary |= {
                "energy_drift": float(np.max(np.abs(imbalance), initial=0.0)) / peak,
                "softened_bonds": int(history.rows[-1][8]) if history.rows else 0,
                "largest_Z": max((row[9] for row in history.rows), default=0.0),
                "seconds": {name: round(value, 6) for name, value in clock.seconds.items()},
                "seconds_per_step": clock.seconds["steps"] / max(1, state.step),
                "peak_memory_mb": round(peak_memory_mb(), 1),
                **({"stiffness_products_for_cfl": limit.products} if limit is not None else {}),
            }
            write_summary(out / "summary.json", summary)
    return summary


def _balance(problem: Problem) -> dict[str, Any]:
    """What the summary says of balanced weights; nothing where there are none."""
    balance = problem.bonds.balance
    if balance is None:
        return {}
    return {"unbalanced_vertices": len(balance.unbalanced), "smallest_weight_ratio": balance.smallest}


def _whole(number: float) -> int | None:
    """The integer that a number is, or None."""
    return round(number) if abs(number - round(number)) < 1e-6 else None


def _row(state: State | Equilibrium, count: Census) -> tuple[float, ...]:
    kinetic = state.kinetic
    total = kinetic + count.elastic
    imbalance = total - state.work - state.initial
    return (
        *(
            state.t,
            state.step,
            kinetic,
            count.energy_intact,
            count.energy_softened,
            total,
            state.work,
            imbalance,
        ),
        *(count.softened, count.Z),
    )


def _pictures(out: Path, problem: Problem, u: Floats, history: History) -> None:
    title = problem.scene.title
    plot.plot_damage(out / "damage.png", problem.basis, u, damage(problem.body, u).intact, title)
    plot.plot_energies(out / "energies.png", history, title)
