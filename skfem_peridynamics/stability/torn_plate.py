"""A double-cantilever plate torn in two, quasi-statically: what that costs."""

from __future__ import annotations

from functools import partial
from operator import mul

import numpy as np

from ..analysis.damage import census
from ..bonds.bond_basis import BondBasis
from ..geometry.slit import Crack, slit
from ..material.material import Material
from ..model.peridynamics import Peridynamics
from ..model.space import vector_basis
from ..solve.constraints import Prescribed
from ..solve.newton import Effort
from ..solve.static import static
from .verdicts import Verdicts

_TOUGHNESS, _PER_HORIZON = 1e-4, 4


def tear(verdicts: Verdicts, quick: bool) -> None:
    """Pull the ends of the slit apart until nothing is left of the plate; count the energy of softened bonds."""
    import skfem

    sizes = (
        ((0.025, 0.75, 1.2, 80),)
        if quick
        else ((0.025, 0.75, 1.2, 80), (0.025, 1.0, 1.0, 400), (0.0125, 1.0, 2.5, 400))
    )
    for h, length, opening, steps in sizes:
        height, notch, horizon = 0.5, 0.3, _PER_HORIZON * h
        x, y = (np.linspace(0.0, side, round(side / h) + 1) for side in (length, height))
        middle = 0.5 * height
        mesh = slit(skfem.MeshTri.init_tensor(x, y), Crack([[0.0, middle], [notch, middle]]))
        basis = vector_basis(mesh)
        material = Material.from_elastic(young=1.0, toughness=_TOUGHNESS, density=1.0, plane="stress")
        # only bonds that can cross the plane of the slit fail: the crack stays there, as in a grooved specimen
        away = np.flatnonzero(np.abs(mesh.p[1] - middle) > 1.01 * horizon)
        body = Peridynamics(BondBasis(basis, horizon), material, no_fail=away)
        left = mesh.p[0] < 2.1 * h
        top, bottom = (np.flatnonzero(left & side) for side in (mesh.p[1] > height - 4.1 * h, mesh.p[1] < 4.1 * h))
        fixed = [
            Prescribed(2 * top + 1, displacement=partial(mul, opening)),
            Prescribed(2 * bottom + 1, displacement=partial(mul, -opening)),
            Prescribed(2 * np.r_[top[:1], bottom[:1]], displacement=0.0),
        ]
        effort, path = Effort(), []
        for state in static(body, steps=steps, fixed=fixed, effort=effort):
            count = census(body, state.u)
            pull = float(state.reaction[fixed[0].dofs].sum())
            path.append((2.0 * opening * state.t, pull, count.energy_softened, count.energy_intact, state.imbalance))
        apart, pull, spent, stored, lost = np.array(path).T
        new = length - notch
        where = f"h = {h:g}, ligament {new / h:.0f} h"
        jumps = -lost[-1] / (new * _TOUGHNESS)
        note = f"{effort.iterations} iterations, {effort.products} products, {jumps:.2f} lost in jumps"
        label = where.replace(",", ":")
        verdicts.add(
            "tear", where, "energy of softened bonds over G_c length", spent[-1] / (new * _TOUGHNESS), 1.05, 0.95, note
        )
        verdicts.add("tear", where, "energy left in other bonds", stored[-1] / spent[-1], 1e-9)
        verdicts.add("tear", where, "force at the end over the largest", abs(pull[-1]) / pull.max(), 1e-6)
        verdicts.draw("tear", label, apart, pull, ("opening", "force"))
        verdicts.draw(
            "torn energy",
            label,
            apart,
            spent / (new * _TOUGHNESS),
            ("opening", "energy of softened bonds / (G_c ligament)"),
        )
