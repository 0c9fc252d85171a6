"""One run in many units: the same numbers after rescaling."""

from __future__ import annotations

import numpy as np

from .._types import Floats
from ..analysis.motion import unit_box
from ..bonds.bond_basis import BondBasis
from ..bonds.rules import PairRule
from ..material.calibration import Material
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from ..solve.cfl import stable_time_step
from .bodies import ball
from .book import Book

# factors of length, of stress and of time
SCALES = {
    "millimetres and megapascals": (1e3, 1e-6, 1.0),
    "micrometres": (1e6, 1.0, 1.0),
    "1e-12": (1e-12, 1e-12, 1e-12),
    "1e12": (1e12, 1e12, 1e12),
    "mixed": (1e-9, 1e12, 1e6),
}
POWERS = {"powers of two": (2.0**10, 2.0**-21, 2.0**5), "large powers of two": (2.0**-40, 2.0**38, 2.0**41)}


def _run(dim: int, rule: PairRule | None, steps: int, length: float, stress: float, second: float) -> Floats:
    mesh = unit_box(dim, {1: 30, 2: 10, 3: 4}[dim], "random")
    mesh = type(mesh)(mesh.p * length, mesh.t)
    glass = Material.from_elastic(
        lame=2.0 * stress,
        toughness=0.25 * stress * length,
        density=1.5 * stress * second**2 / length**2,
        plane="strain" if dim == 2 else None,
    )
    body = Peridynamics(BondBasis(vector_basis(mesh), 0.4 * length, rule=rule or ball(dim)), glass)
    M = mass_matrix(body.basis, density=glass.density)
    dt = 0.9 * stable_time_step(body, M).dt
    u0 = 0.02 * length * np.sin(np.pi * mesh.p.T / length).ravel()
    b = 0.01 * stress * length ** (dim - 1) * M.diagonal() / M.diagonal().sum()
    *_, state = central_difference(body, M, u0, dt=dt, until=steps * dt, load=lambda t: np.cos(t / (20.0 * dt)) * b)
    return np.asarray(state.u / length)


def units(book: Book, quick: bool) -> None:
    """A smooth nonlinear run with a load, its step from the limit, in every system of units."""
    steps = 50 if quick else 200
    for dim in (1, 2) if quick else (1, 2, 3):
        for name, rule in (("pairs", PairRule()), ("balls", None)):
            plain = _run(dim, rule, steps, 1.0, 1.0, 1.0)
            size = float(np.abs(plain).max())
            for label, scales in SCALES.items():
                error = float(np.abs(_run(dim, rule, steps, *scales) - plain).max()) / size
                book.judge("units", f"{dim}D, {name}, {label}", f"{steps} steps, the same run", error, 1e-10)
            for label, scales in POWERS.items():
                error = float(np.abs(_run(dim, rule, steps, *scales) - plain).max()) / size
                book.judge("units", f"{dim}D, {name}, {label}", "the same bits", error, 0.0)
