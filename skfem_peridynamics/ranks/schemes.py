"""Implicit schemes over ranks: the first rank steps, all compute the operators and have their part of each state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np

from .._types import Floats, Load, Longs
from ..model.led_body import offer
from ..solve.constraints import Prescribed
from ..solve.instability import UnstableRun
from ..solve.mass_solver import mass_solver
from ..solve.newmark import newmark
from ..solve.newton import NotConverged
from ..solve.state import Equilibrium, State
from ..solve.static import static
from .body import RankBody
from .limit import stable_time_step
from .mass import RankMass
from .operators import Operators
from .whole_body import WholeBody

_T = TypeVar("_T", State, Equilibrium)


def newmark_over_ranks(
    body: RankBody,
    M: Floats | RankMass,
    u0: Floats | None = None,
    v0: Floats | None = None,
    *,
    load: Load | None = None,
    fixed: Sequence[Prescribed] = (),
    **options: Any,
) -> Iterator[State]:
    """Yield on every rank what :func:`newmark` does, with vectors that are its own part; so are all arguments."""
    mass = mass_solver(M, np.zeros(0, dtype=np.int64))
    whole_M = M.whole() if isinstance(M, RankMass) else body.gather(M)
    u, v = _gathered(body, u0), _gathered(body, v0)

    def steps(whole: WholeBody, **given: Any) -> Iterator[State]:
        return newmark(whole, whole_M, u, v, **given, **options)  # type: ignore[arg-type]

    def made(own: dict[str, Any], numbers: dict[str, Any]) -> State:
        return State(**own, **numbers, _body=body, _mass=mass)

    return _led(body, steps, load, fixed, made)


def static_over_ranks(
    body: RankBody,
    u0: Floats | None = None,
    *,
    load: Load | None = None,
    fixed: Sequence[Prescribed] = (),
    **options: Any,
) -> Iterator[Equilibrium]:
    """Yield on every rank what :func:`static` does, with vectors that are its own part; so are all arguments."""
    u = _gathered(body, u0)

    def steps(whole: WholeBody, **given: Any) -> Iterator[Equilibrium]:
        return static(whole, u, **given, **options)  # type: ignore[arg-type]

    def made(own: dict[str, Any], numbers: dict[str, Any]) -> Equilibrium:
        return Equilibrium(**own, **numbers, _body=body)

    return _led(body, steps, load, fixed, made)


def _gathered(body: RankBody, own: Floats | None) -> Floats | None:
    """A vector on the first rank, None where no rank has one."""
    there = body.comm.allreduce(own is not None)
    if there and there < body.comm.size:
        raise ValueError(f"{there} of {body.comm.size} processes give initial values: all do, or none")
    return None if own is None else body.gather(own)


@dataclass(eq=False)
class _Led(Operators):
    """What the first rank asks of the others as it steps."""

    load: Load | None
    fixed: Sequence[Prescribed]
    made: Callable[[dict[str, Any], dict[str, Any]], Any]
    over: bool = field(default=False, init=False)

    def load_at(self, t: float) -> Floats | None:
        """The load at t."""
        return self.body.gather(np.zeros(self.body.share.own * self.body.dim) if self.load is None else self.load(t))

    def motion_at(self, rank: int, k: int, t: float) -> Floats:
        """The displacement, or the velocity, that a rank prescribes at t."""
        value = None
        if self.comm.rank == rank:
            one = self.fixed[k]
            value = one.mean_velocity(t, t) if one.displacement is None else one.start(t)
        found: Floats = self.comm.bcast(value, root=rank)
        return found

    def state(self, names: tuple[str, ...], numbers: dict[str, Any]) -> Any:
        """A rank's own part of a state."""
        vectors = {name: self.body.dealt.scatter(x, self.body.dim) for name, x in zip(names, self.given, strict=False)}
        if self.comm.rank and "initial_ripple" in numbers:  # its sums are those over ranks
            numbers = numbers | {"work": 0.0, "dissipated": 0.0}
        return self.made(vectors, numbers)

    def end(self) -> None:
        """There are no more states."""
        self.over = True

    def fail(self, kind: type[Exception], said: str) -> None:
        """Raise what the first rank has met, on all."""
        raise kind(said)


def _led(
    body: RankBody,
    steps: Callable[..., Iterator[_T]],
    load: Load | None,
    fixed: Sequence[Prescribed],
    made: Callable[[dict[str, Any], dict[str, Any]], _T],
) -> Iterator[_T]:
    """Yield the states that the first rank makes, on every rank its own part."""
    comm, led = body.comm, _Led(body.comm, body, load, fixed, made)
    loaded = comm.allreduce(load is not None) > 0
    dofs = [(one.dofs, one.displacement is not None) for one in fixed]
    number, dim = body.share.number, body.dim
    held = comm.gather([(number[own // dim] * dim + own % dim, placed) for own, placed in dofs], root=0)
    points = body.gather(np.ascontiguousarray(body.share.mesh.p.T[: body.share.own]).ravel())
    nbonds = comm.allreduce(body.nbonds)
    if comm.rank:
        yield from _followed(led)
        return
    assert points is not None
    p = points.reshape(-1, dim).T
    one = body.any_piece
    bonds = SimpleNamespace(
        nbonds=nbonds,
        dim=dim,
        mesh=SimpleNamespace(p=p, nvertices=p.shape[1], dim=lambda: dim),
        horizon=one.bonds.horizon,
        rule=one.bonds.rule,
        vertex_weight=one.bonds.vertex_weight,
        samples=SimpleNamespace(at_vertices=one.bonds.samples.at_vertices),
    )
    motions = [
        _motion(led, rank, k, which, placed)
        for rank, of_rank in enumerate(held)
        for k, (which, placed) in enumerate(of_rank)
    ]
    given = {"load": (lambda t: led.order("load_at", t)) if loaded else None, "fixed": motions}
    try:
        for state in steps(WholeBody(led, bonds, one.material), **given):
            names = ("u", "v", "a") if isinstance(state, State) else ("u", "reaction")
            led.given = tuple(getattr(state, name) for name in names)
            yield led.order("state", names, {name: getattr(state, name) for name in state.NUMBERS})
    except (NotConverged, UnstableRun, ValueError) as error:
        if led.busy:  # of what all were at
            raise
        kinds = (NotConverged, UnstableRun, ValueError)
        led.order("fail", next(kind for kind in kinds if isinstance(error, kind)), str(error))
    led.order("end")


def _motion(led: _Led, rank: int, k: int, dofs: Longs, placed: bool) -> Prescribed:
    """A motion that a rank prescribes, of the unknowns of the whole body."""

    def at(t: float) -> Floats:
        found: Floats = led.order("motion_at", rank, k, t)
        return found

    return Prescribed(dofs, displacement=at) if placed else Prescribed(dofs, velocity=at)


def _followed(led: _Led) -> Iterator[Any]:
    """Yield what the first rank deals out."""
    while True:
        name, arguments = led.comm.bcast(None, root=0)
        found = getattr(led, name)(*arguments)
        if led.over:
            return
        if name == "state":
            yield found


def offer_schemes() -> None:
    """Have :func:`newmark`, :func:`static` and :func:`stable_time_step` take bodies over ranks."""
    offer(RankBody, "newmark", newmark_over_ranks)
    offer(RankBody, "static", static_over_ranks)
    offer(RankBody, "stable_time_step", stable_time_step)
