"""The motion at one time, and its energies."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np

from .._types import Floats, Longs
from .energy import Energies, inner, total
from .preconditioner import SolverMemory


def read_only(*arrays: Floats) -> list[Floats]:
    """Return views of arrays that cannot be written through."""
    views = [array.view() for array in arrays]
    for view in views:
        view.flags.writeable = False
    return views


@dataclass(frozen=True, eq=False)
class State:
    """The motion at one time: read-only views, valid until the next step; :meth:`copy` keeps them.

    Parameters
    ----------
    t : float
        The time.
    step : int
        How many steps were made.
    dt : float
        The step.
    u : ndarray, (N,)
        Displacement.
    v : ndarray, (N,)
        Velocity at the full step, second order in dt: ``(u^{k+1} - u^{k-1}) / (2 dt)``.
    a : ndarray, (N,)
        Acceleration, so that ``v + dt a / 2`` is the paper's next difference quotient.
    work : float
        That of loads and prescribed motions so far.
    initial : float
        The first energy.
    initial_ripple : float, optional
        The first :attr:`ripple`.
    lag : float, optional
        ``gamma/2 - beta`` of Newmark's family, 1/4 for central difference.
    memory : SolverMemory, optional
        What the linear solver of an implicit scheme has learnt.
    dissipated : float, optional
        Energy of the bonds that have broken for good.
    broken : tuple of ndarray of int, optional
        These bonds, block by block.

    Examples
    --------
    >>> from skfem_peridynamics.solve.mass_solver import Lumped
    >>> x = np.ones(2)
    >>> State(t=0.5, step=1, dt=0.5, u=x, v=x, a=x, work=0.0, initial=1.0, _mass=Lumped(3.0 * x)).kinetic
    3.0
    """

    NUMBERS: ClassVar = ("t", "step", "dt", "work", "initial", "initial_ripple", "lag", "dissipated")
    VECTORS: ClassVar = ("u", "v", "a")

    t: float
    step: int
    dt: float
    u: Floats
    v: Floats
    a: Floats
    work: float
    initial: float
    initial_ripple: float = 0.0
    lag: float = 0.25
    _body: Any = field(repr=False, default=None)
    _mass: Any = field(repr=False, default=None)
    memory: SolverMemory | None = field(repr=False, default=None)
    dissipated: float = 0.0
    broken: tuple[Longs, ...] | None = field(repr=False, default=None)

    def __repr__(self) -> str:
        u, v = (float(np.abs(x).max(initial=0.0)) for x in (self.u, self.v))
        return f"State: t = {self.t:g}, step {self.step} of {self.dt:g}, |u| up to {u:.3g}, |v| up to {v:.3g}"

    @property
    def kinetic(self) -> float:
        """``v.M v / 2``"""
        return total(self._body, 0.5 * inner(self.v, self._mass.times(self.v)))

    @property
    def ripple(self) -> float:
        """``lag dt^2/2 a.M a``: by this the energy of a linear run swings about a constant, without being wrong.

        ``lag`` is ``gamma/2 - beta`` of Newmark's family, 1/4 for central difference. What is left never grows.
        """
        return total(self._body, 0.5 * self.lag * self.dt**2 * inner(self.a, self._mass.times(self.a)))

    @cached_property
    def energies(self) -> Energies:
        """Kinetic and elastic energy and external work, computed when first read."""
        elastic, work = float(self._body.energy(self.u)), total(self._body, self.work)
        dissipated = total(self._body, self.dissipated)
        return Energies(self.kinetic, total(self._body, elastic), work, self.initial, dissipated)

    def copy(self) -> State:
        """Return a state that later steps leave alone.

        Returns
        -------
        State
            The copy.
        """
        kept = dataclasses.replace(self, u=self.u.copy(), v=self.v.copy(), a=self.a.copy())
        if self.broken is not None and self._body is not None:  # later its energy is that of fewer bonds
            kept.__dict__["energies"] = self.energies
        return kept


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A body at rest at one point of a path: read-only views, valid until the next step; :meth:`copy` keeps them.

    Parameters
    ----------
    t : float
        What loads and displacements were asked for.
    step : int
        How many steps were made.
    dt : float
        The last step of t.
    u : ndarray, (N,)
        Displacement.
    reaction : ndarray, (N,)
        What holds the prescribed degrees of freedom, 0 elsewhere.
    work : float
        That of loads and prescribed motions so far.
    initial : float
        The first energy.
    change : ndarray, (N,), optional
        How u changed in the last step, by which the next is guessed.
    memory : SolverMemory, optional
        What the linear solver has learnt.
    dissipated : float, optional
        Energy of the bonds that have broken for good.
    broken : tuple of ndarray of int, optional
        These bonds, block by block.

    Examples
    --------
    >>> x = np.zeros(1)
    >>> Equilibrium(t=1.0, step=1, dt=1.0, u=x, reaction=x, work=0.0, initial=0.0).kinetic
    0.0
    """

    NUMBERS: ClassVar = ("t", "step", "dt", "work", "initial", "dissipated")
    VECTORS: ClassVar = ("u", "reaction", "change")

    t: float
    step: int
    dt: float
    u: Floats
    reaction: Floats
    work: float
    initial: float
    _body: Any = field(repr=False, default=None)
    change: Floats | None = field(repr=False, default=None)
    memory: SolverMemory | None = field(repr=False, default=None)
    dissipated: float = 0.0
    broken: tuple[Longs, ...] | None = field(repr=False, default=None)

    def __repr__(self) -> str:
        u = float(np.abs(self.u).max(initial=0.0))
        return f"Equilibrium: t = {self.t:g}, step {self.step} of {self.dt:g}, |u| up to {u:.3g}"

    @cached_property
    def elastic(self) -> float:
        """The energy of all bonds, computed when first read."""
        return total(self._body, float(self._body.energy(self.u)))

    @property
    def kinetic(self) -> float:
        """0: it is at rest."""
        return 0.0

    @property
    def imbalance(self) -> float:
        """``elastic + dissipated - work - initial``: 0 along a path without jumps, minus what a jump has lost."""
        return self.elastic + self.dissipated - self.work - self.initial

    def copy(self) -> Equilibrium:
        """Return an equilibrium that later steps leave alone.

        Returns
        -------
        Equilibrium
            The copy.
        """
        change = None if self.change is None else self.change.copy()
        kept = dataclasses.replace(self, u=self.u.copy(), reaction=self.reaction.copy(), change=change)
        if self.broken is not None and self._body is not None:  # later its energy is that of fewer bonds
            kept.__dict__["elastic"] = self.elastic
        return kept


_T = TypeVar("_T", bound=State | Equilibrium)


def contents(state: State | Equilibrium) -> tuple[dict[str, float], dict[str, Floats], tuple[Longs, ...] | None]:
    """Return the numbers and vectors that a state is made of, by name, and its broken bonds: what a file must hold."""
    numbers = {name: getattr(state, name) for name in state.NUMBERS}
    vectors = {name: getattr(state, name) for name in state.VECTORS if getattr(state, name) is not None}
    if state.memory is not None:
        numbers["spent"] = state.memory.spent
        if state.memory.tangent is not None:
            vectors["tangent"] = state.memory.tangent
    broken, kept = state.broken, getattr(state._body, "kept", None)
    return numbers, vectors, tuple(kept(broken)) if broken is not None and kept is not None else broken


def rebuilt(
    kind: type[_T], numbers: Mapping[str, float], vectors: Mapping[str, Floats], broken: Sequence[Any] | None
) -> _T:
    """Return the state that :func:`contents` has taken apart; what older files lack gets its default.

    Raises ``KeyError`` for a number that is missing, ``TypeError`` for what is no part of a state.
    """
    # a file holds floats only: steps are counted in whole numbers
    given: dict[str, Any] = {name: float(value) for name, value in numbers.items() if name != "spent"}
    given["step"] = int(numbers["step"])
    given |= {name: np.asarray(values, dtype=float) for name, values in vectors.items()}
    tangent = given.pop("tangent", None)
    if "spent" in numbers:
        given["memory"] = SolverMemory(int(numbers["spent"]), tangent)
    if broken is not None:
        arrays = [np.asarray(bonds, dtype=np.int64) for bonds in broken]
        # pairs of vertices, or numbers block by block
        given["broken"] = tuple(x if x.ndim == 2 and x.shape[1] == 2 else x.reshape(-1) for x in arrays)
    return kind(**given)
