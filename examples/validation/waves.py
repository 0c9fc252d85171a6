"""Case 1: surface waves of Rayleigh's kind and bulk waves, by vertex pairs and by the ball rule."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import skfem
from page import Page, draw_lines

import skfem_peridynamics as peri

SPEED = np.sqrt(2.0 - 2.0 / np.sqrt(3.0))  # of Rayleigh's wave over that of shear, lambda = mu
LENGTH, X0, WIDTH, TRAVEL = 7.0, 2.3, 0.6, 1.5  # wavelengths


def rayleigh(x: np.ndarray, z: np.ndarray, c: float) -> tuple[np.ndarray, np.ndarray]:
    """Displacement and velocity at t = 0 of a packet of Rayleigh waves of length 1, z the depth, (2, n) each."""
    k = 2.0 * np.pi
    q, s = k * np.sqrt(1.0 - c**2 / 3.0), k * np.sqrt(1.0 - c**2)
    along = 1j * k * (np.exp(-q * z) - 2.0 * q * s / (s**2 + k**2) * np.exp(-s * z))
    down = -q * (np.exp(-q * z) - 2.0 * k**2 / (s**2 + k**2) * np.exp(-s * z))
    packet = np.exp(1j * k * x - 0.5 * ((x - X0) / WIDTH) ** 2)
    rate = -1j * k * c + c * (x - X0) / WIDTH**2
    mode = np.stack([along, -down]) * packet
    return mode.real, (mode * rate).real


def surface_speed(per_horizon: int, ratio: int, rule: str, mirrored: bool = False) -> tuple[float, int, int]:
    """Return the speed of the wave over that of shear, with so many vertices a horizon and horizons a wavelength."""
    h = 1.0 / (per_horizon * ratio)
    x, y = np.arange(0.0, LENGTH + h / 2, h), np.arange(-2.0, h / 2, h)
    mesh = skfem.MeshTri.init_tensor(x, y)
    if mirrored:  # the other diagonals
        mesh = skfem.MeshTri(mesh.p * np.array([[-1.0], [1.0]]) + np.array([[x[-1]], [0.0]]), mesh.t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    solid = peri.Material.from_elastic(lame=1.0, density=1.0, plane="strain", potential="linear")
    chosen = peri.BallRule(outer="vertices") if rule == "ball" else peri.PairRule()
    bonds = peri.BondBasis(basis, 1.0 / ratio, rule=chosen)
    body, mass = peri.Peridynamics(bonds, solid), peri.mass_matrix(basis)
    u, v = (field.T.ravel() for field in rayleigh(mesh.p[0], -mesh.p[1], SPEED))
    until = TRAVEL / SPEED
    dt = peri.stable_time_step(body, mass).step_for(until, 0.5)
    top = np.flatnonzero(mesh.p[1] > -h / 2)
    wave, t, phase = np.exp(-2j * np.pi * mesh.p[0, top]), [], []
    for state in peri.central_difference(body, mass, u, v, dt=dt, until=until):
        t.append(state.t)
        phase.append(np.angle(wave @ state.u[2 * top + 1]))
    slope = np.polyfit(t, np.unwrap(phase), 1)[0]
    return -slope / (2.0 * np.pi), len(t) - 1, int(mesh.nvertices)


def bulk_speed(rule: str, kind: str, ratio: float) -> float:
    """Return the phase speed of a plane wave at an inner vertex over that of long waves, by force over mass there."""
    h = 1.0 / (4.0 * ratio)
    grid = h * np.arange(-9, 10)
    basis = skfem.Basis(skfem.MeshTri.init_tensor(grid, grid), skfem.ElementVector(skfem.ElementTriP1()))
    solid = peri.Material.from_elastic(lame=1.0, density=1.0, plane="strain", potential="linear")
    chosen = peri.BallRule(outer="vertices") if rule == "ball" else peri.PairRule()
    body = peri.Peridynamics(peri.BondBasis(basis, 1.0 / ratio, rule=chosen), solid)
    x, middle = basis.mesh.p, int(np.abs(basis.mesh.p).sum(axis=0).argmin())
    u, axis = np.zeros((len(x.T), 2)), 0 if kind == "P" else 1
    u[:, axis] = np.cos(2.0 * np.pi * x[0])
    omega2 = -body.force(u.ravel())[2 * middle + axis] / peri.mass_matrix(basis).diagonal()[2 * middle + axis]
    return float(np.sqrt(omega2) / (2.0 * np.pi) / np.sqrt(3.0 if kind == "P" else 1.0))


def run(folder: Path, quick: bool = False) -> Page:
    """Run the case."""
    page = Page(
        "waves",
        "Waves",
        "A packet of Rayleigh waves runs along the free surface of a half space; its speed is the slope of the "
        "phase of the "
        "surface's Fourier coefficient. Near a free surface a bond-based body is softer than inside, within a "
        "horizon: the "
        "wave is slow by an amount that falls with the horizon over its length. lambda = mu = 1, four vertices "
        "a horizon.",
    )
    rows = []
    for rule in ("pairs", "ball"):
        for ratio in (8, 16) if quick else (8, 16, 32):
            with page.timed(f"{rule}, {ratio} horizons a wavelength") as said:
                c, said["steps"], nodes = surface_speed(4, ratio, rule)
                said["error"] = abs(c / SPEED - 1.0)
            rows.append((rule, ratio, nodes, c / SPEED))
        finest = rows[-1][3]
        # what is left falls with the horizon: the two finest, extrapolated
        limit = 2.0 * rows[-1][3] - rows[-2][3]
        page.judge(f"Rayleigh speed over the exact one, {rule}, finest", finest, 0.98, 1.02, "Rayleigh (1885)")
        page.judge(f"the same as the horizon goes to 0, {rule}", limit, 0.99, 1.01, "Rayleigh (1885)")
    if not quick:
        for per_horizon, mirrored in ((3, False), (6, False), (4, True)):
            with page.timed(f"pairs, 16 horizons a wavelength, {per_horizon} vertices a horizon") as said:
                c, said["steps"], nodes = surface_speed(per_horizon, 16, "pairs", mirrored)
            rows.append((f"pairs, {per_horizon} a horizon" + (", mirrored" if mirrored else ""), 16, nodes, c / SPEED))
        same = [row[3] for row in rows if row[1] == 16 and row[0].startswith("pairs")]
        page.judge("spread over four meshes at 16 horizons a wavelength", max(same) - min(same), 0.0, 0.02)
        lines = {
            rule: list(zip(*[(r[1], r[3]) for r in rows if r[0] == rule], strict=True)) for rule in ("pairs", "ball")
        }
        where = page.picture(folder, "Speed of the surface wave over Rayleigh's")
        draw_lines(where, lines, ("horizons a wavelength", "speed over Rayleigh's"), 1.0)
    columns = ("rule", "horizons a wavelength", "vertices", "ratio")
    page.tables.append(("Speed of the surface wave over Rayleigh's", columns, rows))
    bulk, off = [], {"pairs": 0.0, "ball": 0.0}
    for kind in ("P", "S"):
        for ratio in (2.0, 4.0, 8.0, 16.0):
            k = 2.0 * np.pi
            omega = peri.dispersion(np.array([k]), dim=2, horizon=1.0 / ratio, slope=6.0, density=1.0, wave=kind)[0]
            exact = omega / k / np.sqrt(3.0 if kind == "P" else 1.0)
            found = {rule: bulk_speed(rule, kind, ratio) for rule in off}
            bulk.append((kind, ratio, exact, *found.values()))
            if ratio >= 4.0:
                off = {rule: max(off[rule], abs(found[rule] / exact - 1.0)) for rule in off}
    for rule, worst in off.items():
        page.judge(
            f"bulk waves off the exact dispersion, {rule}, from 4 horizons a wavelength on",
            worst,
            0.0,
            0.02,
            "the symbol of the model",
        )
    columns = ("wave", "horizons a wavelength", "exact", *off)
    page.tables.append(("Speed of plane waves over that of long ones, four vertices a horizon", columns, bulk))
    return page
