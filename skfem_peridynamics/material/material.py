"""From elastic constants and toughness to ``f'(0)`` and ``f_inf``, and back (docs/theory/model.md, section 4)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import pi
from typing import Any

import numpy as np

from .elastic import Elastic, check_pairs, lame_constants, poisson_of, state
from .own_law import make_potential
from .potential import Potential
from .tension_only import COMPRESSION, TensionOnly
from .volumetric import Volumetric, make_volumetric

# volume of the unit ball, omega_d, for d = 0, 1, 2, 3
UNIT_BALL = (1.0, 2.0, pi, 4.0 * pi / 3.0)

# mu = FACTOR[d] f'(0) M_d, and bonds alone have lambda = mu. The expansion of the force gives 2 / (d + 2); the paper
# prints 1/4 and 1/5 for d = 2, 3, half of it, because its source defines the elastic energy without the factor 1/2.
FACTOR = {
    "physical": {1: 2.0 / 3.0, 2: 1.0 / 2.0, 3: 2.0 / 5.0},
    "paper": {1: 2.0 / 3.0, 2: 1.0 / 4.0, 3: 1.0 / 5.0},
}


def crossing(dim: int, moment: float) -> float:
    """Return ``G_c / f_inf``: what a unit area of crack cuts of the measures of bonds (paper, section 2.1).

    >>> round(crossing(2, 1 / 3), 6)                            # 4 / pi M_2
    0.424413
    """
    return 2.0 * UNIT_BALL[dim - 1] / UNIT_BALL[dim] * moment


@dataclass(frozen=True)
class Material:
    """Physical constants of a brittle solid and the shape of its bond law; use :meth:`from_elastic`.

    The law itself, ``f'(0)`` and ``f_inf``, also needs the dimension and the influence function, which the bonds
    know: see :meth:`law` and ``Peridynamics.law``.

    Parameters
    ----------
    young : float or None
        Young's modulus; or ``lame``.
    lame : float or None
        ``lambda``, and mu where that is not given.
    toughness : float or None
        ``G_c``, an energy per area.
    density : float
        Mass per volume (per area in 2D, per length in 1D).
    plane : {"stress", "strain"} or None
        In 2D.
    potential : str or object
        Shape of the law: ``"exponential"``, ``"rational"``, ``"linear"``, or one of your own.
    convention : {"physical", "paper"}
        Factor between constants and law.
    calibrate : {"continuum", "discrete"}
        By the exact moment, or by that of the bonds at hand.
    K_Ic : float or None
        In place of the toughness.
    poisson : float or None
        Poisson's ratio beside ``young``; by default that of bonds alone.
    compression : {"soften", "elastic"}
        What bonds do that are pressed.
    mu : float or None
        The shear modulus, beside ``lame`` or ``bulk``.
    bulk : float or None
        The bulk modulus, beside ``mu``.
    volumetric : str or callable
        The energy beside the bonds, ``"quadratic"`` or of your own.

    Raises
    ------
    ValueError
        For constants that are missing, doubled, not positive, or that no elastic solid has.

    Examples
    --------
    >>> steel = Material.from_elastic(lame=2.0, toughness=1.0, density=3.0)
    >>> steel.law(dim=3, moment=0.25).slope                              # lambda / (2/5 M_3)
    20.0
    """

    young: float | None
    lame: float | None
    toughness: float | None
    density: float
    plane: str | None = None
    potential: Any = "exponential"
    convention: str = "physical"
    calibrate: str = "continuum"
    K_Ic: float | None = None
    poisson: float | None = None
    compression: str = "soften"
    mu: float | None = None
    bulk: float | None = None
    volumetric: Any = "quadratic"

    @classmethod
    def from_elastic(
        cls,
        *,
        young: float | None = None,
        lame: float | None = None,
        toughness: float | None = None,
        K_Ic: float | None = None,
        density: float,
        plane: str | None = None,
        poisson: float | None = None,
        potential: Any = "exponential",
        convention: str = "physical",
        calibrate: str = "continuum",
        compression: str = "soften",
        mu: float | None = None,
        bulk: float | None = None,
        volumetric: Any = "quadratic",
    ) -> Material:
        """Describe a material by what handbooks give.

        Parameters
        ----------
        young : float, optional
            Young's modulus, a stress, with ``poisson`` or without; or ``lame``.
        lame : float, optional
            Lame's constant ``lambda``, the plane one in plane stress; without ``mu`` it is mu too.
        toughness : float, optional
            ``G_c``, an energy per area; or ``K_Ic``. Neither is needed for ``potential="linear"``.
        K_Ic : float, optional
            The stress intensity at which a crack grows.
        density : float
            Mass per volume.
        plane : {"stress", "strain"}, optional
            In 2D; absent in 1D and 3D.
        poisson : float, optional
            Poisson's ratio, between -1 and 1/2 (plane stress: 1). Bonds alone have 1/3 in plane stress and 1/4 else,
            which is the default; any other adds an energy of the volumetric strain, and a force then costs up to
            twice as much.
        potential : str or object, optional
            ``"exponential"``, ``"rational"``, ``"linear"``, a :class:`Potential`, or an object for
            :func:`own_potential`.
        convention : {"physical", "paper"}, optional
            ``"paper"`` takes the factors ``C_d`` as the paper prints them: waves run sqrt(2) too fast in 2D and 3D.
        calibrate : {"continuum", "discrete"}, optional
            ``"discrete"`` uses the moment of the bonds at hand in place of ``M_d``.
        compression : {"soften", "elastic"}, optional
            ``"elastic"`` lets bonds soften in tension only; the paper's law softens both ways.
        mu : float, optional
            The shear modulus, beside ``lame`` or ``bulk``.
        bulk : float, optional
            The bulk modulus, in plane stress ``lambda + mu``, else ``lambda + 2 mu / 3``; beside ``mu``.
        volumetric : str or callable, optional
            ``"quadratic"``, ``(lambda - mu) e^2 / 2`` of the volumetric strain e, or a callable that takes
            ``lambda - mu`` and returns an object with ``g(e)``, ``dg(e)``, ``d2g(e)``.

        Returns
        -------
        Material
            The material.

        Raises
        ------
        ValueError
            For constants that are missing, doubled, not positive, or that no elastic solid has.

        Examples
        --------
        >>> glass = Material.from_elastic(young=72e9, toughness=135.0, density=2440.0, plane="stress")
        >>> law = glass.law(dim=2, moment=1 / 3)
        >>> law.slope, round(law.limit, 6)             # f'(0) = 4 * 27e9 / (2/3), f_inf = pi 135 / (4/3)
        (162000000000.0, 318.086256)
        """
        return cls(
            young,
            lame,
            toughness,
            density,
            plane,
            potential,
            convention,
            calibrate,
            K_Ic,
            poisson,
            compression,
            mu,
            bulk,
            volumetric,
        )

    def __post_init__(self) -> None:
        for name in ("toughness", "K_Ic", "density"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value} must be a positive number")
        check_pairs(self.young, self.lame, self.poisson, self.mu, self.bulk)
        if self.toughness is not None and self.K_Ic is not None:
            raise ValueError(f"give one of toughness = {self.toughness} and K_Ic = {self.K_Ic}, not both")
        if self.potential != "linear" and self.toughness is None and self.K_Ic is None:
            raise ValueError('toughness = None: a law that can fail needs toughness or K_Ic (or potential = "linear")')
        if self.plane not in (None, "stress", "strain"):
            raise ValueError(f'plane = {self.plane!r} must be "stress" or "strain" (2D), or absent (1D, 3D)')
        if self.convention not in FACTOR:
            raise ValueError(f"convention = {self.convention!r} must be one of {', '.join(FACTOR)}")
        if self.calibrate not in ("continuum", "discrete"):
            raise ValueError(f'calibrate = {self.calibrate!r} must be "continuum" or "discrete"')
        # without a plane state it may be a body in 3D; 1D is refused by the law
        self._constants(2 if self.plane else 3)
        if self.compression not in COMPRESSION:
            raise ValueError(f"compression = {self.compression!r} must be one of {', '.join(COMPRESSION)}")

    def with_(self, **changes: Any) -> Material:
        """Return a copy with some constants changed.

        Parameters
        ----------
        **changes
            Constants by their names.

        Returns
        -------
        Material
            The copy.

        Examples
        --------
        >>> Material.from_elastic(young=1.0, toughness=1.0, density=1.0).with_(density=2.0).density
        2.0
        """
        return dataclasses.replace(self, **changes)

    def _constants(self, dim: int) -> tuple[float, float]:
        """``(lambda, mu)`` of a body of that dimension."""
        return lame_constants(dim, self.plane, self.young, self.lame, self.poisson, self.mu, self.bulk)

    def law(self, dim: int, moment: float, crack_moment: float | None = None) -> Potential:
        """Return the calibrated potential for a dimension and a moment of the influence function.

        ``f'(0) = mu / (factor M_d)``, ``f_inf = G_c omega_d / (2 omega_{d-1} M_d)``, with the factor of
        docs/theory/model.md.

        Parameters
        ----------
        dim : int
            Dimension of the body, 1, 2 or 3.
        moment : float
            ``M_d`` of the influence function, for strains.
        crack_moment : float, optional
            The same for cracks, where a rule has another; by default ``moment``.

        Returns
        -------
        Potential
            The law.

        Raises
        ------
        ValueError
            For a ratio of Poisson that no elastic solid has, and for K_Ic or a second elastic constant in 1D.

        References
        ----------
        Paper, section 2.1.
        """
        crack_moment = moment if crack_moment is None else crack_moment
        lam, mu = self._constants(dim)
        slope = mu / (FACTOR[self.convention][dim] * moment)
        toughness = self.toughness
        if self.K_Ic is not None:
            young, nu = _young_and_poisson(lam, mu, dim, self.plane)
            if nu is None:
                raise ValueError(f"K_Ic = {self.K_Ic} has no meaning in 1D; give toughness")
            toughness = self.K_Ic**2 / (young if self.plane == "stress" else young / (1.0 - nu**2))
        limit = float("inf") if toughness is None else toughness / crossing(dim, crack_moment)
        return self.shaped(slope, limit)

    def shaped(self, slope: float, limit: float) -> Potential:
        """Return the law of this shape with a given ``f'(0)`` and ``f_inf``.

        Parameters
        ----------
        slope : float
            ``f'(0)``, a stress.
        limit : float
            ``f_inf``, an energy per area.

        Returns
        -------
        Potential
            The law.
        """
        law = make_potential(self.potential, slope, limit)
        return TensionOnly.of(law) if self.compression == "elastic" else law

    def volumetric_energy(self, law: Potential, dim: int, moment: float) -> Volumetric | None:
        """Return the energy of volumetric strains beside the bonds, None where bonds alone have the constants.

        Parameters
        ----------
        law : Potential
            That of :meth:`law`.
        dim : int
            Dimension of the body, 1, 2 or 3.
        moment : float
            ``M_d`` of the influence function, for strains.

        Returns
        -------
        Volumetric or None
            With ``G''(0) = lambda - mu``.

        Examples
        --------
        >>> steel = Material.from_elastic(young=2.6, poisson=0.3, toughness=1.0, density=1.0)
        >>> round(steel.volumetric_energy(steel.law(3, 0.25), 3, 0.25).modulus, 12)         # lambda 1.5, mu 1
        0.5
        """
        lam, mu = self._constants(dim)
        # the paper's factor makes a body stiffer as a whole, at the same ratio
        return make_volumetric(self.volumetric, (lam / mu - 1.0) * FACTOR["physical"][dim] * law.slope * moment)

    def elastic(self, law: Potential, dim: int, moment: float, crack_moment: float | None = None) -> Elastic:
        """Return the constants that a law has: the way back, always with the physical factor.

        Parameters
        ----------
        law : Potential
            The law.
        dim : int
            Dimension of the body, 1, 2 or 3.
        moment : float
            ``M_d`` of the influence function, for strains.
        crack_moment : float, optional
            The same for cracks, where a rule has another; by default ``moment``.

        Returns
        -------
        Elastic
            The constants.

        Examples
        --------
        >>> m = Material.from_elastic(young=5.0, toughness=2.0, density=1.0, convention="paper")
        >>> e = m.elastic(m.law(dim=3, moment=0.25), dim=3, moment=0.25)
        >>> round(e.young, 12), round(e.toughness, 12)         # the paper's factor makes the body twice as stiff
        (10.0, 2.0)
        """
        given = self._constants(dim)
        mu = FACTOR["physical"][dim] * law.slope * moment
        lam = mu if given[0] == given[1] else mu * (given[0] / given[1])
        young, nu = _young_and_poisson(lam, mu, dim, self.plane)
        toughness = law.limit * crossing(dim, crack_moment or moment)
        return Elastic(lam, young, nu, toughness, self.density, None if lam == mu else mu)


def _young_and_poisson(lam: float, mu: float, dim: int, plane: str | None) -> tuple[float, float | None]:
    """Young's modulus and Poisson's ratio of lambda and mu."""
    ratio, nu = state(dim, plane)
    if lam == mu:
        return lam / ratio, nu
    nu = poisson_of(lam, mu, plane)
    return 2.0 * mu * (1.0 + nu), nu
