"""What a scene has measured besides its energies, each some columns of the history: the crack, J, reactions, probes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Protocol

import numpy as np

from ..._types import Floats
from ...analysis.crack import CrackPath, Ground, crack_path
from ...analysis.damage import Census
from ...analysis.j_integral import j_integral
from ...geometry.locate import locate
from ...geometry.slit_tips import slit_directions
from ...solve.state import Equilibrium, State
from ..scene.reading import SceneError, blame
from .problem import Problem

_AXES = ("x", "y", "z")
_GROWN = 3.0  # horizons from which on the way of a crack has a direction of its own
Moment = State | Equilibrium


class Measure(Protocol):
    """Some columns of the history, and how to fill them from a state and the count of its bonds."""

    columns: tuple[str, ...]

    def read(self, state: Moment, count: Census) -> tuple[float, ...]: ...


def measures(problem: Problem) -> list[Measure]:
    """Return what the scene asks for. Nothing is computed before the first row. Raises :class:`SceneError`."""
    scene, out = problem.scene, list[Measure]()
    dim = int(problem.mesh.dim())
    table = scene.measure
    potentials = [scene.material.potential, *(potential.potential for potential in scene.inclusion)]
    breakable = any(potential not in (None, "linear") for potential in potentials)
    if scene.material.breaking is not None:
        out.append(Broken())
    if table.crack and dim == 1:
        raise SceneError("measure.crack = true: a crack in 1D is a point, and has no way to follow")
    track = CrackTrack(problem)
    if (breakable and dim > 1) if table.crack is None else table.crack:
        out.append(track)
    if table.j_integral is not None:
        out.append(JIntegral(problem, track, table.j_integral))
    if scene.fixed if table.reactions is None else table.reactions:
        out.append(Reactions(problem))
    out += [Probe(problem, k) for k in range(len(scene.probe))]
    return out


class Broken:
    """Bonds that have broken for good, and the energy they took with them."""

    columns: tuple[str, ...] = ("dissipated", "broken_bonds")

    def read(self, state: Moment, count: Census) -> tuple[float, ...]:
        return state.dissipated, count.broken


class CrackTrack:
    """How far the crack has come, its area, and where its first tip is: no number while there is none.

    In 2D also the length of all its branches, and the number of their tips. ``cracks`` counts those that do not touch;
    ``crushed`` is the part of the damaged volume that is none. Where bonds break for good lengths do not shrink.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.dim = problem, int(problem.mesh.dim())
        branches = ("crack_length", "tips") if self.dim == 2 else ()
        tip = (f"tip_{a}" for a in _AXES[: self.dim])
        self.columns = ("crack_reach", "crack_area", *branches, *tip, "cracks", "crushed")
        self._last: tuple[float, CrackPath] | None = None
        self._ground: Ground | None = None
        self._most: tuple[float, ...] = (0.0,) * (3 if self.dim == 2 else 2)

    def resume(self, rows: Sequence[tuple[float, ...]]) -> None:
        """Go on from the rows of an earlier run, this measure's columns of them."""
        for row in rows:
            self._grown(row[: len(self._most)])

    def _grown(self, sizes: tuple[float, ...]) -> tuple[float, ...]:
        """Sizes that do not shrink where bonds do not heal."""
        if self.problem.scene.material.breaking is not None:
            self._most = sizes = tuple(max(pair) for pair in zip(self._most, sizes, strict=True))
        return sizes

    def path(self, state: Moment, count: Census) -> CrackPath:
        """The crack at a state, followed once."""
        if self._last is None or self._last[0] != state.t:
            intact = self.problem.intact(count)
            if self._ground is None:
                self._ground = Ground.of(self.problem.mesh)
            horizon = self.problem.scene.bonds.horizon
            self._last = state.t, crack_path(self.problem.mesh, intact, horizon, ground=self._ground)
        return self._last[1]

    def read(self, state: Moment, count: Census) -> tuple[float, ...]:
        path = self.path(state, count)
        reach = float(path.reach[0]) if path.found else 0.0
        sizes = self._grown((reach, count.area, *((path.length,) if self.dim == 2 else ())))
        tips = (len(path.tips),) if self.dim == 2 else ()
        tip = path.tips[0].tolist() if path.found else [float("nan")] * self.dim
        return (*sizes, *tips, *tip, path.cracks, path.crushed)


class JIntegral:
    """J about the first tip of the crack, or about that of the slit before it grows; not a number at no tip."""

    columns: tuple[str, ...] = ("j_integral",)

    def __init__(self, problem: Problem, track: CrackTrack, radius: float) -> None:
        self.problem, self.track, self.radius = problem, track, radius
        if problem.mesh.dim() != 2:
            raise SceneError(f"measure.j_integral = {radius:g}: it is computed in 2D")
        if radius < 2.0 * problem.scene.bonds.horizon * (1.0 - 1e-9):
            raise SceneError(
                f"measure.j_integral = {radius:g}: the radius must be at least two horizons, "
                f"{2 * problem.scene.bonds.horizon:g}, for within one of the tip strains are not those of a local body"
            )

    def read(self, state: Moment, count: Census) -> tuple[float, ...]:
        path, (tips, directions) = self.track.path(state, count), slit_directions(self.problem.mesh)
        if path.found and (path.reach[0] > _GROWN * self.problem.scene.bonds.horizon or not len(tips)):
            tip, along = path.tips[0], path.direction
        elif len(tips):
            last = path.tips[0] if path.found else tips[0]
            near = int(np.linalg.norm(tips - last, axis=1).argmin())
            tip, along = (path.tips[0] if path.found else tips[near]), directions[near]
        else:
            return (float("nan"),)
        v, a = (state.v, state.a) if isinstance(state, State) else (None, None)
        try:
            return (j_integral(self.problem.body, state.u, tip, along, self.radius, v=v, a=a),)
        except ValueError:  # the ring has reached the boundary
            return (float("nan"),)


class Reactions:
    """The force that holds or moves each named part of the body whose motion is prescribed."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.dim = problem, int(problem.mesh.dim())
        self.names = {}
        for k, table in enumerate(problem.scene.fixed):
            self.names.setdefault(table.on or table.region or f"fixed{k}", []).append(k)
        if not self.names:
            raise SceneError("measure.reactions = true: no motion is prescribed, so nothing reacts; add [[fixed]]")
        self.columns = tuple(f"reaction_{name}_{a}" for name in self.names for a in _AXES[: self.dim])

    names: dict[str, list[int]]

    @cached_property
    def dofs(self) -> list[Floats]:
        fixed = self.problem.fixed
        return [np.unique(np.concatenate([fixed[k].dofs for k in numbers])) for numbers in self.names.values()]

    def read(self, state: Moment, count: Census) -> tuple[float, ...]:
        if isinstance(state, Equilibrium):
            force = state.reaction
        else:
            problem = self.problem
            force = problem.mass @ state.a - problem.body.force(state.u)
            if problem.load is not None:
                force = force - problem.load(state.t)
        out: list[float] = []
        for dofs in self.dofs:
            out += np.bincount(dofs % self.dim, force[dofs], self.dim).tolist()
        return tuple(out)


class Probe:
    """Displacement and velocity at a point."""

    def __init__(self, problem: Problem, number: int) -> None:
        table, dim = problem.scene.probe[number], int(problem.mesh.dim())
        path, axes = f"probe[{number}]", _AXES[:dim]
        if len(table.at) != dim:
            raise SceneError(f"{path}.at = {list(table.at)} has {len(table.at)} coordinates; the body has {dim}")
        with blame(f"{path}.at"):
            self.vertices, self.share = locate(problem.mesh, np.array(table.at))
        name = table.name or str(number)
        kinds = ("u",) if problem.scene.time.scheme == "static" else ("u", "v")
        self.columns = tuple(f"probe_{name}_{kind}{a}" for kind in kinds for a in axes)
        self.dim = dim

    def read(self, state: Moment, count: Census) -> tuple[float, ...]:
        fields = (state.u, state.v) if isinstance(state, State) else (state.u,)
        return tuple(x for u in fields for x in (self.share @ u.reshape(-1, self.dim)[self.vertices]).tolist())
