"""Case 2: what a crack costs, along mesh lines, across them, and on a random mesh, by three rules."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import skfem
from page import Page, draw_lines

import skfem_peridynamics as peri
from skfem_peridynamics.engine.block import Block

HALF, WINDOW = 0.8, 0.6  # half of the body's side; the crack is weighed by cos^2 out to there
RULES = ("pairs", "balanced pairs", "ball")


def square(n: int, kind: str) -> skfem.MeshTri:
    """A square of n by n, structured or with its inner vertices moved by up to 30 % of h at random."""
    grid = np.linspace(-HALF, HALF, n + 1)
    mesh = skfem.MeshTri.init_tensor(grid, grid)
    if kind == "random":
        inside = (np.abs(mesh.p) < HALF - 1e-9).all(axis=0)
        shift = np.random.default_rng(5).uniform(-0.3, 0.3, mesh.p.shape) * (2 * HALF / n) * inside
        mesh = skfem.MeshTri(mesh.p + shift, mesh.t)
    return mesh


def energy_per_length(mesh: skfem.MeshTri, horizon: float, angle: float, rule: str) -> float:
    """Return the energy over G_c, per length, of a crack through the middle, opened far."""
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    chosen = peri.BallRule(outer="vertices") if rule == "ball" else peri.PairRule()
    bonds = peri.BondBasis(basis, horizon, rule=chosen)
    bonds = bonds.balanced() if rule == "balanced pairs" else bonds
    # a ball's bonds end inside the band that the crack is: they are calibrated by their own count
    # (docs/theory/model.md)
    calibrate = "discrete" if rule == "ball" else "continuum"
    solid = peri.Material.from_elastic(young=1.0, toughness=1.0, density=1.0, plane="stress", calibrate=calibrate)
    body = peri.Peridynamics(bonds, solid)
    along = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
    across = np.array([-along[1], along[0]])
    above = across @ mesh.p > 1e-9
    u = (1e4 * above[:, None] * across).ravel()
    place = bonds.samples.take(mesh.p.T) @ along

    def look(block: Block, T: np.ndarray) -> float:
        middle = 0.5 * (block.part.near(place) + block.part.far(place))
        weight = np.cos(0.5 * np.pi * np.clip(middle / WINDOW, -1.0, 1.0)) ** 2
        return float((block.k * block.law.energy(T)) @ weight)

    return sum(body.each_block(u, look)) / WINDOW


def run(folder: Path, quick: bool = False) -> Page:
    """Run the case."""
    page = Page(
        "toughness",
        "Toughness",
        "A straight crack through a square, opened in mode I far beyond the strength of its bonds: the energy "
        "of the bonds it "
        "cuts over its length, against G_c, at three angles to the lines of a regular mesh and on a random one.",
    )
    settings = [
        ("along mesh lines", 0.0, "structured"),
        ("22.5 degrees", 22.5, "structured"),
        ("45 degrees", 45.0, "structured"),
        ("random mesh", 0.0, "random"),
        ("random mesh, 22.5 degrees", 22.5, "random"),
    ]
    rows = []
    for rule in RULES[:1] if quick else RULES:
        for n, per_horizon in [(64, 4)] if quick else [(32, 4), (64, 4), (64, 8)]:
            with page.timed(f"{rule}, {n} x {n}, {per_horizon} vertices a horizon") as said:
                horizon = per_horizon * 2 * HALF / n
                found = [energy_per_length(square(n, kind), horizon, angle, rule) for _, angle, kind in settings]
                said["error"] = max(abs(one - 1.0) for one in found)
            rows.append((rule, n, per_horizon, *found))
            if rule == "ball" or n == 32:
                continue
            where = f"{rule}, {per_horizon} vertices a horizon, {n} x {n}"
            page.judge(f"largest distance to G_c, {where}", said["error"], 0.0, 0.03, "the model's own G_c")
            page.judge(f"largest distance to each other, {where}", max(found) - min(found), 0.0, 0.03)
    if not quick:
        names = ["0", "22.5", "45", "random, 0", "random, 22.5"]
        lines = {f"{rule}, {m} a horizon": (names, found) for rule, n, m, *found in rows if n == 64}
        draw_lines(page.picture(folder, "Energy per length over G_c, 64 x 64"), lines, ("degrees", "over G_c"), 1.0)
    columns = ("rule", "n", "vertices a horizon", *(name for name, _, _ in settings))
    page.tables.append(("Energy per length over G_c", columns, rows))
    page.notes.append(
        "On the coarse random mesh the crack zigzags by a third of an edge, which is longer by some 4 %. The "
        "ball rule, "
        "calibrated by its own count of bonds, is off by up to 5 % and by 10 % on the coarse random mesh: its "
        "bonds end "
        "inside the row of elements that a crack in a P1 field is. Cracks are for vertex pairs, which are the default."
    )
    return page
