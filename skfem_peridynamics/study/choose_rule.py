"""Choose the rule of a scene by measured tables of error against seconds (docs/evidence/error_against_run_time.md)."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from .._types import Mesh
from ..bonds.ball_rule import BallRule
from ..bonds.pair_rule import PairRule
from ..geometry.simplices import vertex_volumes
from ..material.influence import Influence
from ..model.discretisation import CLASSICAL, Discretisation
from ..solve.cfl import exact_eigenvalue_bound

BALANCED_PAIRS = Discretisation(PairRule(), balanced=True)
CANDIDATES: dict[int, tuple[Discretisation, ...]] = {
    1: (
        CLASSICAL,
        BALANCED_PAIRS,
        Discretisation(PairRule(points="gauss")),
        Discretisation(BallRule(3, 1), balanced=True),
    ),
    2: (
        CLASSICAL,
        BALANCED_PAIRS,
        Discretisation(PairRule(points="gauss")),
        Discretisation(BallRule(3, 8)),
        Discretisation(BallRule(3, 8), balanced=True),
        Discretisation(BallRule(4, 12), balanced=True),
        Discretisation(BallRule(5, 16), balanced=True),
    ),
    3: (CLASSICAL, BALANCED_PAIRS, Discretisation(BallRule(2, 13)), Discretisation(BallRule(2, 13), balanced=True)),
}
DEFAULT_TOLERANCE = 1e-2
_IRREGULAR = 0.05  # relative spread of the volumes of inner vertices; 0 on a lattice, 0.2 on a random mesh
_ENOUGH = 2.75  # vertices per horizon from which weights can be balanced on any mesh (docs/evidence/verification.md)


@dataclass(frozen=True)
class Measured:
    """One line of the table: a scheme at some number of vertices per horizon, and what it missed and cost there."""

    dim: int
    mesh: str
    scheme: str
    per_horizon: float
    error: float
    setup: float  # seconds a vertex
    step: float  # seconds a vertex and step


@dataclass(frozen=True)
class Choice:
    """A scheme and why it was chosen, in a sentence."""

    scheme: Discretisation
    why: str
    predicted: float | None = None


@cache
def table() -> tuple[Measured, ...]:
    """Return the measured table that comes with the package (docs/benchmarks/make_measured.py makes it)."""
    text = files("skfem_peridynamics.study").joinpath("measured.csv").read_text()
    lines = csv.DictReader(text.splitlines())
    return tuple(
        Measured(
            int(x["dim"]),
            x["mesh"],
            x["scheme"],
            *(float(x[name]) for name in ("per_horizon", "error", "setup", "step")),
        )
        for x in lines
    )


def per_horizon(mesh: Mesh, horizon: float) -> float:
    """Return how many vertices a horizon spans, by the volume an inner vertex has.

    >>> import skfem
    >>> axis = np.linspace(0, 1, 11)
    >>> round(per_horizon(skfem.MeshTri.init_tensor(axis, axis), 0.4), 6)
    4.0
    """
    return float(horizon / np.median(_inner_volumes(mesh)) ** (1.0 / mesh.dim()))


def is_irregular(mesh: Mesh) -> bool:
    """Return whether the volumes of inner vertices differ by more than a lattice's do.

    >>> import skfem
    >>> is_irregular(skfem.MeshLine(np.array([0.0, 0.1, 0.3, 0.6, 1.0])))
    True
    """
    volumes = _inner_volumes(mesh)
    if len(volumes) == mesh.nvertices:
        return False  # no vertex inside: nothing is known
    return bool(np.std(volumes) > _IRREGULAR * np.mean(volumes))


def _inner_volumes(mesh: Mesh) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    inner = np.ones(mesh.nvertices, dtype=bool)
    inner[np.unique(mesh.facets[:, mesh.boundary_facets()])] = False
    volumes = vertex_volumes(mesh)
    return volumes[inner] if inner.any() else volumes


def choose(
    mesh: Mesh,
    horizon: float,
    *,
    fracturing: bool,
    tolerance: float | None,
    steps: float,
    measured: Sequence[Measured] | None = None,
) -> Choice:
    """Return the scheme for a mesh: the cheapest that meets the tolerance, for a body that does not break.

    Where bonds may break and no ``tolerance`` is asked for, vertex pairs: they alone cost G_c. Errors and seconds are
    read from the table of this dimension and kind of mesh at the number of vertices per horizon, log-log between its
    lines; a motion as smooth as that of the studies is assumed. ``steps`` is about how many the run will take.
    """
    m, irregular, dim = per_horizon(mesh, horizon), is_irregular(mesh), int(mesh.dim())
    kind = "an irregular" if irregular else "a regular"
    if fracturing and tolerance is None:
        scheme = BALANCED_PAIRS if irregular and m >= _ENOUGH else CLASSICAL
        return Choice(scheme, f"{scheme.name}: bonds may break, and of all rules vertex pairs cost G_c, on {kind} mesh")
    wanted = DEFAULT_TOLERANCE if tolerance is None else tolerance
    lines = [x for x in measured or table() if x.dim == dim and (x.mesh != "regular") == irregular]
    predicted: list[tuple[float, float, Discretisation]] = []
    for scheme in CANDIDATES[dim]:
        measurements = sorted((x for x in lines if x.scheme == scheme.name), key=lambda x: x.per_horizon)
        if not measurements or (scheme.balanced and m < 0.9 * measurements[0].per_horizon):
            continue
        error, setup, step = (_at(measurements, name, m) for name in ("error", "setup", "step"))
        predicted.append((error, setup + steps * step, scheme))
    if not predicted:
        return Choice(CLASSICAL, f"{CLASSICAL.name}: nothing is measured in {dim}D on {kind} mesh")
    good = [x for x in predicted if x[0] <= wanted]
    at = f"{m:.3g} vertices per horizon, {kind} mesh, about {steps:.3g} steps"
    if good:
        error, _, scheme = min(good, key=lambda x: x[1])
        return Choice(scheme, f"{scheme.name}: the cheapest that is to meet {wanted:g} ({error:.1e}) at {at}", error)
    error, _, scheme = min(predicted, key=lambda x: x[0])
    return Choice(scheme, f"{scheme.name}: none is to meet {wanted:g} at {at}; this comes closest ({error:.1e})", error)


def expected_steps(
    until: float, slope: float, density: float, dim: int, horizon: float, influence: Influence, part: float
) -> float:
    """Return about how many steps of ``part`` of the stable limit a run takes, before there are bonds.

    The limit is that of the exact integrals; in 1D, where they have none, half the time that a wave takes across the
    horizon is about it.

    >>> from skfem_peridynamics import constant
    >>> round(expected_steps(until=1.0, slope=1.0, density=1.0, dim=1, horizon=0.1, influence=constant, part=1.0), 6)
    28.284271
    """
    mean = influence.mean_inverse_power(1.0, dim)
    lam = exact_eigenvalue_bound(slope, mean if np.isfinite(mean) else 4.0, density, dim, horizon)
    return float(until / (part * 2.0 / np.sqrt(lam)))


def _at(lines: Sequence[Measured], name: str, m: float) -> float:
    """Read the table at m, log-log; beyond its ends with the slope of the last two lines. Repeated m are averaged."""
    x = np.array([line.per_horizon for line in lines])
    y = np.log([getattr(line, name) for line in lines])
    knots = np.unique(x)
    values = np.array([y[x == knot].mean() for knot in knots])
    if len(knots) == 1:
        return float(np.exp(values[0]))
    at, logs = np.log(m), np.log(knots)
    k = int(np.clip(np.searchsorted(logs, at) - 1, 0, len(logs) - 2))
    slope = (values[k + 1] - values[k]) / (logs[k + 1] - logs[k])
    return float(np.exp(values[k] + slope * (at - logs[k])))
