"""Stiff scenes: who reaches one per cent first, explicit at its limit, Newmark at its best step, or statics."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .._types import Csr, Floats, Load, Longs
from ..bonds.bond_basis import BondBasis
from ..geometry.boxes import axis_with_a_twin, unit_box
from ..geometry.layers import collar
from ..geometry.slit import Crack, slit
from ..material.composite import Composite
from ..material.material import Material
from ..model.loads import layer_traction
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.central_difference import central_difference
from ..solve.cfl import stable_time_step
from ..solve.constraints import Prescribed
from ..solve.newmark import newmark
from ..solve.static import static
from .verdicts import Verdicts

TARGET = 1e-2  # relative error of the displacement at the end, in the norm of the mass
_SAFETY, _REFERENCE = 0.95, 0.25  # of the limit


@dataclass(frozen=True, eq=False)
class Scene:
    """A body and what is done to it."""

    name: str
    body: Peridynamics
    M: Csr
    until: float
    fixed: list[Prescribed]
    load: Load | None = None
    statics: bool = False  # whether inertia may be left out


def _pulled(body: Peridynamics, until: float, width: float) -> list[Prescribed]:
    """Hold the left end, and move the right end as a course of time says."""
    x, dim = body.bonds.mesh.p[0], body.bonds.dim

    def dofs(vertices: Longs) -> Longs:
        return np.asarray((vertices[:, None] * dim + np.arange(dim)).ravel())

    left, right = np.flatnonzero(x < width), np.flatnonzero(x > 1.0 - width)
    along = np.tile(np.eye(dim)[0], len(right))
    return [
        Prescribed(dofs(left), displacement=0.0),
        Prescribed(dofs(right), displacement=partial(_course, until, 0.01 * along)),
    ]


def _course(until: float, how: Floats, t: float) -> Floats:
    """From nothing to all, smoothly."""
    s = min(max(t / until, 0.0), 1.0)
    return how * (s * s * (3.0 - 2.0 * s))


def scenes(quick: bool) -> Iterator[Scene]:
    """Yield a body with stiff parts, one with a row of thin elements, one pulled slowly, and one with waves."""
    import skfem

    n = 16 if quick else 32
    horizon = 4.0 / n
    stone = Material.from_elastic(lame=1.0, toughness=1.0, density=1.0, plane="strain")  # waves take 0.6 to cross it

    def scene_of(name: str, mesh: object, material: Composite, until: float, statics: bool = False) -> Scene:
        body = Peridynamics(BondBasis(vector_basis(mesh), horizon), material)
        M = mass_matrix(body.basis, density=material.density_on(mesh))
        return Scene(name, body, M, until, _pulled(body, until, 1.01 / n), statics=statics)

    uniform = Composite(stone)
    contrast = 1e3 if quick else 1e4
    stiff = Composite(stone, {"stiff": stone.with_(lame=contrast)})
    mesh = unit_box(2, n)
    inside = (np.abs(mesh.p[:, mesh.t].mean(axis=1) - 0.5) < 0.2).all(axis=0)
    yield scene_of(
        f"an inclusion {contrast:.0e} times as stiff",
        mesh.with_subdomains({"stiff": np.flatnonzero(inside)}),
        stiff,
        4.0,
    )
    axis = np.linspace(0.0, 1.0, n + 1)
    thin = skfem.MeshTri.init_tensor(axis, axis_with_a_twin(n, 1e-4))
    yield scene_of("a row of elements 1e-4 thin", thin, uniform, 4.0)
    yield scene_of("pulled in 40 crossings", unit_box(2, n), uniform, 24.0, statics=True)
    yield scene_of("waves", unit_box(2, n), uniform, 1.0)
    if not quick:
        yield _torn(40)


def _torn(n: int) -> Scene:
    """A notched plate that a load tears in two, in a few crossings of a wave."""
    import skfem

    x = np.linspace(0.0, 1.0, n + 1)
    mesh = slit(skfem.MeshTri.init_tensor(x, x[: n // 2 + 1]), Crack([[0.0, 0.25], [0.4, 0.25]])).with_defaults()
    basis = vector_basis(mesh)
    brittle = Material.from_elastic(young=1.0, toughness=1e-4, density=1.0, plane="stress")
    layers = [collar(mesh, side, width=0.1) for side in ("top", "bottom")]
    body = Peridynamics(BondBasis(basis, 4.0 / n), brittle, no_fail=np.concatenate(layers))
    up, down = (layer_traction(basis, side, [0.0, t], width=0.1) for side, t in (("top", 0.012), ("bottom", -0.012)))
    return Scene("torn by a load", body, mass_matrix(basis), 6.0, [], partial(_growing, up + down))


def _growing(pull: Floats, t: float) -> Floats:
    return pull * min(t, 1.0)


def _timed(run: Iterator[object]) -> tuple[Floats, float, int]:
    """The displacement at the end, seconds, and how many states there were."""
    begin, count, state = time.perf_counter(), 0, None
    for state in run:  # noqa: B007 (the last one is wanted)
        count += 1
    return np.array(state.u), time.perf_counter() - begin, count - 1  # type: ignore[attr-defined]


def race(verdicts: Verdicts, quick: bool) -> None:
    """Error and seconds of each method; the reference is the explicit one at a quarter of its limit."""
    for scene in scenes(quick):
        body, M, until = scene.body, scene.M, scene.until
        given: dict[str, Any] = {"until": until, "fixed": scene.fixed, "load": scene.load}
        _ = body.force(np.zeros(body.basis.N))  # bonds and loops are there before anyone is timed
        begin = time.perf_counter()
        limit = stable_time_step(body, M)
        limit_seconds = time.perf_counter() - begin
        exact, *_ = _timed(central_difference(body, M, dt=limit.step_for(until, _REFERENCE), **given))
        norm = float(np.sqrt(exact @ (M @ exact)))

        def error(u: Floats, exact: Floats = exact, M: Csr = M, norm: float = norm) -> float:
            return float(np.sqrt((u - exact) @ (M @ (u - exact)))) / norm

        u, seconds, steps = _timed(central_difference(body, M, dt=limit.step_for(until, _SAFETY), **given))
        runs = {"explicit": [(error(u), seconds + limit_seconds, f"{steps} steps")]}
        runs["Newmark"] = []
        for parts in (4, 8, 16, 32, 64, 128, 256):
            dt = until / parts
            if dt < limit.dt and parts > 4:
                break
            u, seconds, count = _timed(newmark(body, M, dt=dt, watch=0, **given))
            runs["Newmark"].append((error(u), seconds, f"dt = {dt / limit.dt:.3g} limits, {count} steps"))
        if scene.statics:
            u, seconds, _ = _timed(static(body, steps=1, **given))
            runs["statics"] = [(error(u), seconds, "one step")]
        outcomes, best = [], (np.inf, "nobody")
        for name, rows in runs.items():
            good = [row for row in rows if row[0] <= TARGET]
            if good:
                off, seconds, how = min(good, key=lambda row: row[1])
                outcomes.append(f"{name} {seconds:.3g} s ({how}, error {off:.1e})")
                best = min(best, (seconds, name))
            else:
                off, seconds, how = min(rows)
                outcomes.append(f"{name} not (at best error {off:.1e}, {seconds:.3g} s, {how})")
            x, y = [row[1] for row in rows], [max(row[0], 1e-12) for row in rows]
            axes = ("seconds", "relative error of u")
            verdicts.draw("race", f"{scene.name}, {name}", x, y, axes, (True, True))
        least = min(row[0] for rows in runs.values() for row in rows)
        note = f"first {best[1]}: {'; '.join(outcomes)}"
        verdicts.add(
            "race", f"{scene.name}, {body.basis.N} unknowns", "some method reaches 1 %", least, TARGET, note=note
        )
