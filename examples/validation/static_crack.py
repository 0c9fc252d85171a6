"""Case 3: the stress intensity of a plate with a central crack, from the J-integral, against the handbook."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import skfem
from page import Page, draw_lines
from scenes import box_mesh

import skfem_peridynamics as peri

WIDE, HIGH, CRACK = 1.0, 1.5, 0.4  # half width, half height, half length of the crack


def handbook() -> float:
    """K_I / sigma of a plate of finite width (Tada, Paris and Irwin, The Stress Analysis of Cracks; good to 0.1 %)."""
    a = CRACK / WIDE
    return np.sqrt(np.pi * CRACK / np.cos(0.5 * np.pi * a)) * (1.0 - 0.025 * a**2 + 0.06 * a**4)


def intensity(
    n: int, per_horizon: int, rule: str, kind: str = "structured", poisson: float | None = None
) -> tuple[float, float, int]:
    """Return K_I / sigma by two rings, and the number of vertices: n edges along half the width."""
    h = WIDE / n
    x, y = np.linspace(-WIDE, WIDE, 2 * n + 1), np.linspace(-HIGH, HIGH, 2 * round(n * HIGH / WIDE) + 1)
    mesh = skfem.MeshTri.init_tensor(x, y)
    if kind != "structured":
        box, divisions = [[-WIDE, WIDE], [-HIGH, HIGH]], [len(x) - 1, len(y) - 1]
        mesh = box_mesh(box, divisions, kind, lambda p: np.abs(p[1]) < 1e-9)
    mesh = mesh.with_boundaries({"top": lambda x: x[1] > HIGH - 1e-9, "bottom": lambda x: x[1] < -HIGH + 1e-9})
    mesh = peri.slit(mesh, peri.Crack([[-CRACK, 0.0], [CRACK, 0.0]]))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementTriP1()))
    solid = peri.Material.from_elastic(young=1.0, poisson=poisson, density=1.0, plane="stress", potential="linear")
    chosen = peri.BallRule(outer="vertices") if rule == "ball" else peri.PairRule()
    body = peri.Peridynamics(peri.BondBasis(basis, per_horizon * h, rule=chosen), solid)
    pull = peri.traction(basis, "top", [0.0, 1.0]) + peri.traction(basis, "bottom", [0.0, -1.0])
    corner = np.lexsort((mesh.p[0], mesh.p[1]))[0]
    other = np.lexsort((-mesh.p[0], mesh.p[1]))[0]
    held = [peri.Prescribed(np.array([2 * corner, 2 * corner + 1, 2 * other + 1]), displacement=0.0)]
    state = list(peri.static(body, steps=1, load=lambda t: t * pull, fixed=held))[-1]
    J = [peri.j_integral(body, state.u, [CRACK, 0.0], [1.0, 0.0], r, 0.5 * r) for r in (0.55, 0.4)]
    first, second = (float(np.sqrt(one)) for one in J)  # K^2 = E J, E = 1
    return first, second, int(mesh.nvertices)


def run(folder: Path, quick: bool = False) -> Page:
    """Run the case."""
    exact = handbook()
    page = Page(
        "static_crack",
        "A crack at rest",
        f"A plate of half width {WIDE}, half height {HIGH} with a central crack of half length {CRACK} under "
        "tension, by one "
        "equilibrium. K_I from the J-integral over two rings, against the handbook, as the horizon falls at "
        "four vertices a horizon. "
        "The faces of the crack are softer within a horizon, as any free surface, so the crack is longer in effect.",
    )
    rows, last = [], {}
    for rule in ("pairs", "ball"):
        for n in (20, 40) if quick else (20, 40, 80):
            with page.timed(f"{rule}, horizon {4 * WIDE / n:g}") as said:
                wide, narrow, nodes = intensity(n, 4, rule)
                said["error"] = abs(wide / exact - 1.0)
            rows.append((rule, 4 * WIDE / n, nodes, wide / exact, narrow / exact))
            last.setdefault(rule, []).append(wide / exact)
        limit = 2.0 * last[rule][-1] - last[rule][-2]
        page.judge(f"K_I over the handbook's as the horizon goes to 0, {rule}", limit, 0.97, 1.03, "Tada, Paris, Irwin")
        if not quick:
            page.judge(
                f"K_I over the handbook's at the smallest horizon, {rule}",
                last[rule][-1],
                0.97,
                1.03,
                "Tada, Paris, Irwin",
            )
        page.judge(f"largest distance of two rings, {rule}", max(abs(r[3] - r[4]) for r in rows[-1:]), 0.0, 0.02)
    for kind in ("crossed", "random"):
        with page.timed(f"pairs, horizon {4 * WIDE / 40:g}, {kind} mesh"):
            other, _, _ = intensity(40, 4, "pairs", kind)
        page.judge(f"distance to the regular mesh, {kind}", abs(other / exact - last["pairs"][1]), 0.0, 0.01)
    if not quick:
        lines = {
            rule: list(zip(*[(r[1], r[3]) for r in rows if r[0] == rule], strict=True)) for rule in ("pairs", "ball")
        }
        where = page.picture(folder, "K_I over the handbook's against the horizon, half width 1")
        draw_lines(where, lines, ("horizon", "K_I over the handbook's"), 1.0)
    page.tables.append(
        ("K_I over the handbook's", ("rule", "horizon", "vertices", "ring to 0.55", "ring to 0.4"), rows)
    )
    return page
