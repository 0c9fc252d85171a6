"""Choose the rule of a scene by its mesh, as the tables of error against seconds advise.

docs/evidence/error_against_run_time.md says how often that is within 1.5 of the best.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._types import Mesh
from ..bonds.ball_rule import BallRule
from ..bonds.corner_rule import CornerRule
from ..bonds.pair_rule import PairRule
from ..geometry.simplices import vertex_volumes
from ..model.discretisation import CLASSICAL, Discretisation

BALANCED_PAIRS = Discretisation(PairRule(), balanced=True)
# by dimension: up to so many vertices per horizon, this
CHOICES: dict[int, tuple[tuple[float, Discretisation], ...]] = {
    1: ((12.0, Discretisation(PairRule(points="gauss"))), (np.inf, CLASSICAL)),
    2: (
        (3.5, Discretisation(CornerRule(), balanced=True)),
        (12.0, BALANCED_PAIRS),
        (np.inf, Discretisation(CornerRule(), balanced=True)),
    ),
    3: ((4.5, Discretisation(BallRule(3, 25))), (np.inf, BALANCED_PAIRS)),
}
_IRREGULAR = 0.05  # relative spread of the volumes of inner vertices; 0 on a lattice, 0.2 on a random mesh
_ENOUGH = 2.75  # vertices per horizon from which weights can be balanced on any mesh (docs/evidence/verification.md)


@dataclass(frozen=True)
class Choice:
    """A scheme and why it was chosen, in a sentence."""

    scheme: Discretisation
    why: str


def per_horizon(mesh: Mesh, horizon: float) -> float:
    """Return how many vertices a horizon spans, by the volume an inner vertex has.

    >>> import skfem
    >>> axis = np.linspace(0, 1, 11)
    >>> round(per_horizon(skfem.MeshTri.init_tensor(axis, axis), 0.4), 6)
    4.0
    """
    return float(horizon / np.median(_inner_volumes(mesh)) ** (1.0 / mesh.dim()))


def is_irregular(mesh: Mesh) -> bool:
    """Return whether the volumes of inner vertices differ by more than a lattice's do.

    >>> import skfem
    >>> is_irregular(skfem.MeshLine(np.array([0.0, 0.1, 0.3, 0.6, 1.0])))
    True
    """
    volumes = _inner_volumes(mesh)
    if len(volumes) == mesh.nvertices:
        return False  # no vertex inside: nothing is known
    return bool(np.std(volumes) > _IRREGULAR * np.mean(volumes))


def _inner_volumes(mesh: Mesh) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    inner = np.ones(mesh.nvertices, dtype=bool)
    inner[np.unique(mesh.facets[:, mesh.boundary_facets()])] = False
    volumes = vertex_volumes(mesh)
    return volumes[inner] if inner.any() else volumes


def choose(mesh: Mesh, horizon: float, *, fracturing: bool) -> Choice:
    """Return the scheme for a mesh.

    Where bonds may break: vertex pairs, which cost G_c, balanced on irregular meshes. Otherwise by how many vertices a
    horizon spans: in 1D Gauss pairs below twelve and vertex pairs above; in 2D balanced vertex pairs, and corner pairs
    where they are few (below 3.5) or many (from twelve on); in 3D balls of 3 x 25 below 4.5 and balanced pairs above.

    >>> import skfem
    >>> axis = np.linspace(0, 1, 17)
    >>> choose(skfem.MeshTri.init_tensor(axis, axis), 0.25, fracturing=False).scheme.name
    'vertex pairs, partial volume, balanced; lumped mass'
    """
    m, irregular, dim = per_horizon(mesh, horizon), is_irregular(mesh), int(mesh.dim())
    if fracturing:
        scheme = BALANCED_PAIRS if irregular and m >= _ENOUGH else CLASSICAL
        kind = "an irregular" if irregular else "a regular"
        return Choice(scheme, f"{scheme.name}: bonds may break, and of all rules vertex pairs cost G_c, on {kind} mesh")
    scheme = next(scheme for most, scheme in CHOICES[dim] if m < most)
    return Choice(scheme, f"{scheme.name}: bonds do not break, and the horizon spans {m:.3g} vertices in {dim}D")
