"""What all ranks of a run do together, when the first one says so."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..._types import Csr, Floats, Load, Longs
from ...bonds.bond_list import Balance
from ...material.composite import Composite
from ...model.breaking import sorted_pairs
from ...ranks.body import RankBody
from ...ranks.breaking_ranks import BreakingRanks
from ...ranks.distributed import distributed
from ...ranks.limit import stable_time_step
from ...ranks.mass import RankMass
from ...ranks.operators import Operators
from ...solve.central_difference import central_difference
from ...solve.cfl import StepLimit
from ...solve.constraints import Prescribed
from ...solve.instability import UnstableRun, Watch
from ...solve.state import State
from ..problem.conditions import LoadTerms, motion_of
from ..problem.materials import make_material
from ..problem.problem import Problem
from ..scene.scene import Scene

_CHECKED = 100  # steps between two checks of the energy balance


@dataclass(eq=False)
class Crew(Operators):
    """A rank's part of a run."""

    scene: Scene
    m: Floats | RankMass
    load: Load | None
    fixed: list[Prescribed]
    now: State | None = field(default=None, init=False)
    failed: UnstableRun | None = field(default=None, init=False)
    # on the first rank: numbers of the state to start from
    start: dict[str, Any] | None = field(default=None, init=False)
    _steps: Iterator[State] = field(default_factory=lambda: iter(()), init=False)

    @classmethod
    def of(cls, comm: Any, scene: Scene, problem: Problem | None) -> Crew:
        """Deal a problem, which the first rank has, out over all."""
        lead = problem is not None
        found = None
        if problem is not None:  # what follows the mesh is chosen for the whole
            found = problem.discretisation.rule, problem.discretisation.balanced, problem.mass_kind
        rule, balanced, kind = comm.bcast(found, root=0)
        body = distributed(
            problem.mesh if problem is not None else None,
            scene.bonds.horizon,
            lambda mesh: make_material(scene, mesh),
            influence=scene.bonds.influence,
            rule=rule,
            no_fail=None if problem is None else problem.no_fail,
            balanced=balanced,
            boundary_function=scene.bonds.boundary_function,
            breaking=scene.material.breaking,
        )
        share = body.share
        m: Floats | RankMass
        if kind == "consistent":
            made = make_material(scene, share.mesh)
            m = RankMass.of(body, made.density_on(share.mesh) if isinstance(made, Composite) else made.density)
        else:
            m = body.scatter(problem.mass.diagonal() if problem is not None else None)
        terms, sets = None, None
        if problem is not None:
            terms = problem.load_terms
            sets = [np.unique(prescribed.dofs // body.dim) for prescribed in problem.fixed]
        own = share.number[: share.own]
        fixed = []
        for k, chosen in enumerate(comm.bcast(sets, root=0)):
            mine = np.flatnonzero(np.isin(own, chosen))
            if len(mine):
                fixed.append(motion_of(scene.fixed[k], share.mesh, mine, f"fixed[{k}]"))
        load = _dealt_load(comm, scene, body, terms) if comm.bcast(lead and terms is not None) else None
        return cls(comm, body, scene, m, load, fixed)

    # ---- what can be ordered
    def limit(self) -> StepLimit:
        """The stable step."""
        return stable_time_step(self.body, self.m)

    def begin(self, dt: float, until: float, limit: StepLimit, has: tuple[bool, bool], resumed: bool) -> None:
        """Make ready to step from the initial vectors, or from a state, that the first rank deals out."""
        u = v = state = None
        if resumed:
            numbers = self.comm.bcast(self.start)
            mine = numbers if self.comm.rank == 0 else numbers | {"work": 0.0, "dissipated": 0.0}
            vectors: dict[str, Any] = {
                name: self.body.dealt.scatter(x, self.body.dim)
                for name, x in zip(State.VECTORS, self.given, strict=True)
            }
            state = State(**vectors, **mine)
        else:
            u, v = (self.body.scatter(self.given[k]) if has[k] else None for k in (0, 1))
        self._steps = central_difference(
            self.body,
            self.m,
            u,
            v,
            dt=dt,
            until=until,
            load=self.load,
            fixed=self.fixed,
            limit=limit,
            watch=Watch(_CHECKED, limit),
            start=state,
        )
        if not resumed:
            self.now = next(self._steps)

    def advance(self, count: int) -> bool:
        """Make some steps; return whether the motion is sound."""
        try:
            for _ in range(count):
                self.now = next(self._steps)
        except UnstableRun as error:  # the balance is that of the whole body: all ranks see it at once
            self.now, self.failed = error.state, error
        return self.failed is None

    def state(self) -> tuple[dict[str, Any], list[Floats | None]]:
        """The numbers of the last state, whole, and its vectors."""
        assert self.now is not None
        now, add = self.now, self.body.total
        numbers: dict[str, Any] = {
            "t": now.t,
            "step": now.step,
            "dt": now.dt,
            "work": add(now.work),
            "initial": now.initial,
        }
        numbers |= {"initial_ripple": now.initial_ripple, "dissipated": add(now.dissipated)}
        if isinstance(self.body, BreakingRanks):
            found = self.comm.gather(self.body.broken_pairs(), root=0)
            numbers["broken"] = None if found is None else (sorted_pairs(np.concatenate(found)),)
        return numbers, [self.body.gather(x) for x in (now.u, now.v, now.a)]

    def bonds(self) -> tuple[list[int] | None, Balance | None]:
        """How many bonds each rank has, and the balance of all, with the vertices of the whole mesh."""
        counts: list[int] | None = self.comm.gather(self.body.nbonds, root=0)
        found = self.body.any_piece.bonds.balance
        if found is None:
            return counts, None
        missed = self.comm.gather(self.body.share.number[found.unbalanced], root=0)
        every = np.sort(np.concatenate(missed)) if missed is not None else found.unbalanced
        return counts, dataclasses.replace(found, weights=[], unbalanced=every)

    def close(self) -> None:
        """It is over."""
        self.body.close()


def _dealt_load(comm: Any, scene: Scene, body: RankBody, terms: LoadTerms | None) -> Load:
    """The load at a rank's own vertices, from that of the whole body, which the first rank has."""
    share, dim = body.share, body.dim
    constant = body.scatter(terms.constant if terms is not None else None)
    moving: list[tuple[int, Csr]] = []
    numbers: list[Longs] | None = comm.gather((share.number, share.own), root=0)
    dealt = None
    if terms is not None and numbers is not None:
        dealt = [[(k, spread[number[:own]][:, number]) for k, spread in terms.moving] for number, own in numbers]
    moving = comm.scatter(dealt, root=0)
    assert share.own * dim == len(constant)
    return LoadTerms(constant, moving).of(scene, share.mesh.p)
