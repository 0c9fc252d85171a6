"""Horizons from one element to a thousand bodies, and meshes that no one should make."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from .._types import Mesh
from ..bonds.pair_rule import PairRule
from ..geometry.boxes import axis_with_a_twin, box_of_axes, graded_axis, single_element, unit_box
from ..material.potential import Linear
from ..model.mass import mass_matrix
from ..model.rigidity import check_rigid
from ..solve.central_difference import central_difference
from ..solve.cfl import stable_time_step
from .bodies import ball, body_on, exact_limit
from .oracles import energy_of_a_stretch, energy_of_pairs, zero_modes
from .verdicts import Verdicts

_STEPS = 100


def meshes(quick: bool) -> Iterator[tuple[str, Mesh, float]]:
    """Yield name, mesh and horizon of every extreme body."""
    for m in (1.01, 4.0, 32.0) if quick else (1.01, 1.5, 2.0, 4.0, 8.0, 16.0, 32.0):
        n = max(8, int(np.ceil(2.0 * m)))
        yield f"1D, eps/h = {m:g}", unit_box(1, n), m / n
    for m in (1.01, 4.0) if quick else (1.01, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0):
        n = max(6, int(np.ceil(2.0 * m)))
        yield f"2D, eps/h = {m:g}", unit_box(2, n), m / n
    for m in (1.01,) if quick else (1.01, 1.5, 2.0, 3.0):
        n = max(4, int(np.ceil(2.0 * m)))
        yield f"3D, eps/h = {m:g}", unit_box(3, n), m / n
    for dim in (1, 2, 3):
        for times in (3.0, 1e3):
            yield f"{dim}D, horizon = {times:g} bodies", unit_box(dim, {1: 12, 2: 6, 3: 3}[dim], "random"), times
        yield f"{dim}D, one element", single_element(dim), 2.0
    twin, even = axis_with_a_twin(6, 1e-9), np.linspace(0.0, 1.0, 5)
    yield "1D, two vertices 1e-9 apart", box_of_axes(twin), 0.4
    yield "2D, rows of vertices 1e-9 apart", box_of_axes(even, twin), 0.6
    sliver = axis_with_a_twin(4, float(np.tan(np.radians(0.1))))
    yield "2D, slivers of 0.1 degrees", box_of_axes(even, sliver), 0.6
    if not quick:
        yield "3D, slivers of 0.1 degrees", box_of_axes(even, even, sliver), 0.6
    for dim in (1, 2):
        axis = graded_axis(16, 1e4)
        horizon = 1.01 * float(np.diff(axis).max()) * np.sqrt(dim)
        yield f"{dim}D, graded 1:1e4", box_of_axes(*[axis] * dim), horizon


def extreme_geometry(verdicts: Verdicts, quick: bool) -> None:
    """Energies against sums over all pairs, rigid motions and no others, the limit against the dense spectrum."""
    for name, mesh, horizon in meshes(quick):
        dim = int(mesh.dim())
        rules = {"vertex pairs": None, "balls": ball(dim)}
        for label, rule in rules.items():
            where = f"{name}, {label}"
            body = body_on(mesh, horizon, Linear(1.0), rule)
            M = mass_matrix(body.basis)
            u = np.random.default_rng(0).standard_normal(body.basis.N)
            if rule is None:
                error = abs(body.energy(u) / energy_of_pairs(mesh, horizon, 1.0, u) - 1.0)
                verdicts.add("geometry", where, "energy against all pairs", error, 1e-10)
            elif "one element" not in name:
                # a rule of three nodes is exact for a whole ray, not where J ends within it; corners cost the rest
                stretch = np.eye(dim)[0][:, None] * mesh.p[0]
                error = abs(body.energy(stretch.T.ravel()) / energy_of_a_stretch(dim, horizon) - 1.0)
                verdicts.add("geometry", where, "energy of a stretch", error, 0.05)
            K = body.stiffness().toarray()
            extra = zero_modes(K) - dim * (dim + 1) // 2
            verdicts.add("geometry", where, "zero modes that are not rigid", extra, 0, 0)
            limit, exact = stable_time_step(body, M), exact_limit(body, M)
            verdicts.add("geometry", where, "limit over the dense spectrum's", limit.dt / exact, 1.0 + 1e-9, 0.99)
            dt = 0.95 * exact
            worst = 0.0
            for state in central_difference(body, M, u, dt=dt, until=_STEPS * dt, watch=0):
                off = state.energies.imbalance - state.ripple + state.initial_ripple
                worst = max(worst, abs(off) / state.energies.total)
            verdicts.add("geometry", where, f"energy error of {_STEPS} steps", worst, 1e-9)


def refusals(verdicts: Verdicts, quick: bool) -> None:
    """The three bodies that have no answer are refused, in words that say why."""
    import skfem

    grid = np.linspace(0.0, 1.0, 5)
    square = skfem.MeshTri.init_tensor(grid, grid)
    flat = skfem.MeshTri(np.array([[0.0, 1.0, 2.0, 1.0], [0.0, 0.0, 0.0, 1.0]]), np.array([[0, 1], [1, 2], [3, 3]]))
    flat.p[1, 3] = 0.0
    axes_only = PairRule(partial_volume=False)
    cases: dict[str, tuple[Callable[[], object], str]] = {
        "a vertex without a bond": (
            lambda: body_on(square, 0.1, Linear(1.0), axes_only).bonds.parts,
            "without a bond",
        ),
        "bonds along the axes of a lattice": (
            lambda: check_rigid(body_on(square, 0.26, Linear(1.0), axes_only)),
            "no bond resists a shear",
        ),
        "elements of no volume": (lambda: body_on(flat, 3.0, Linear(1.0)).bonds.parts, "volume"),
    }
    for name, (make, words) in cases.items():
        said = ""
        try:
            with np.errstate(all="ignore"):  # scikit-fem divides by the volume before anyone looks at it
                make()
        except ValueError as error:
            said = str(error)
        verdicts.add("geometry", name, f"refused: {words!r}", float(words in said), 1.0, 1.0, said[:100])
