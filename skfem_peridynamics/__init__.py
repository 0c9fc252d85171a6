"""Nonlocal fracture as a scikit-fem extension: bonds over a P1 basis, a law, a body, a stable step, a run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ._version import __version__
from .analysis.crack import CrackPath, crack_path
from .analysis.damage import Census, Damage, census, damage
from .analysis.dispersion import dispersion
from .analysis.j_integral import j_integral
from .analysis.stress import strain, stress
from .bonds.ball_rule import BallRule
from .bonds.bond_basis import BondBasis
from .bonds.corner_rule import CornerRule
from .bonds.pair_rule import PairRule
from .geometry.layers import boundary_function, collar, region
from .geometry.slit import Crack, slit
from .material.composite import Composite
from .material.elastic import Elastic
from .material.influence import Influence, conical, constant, gaussian
from .material.material import Material
from .material.own_law import Scalars, own_potential
from .material.potential import Exponential, Linear, Potential, Rational
from .model.breaking import Breaking
from .model.loads import body_force, layer_traction, traction
from .model.mass import mass_matrix
from .model.peridynamics import Peridynamics
from .model.space import interpolate, project
from .solve.central_difference import central_difference
from .solve.cfl import StepLimit, discrete_energy, stable_time_step
from .solve.constraints import Prescribed
from .solve.energy import Energies
from .solve.instability import UnstableRun
from .solve.newmark import newmark
from .solve.newton import Effort, NotConverged
from .solve.state import Equilibrium, State
from .solve.state_bound import bound_of_all_states
from .solve.state_files import load_state, save_state
from .solve.static import static

if TYPE_CHECKING:
    from .app.files.frames import Frames
    from .app.report.plot import plot
    from .app.report.view import view
    from .app.run.finished import FinishedRun
    from .app.run.run import run
    from .app.run.sweep import sweep
    from .app.scene.scene import Scene

__all__ = [
    "BallRule",
    "BondBasis",
    "Breaking",
    "Census",
    "Composite",
    "CornerRule",
    "Crack",
    "CrackPath",
    "Damage",
    "Effort",
    "Elastic",
    "Energies",
    "Equilibrium",
    "Exponential",
    "FinishedRun",
    "Frames",
    "Influence",
    "Linear",
    "Material",
    "NotConverged",
    "PairRule",
    "Peridynamics",
    "Potential",
    "Prescribed",
    "Rational",
    "Scalars",
    "Scene",
    "State",
    "StepLimit",
    "UnstableRun",
    "__version__",
    "body_force",
    "bound_of_all_states",
    "boundary_function",
    "census",
    "central_difference",
    "collar",
    "conical",
    "constant",
    "crack_path",
    "damage",
    "discrete_energy",
    "dispersion",
    "gaussian",
    "interpolate",
    "j_integral",
    "layer_traction",
    "load_state",
    "mass_matrix",
    "newmark",
    "own_potential",
    "plot",
    "project",
    "region",
    "run",
    "save_state",
    "slit",
    "stable_time_step",
    "static",
    "strain",
    "stress",
    "sweep",
    "traction",
    "view",
]

_LATER = {
    "Frames": "app.files.frames",
    "Scene": "app.scene.scene",
    "FinishedRun": "app.run.finished",
    "distributed": "ranks.distributed",
    "plot": "app.report.plot",
    "run": "app.run.run",
    "sweep": "app.run.sweep",
    "view": "app.report.view",
}


def __getattr__(name: str) -> Any:
    """Load the runner only for those who use it: a script over plain arrays needs no files, formulas or pictures."""
    if name in _LATER:
        from importlib import import_module

        return getattr(import_module(f".{_LATER[name]}", __name__), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
