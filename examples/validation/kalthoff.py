"""Case 6: the angle of the cracks in the plate of Kalthoff and Winkler."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from page import Page
from scenes import read
from scenes import run as run_scene

from skfem_peridynamics.analysis.crack import CRACKED
from skfem_peridynamics.app.files.results import Results
from skfem_peridynamics.app.report.body_pictures import plot_damage

TIP, NOTCHES = 0.05, ((0.125, 1.0), (0.075, -1.0))


def angles(results: Results) -> list[float]:
    """Return the angle to its notch of each crack: the mean direction of what is hurt beyond a third of its length."""
    body, out = results.last, []
    assert body is not None
    for height, side in NOTCHES:
        x, y = body.mesh.p[0] - TIP, side * (body.mesh.p[1] - height)
        some = (body.broken >= CRACKED) & (y > -2e-3) & (x > -0.02)
        far = np.hypot(x, y) * some
        outer = far > far.max() / 3.0
        out.append(float(np.degrees(np.arctan2(y[outer].sum(), x[outer].sum()))))
    return out


def on_the_notch(p: np.ndarray) -> np.ndarray:
    """Return which points lie on the line of a notch, and stay where they are on a random mesh."""
    return (p[0] < TIP + 1e-9) & (np.abs(np.abs(p[1] - 0.1) - 0.025) < 1e-9)


def run(folder: Path, quick: bool = False) -> Page:
    """Run the case."""
    page = Page(
        "kalthoff",
        "Kalthoff and Winkler's plate",
        "Maraging steel, 100 x 200 mm, two notches 50 mm deep and 50 mm apart; the edge between them is pushed "
        "at 16.5 m/s. "
        "Angle of the cracks to the notches after 75 microseconds, as the horizon falls at five to six and a "
        "half vertices a horizon.",
    )
    rows, mean = [], {}
    settings = (
        [(6e-3, [100, 200])]
        if quick
        else [(4e-3, [160, 320]), (3e-3, [200, 400]), (2e-3, [320, 640]), (1.25e-3, [400, 800]), (1e-3, [500, 1000])]
    )
    for horizon, divisions in settings:
        tables = read("kalthoff.toml", mesh__divisions=divisions, bonds__horizon=horizon)
        found = run_scene(page, f"horizon {1e3 * horizon:g} mm, {divisions[0]} x {divisions[1]}", tables)
        up, down = angles(found)
        mean[horizon] = 0.5 * (up + down)
        rows.append(
            (
                1e3 * horizon,
                f"{divisions[0]} x {divisions[1]}",
                "structured",
                up,
                down,
                found.summary["largest_tip_speed"],
            )
        )
    if not quick:
        plot_damage(page.picture(folder, "Damage after 75 microseconds, horizon 1 mm"), found.last, "", found.units)
    for kind in () if quick else ("crossed", "random"):
        tables = read("kalthoff.toml", mesh__divisions=[200, 400], bonds__horizon=3e-3)
        up, down = angles(run_scene(page, f"horizon 3 mm, {kind}", tables, kind, on_the_notch))
        rows.append((3.0, "200 x 400", kind, up, down, float("nan")))
    columns = ("horizon, mm", "mesh", "kind", "upper", "lower", "fastest tip, m/s")
    page.tables.append(("Angles in degrees", columns, rows))
    page.judge(
        "largest difference of upper and lower angle, degrees",
        max(abs(r[3] - r[4]) for r in rows),
        0.0,
        2.0,
        "symmetry",
    )
    source = "experiment about 70 degrees (Kalthoff and Winkler, 1988; Kalthoff, 2000)"
    if quick:
        page.judge("angle, coarse", mean[6e-3], 50.0, 72.0, source)
        return page
    page.judge("angle at the smallest horizon", mean[1e-3], 65.0, 72.0, source)
    slope, limit = np.polyfit(list(mean), list(mean.values()), 1)
    page.judge("angle as the horizon goes to 0, by a straight line", limit, 65.0, 72.0, source)
    spread = [0.5 * (r[3] + r[4]) for r in rows if r[0] == 3.0]
    page.judge("spread over three meshes at 3 mm, degrees", max(spread) - min(spread), 0.0, 3.0)
    page.notes.append(
        f"The angle rises by {-slope * 1e-3:.1f} degrees a millimetre that the horizon is shorter. A crack that "
        "leaves a notch turns by "
        "70.5 degrees in a field of pure mode II, where the largest hoop stress is; within a horizon of the "
        "tip there is no such field."
    )
    return page
