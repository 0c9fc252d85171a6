"""The first rank of a run: it holds the scene's whole mesh, says what is done, and writes the files as ever."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..._types import Floats
from ...analysis.damage import Census, Damage
from ...model.rigidity import check_rigid
from ...ranks.make_body import ends_inside
from ...ranks.whole_body import WholeBody
from ...solve.cfl import StepLimit
from ...solve.instability import UnstableRun, Watch, watching
from ...solve.mass_solver import Chebyshev, Lumped, MassSolver
from ...solve.state import State
from ..problem.problem import Problem
from ..problem.states import states
from ..run.record import Marks
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene
from .crew import Crew

_SECONDS = 0.2  # of a block of steps after which the first rank looks up


def refuse(scene: Scene) -> None:
    """Raise :class:`SceneError` for what does not go over several processes yet."""
    no = {
        f"time.scheme = {scene.time.scheme!r} with material.breaking": (
            scene.time.scheme in ("newmark", "static") and scene.material.breaking is not None
        ),
        f'material.calibrate = "discrete" with bonds.rule = "{scene.bonds.rule}"': (
            scene.material.calibrate == "discrete" and scene.bonds.rule == "gauss_pairs"
        ),
    }
    found = [name for name, there in no.items() if there]
    if found:
        raise SceneError(f"{', '.join(found)}: does not go with --mpi yet; run it without")


def refuse_problem(problem: Problem) -> None:
    """Do so for what shows in the mesh and the materials."""
    if problem.scene.material.breaking is not None and (problem.dilated >= 0.0 or ends_inside(problem.rule)):
        other = "material.poisson other than that of bonds alone" if problem.dilated >= 0.0 else problem.rule.name
        raise SceneError(f"material.breaking with {other}: does not go with --mpi yet; run it without")


@dataclass(frozen=True, eq=False)
class LeadingProblem(Problem):
    """A problem whose bonds are those of all ranks."""

    crew: Crew | None = None
    notes: list[str] = field(default_factory=list)  # what was said as the problem was made
    _seen: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def _crew(self) -> Crew:
        assert self.crew is not None
        return self.crew

    @cached_property
    def bonds(self) -> Any:
        """What a run asks of all bonds."""
        counts, balance = self._crew.order("bonds")
        self.check_horizon()
        return SimpleNamespace(
            nbonds=sum(counts),
            balance=balance,
            dim=int(self.mesh.dim()),
            mesh=self.mesh,
            horizon=self.scene.bonds.horizon,
            rule=self.rule,
            vertex_weight=self.scene.bonds.boundary_function,
            samples=SimpleNamespace(at_vertices=self._crew.body.any_piece.bonds.samples.at_vertices),
            ranks=counts,
        )

    @cached_property
    def body_at_rest(self) -> Any:
        """What a run asks of the whole body."""
        return WholeBody(self._crew, self.bonds, self.material)

    @cached_property
    def body(self) -> Any:
        """The same."""
        return self.body_at_rest

    @cached_property
    def limit(self) -> StepLimit:
        """The stable step of the body at rest."""
        found: StepLimit = self.known_limit if self.known_limit is not None else self._crew.order("limit")
        return found

    def check_rigid(self) -> None:
        """Raise :class:`SceneError` where bonds leave a vertex or the whole body free to move."""
        with blame("bonds"):
            check_rigid(self.body_at_rest)

    def look(self, state: Any, count: bool, damage: bool) -> tuple[Census | None, Damage | None]:
        """Return the census and the damage at a state."""
        if self._seen.get("t") != state.t:
            self._crew.given = (state.u, None, None)
            self._seen["t"], self._seen["look"] = state.t, self._crew.order("look")
        counted, hurt = self._seen["look"]
        return counted if count else None, hurt if damage else None

    def intact(self, count: Census) -> Floats:
        """Return the fraction of each vertex's bonds that are left, at the state that was looked at last."""
        found: Floats = self._seen["look"][1].intact
        return found

    def stress(self, state: Any) -> Floats:
        """Return the stress at the vertices at a state."""
        self._crew.given = (state.u, None, None)
        found: Floats = self._crew.order("stress")
        return found

    def states(self, dt: float, start: State | None, watch: Any) -> Iterator[State]:
        """Return whole states: those of explicit schemes at the ends of blocks of steps, where something is written and
        some times a second. Implicit steps are made here, with operators that all ranks compute.
        """
        return self._explicit(dt, start, watch) if self.explicit else states(self, dt, start, watch)

    def _explicit(self, dt: float, start: State | None, watch: Watch) -> Iterator[State]:
        time_table, crew = self.scene.time, self._crew
        steps, output = round(time_table.until / dt), self.scene.output
        if start is not None:
            numbers = {name: getattr(start, name) for name in (*State.NUMBERS, "broken") if name != "lag"}
            crew.start, crew.given = numbers, (start.u, start.v, start.a)
        else:
            crew.given = (self.u0, self.v0, None)
        has = (True, True) if start is not None else (self.u0 is not None, self.v0 is not None)
        crew.order("begin", dt, time_table.until, self.limit, has, start is not None)
        step = 0 if start is None else start.step
        first = self._whole() if start is None else start
        watching(watch, self.limit, abs(first.initial))
        if start is None:
            yield first
        marks = Marks(steps, output.frames), Marks(steps, max(2, output.history))
        block = 1
        while step < steps:
            ahead = 1
            while ahead < block and step + ahead < steps:
                there = step + ahead
                if any(there in mark for mark in marks) or (output.every.steps and there % output.every.steps == 0):
                    break
                ahead += 1
            before = time.perf_counter()
            sound = crew.order("advance", ahead)
            spent = time.perf_counter() - before
            step += ahead
            block = max(1, min(4 * block, int(_SECONDS * ahead / max(spent, 1e-9))))
            if not sound:
                failed = crew.failed
                assert failed is not None
                raise UnstableRun(str(failed), self._whole(), failed.step)
            yield self._whole()

    def _whole(self) -> State:
        """The last state, of the whole body."""
        numbers, (u, v, a) = self._crew.order("state")
        return State(u=u, v=v, a=a, _body=self.body, _mass=self._whole_mass, **numbers)

    @cached_property
    def _whole_mass(self) -> MassSolver:
        """The mass of the whole body: states only multiply with it."""
        if self.mass_kind == "lumped":
            return Lumped(self.mass.diagonal())
        return Chebyshev(self.mass, np.zeros(0, dtype=np.int64))
