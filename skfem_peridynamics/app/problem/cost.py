"""What a run will cost, before any of it is spent: memory, and whether compiled loops are worth loading."""

from __future__ import annotations

from ..._compile import installed
from ..._types import Mesh
from ...bonds.ball_bonds import BallPart
from ...bonds.ball_rule import BallRule
from ...bonds.pair_bonds import PairPart
from ...bonds.rule import Rule
from ...engine.block import matrix_bytes
from ...model.peridynamics import MATRIX_MEMORY

SPARE = 0.8  # of the free memory that a run may plan to take
PRODUCTS = 40  # of a step limit
PER_IMPLICIT_STEP = 50  # evaluations of force, energy or tangent; 75 in examples/double_cantilever.toml
_PROGRAM = 120_000_000  # bytes of the interpreter and the libraries
_BALANCING = {1: 180, 2: 400, 3: 800}  # bytes a bond while weights are balanced
_SPARSE = 7e-9  # seconds a bond and force by sparse products (docs/performance.md)
_LOADING = 1.0  # seconds that it takes to load compiled loops, with what numba itself loads


def worth_compiling(nbonds: int, evaluations: float) -> bool:
    """Return whether so many forces take longer by sparse products than it takes to load compiled loops."""
    return nbonds * evaluations * _SPARSE > _LOADING


def memory_of_run(mesh: Mesh, rule: Rule, nbonds: int, balanced: bool) -> int:
    """Return the bytes of a run: bonds as listed and computed with, mesh, fields, and what the program itself takes."""
    dim, nvertices, nelements = (int(x) for x in (mesh.dim(), mesh.nvertices, mesh.nelements))
    kind = BallPart if isinstance(rule, BallRule) else PairPart
    matrices = min(8 * nbonds if installed() else matrix_bytes(nbonds, dim, kind), MATRIX_MEMORY)
    per_bond = (24 if installed() else 64) + (_BALANCING[dim] if balanced else 0)
    return int(nbonds * per_bond + matrices) + 60 * 8 * dim * nvertices + 200 * dim * nelements + _PROGRAM
