"""Deal a body out over the ranks of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from .._types import Bools, Floats, Longs, Mesh
from ..bonds.ball_rule import BallRule
from ..bonds.bond_basis import BondBasis
from ..bonds.corner_rule import CornerRule
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule
from ..geometry.neighbours import local_order, pairs_within
from ..geometry.simplices import check_simplices, facet_directions, longest_edge, vertex_sizes
from ..material.composite import Composite
from ..material.influence import Influence
from ..material.material import Material
from ..material.potential import Potential
from ..model.bond_laws import marked_vertices
from ..model.space import numbering_basis
from .body import RankBody
from .make_body import make_body
from .schemes import offer_schemes
from .share import Share, divided, shares
from .world import threads_of_a_rank, world

Made: TypeAlias = Material | Potential | Composite


def distributed(
    mesh: Mesh | None,
    horizon: float,
    material: Made | Callable[[Mesh], Made],
    *,
    influence: Influence | str = "constant",
    rule: Rule | None = None,
    no_fail: npt.ArrayLike | None = None,
    balanced: bool = False,
    boundary_function: str | npt.ArrayLike | None = None,
    breaking: float | None = None,
    overlap: bool = False,
    **options: Any,
) -> RankBody:
    """Return a body that is dealt out over all ranks that ``mpiexec`` has started.

    Explicit steppers take it as they take any body; vectors are then a rank's own part. Only the first rank needs the
    mesh and the no-fail vertices, and holds the whole of them.

    Parameters
    ----------
    mesh : skfem.Mesh or None
        Lines, triangles or tetrahedra on the first rank; None, or anything, on the others.
    horizon : float
        A length.
    material : Material, Composite, Potential or callable
        What the body is made of, the same on all ranks, or a function that makes it of the mesh of a rank.
    influence : Influence or str, optional
        The influence function.
    rule : PairRule, BallRule or CornerRule, optional
        Vertex pairs by default.
    no_fail : array_like of int, optional
        Vertices all of whose bonds stay linear.
    balanced : bool, optional
        With balanced weights, as :meth:`BondBasis.balanced` gives.
    boundary_function : {"smooth"} or array_like, (nvertices,), optional
        The paper's w, on the first rank.
    breaking : float, optional
        How many times their critical strain bonds bear before they break for good, as of :class:`Breaking`; of vertex
        pairs, without a dilatation.
    overlap : bool, optional
        Compute the bonds that need no ghost while ghosts are on their way, and the others by themselves: it pays where
        an exchange takes longer than a twentieth of a force, on a slow network (docs/howto/processes.md).
    **options
        ``threads`` (a rank's part of the cores that the ranks of its machine may use), ``matrix_memory`` and
        ``compiled`` of :class:`Peridynamics`.

    Returns
    -------
    RankBody
        The rank's part of it, with ``scatter`` and ``gather`` of vectors; ``close`` it at the end.

    Raises
    ------
    ValueError
        Where MPI and PETSc are not installed, and for another rule or a material that is not dealt out yet.

    Examples
    --------
    A script for ``mpiexec -n 4 python script.py``, of a mesh that the first rank reads::

        body = peri.distributed(mesh if world().rank == 0 else None, horizon=0.1, material=glass)
        m = body.scatter(mass.diagonal() if body.share.rank == 0 else None)
        for state in peri.central_difference(body, m, u0, v0, dt=dt, until=1e-3):
            ...
        u = body.gather(state.u)                                  # on the first rank, of the whole mesh
    """
    rule = PairRule() if rule is None else rule
    if not isinstance(rule, PairRule | BallRule | CornerRule):
        named = getattr(rule, "name", repr(rule))
        raise ValueError(f"rule = {named}: over processes it must be a PairRule, a BallRule or a CornerRule")
    if breaking is not None and not isinstance(breaking, (int, float)):
        raise ValueError(f"breaking = {breaking!r} must be a number, 1 or more")
    offer_schemes()
    comm, mine, plan = world(), None, None
    said = ""
    if comm.rank == 0:
        try:
            plan = _plan(mesh, horizon, rule, no_fail, boundary_function, comm.size)
        except ValueError as error:  # what the first rank alone can see, all say
            said = str(error)
    said = comm.bcast(said, root=0)
    if said:
        raise ValueError(said)
    if plan is not None:
        for rank, part in enumerate(_dealt(plan)):
            if rank:  # one after the other: beside the whole mesh there is one share at a time
                comm.send(part, dest=rank)
            else:
                mine = part
    else:
        mine = comm.recv(source=0)
    assert mine is not None
    share = mine.share
    made = material(share.mesh) if callable(material) and not isinstance(material, Potential) else material
    materials = made.materials if isinstance(made, Composite) else (made,)
    facets = None
    if any(getattr(one, "calibrate", "") == "discrete" for one in materials):
        facets = comm.bcast(facet_directions(mesh) if mesh is not None and comm.rank == 0 else None, root=0)
    options.setdefault("threads", threads_of_a_rank())
    rest = mine.no_fail if len(mine.no_fail) else None, balanced, mine.w, breaking, overlap, facets
    return make_body(comm, share, horizon, influence, mine.rule, made, *rest, **options)


class _Part(NamedTuple):
    """What a rank is sent: the rule for the whole mesh, its share, no-fail vertices and values of w of that."""

    rule: Rule
    share: Share
    no_fail: Longs
    w: Floats | None


class _Plan(NamedTuple):
    """How a mesh is dealt: the rule for the whole of it, the owners of vertices, no-fail vertices and values of w."""

    mesh: Mesh
    rule: Rule
    owner: Longs
    reach: float
    along: Longs | None
    no_fail: Bools
    w: Floats | None


def _plan(
    mesh: Mesh | None,
    horizon: float,
    rule: Rule,
    no_fail: npt.ArrayLike | None,
    boundary_function: str | npt.ArrayLike | None,
    nranks: int,
) -> _Plan:
    """Return how a mesh is dealt. Raises ``ValueError`` for arguments that make no sense."""
    if mesh is None:
        raise ValueError("mesh = None: the first rank needs the mesh")
    check_simplices(mesh)
    whole = BondBasis(numbering_basis(mesh), horizon, boundary_function=boundary_function)
    if mesh.nvertices < nranks:
        raise ValueError(f"{nranks} processes are too many for {mesh.nvertices} vertices")
    along = None
    if isinstance(rule, BallRule | CornerRule):
        rule = rule.fitted(mesh, horizon)  # what follows the mesh follows the whole
    if isinstance(rule, CornerRule):
        along = np.argsort(local_order(mesh.p))
    chosen = np.zeros(mesh.nvertices, dtype=bool)
    if no_fail is not None:
        chosen = marked_vertices(no_fail, int(mesh.nvertices))
    w = whole.vertex_weight  # known where the whole boundary is
    owner = divided(mesh.p, work_of_vertices(mesh, horizon, rule), nranks)
    return _Plan(mesh, rule, owner, reach_of(mesh, horizon, rule, w is not None), along, chosen, w)


def _dealt(plan: _Plan) -> Iterator[_Part]:
    """Yield what each rank is sent."""
    for share in shares(plan.mesh, plan.owner, plan.reach, plan.along):
        w = None if plan.w is None else share.part(plan.w)
        yield _Part(plan.rule, share, np.flatnonzero(plan.no_fail[share.number]), w)


def reach_of(mesh: Mesh, horizon: float, rule: Rule, weighted: bool = False) -> float:
    """Return how far beyond its own vertices a rank's mesh goes: what its bonds meet has its whole size there.

    A sample in an element is an edge at most from the vertex that owns it; so are the points about which moments are
    integrated for balls, and where w is not 1 everywhere, and those that a corner pair stands for: rays from its far
    end that meet them go on within a horizon of its near end.
    """
    edges = 1.0 if isinstance(rule, PairRule) and rule.points == "vertices" and not weighted else 2.0
    return horizon + float(vertex_sizes(mesh).max()) + edges * float(longest_edge(mesh))


def work_of_vertices(mesh: Mesh, horizon: float, rule: Rule) -> Floats:
    """Return about how many bonds each vertex has, (nvertices,): what a rank has to do is their sum.

    Of balls, and of the pairs that stand for them, there are as many at every outer point; a point in an element is
    that of its lowest vertex.
    """
    elements = np.bincount(mesh.t.min(axis=0), minlength=mesh.nvertices).astype(float)
    if isinstance(rule, BallRule | CornerRule):
        return elements if getattr(rule, "outer", "vertices") == "gauss" else np.ones(mesh.nvertices)
    bonds = bonds_of_vertices(mesh, horizon)
    return bonds * elements if getattr(rule, "points", "vertices") == "gauss" else bonds


def bonds_of_vertices(mesh: Mesh, horizon: float) -> Floats:
    """Return about how many bonds each vertex has, (nvertices,): what a rank has to do is their sum."""
    count = np.zeros(mesh.nvertices)
    for i, j, _ in pairs_within(np.ascontiguousarray(mesh.p), horizon):
        count += np.bincount(i, minlength=len(count))
        count += np.bincount(j, minlength=len(count))
    return count
