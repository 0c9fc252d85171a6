"""Case 8: the centre crack, the branching plate and Kalthoff's plate with the Poisson ratios of their materials."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from branching import before_branching, directions, with_load
from kalthoff import angles
from page import Page
from scenes import read
from scenes import run as run_scene
from static_crack import handbook, intensity

GLASS, STEEL = 0.22, 0.3


def run(folder: Path, quick: bool = False) -> Page:
    """Run the case."""
    page = Page(
        "poisson",
        "The Poisson ratio of the material",
        "Three of the cases above with the ratios of their materials, by a dilatation beside the bonds "
        "(docs/theory/dilatation.md), and beside them with bonds alone, 1/3 in plane stress and 1/4 in plane strain.",
    )
    rows = []
    for nu in (0.0, 0.3, None):
        found = []
        for n in (20, 40) if quick else (20, 40, 80):
            with page.timed(f"centre crack, {_said(nu, 1 / 3)}, horizon {4 / n:g}") as said:
                found.append(intensity(n, 4, "pairs", poisson=nu)[0] / handbook())
                said["error"] = abs(found[-1] - 1.0)
        limit = 2.0 * found[-1] - found[-2]
        rows.append((_said(nu, 1 / 3), *found, limit))
        source = "Tada, Paris, Irwin: it does not depend on the ratio"
        page.judge(f"K_I over the handbook's as the horizon goes to 0, {_said(nu, 1 / 3)}", limit, 0.97, 1.03, source)
    horizons = tuple(f"horizon {4 / n:g}" for n in ((20, 40) if quick else (20, 40, 80)))
    page.tables.append(("K_I over the handbook's", ("material", *horizons, "limit"), rows))
    if not quick:
        _branching(page)
    _kalthoff(page, quick)
    return page


def _said(nu: float | None, alone: float) -> str:
    return f"bonds alone, {alone:.3g}" if nu is None else f"nu = {nu:g}"


def _branching(page: Page) -> None:
    rows, speeds = [], []
    for nu in (GLASS, None):
        found = run_scene(page, f"12 MPa, {_said(nu, 1 / 3)}", with_load(12.0, material__poisson=nu or 1 / 3))
        speed, where = before_branching(found.history)
        up, down = directions(found)
        speeds.append(speed / found.summary["elastic"]["rayleigh_speed"])
        rows.append((_said(nu, 1 / 3), speed, speeds[-1], 1e3 * where, up + down, int(found.history["tips"].max())))
    columns = (
        "material",
        "speed before branching, m/s",
        "over Rayleigh",
        "way until then, mm",
        "angle",
        "tips at last",
    )
    page.tables.append(("Branching at 12 MPa", columns, rows))
    source = "in glass small branches appear near 0.42 (Sharon and Fineberg, 1998)"
    page.judge(f"speed before branching over the Rayleigh speed, nu = {GLASS}", speeds[0], 0.35, 0.7, source)
    page.judge(f"tips at last, nu = {GLASS}", rows[0][-1], 2, 10, "branches at 12 MPa (Ha and Bobaru, 2010)")


def _kalthoff(page: Page, quick: bool) -> None:
    rows, mean = [], {}
    settings = [(6e-3, [100, 200])] if quick else [(3e-3, [200, 400]), (2e-3, [320, 640])]
    for horizon, divisions in settings:
        for nu in (STEEL, None):
            tables = read(
                "kalthoff.toml", mesh__divisions=divisions, bonds__horizon=horizon, material__poisson=nu or 0.25
            )
            found = run_scene(page, f"Kalthoff, horizon {1e3 * horizon:g} mm, {_said(nu, 0.25)}", tables)
            up, down = angles(found)
            mean[horizon, nu] = 0.5 * (up + down)
            rows.append((1e3 * horizon, _said(nu, 0.25), up, down, found.summary["largest_tip_speed"]))
    columns = ("horizon, mm", "material", "upper", "lower", "fastest tip, m/s")
    page.tables.append(("Kalthoff and Winkler's angles in degrees", columns, rows))
    source = "experiment about 70 degrees; it is 65 to 72 at the smallest horizon of case 6"
    page.judge(f"angle, nu = {STEEL}, {rows[-1][0]:g} mm", mean[horizon, STEEL], 50.0 if quick else 60.0, 72.0, source)
    apart = float(np.abs([mean[h, STEEL] - mean[h, None] for h, _ in settings]).max())
    page.judge("largest distance to bonds alone, degrees", apart, 0.0, 5.0)
