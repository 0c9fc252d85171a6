"""The studies that are not races: the local limit, and the paper's theorems beside what is measured."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.sparse.linalg import LinearOperator, eigsh

from .._types import Floats
from ..bonds.ball_rule import BallRule
from ..bonds.bond_basis import BondBasis
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule
from ..geometry.boxes import unit_box
from ..model.discretisation import CLASSICAL, Discretisation
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from .bounds import (
    convergence_constants,
    discussion,
    energy_bound,
    lipschitz_constant,
    sharper_constant,
    symbol_supremum,
)
from .h2_bounds import h2_table
from .known_motion import law_of
from .local_limit import distance_to_local
from .manufactured import Manufactured
from .measure import measure, prepare, time_constant
from .rates import rate
from .result import Table
from .velocity import velocity_equation

Report = Callable[[str], None]


def local_tables(quick: bool, report: Report) -> list[Table]:
    """Distances to the local solution and their rates in the horizon, eps/h = 2, 4 and 8."""
    out: list[Table] = []
    schemes: list[tuple[str, Rule]] = [
        ("ball 3 x 8, Gauss points", BallRule(3, 8)),
        ("ball 3 x 8, vertices", BallRule(3, 8, "vertices")),
    ]
    for per_horizon, horizons in ((2, (1 / 3, 1 / 6, 1 / 12)), (4, (1 / 3, 1 / 6, 1 / 12)), (8, (1 / 2, 1 / 4, 1 / 6))):
        if quick and per_horizon == 8:
            continue
        rows = []
        for label, rule in (*schemes, ("vertex pairs, partial volume", PairRule())):
            gaps = [distance_to_local(eps, per_horizon, rule) for eps in horizons]
            rows.append((label, *gaps, float(np.polyfit(np.log(horizons), np.log(gaps), 1)[0])))
            report(f"eps/h = {per_horizon}, {label}: {', '.join(f'{gap:.2e}' for gap in gaps)}")
        columns = ("rule", *(f"eps = {eps:.3g}" for eps in horizons), "rate")
        out.append((f"Relative L2 distance to scikit-fem's local solution, eps/h = {per_horizon}", columns, rows))
    return out


def theorem_tables(quick: bool, report: Report) -> list[Table]:
    """All tables of the paper's estimates."""
    out: list[Table] = [
        (
            "The paper's discussion section, as printed and recomputed",
            ("quantity", "unit", "printed", "recomputed"),
            [(what, unit, printed, ours) for what, unit, printed, ours in discussion()],
        )
    ]
    for make in (convergence_table, lipschitz_table, energy_table, velocity_table, time_table, horizon_table, h2_table):
        report(str(make.__doc__).splitlines()[0])
        out.append(make(quick))
    return out


def convergence_table(quick: bool = False) -> Table:
    """Error of short runs under the bound of the convergence theorem."""
    rows = []
    for dim, horizon, n in ((2, 0.25, 12), (2, 0.25, 24), *(() if quick else ((3, 0.4, 8),))):
        order, table = (8, 12) if dim == 2 else (5, 5)
        law = law_of(dim, horizon)
        # T (1 + L1 / eps^2) = 4, so that the exponential stays below 100
        T = 4.0 / (1.0 + lipschitz_constant(law, "constant", dim) / horizon**2)
        motion = Manufactured(dim, horizon, law, until=T, order=order, table=table)
        constants = convergence_constants(motion)
        mesh = unit_box(dim, n)
        setup = prepare(motion, mesh, Discretisation(BallRule(3, 8) if dim == 2 else BallRule(2, 13)))
        dt, norm = T / 8, motion.l2_norm
        before: list[Floats] = []
        errors: list[float] = []

        def watch(
            state: Any,
            motion: Manufactured = motion,
            mesh: Any = mesh,
            norm: float = norm,
            before: list[Floats] = before,
            errors: list[float] = errors,
        ) -> None:
            # the paper's v^k = (u^k - u^(k-1)) / dt
            v = state.v if not before else (state.u - before[-1]) / state.dt
            before.append(state.u.copy())
            miss = motion.errors(mesh, state.u, state.t)[0] + motion.omega * motion.errors(mesh, v, state.t, 1)[0]
            errors.append(miss * norm)

        setup.run(dt, watch)
        worst = max(errors)
        factor = constants.exponential(T, dt, horizon)
        bound = constants.bound(T, dt, 1.0 / n, horizon, e0=0.0)
        numbers = (constants.L1, constants.C_p, constants.C_t, constants.C_s)
        rows.append((dim, horizon, 1.0 / n, T, factor, *numbers, worst, bound, worst / bound))
    columns = ("d", "eps", "h", "T", "exponential", "L1", "C_p", "C_t", "C_s", "measured sup E^k", "bound", "ratio")
    return "Bound of the convergence theorem, free body, ball rule, e^0 = 0 (u_h starts from r_h u)", columns, rows


def largest_tangent(body: Any, M: Any, u: Floats) -> float:
    """Return the largest absolute eigenvalue of ``M^-1 tangent(u)``: the local Lipschitz constant of the force in L2.

    By Lanczos, that is a power iteration that keeps its vectors.
    """
    m = 1.0 / np.sqrt(M.diagonal())
    T = body.tangent_operator(u)
    S = LinearOperator(T.shape, matvec=lambda x: m * (T @ (m * x.ravel())), dtype=np.dtype(float))
    start = np.random.default_rng(0).standard_normal(T.shape[0])
    return float(np.abs(eigsh(S, k=1, which="LM", tol=1e-4, v0=start, return_eigenvectors=False)).max())


def lipschitz_table(quick: bool = False) -> Table:
    """Lipschitz constant of the force in L2, times eps^2: measured on the tangent, and its bounds."""
    rows = []
    for dim, horizon, n, influence in (
        (1, 0.1, 80, "constant"),
        (2, 0.15, 30, "constant"),
        (2, 0.15, 30, "conical"),
        *(() if quick else ((3, 0.3, 12, "constant"), (3, 0.3, 12, "conical"))),
    ):
        law = law_of(dim, horizon)
        mesh = unit_box(dim, n)
        basis = vector_basis(mesh)
        body = Peridynamics(BondBasis(basis, horizon, influence), law)
        M = mass_matrix(basis)
        rng = np.random.default_rng(1)
        at_rest = largest_tangent(body, M, np.zeros(basis.N)) * horizon**2
        # strains up to several times the critical one
        amplitude = 2.0 * law.inflection * np.sqrt(horizon)
        loaded = max(
            largest_tangent(body, M, scale * amplitude * rng.standard_normal(basis.N)) * horizon**2
            for scale in (0.03, 0.3, 1.0)
        )
        bounds = (
            symbol_supremum(law, influence, dim),
            sharper_constant(law, influence, dim),
            lipschitz_constant(law, influence, dim),
        )
        rows.append((dim, influence, at_rest, loaded, *bounds))
    columns = ("d", "J", "at rest", "largest, loaded", "symbol", "L1 / d", "L1")
    return "Lipschitz constant of the force in L2, times eps^2 (vertex pairs, eps/h = 3.6 to 8)", columns, rows


def energy_table(quick: bool = False) -> Table:
    """Energy of nonlinear runs with a body force under the semi-discrete bound."""
    rows = []
    for density in (0.25, 1.0, 4.0):
        horizon = 0.2
        motion = Manufactured(2, horizon, law_of(2, horizon), until=2.0)
        setup = prepare(motion, unit_box(2, 20, "random"), CLASSICAL)
        M = density * setup.M
        b = np.ones(setup.basis.N) * setup.M.diagonal()
        m = setup.M.diagonal()
        u0 = 0.05 * motion.field(setup.basis.mesh.p.T).ravel()

        def load(t: float, b: Floats = b) -> Floats:
            return float(np.sin(3.0 * t)) * b

        impulse, initial, ratio, final = 0.0, 0.0, 0.0, (0.0, 0.0)
        dt = 0.2 * np.sqrt(density) * setup.limit.dt
        for state in central_difference(setup.body, M, u0, dt=dt, until=2.0, load=load):
            total = state.energies.total
            if state.step == 0:
                initial = total
            else:  # trapezoidal rule of ||b||
                sizes = [float(np.sqrt((load(t) ** 2 / m).sum())) for t in (state.t - state.dt, state.t)]
                impulse += 0.5 * state.dt * sum(sizes)
            final = (total, energy_bound(initial, impulse, density))
            ratio = max(ratio, final[0] / final[1]) if state.step else ratio
        printed = (np.sqrt(initial) + impulse) ** 2
        rows.append((density, initial, final[0], final[1], ratio, float(printed)))
    columns = ("density", "E(0)", "E(T)", "bound at T", "largest ratio in the run", "bound with coefficient 1, at T")
    return "Semi-discrete energy, nonlinear law, body force (2D, random mesh)", columns, rows


def velocity_table(quick: bool = False) -> Table:
    """The velocity by its own equation against the difference quotient of u."""
    motion = Manufactured(2, 0.2, law_of(2, 0.2), until=0.5)
    setup = prepare(motion, unit_box(2, 15, "random"), CLASSICAL)
    shape = motion.field(setup.basis.mesh.p.T).ravel()
    load, rows, misses = setup.load, [], []
    assert load is not None

    def load_rate(t: float, step: float = 1e-5) -> Floats:
        return np.asarray((load(t + step) - load(t - step)) / (2.0 * step))

    steps = [0.4 * setup.limit.dt * 0.5**k for k in range(3)]
    for dt in steps:
        run = central_difference(setup.body, setup.M, shape, dt=dt, until=0.5, load=load)
        miss = scale = 0.0
        for state, v in velocity_equation(setup.body, setup.M, run, load_rate):
            miss, scale = max(miss, np.abs(v - state.v).max()), max(scale, np.abs(state.v).max())
        misses.append(miss / scale)
    orders = [float("nan"), *rate(steps, misses)]
    rows = [(dt, float(miss), float(order)) for dt, miss, order in zip(steps, misses, orders, strict=True)]
    return (
        "v by rho v'' = Q(v; u) + b' against the difference quotient of u, largest",
        ("dt", "difference", "order"),
        rows,
    )


def time_table(quick: bool = False) -> Table:
    """Order of u and of both velocities in dt, against the same mesh at a small step."""
    motion = Manufactured(2, 0.25, law_of(2, 0.25), until=1.0)
    setup = prepare(motion, unit_box(2, 12, "random"), CLASSICAL)
    m, rows = setup.M.diagonal(), []
    steps = [0.8 * setup.limit.dt * 0.5**k for k in range(4)]
    fine, _, _ = setup.run(steps[-1] / 16)
    fine = fine.copy()
    errors: dict[str, list[float]] = {"u": [], "v, full step": [], "v, the paper's quotient": []}
    taken = []
    for dt in steps:
        before: list[Floats] = []

        def watch(state: Any, before: list[Floats] = before) -> None:
            before.append(state.u.copy())

        state, _, _ = setup.run(dt, watch)
        taken.append(state.dt)
        quotient = (before[-1] - before[-2]) / state.dt
        for quantity, observed, true in (
            ("u", state.u, fine.u),
            ("v, full step", state.v, fine.v),
            ("v, the paper's quotient", quotient, fine.v),
        ):
            errors[quantity].append(float(np.sqrt(m @ (observed - true) ** 2) / np.sqrt(m @ true**2)))
    for quantity, values in errors.items():
        rows.append((quantity, *values, float(np.polyfit(np.log(taken), np.log(values), 1)[0])))
    return "Error of the time step (2D)", ("quantity", *(f"dt = {dt:.3g}" for dt in taken), "order"), rows


def horizon_table(quick: bool = False) -> Table:
    """Errors at a fixed mesh for several horizons: the exponent of eps in front of h^2 and, in H1, of h."""
    rows, errors = [], []
    horizons, n = (0.4, 0.2, 0.1), 80
    for horizon in horizons:
        motion = Manufactured(1, horizon, law_of(1, horizon), table=14)
        constant = time_constant(motion)
        distances = []
        for scheme in (Discretisation(BallRule(round(4 * n * horizon), 1), balanced=True), CLASSICAL):
            row = measure(motion, "", "regular", unit_box(1, n), n, scheme, constant)
            distances.append((row.error_l2, row.error_h1))
        errors.append(distances)
    for k, label in enumerate(("ball, balanced, consistent mass", "classical pairs, lumped mass")):
        for j, norm in enumerate(("L2", "H1")):
            values = [distances[k][j] for distances in errors]
            exponent = float(np.polyfit(np.log(horizons), np.log(values), 1)[0])
            rows.append((f"{norm}, {label}", *values, exponent))
    columns = ("error", *(f"eps = {eps:g}" for eps in horizons), "exponent of eps")
    return f"Errors at h = 1/{n}, 1D (the paper: h^2/eps^2 in L2, conjectured h/eps^(2+alpha) in H1)", columns, rows
