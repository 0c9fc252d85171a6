"""One run in many units: the same numbers after rescaling."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from .._scaling import whole_power
from .._types import Floats
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_rule import PairRule
from ..geometry.boxes import unit_box
from ..material.material import Material
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from ..solve.cfl import SAFETY, stable_time_step
from .bodies import ball
from .verdicts import Verdicts

# factors of length, of stress and of time
SCALES = {
    "millimetres and megapascals": (1e3, 1e-6, 1.0),
    "micrometres": (1e6, 1.0, 1.0),
    "1e-12": (1e-12, 1e-12, 1e-12),
    "1e12": (1e12, 1e12, 1e12),
    "mixed": (1e-9, 1e12, 1e6),
}
POWERS = {"powers of two": (2.0**10, 2.0**-21, 2.0**5), "large powers of two": (2.0**-40, 2.0**38, 2.0**41)}


# LAPACK and ARPACK find the step limit: in other units it differs in the last places, by so many at most
ULPS = 256


def _body(
    dim: int, rule: PairRule | None, scales: tuple[float, float, float]
) -> tuple[Peridynamics, sparse.csr_matrix]:
    """The same body and its mass in units that make lengths, stresses and times so many times larger."""
    length, stress, second = scales
    mesh = unit_box(dim, {1: 30, 2: 10, 3: 4}[dim], "random")
    mesh = type(mesh)(mesh.p * length, mesh.t)
    material = Material.from_elastic(
        lame=2.0 * stress,
        toughness=0.25 * stress * length,
        density=1.5 * stress * second**2 / length**2,
        plane="strain" if dim == 2 else None,
    )
    body = Peridynamics(BondBasis(vector_basis(mesh), 0.4 * length, rule=rule or ball(dim)), material)
    return body, mass_matrix(body.basis, density=material.density)


def _run(body: Peridynamics, M: sparse.csr_matrix, dt: float, steps: int, scales: tuple[float, float, float]) -> Floats:
    """The displacement after a run, in units of the length."""
    length, stress, _ = scales
    dim = body.bonds.dim
    u0 = 0.02 * length * np.sin(np.pi * body.bonds.mesh.p.T / length).ravel()
    share = M.diagonal() / M.diagonal().sum()
    b = 0.01 * stress * whole_power(length, dim - 1) * share
    *_, state = central_difference(body, M, u0, dt=dt, until=steps * dt, load=lambda t: np.cos(t / (20.0 * dt)) * b)
    return np.asarray(state.u / length)


def units(verdicts: Verdicts, quick: bool) -> None:
    """A smooth nonlinear run with a load, its step from the limit, in every system of units.

    With powers of two the run has the same bits when its step has; the limit itself, from LAPACK and ARPACK, agrees
    to :data:`ULPS` units in the last place.
    """
    steps = 50 if quick else 200
    for dim in (1, 2) if quick else (1, 2, 3):
        for name, rule in (("pairs", PairRule()), ("balls", None)):
            body, M = _body(dim, rule, (1.0, 1.0, 1.0))
            dt = SAFETY * stable_time_step(body, M).dt
            plain = _run(body, M, dt, steps, (1.0, 1.0, 1.0))
            size = float(np.abs(plain).max())
            for label, scales in SCALES.items():
                body, M = _body(dim, rule, scales)
                error = float(np.abs(_run(body, M, SAFETY * stable_time_step(body, M).dt, steps, scales) - plain).max())
                verdicts.add("units", f"{dim}D, {name}, {label}", f"{steps} steps, the same run", error / size, 1e-10)
            for label, scales in POWERS.items():
                body, M = _body(dim, rule, scales)
                error = float(np.abs(_run(body, M, scales[2] * dt, steps, scales) - plain).max()) / size
                verdicts.add("units", f"{dim}D, {name}, {label}", "the same bits", error, 0.0)
                ulps = abs(SAFETY * stable_time_step(body, M).dt / scales[2] / dt - 1.0) / np.finfo(float).eps
                verdicts.add("units", f"{dim}D, {name}, {label}", "the same limit, in units of 2^-52", ulps, ULPS)
