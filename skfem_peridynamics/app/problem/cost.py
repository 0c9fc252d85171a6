"""What a run will cost, before any of it is spent: memory, and whether compiled loops are worth loading."""

from __future__ import annotations

from ..._compile import installed
from ..._memory import free_memory
from ..._types import Mesh
from ...bonds.ball_bonds import BallBonds
from ...bonds.ball_rule import BallRule
from ...bonds.corner_rule import CornerRule
from ...bonds.pair_bonds import PairBonds
from ...bonds.pair_rule import PairRule
from ...bonds.rule import Rule
from ...engine.block import matrix_bytes
from ...model.peridynamics import MATRIX_MEMORY

SPARE = 0.8  # of the free memory that a run may plan to take
PRODUCTS = 40  # of a step limit
PER_IMPLICIT_STEP = 50  # evaluations of force, energy or tangent; 75 in examples/double_cantilever.toml
_PROGRAM = 120_000_000  # bytes of the interpreter and the libraries
_COMPILER = 90_000_000  # bytes of numba
_PICTURES, _IN_PICTURE = 30_000_000, 900  # bytes of matplotlib, and a vertex that is drawn
_MAKING = (130e6, 200.0)  # bytes while bonds are made: at most, and a bond
_BALL_LISTED = 200  # bytes of a bond of the ball rule, as sparse products hold it
# bytes a bond while weights are balanced: of vertex pairs by compiled loops (docs/benchmarks/balancing.py: 39, and 92
# in a cube of 50^3), of others and by arrays
_BALANCING_PAIRS, _BALANCING = {1: 180, 2: 40, 3: 120}, {1: 180, 2: 400, 3: 800}
_LOADING = 1.0  # seconds that it takes to load compiled loops, with what numba itself loads
# seconds (docs/evidence/performance.md): a bond and force by sparse products; a bond and step of a whole run on two
# cores, its history and frames included, by either engine
_SPARSE_FORCE, _SPARSE_STEP, _COMPILED_STEP = 7e-9, 22e-9, 6e-9
# seconds of any set-up, of a vertex, of a bond by dimension (slits are looked at), of a bond whose weights are balanced
_SETUP, _VERTEX, _BOND, _BALANCED_BOND = 0.3, 3e-6, {1: 3e-7, 2: 1e-6, 3: 2.2e-6}, 6e-5
_BALANCED_PAIR = {1: 6e-5, 2: 3e-7, 3: 1.5e-6}  # the same of vertex pairs
_DILATED = 2.0  # a force with a dilatation over one without (docs/benchmarks/dilatation.py)
_CALL = {True: 1e-4, False: 6e-4}  # seconds of an explicit step, and of an implicit evaluation, whatever the body
# seconds a vertex of a frame; of pictures, and a vertex in them; of a row of the history, and a bond in it
_IN_FRAME, _DRAWING, _DRAWN, _ROW, _IN_ROW = 6e-6, 1.5, 5e-5, 2e-3, 1e-8


def worth_compiling(nbonds: int, evaluations: float) -> bool:
    """Return whether so many forces take longer by sparse products than it takes to load compiled loops."""
    return nbonds * evaluations * _SPARSE_FORCE > _LOADING


def seconds_of_run(
    nvertices: int,
    nbonds: int,
    steps: float,
    *,
    dim: int = 2,
    explicit: bool,
    balanced: bool,
    frames: int,
    rows: int = 0,
    pairs: bool = False,
    pictures: bool = False,
    dilated: bool = False,
) -> dict[str, float]:
    """Return about how many seconds the phases of a run take on two cores; `docs/benchmarks/estimates.py` compares."""

    def a_bond(evaluations: float) -> float:
        compiled = installed() and worth_compiling(nbonds, evaluations)
        return (_COMPILED_STEP if compiled else _SPARSE_STEP) * (_DILATED if dilated else 1.0)

    forces = steps if explicit else steps * PER_IMPLICIT_STEP
    each = _BOND[dim] + ((_BALANCED_PAIR[dim] if pairs else _BALANCED_BOND) if balanced else 0.0)
    parts = {"set-up": _SETUP + nvertices * _VERTEX + nbonds * each}
    if explicit:
        parts["step limit"] = PRODUCTS * nbonds * a_bond(PRODUCTS)
    parts["steps"] = forces * (_CALL[explicit] + nbonds * a_bond(forces))
    drawing = _DRAWING + nvertices * _DRAWN if pictures else 0.0
    parts["output"] = frames * nvertices * _IN_FRAME + min(rows, steps) * (_ROW + nbonds * _IN_ROW) + drawing
    return parts


def memory_of_run(
    mesh: Mesh,
    rule: Rule,
    nbonds: int,
    balanced: bool,
    *,
    evaluations: float = PRODUCTS,
    pictures: bool = False,
    dilated: bool = False,
) -> int:
    """Return the bytes of a run: bonds as made and as computed with, mesh, fields, pictures, and the program itself.

    Bonds are made in parts, which takes more than to hold them, but no more than so much (``_MAKING``).
    """
    dim, nvertices, nelements = (int(x) for x in (mesh.dim(), mesh.nvertices, mesh.nelements))
    is_ball = isinstance(rule, BallRule)
    compiled = installed() and worth_compiling(nbonds, evaluations)
    matrices = min(
        8 * nbonds if compiled else matrix_bytes(nbonds, dim, BallBonds if is_ball else PairBonds, dilated),
        MATRIX_MEMORY,
    )
    listed = 24 if compiled else _BALL_LISTED if is_ball else 64
    most, each = _MAKING
    bonds = max(nbonds * listed + matrices, nbonds * 24 + min(most, nbonds * each))
    if balanced:
        bonds += nbonds * (_BALANCING_PAIRS if at_vertices(rule) and installed() else _BALANCING)[dim]
    program = _PROGRAM + (_COMPILER if compiled else 0) + (_PICTURES + _IN_PICTURE * nvertices if pictures else 0)
    return int(bonds) + 60 * 8 * dim * nvertices + 200 * dim * nelements + program


def at_vertices(rule: Rule) -> bool:
    """Return whether the bonds of a rule are vertex pairs."""
    return isinstance(rule, CornerRule) or (isinstance(rule, PairRule) and rule.points == "vertices")


def check_memory(need: float) -> None:
    """Raise ``ValueError`` where so many bytes are more than a run may plan to take of what is free."""
    free = free_memory()
    if need > SPARE * free:
        raise ValueError(
            f"which need {need / 1e9:.3g} GB; {free / 1e9:.3g} GB are free: take a smaller horizon or a coarser mesh"
        )
