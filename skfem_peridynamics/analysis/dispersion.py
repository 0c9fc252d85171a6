"""Plane waves of the linear model in an infinite body: the exact dispersion relation (docs/theory/model.md)."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np
import numpy.typing as npt

from .._types import Floats
from ..material.influence import as_influence
from ..material.material import UNIT_BALL

_PANELS, _NODES = 64, 16  # of the radial integral


def dispersion(
    wave_number: npt.ArrayLike,
    *,
    dim: int,
    horizon: float,
    slope: float,
    density: float,
    influence: Any = "constant",
    wave: str = "P",
    volumetric: float = 0.0,
) -> Floats:
    """Return the angular frequency of plane waves ``exp(i (k.x - omega t))``.

    The body is isotropic, so only ``|k|`` matters. For long waves ``omega = k sqrt((lambda + 2 mu)/rho)`` or ``k
    sqrt(mu/rho)``.

    Parameters
    ----------
    wave_number : array_like
        ``|k|``, any shape, 1 / length.
    dim : int
        1, 2 or 3.
    horizon : float
        A length.
    slope : float
        ``f'(0)``, see ``body.law``.
    density : float
        Mass per volume.
    influence : Influence, str or callable, optional
        ``J(s)``.
    wave : {"P", "S"}, optional
        Polarised along k, or across (not in 1D).
    volumetric : float, optional
        ``lambda - mu``, of an energy beside the bonds; S waves have no volumetric strain.

    Returns
    -------
    ndarray
        The shape of ``wave_number``, 1 / time.

    Raises
    ------
    ValueError
        For another wave or dimension.

    Examples
    --------
    >>> k = np.array([1e-3, 20.0])                                     # eps = 0.1: long, and three horizons long
    >>> omega = dispersion(k, dim=2, horizon=0.1, slope=3.0, density=1.0)  # lambda = mu = 2 * 3 / (3 * 4) = 0.5
    >>> (omega / k / np.sqrt(1.5)).round(4).tolist()
    [1.0, 0.9201]
    """
    if dim not in (1, 2, 3):
        raise ValueError(f"dim = {dim} must be 1, 2 or 3")
    if wave not in ("P", "S") or (dim == 1 and wave == "S"):
        raise ValueError(f'wave = {wave!r} must be "P"' + (' or "S"' if dim > 1 else " in 1D"))
    kappa = np.abs(np.asarray(wave_number, dtype=float)) * horizon
    J = as_influence(influence)
    x, w = np.polynomial.legendre.leggauss(_NODES)
    s = ((np.arange(_PANELS)[:, None] + 0.5 * (x + 1.0)) / _PANELS).ravel()
    weight = np.tile(0.5 * w / _PANELS, _PANELS) * J(s) * s ** (dim - 2)
    total = _angular(kappa[..., None] * s, dim, wave) @ weight
    symbol: Floats = 4.0 * slope / (density * horizon**2 * UNIT_BALL[dim]) * total
    if wave == "P" and volumetric:
        # the volumetric strain of the wave exp(i k.x) n is i e, with e = k for long waves
        strain = _ratio_of_strain(kappa[..., None] * s, dim) @ (weight * s) / (weight @ s**2)
        symbol += volumetric * (strain / horizon) ** 2 / density
    return np.sqrt(np.maximum(symbol, 0.0))  # round-off at k = 0


def _angular(a: Floats, dim: int, wave: str) -> Floats:
    """``int (1 - cos(a e.n)) (e.m)^2`` over unit vectors e; m along the wave's direction n (P) or across it (S)."""
    from scipy.special import j0, jv, spherical_jn

    if dim == 1:
        out: Floats = 4.0 * np.sin(0.5 * a) ** 2
        return out
    if dim == 2:
        bend = _ratio(lambda z: jv(1, z), a, 0.5)
        flat: Floats = 2.0 * pi * ((0.5 - j0(a) + bend) if wave == "P" else (0.5 - bend))
        return flat
    bend = _ratio(lambda z: spherical_jn(1, z), a, 1.0 / 3.0)
    along: Floats = 4.0 * pi * (1.0 / 3.0 - spherical_jn(0, a) + 2.0 * bend)
    across: Floats = 0.5 * (4.0 * pi * (1.0 - spherical_jn(0, a)) - along)
    return along if wave == "P" else across


def _ratio_of_strain(a: Floats, dim: int) -> Floats:
    """``d`` times the mean of ``e.n sin(a e.n)`` over unit vectors e."""
    from scipy.special import j1, spherical_jn

    mean: Floats = np.sin(a) if dim == 1 else 2.0 * j1(a) if dim == 2 else 3.0 * spherical_jn(1, a)
    return mean


def _ratio(function: Any, a: Floats, at_zero: float) -> Floats:
    """``function(a) / a`` with its limit at 0."""
    ratio: Floats = np.divide(function(a), a, out=np.full_like(a, at_zero), where=a != 0.0)
    return ratio
