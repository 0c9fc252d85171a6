"""A bound of the largest eigenvalue over all states of a body, dilatation included."""

from __future__ import annotations

from math import inf

import numpy as np

from .._types import Floats
from ..model.peridynamics import Peridynamics
from .cfl import nodal_bounds


def bound_of_all_states(body: Peridynamics, m: Floats) -> float:
    """Return a bound of ``x^T K_tangent(u) x / x^T M x`` over all x and all u.

    Of bonds alone with concave f it is the nodal bound at rest. What a dilatation adds to it goes with ``(F1'')^2``,
    which a law that falls steeply has larger than at rest. A pressed bond in a dilated point may stiffen: to its weight
    ``sup |F1'''| sqrt(r) (p_x + p_y) / 2`` is added, with the largest pressure that the virial of its ends can have,
    ``|lambda - mu| / ((d + 2) mu)`` times ``sup |F1'| / 2 sum k sqrt(r) Phi / unit``.

    Parameters
    ----------
    body : Peridynamics
        With a law whose force has an end, or a linear one.
    m : ndarray, (N,)
        The lumped mass.

    Returns
    -------
    float
        1 / time^2; infinite where bonds that are pressed stay linear, and for a volumetric energy of your own.

    References
    ----------
    docs/theory/dilatation.md

    Examples
    --------
    >>> import skfem
    >>> from skfem_peridynamics import BondBasis, Material, mass_matrix, stable_time_step
    >>> grid = np.linspace(0, 1, 9)
    >>> basis = skfem.Basis(skfem.MeshTri.init_tensor(grid, grid), skfem.ElementVector(skfem.ElementTriP1()))
    >>> glass = Material.from_elastic(young=1.0, poisson=0.22, toughness=1.0, density=1.0, plane="stress")
    >>> body, M = Peridynamics(BondBasis(basis, horizon=0.3), glass), mass_matrix(basis)
    >>> round(bound_of_all_states(body, M.diagonal()) / stable_time_step(body, M).nodal_bound, 2)
    1.17
    """
    dilatation = body.dilatation
    if dilatation is None:
        return nodal_bounds(body, m)[0]
    if not dilatation.quadratic:
        return inf
    samples = body.bonds.samples
    chi = samples.take(dilatation.dim * np.maximum(dilatation.curvature(), 0.0))
    pull = np.zeros(samples.nsamples)
    for block in body.blocks:
        if block.law.suprema[2] > 0.0 and not np.isfinite(block.law.suprema[0]):
            return inf
        # a linear bond bears any pull, and none of it bends it: its ends bend others
        C, root = block.both_ends()
        pull[block.window] += C.T @ (block.k * root * (0.5 * block.law.suprema[0]))
    added = []
    with np.errstate(invalid="ignore"):
        pressure = samples.take(np.abs(dilatation.stiffness()) * samples.spread(pull))
        for block in body.blocks:
            # a law that falls steeply has a rate of the virial beyond that at rest
            steep = max(1.0, (0.5 * block.law.suprema[1] / block.law.slope) ** 2)
            weight = block.rest_stiffness * (1.0 + 0.5 * steep * block.pressures(chi))
            if block.law.suprema[2] > 0.0:
                weight += block.k * block.both_ends()[1] * (0.5 * block.law.suprema[2]) * block.pressures(pressure)
            added.append(weight)
    return nodal_bounds(body, m, added)[0] if all(np.isfinite(each).all() for each in added) else inf
