"""What a run will cost, before any of it is spent: memory, and whether compiled loops are worth loading."""

from __future__ import annotations

from ..._compile import installed
from ..._memory import free_memory
from ..._types import Mesh
from ...bonds.ball_bonds import BallBonds
from ...bonds.ball_rule import BallRule
from ...bonds.pair_bonds import PairBonds
from ...bonds.rule import Rule
from ...engine.block import matrix_bytes
from ...model.peridynamics import MATRIX_MEMORY

SPARE = 0.8  # of the free memory that a run may plan to take
PRODUCTS = 40  # of a step limit
PER_IMPLICIT_STEP = 50  # evaluations of force, energy or tangent; 75 in examples/double_cantilever.toml
_PROGRAM = 120_000_000  # bytes of the interpreter and the libraries
_BALANCING = {1: 180, 2: 400, 3: 800}  # bytes a bond while weights are balanced
_LOADING = 1.0  # seconds that it takes to load compiled loops, with what numba itself loads
# seconds (docs/evidence/performance.md): a bond and force by sparse products; a bond and step of a whole run on two
# cores, its history and frames included, by either engine
_SPARSE_FORCE, _SPARSE_STEP, _COMPILED_STEP = 7e-9, 22e-9, 6e-9
# seconds a vertex and a bond of a set-up, a bond while weights are balanced, a vertex of a frame
_VERTEX, _BOND, _BALANCED_BOND, _IN_FRAME = 3e-6, 1.2e-7, 6e-5, 6e-6


def worth_compiling(nbonds: int, evaluations: float) -> bool:
    """Return whether so many forces take longer by sparse products than it takes to load compiled loops."""
    return nbonds * evaluations * _SPARSE_FORCE > _LOADING


def seconds_of_run(
    nvertices: int, nbonds: int, steps: float, *, explicit: bool, balanced: bool, frames: int
) -> dict[str, float]:
    """Return about how many seconds the phases of a run take on two cores."""

    def a_bond(evaluations: float) -> float:
        compiled = installed() and worth_compiling(nbonds, evaluations)
        return _COMPILED_STEP if compiled else _SPARSE_STEP

    forces = steps if explicit else steps * PER_IMPLICIT_STEP
    parts = {"set-up": nvertices * _VERTEX + nbonds * (_BOND + (_BALANCED_BOND if balanced else 0.0))}
    if explicit:
        parts["step limit"] = PRODUCTS * nbonds * a_bond(PRODUCTS)
    parts["steps"] = forces * nbonds * a_bond(forces)
    parts["output"] = frames * nvertices * _IN_FRAME
    return parts


def memory_of_run(mesh: Mesh, rule: Rule, nbonds: int, balanced: bool) -> int:
    """Return the bytes of a run: bonds as listed and computed with, mesh, fields, and what the program itself takes."""
    dim, nvertices, nelements = (int(x) for x in (mesh.dim(), mesh.nvertices, mesh.nelements))
    kind = BallBonds if isinstance(rule, BallRule) else PairBonds
    matrices = min(8 * nbonds if installed() else matrix_bytes(nbonds, dim, kind), MATRIX_MEMORY)
    per_bond = (24 if installed() else 64) + (_BALANCING[dim] if balanced else 0)
    return int(nbonds * per_bond + matrices) + 60 * 8 * dim * nvertices + 200 * dim * nelements + _PROGRAM


def check_memory(need: float) -> None:
    """Raise ``ValueError`` where so many bytes are more than a run may plan to take of what is free."""
    free = free_memory()
    if need > SPARE * free:
        raise ValueError(
            f"which need {need / 1e9:.3g} GB; {free / 1e9:.3g} GB are free: take a smaller horizon or a coarser mesh"
        )
