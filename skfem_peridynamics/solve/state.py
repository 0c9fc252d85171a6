"""The motion at one time, and its energies."""

from __future__ import annotations

import dataclasses
import os
import zipfile
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from .._types import Floats, Longs
from .energy import Energies, inner
from .preconditioner import SolverMemory


@dataclass(frozen=True, eq=False)
class State:
    """The motion at one time: read-only views, valid until the next step; :meth:`copy` keeps them.

    ``v`` is the velocity at the full step, second order in dt: ``(u^{k+1} - u^{k-1}) / (2 dt)``; ``a`` the
    acceleration, so that ``v + dt a / 2`` is the paper's next difference quotient. ``memory`` is what the linear solver
    of an implicit scheme has learnt, ``broken`` the bonds of a body that lets them break, ``dissipated`` their energy.
    """

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

    @property
    def kinetic(self) -> float:
        """``v.M v / 2``"""
        return 0.5 * inner(self.v, self._mass.times(self.v))

    @property
    def ripple(self) -> float:
        """``lag dt^2/2 a.M a``: by this the energy of a linear run swings about a constant, without being wrong.

        ``lag`` is ``gamma/2 - beta`` of Newmark's family, 1/4 for central difference. What is left never grows.
        """
        return 0.5 * self.lag * self.dt**2 * inner(self.a, self._mass.times(self.a))

    @cached_property
    def energies(self) -> Energies:
        """Kinetic and elastic energy and external work, computed when first read."""
        return Energies(self.kinetic, float(self._body.energy(self.u)), self.work, self.initial, self.dissipated)

    def copy(self) -> State:
        """Return a state that later steps leave alone."""
        kept = dataclasses.replace(self, u=self.u.copy(), v=self.v.copy(), a=self.a.copy())
        if self.broken is not None and self._body is not None:  # later its energy is that of fewer bonds
            kept.__dict__["energies"] = self.energies
        return kept


_NUMBERS = ("t", "step", "dt", "work", "initial", "initial_ripple", "lag", "dissipated")
_YOUNGER = ("lag", "dissipated")  # which older files lack
_VECTORS = ("u", "v", "a")


def save_state(path: str | Path, state: State) -> None:
    """Write a state to an ``.npz`` file, aside and renamed, so that it is never half written.

    >>> import tempfile
    >>> place = Path(tempfile.mkdtemp()) / "state.npz"
    >>> x = np.ones(2)
    >>> save_state(place, State(t=0.5, step=1, dt=0.5, u=x, v=x, a=x, work=0.0, initial=1.0))
    >>> load_state(place).u.tolist()
    [1.0, 1.0]
    """
    path = Path(path)
    aside = path.with_name(path.name + ".part")
    content: dict[str, Any] = {name: np.asarray(getattr(state, name)) for name in _NUMBERS + _VECTORS}
    if state.memory is not None:
        content["spent"] = np.asarray(state.memory.spent)
        content |= {} if state.memory.tangent is None else {"tangent": state.memory.tangent}
    content |= {f"broken_{k}": one for k, one in enumerate(state.broken or ())}
    with open(aside, "wb") as file:
        np.savez(file, **content)
    os.replace(aside, path)


def load_state(path: str | Path) -> State:
    """Read a state that :func:`save_state` wrote, to continue from with ``start=`` of its scheme.

    Raises ``ValueError`` for a file that is none. Nothing is unpickled.
    """
    try:
        with open(path, "rb") as raw, np.load(raw, allow_pickle=False) as file:
            stored: dict[str, Any] = {
                name: file[name].item() for name in _NUMBERS if name not in _YOUNGER or name in file
            }
            stored |= {name: np.asarray(file[name], dtype=float) for name in _VECTORS}
            lists = [name for name in file if name.startswith("broken_")]
            if lists:
                stored["broken"] = tuple(np.asarray(file[f"broken_{k}"], dtype=np.int64) for k in range(len(lists)))
            if "spent" in file:
                tangent = np.asarray(file["tangent"], dtype=float) if "tangent" in file else None
                stored["memory"] = SolverMemory(int(file["spent"]), tangent)
    except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{str(path)!r} is not a state that save_state wrote: {error}") from None
    return State(**stored)


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A body at rest at one point of a path: read-only views, valid until the next step; :meth:`copy` keeps them.

    ``t`` is what loads and displacements were asked for, ``dt`` the last step of it; ``reaction`` (N,) holds what is
    prescribed, 0 elsewhere; ``work`` is that of loads and prescribed motions so far, ``initial`` the first energy.
    ``change`` is how u changed in the last step, by which the next is guessed, ``memory`` what the linear solver has
    learnt; ``broken`` and ``dissipated`` are the bonds that have broken for good, and their energy.
    """

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

    @cached_property
    def elastic(self) -> float:
        """The energy of all bonds, computed when first read."""
        return float(self._body.energy(self.u))

    @property
    def kinetic(self) -> float:
        """0: it is at rest."""
        return 0.0

    @property
    def imbalance(self) -> float:
        """``elastic + dissipated - work - initial``: 0 along a path without jumps, minus what a jump has lost."""
        return self.elastic + self.dissipated - self.work - self.initial

    def copy(self) -> Equilibrium:
        """Return an equilibrium that later steps leave alone."""
        change = None if self.change is None else self.change.copy()
        kept = dataclasses.replace(self, u=self.u.copy(), reaction=self.reaction.copy(), change=change)
        if self.broken is not None and self._body is not None:  # later its energy is that of fewer bonds
            kept.__dict__["elastic"] = self.elastic
        return kept
