"""Error against run time: what a scheme costs and what it misses, on problems whose motion is known."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .._clock import Clock
from .._types import Basis, Load, Mesh
from ..bonds.bond_basis import BondBasis
from ..geometry.boxes import unit_box
from ..model.discretisation import CLASSICAL, Discretisation
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from ..solve.cfl import SAFETY, StepLimit, stable_time_step
from ..solve.constraints import Prescribed
from .known_motion import Motion

TIME_SHARE = 0.3  # of the error that the time step may make; a run that finds more is repeated with a smaller step


@dataclass(frozen=True)
class Row:
    """One run: what it was, what it cost, what it missed. Errors are relative to the norms of the field.

    ``interpolation`` is the error of the motion itself, interpolated at the vertices of the mesh.
    """

    problem: str
    dim: int
    mesh: str
    scheme: str
    family: str
    horizon: float
    n: int
    per_horizon: float
    nodes: int
    bonds: int
    steps: int
    dt: float
    dt_limit: float
    error_l2: float
    error_h1: float
    error_velocity: float
    interpolation: float
    time_error: float
    seconds_setup: float
    seconds_steps: float

    @property
    def seconds(self) -> float:
        return self.seconds_setup + self.seconds_steps


@dataclass(frozen=True, eq=False)
class Setup:
    """A problem discretised by a scheme on a mesh, ready to step."""

    problem: Motion
    basis: Basis
    body: Peridynamics
    M: Any
    limit: StepLimit
    load: Load | None
    fixed: list[Prescribed]
    seconds: float
    project: bool

    def run(self, dt: float, watch: Callable[[Any], None] | None = None) -> tuple[Any, float, int]:
        """Step to the end; return the last state, the seconds of its steps (median times number) and the steps."""
        problem, basis = self.problem, self.basis
        steps = max(1, int(np.ceil(problem.until / dt - 1e-9)))
        shape = basis.project(problem.at) if self.project else problem.field(basis.mesh.p.T).ravel()
        for prescribed in self.fixed:  # a projection may not move what is held
            shape[prescribed.dofs] = problem.field(basis.mesh.p.T).ravel()[prescribed.dofs]
        taken, before = [], time.perf_counter()
        for state in central_difference(
            self.body,
            self.M,
            problem.g(0.0) * shape,
            problem.g(0.0, 1) * shape,
            dt=problem.until / steps,
            until=problem.until,
            load=self.load,
            fixed=self.fixed,
            limit=self.limit,
            watch=0,
        ):
            now = time.perf_counter()
            taken.append(now - before)
            if watch is not None:
                watch(state)
            before = time.perf_counter()
        return state, float(np.median(taken[1:])) * steps, steps


def prepare(problem: Motion, mesh: Mesh, scheme: Discretisation, **options: Any) -> Setup:
    """Make bonds, body, mass, step limit and load of a scheme; the load is not counted in its seconds."""
    clock = Clock()
    with clock.phase("setup"):
        basis = vector_basis(mesh)
        w = None if problem.boundary is None else problem.w(mesh.p.T)
        bonds = BondBasis(basis, problem.horizon, problem.influence, scheme.rule, boundary_function=w)
        if scheme.balanced:
            bonds = bonds.balanced()
        body = Peridynamics(bonds, problem.law, **options)
        M = mass_matrix(basis, kind=scheme.kind)
        limit = stable_time_step(body, M)
    consistent = scheme.kind == "consistent"
    load = problem.load(basis, "weak" if consistent else "nodal")
    return Setup(problem, basis, body, M, limit, load, problem.held(basis), clock.seconds["setup"], consistent)


def time_constant(problem: Motion) -> float:
    """Return C of the relative time error ``C dt^2`` at the end, from steps dt, dt/2 and dt/4 on a coarse mesh.

    Raises ``ValueError`` when the order it sees is not 2 to a quarter.
    """
    setup = prepare(problem, unit_box(problem.dim, max(4, round(3.0 / problem.horizon))), CLASSICAL)
    dt = 0.45 * setup.limit.dt
    u = [setup.run(dt * 0.5**k)[0].copy() for k in range(3)]
    m, shape = setup.M.diagonal(), problem.field(setup.basis.mesh.p.T).ravel()
    norm = float(np.sqrt(m @ shape**2))
    coarse, fine = (float(np.sqrt(m @ (u[k].u - u[k + 1].u) ** 2)) for k in (0, 1))
    if not 1.75 < np.log2(coarse / fine) < 2.25:
        raise ValueError(f"the time error of this problem falls with order {np.log2(coarse / fine):.2f}, not 2")
    return float(4.0 / 3.0 * fine / u[1].dt ** 2 / norm)


def measure(
    problem: Motion,
    name: str,
    kind: str,
    mesh: Mesh,
    n: int,
    scheme: Discretisation,
    constant: float,
    label: str | None = None,
    share: float = TIME_SHARE,
) -> Row:
    """Run a scheme at 0.9 of its stable step, or less where the time error would count, and return what it missed.

    ``constant`` is that of :func:`time_constant`; ``label`` names the scheme in the row where its own name would not;
    ``share`` is the part of the error that the time step may make.
    """
    setup = prepare(problem, mesh, scheme)
    dt = SAFETY * setup.limit.dt
    for _ in range(8):
        state, seconds, steps = setup.run(dt)
        dt = state.dt
        l2, h1 = problem.errors(mesh, state.u, state.t)
        if constant * dt**2 <= share * l2:
            break
        dt = min(0.7 * dt, float(np.sqrt(0.6 * share * l2 / constant)))
    velocity, _ = problem.errors(mesh, state.v, state.t, derivative=1)
    interpolation, _ = problem.errors(mesh, problem.g(state.t) * problem.field(mesh.p.T).ravel(), state.t)
    return Row(
        problem=name,
        dim=problem.dim,
        mesh=kind,
        scheme=label or scheme.name,
        family=scheme.family,
        horizon=problem.horizon,
        n=n,
        per_horizon=problem.horizon * n,
        nodes=int(mesh.nvertices),
        bonds=int(setup.body.bonds.nbonds),
        steps=steps,
        dt=state.dt,
        dt_limit=setup.limit.dt,
        error_l2=l2,
        error_h1=h1,
        error_velocity=velocity,
        interpolation=interpolation,
        time_error=constant * state.dt**2,
        seconds_setup=setup.seconds,
        seconds_steps=seconds,
    )


def as_dict(row: Row) -> dict[str, Any]:
    """Return a row as plain values, its total seconds with it."""
    return {**dataclasses.asdict(row), "seconds": row.seconds}
