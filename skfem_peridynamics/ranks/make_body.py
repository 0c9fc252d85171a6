"""Make the body of a rank: its bonds, their balance, what they are made of."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._types import Floats, Longs
from ..bonds.ball_rule import BallRule, support
from ..bonds.bond_basis import BondBasis, gives_way
from ..bonds.discrete_moments import DeepSums, deep_points
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule
from ..geometry.simplices import vertex_volumes
from ..material.composite import Composite
from ..material.influence import Influence, as_influence
from ..material.material import Material
from ..material.potential import Potential
from ..model.breaking import Breaking
from ..model.peridynamics import Peridynamics
from ..model.space import numbering_basis
from .body import RankBody
from .breaking_ranks import BreakingRanks
from .dealt_mesh import DealtMesh
from .dealt_rule import DealtRule, dealt
from .dilated_ranks import DilatedRanks
from .rank_moments import balanced_over_ranks
from .share import Share


def make_body(
    comm: Any,
    share: Share,
    horizon: float,
    influence: Influence | str,
    rule: Rule,
    material: Material | Potential | Composite,
    no_fail: Longs | None = None,
    balanced: bool = False,
    w: Floats | None = None,
    breaking: float | None = None,
    overlap: bool = False,
    facets: tuple[Floats, Floats] | None = None,
    **options: Any,
) -> RankBody:
    """Return the body of a share; ``no_fail`` and ``w`` are of vertices of the rank's mesh, ghosts among them.

    With the directions of the ``facets`` of the whole mesh and their shares the moments are those of the bonds.
    """
    mesh, basis = DealtMesh(comm, share), numbering_basis(share.mesh)
    probe = Peridynamics(BondBasis(basis, horizon, influence, rule, w), material)
    if facets is not None:
        if isinstance(rule, PairRule) and rule.points == "gauss":
            raise ValueError('calibrate = "discrete" does not go with Gauss pairs over processes yet')
        probe.bonds.__dict__["discrete_moments"] = (1.0, 1.0)  # whether there is a dilatation does not depend on them
    dilated = any(comm.allgather(any(probe.volumetric_energies)))
    if breaking is not None and (dilated or ends_inside(rule)):
        raise ValueError(
            f"breaking = {breaking:g}: over processes it goes with vertex pairs and corner pairs yet, and with no "
            "Poisson ratio but that of bonds alone"
        )
    rules = dealt(rule, share, horizon, as_influence(influence), apart=overlap and not dilated)
    made = [BondBasis(basis, horizon, influence, one, w) for one in rules]
    there = [bonds for bonds in made if bonds.parts]
    if min(comm.allgather(sum(bonds.nbonds for bonds in there))) == 0:
        raise ValueError(f"{comm.size} processes are too many: one of them would have no bond to compute")
    if isinstance(rule, BallRule):
        _check_support(mesh, rule, there)
    if balanced:
        there = balanced_over_ranks(mesh, there)
        found = there[0].balance
        assert found is not None
        if gives_way(rule, found, say=share.rank == 0):
            mesh.close()
            rest = no_fail, balanced, w, breaking, overlap, facets
            return make_body(comm, share, horizon, influence, PairRule(), material, *rest, **options)
    if facets is not None:
        _set_moments(mesh, there, facets)
    bodies = [_body(bonds, material, no_fail, breaking, options) for bonds in there]
    if dilated:
        (body,) = bodies
        _ = body.engine  # made once, for the bonds with and without their dilatation
        return RankBody(mesh, None, body.bonds_alone, DilatedRanks.of(mesh, body))
    kind = RankBody if breaking is None else BreakingRanks
    if len(made) == 1:
        return kind(mesh, None, bodies[0])
    left = iter(bodies)
    inside, across = (next(left) if bonds.parts else None for bonds in made)
    return kind(mesh, inside, across)


def _body(
    bonds: BondBasis,
    material: Material | Potential | Composite,
    no_fail: Longs | None,
    breaking: float | None,
    options: dict[str, Any],
) -> Peridynamics:
    if breaking is None:
        return Peridynamics(bonds, material, no_fail, **options)
    return Breaking(bonds, material, no_fail, at=breaking, **options)


def ends_inside(rule: Rule) -> bool:
    """Whether bonds of a rule end inside elements."""
    return isinstance(rule, BallRule) or getattr(rule, "points", "vertices") != "vertices"


def _check_support(mesh: DealtMesh, rule: BallRule, pieces: list[BondBasis]) -> None:
    """Raise ``ValueError`` for an own vertex that the bonds of all ranks do not hold in every direction."""
    share, dim = mesh.share, int(mesh.share.mesh.dim())
    local = np.asarray(sum(support(bonds.samples, bonds.parts) for bonds in pieces))
    held = mesh.halo(dim * dim).summed(local.ravel()).reshape(-1, dim, dim)
    own = share.own
    rule.check_support(held, share.mesh.p[:, :own], vertex_volumes(share.mesh)[:own], share.number[:own])


def _set_moments(mesh: DealtMesh, pieces: list[BondBasis], facets: tuple[Floats, Floats]) -> None:
    """Give the bonds of a rank the moments that those of all have."""
    share, sums = mesh.share, np.zeros(3)
    own_sites = isinstance(pieces[0].rule, DealtRule) and isinstance(pieces[0].rule.rule, BallRule)
    for k, bonds in enumerate(pieces):
        samples = bonds.samples
        deep, mine = deep_points(bonds, samples.points), np.ones(len(samples.sites), dtype=bool)
        if samples.at_vertices:  # the rank's mesh may end near its ghosts: these are told by their owners
            vertex = samples.vertices[:, 0]
            own = np.empty(len(vertex))
            own[vertex] = deep
            deep = mesh.halo(1).extended(own[: share.own])[vertex] > 0.5
            if not own_sites:  # balls have no others
                mine = vertex[samples.sites] < share.own
        found = DeepSums.of(bonds, deep, mine, facets)
        sums += found.strain, found.crack, 0.0 if k else found.volume
    whole = DeepSums(*mesh.comm.allreduce(sums).tolist())
    for bonds in pieces:
        bonds.__dict__["discrete_moments"] = whole.moments(bonds, facets)
