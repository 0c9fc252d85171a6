"""The energy of a volumetric strain that stands beside the bonds, where lambda is not mu."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from .._types import Floats

# where an own energy is compared with its derivatives: at no round number, where it may change its form
_SAMPLES = np.array([-0.731, -0.1037, -1.037e-2, -1.37e-3, 1.37e-3, 1.037e-2, 0.1037, 0.731])


@dataclass(frozen=True)
class Volumetric:
    """``G(e) = (lambda - mu) e^2 / 2`` per volume, e the volumetric strain.

    Parameters
    ----------
    modulus : float
        ``G''(0) = lambda - mu``, a stress; negative below the Poisson ratio of bonds alone.

    Examples
    --------
    >>> Volumetric(2.0).energy(np.array([0.5])).tolist(), Volumetric(2.0).gradient(np.array([0.5])).tolist()
    ([0.25], [1.0])
    """

    modulus: float

    def energy(self, e: Floats) -> Floats:
        """Return G.

        Parameters
        ----------
        e : ndarray
            Volumetric strains.

        Returns
        -------
        ndarray
            Energies per volume.
        """
        value: Floats = (0.5 * self.modulus) * e * e
        return value

    def gradient(self, e: Floats) -> Floats:
        """Return ``G'``.

        Parameters
        ----------
        e : ndarray
            Volumetric strains.

        Returns
        -------
        ndarray
            Stresses.
        """
        value: Floats = self.modulus * e
        return value

    def hessian(self, e: Floats) -> Floats:
        """Return ``G''``.

        Parameters
        ----------
        e : ndarray
            Volumetric strains.

        Returns
        -------
        ndarray
            Stresses.
        """
        return np.full_like(e, self.modulus)

    @property
    def quadratic(self) -> bool:
        """Whether the energy is the quadratic one, and the stress linear."""
        return type(self) is Volumetric


@dataclass(frozen=True)
class OwnVolumetric(Volumetric):
    """The energy of any object that gives ``g, dg, d2g``, array to array; see :func:`make_volumetric`."""

    law: Any = None

    def energy(self, e: Floats) -> Floats:
        return self._of("g", e)

    def gradient(self, e: Floats) -> Floats:
        return self._of("dg", e)

    def hessian(self, e: Floats) -> Floats:
        return self._of("d2g", e)

    def _of(self, name: str, e: Floats) -> Floats:
        """A copy goes in, and one number may come out for all."""
        return np.broadcast_to(np.asarray(getattr(self.law, name)(e.copy()), dtype=float), e.shape)


def make_volumetric(what: Any, modulus: float) -> Volumetric | None:
    """Return the energy ``what`` with this ``lambda - mu``: "quadratic", or a callable ``modulus -> g, dg, d2g``.

    None where there is nothing to add. An own energy has ``g(0) = g'(0) = 0`` and ``g''(0) = lambda - mu``, and the
    derivatives that it says.

    >>> make_volumetric("quadratic", 0.0) is None
    True
    >>> class Stiffening:
    ...     def __init__(self, modulus):
    ...         self.m = modulus
    ...     g = lambda self, e: self.m * (np.cosh(e) - 1)
    ...     dg = lambda self, e: self.m * np.sinh(e)
    ...     d2g = lambda self, e: self.m * np.cosh(e)
    >>> round(float(make_volumetric(Stiffening, 2.0).energy(np.array([1.0]))[0]), 6)
    1.086161
    """
    if isinstance(what, str):
        if what != "quadratic":
            raise ValueError(f'volumetric = {what!r} must be "quadratic" or a callable: modulus -> g, dg, d2g')
        return None if modulus == 0.0 else Volumetric(modulus)
    if not callable(what):
        raise ValueError(f'volumetric = {what!r} must be "quadratic" or a callable: modulus -> g, dg, d2g')
    own = OwnVolumetric(modulus, what(modulus))
    for name in ("g", "dg", "d2g"):
        if not callable(getattr(own.law, name, None)):
            raise ValueError(f"volumetric {what!r} gives {own.law!r}, which has no {name}(e)")
    if modulus == 0.0 and not np.any(own.gradient(_SAMPLES)):
        return None
    zero, unit = np.zeros(1), abs(modulus) or float(np.abs(own.hessian(_SAMPLES)).max()) or 1.0
    for name, value in (("g", own.energy(zero)), ("dg", own.gradient(zero))):
        if not abs(float(value[0])) <= 1e-12 * unit:
            raise ValueError(f"volumetric {what!r}: {name}(0) = {float(value[0]):g} must be 0")
    second = float(own.hessian(zero)[0])
    if not abs(second - modulus) <= 1e-6 * unit:
        raise ValueError(f"volumetric {what!r} was asked for d2g(0) = lambda - mu = {modulus:g} and gives {second:g}")
    step = 1e-4 * np.abs(_SAMPLES)
    for derivative, of, function, given in (
        ("dg", "g", own.energy, own.gradient(_SAMPLES)),
        ("d2g", "dg", own.gradient, own.hessian(_SAMPLES)),
    ):
        difference = (function(_SAMPLES + step) - function(_SAMPLES - step)) / (2.0 * step)
        # what a centred difference with that step leaves of a smooth law, and the rounding of the function
        wrong = np.flatnonzero(~(np.abs(difference - given) <= 1e-5 * np.abs(given) + 1e-6 * unit))
        if len(wrong):
            k = wrong[0]
            raise ValueError(
                f"volumetric {what!r}: {derivative} is not the derivative of {of} (at e = {_SAMPLES[k]:g}: "
                f"{given[k]:g}, difference quotient {difference[k]:g})"
            )
    return own
