"""From elastic constants and toughness to ``f'(0)`` and ``f_inf``, and back (docs/theory/model.md, section 4)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from math import pi, sqrt
from typing import Any

import numpy as np

from .own_law import make_potential
from .potential import Potential
from .tension_only import COMPRESSION, TensionOnly

# volume of the unit ball, omega_d, for d = 0, 1, 2, 3
UNIT_BALL = (1.0, 2.0, pi, 4.0 * pi / 3.0)

# lambda = mu = FACTOR[d] f'(0) M_d. The expansion of the force gives 2 / (d + 2); the paper prints 1/4 and 1/5
# for d = 2, 3, half of it, because its source defines the elastic energy without the factor 1/2.
FACTOR = {
    "physical": {1: 2.0 / 3.0, 2: 1.0 / 2.0, 3: 2.0 / 5.0},
    "paper": {1: 2.0 / 3.0, 2: 1.0 / 4.0, 3: 1.0 / 5.0},
}
# lambda / E and the one Poisson ratio that a bond-based law can have
_STATES = {
    (1, None): (1.0 / 3.0, None),
    (2, "stress"): (3.0 / 8.0, 1.0 / 3.0),
    (2, "strain"): (2.0 / 5.0, 1.0 / 4.0),
    (3, None): (2.0 / 5.0, 1.0 / 4.0),
}


def crossing(dim: int, moment: float) -> float:
    """Return ``G_c / f_inf``: what a unit area of crack cuts of the measures of bonds (paper, section 2.1).

    >>> round(crossing(2, 1 / 3), 6)                            # 4 / pi M_2
    0.424413
    """
    return 2.0 * UNIT_BALL[dim - 1] / UNIT_BALL[dim] * moment


def state(dim: int, plane: str | None) -> tuple[float, float | None]:
    """Return ``(lambda / E, nu)`` of a bond-based law in that dimension and plane state.

    >>> state(2, "stress")
    (0.375, 0.3333333333333333)
    """
    if (dim, plane) not in _STATES:
        if dim == 2:
            raise ValueError(f'plane = {plane!r}: a body in 2D is in plane "stress" or plane "strain"')
        raise ValueError(f"plane = {plane!r} has no meaning in {dim}D; leave it out")
    return _STATES[dim, plane]


def _check_poisson(poisson: float, nu: float | None) -> None:
    """Raise ``ValueError`` for another ratio than the one that a bond-based law has in its state, None in 1D."""
    if nu is None or abs(poisson - nu) > 1e-6:
        can = "none in 1D" if nu is None else f"{nu:.6g} in this state"
        raise ValueError(
            f"poisson = {poisson}: a bond-based law has one elastic constant (lambda = mu), hence one Poisson ratio, "
            f"{can}; leave poisson out or choose another model"
        )


@dataclass(frozen=True)
class Elastic:
    """The macroscopic constants of a law; units follow from the input.

    Parameters
    ----------
    lame : float
        ``lambda = mu``, a stress.
    young : float
        Young's modulus.
    poisson : float or None
        Poisson's ratio, None in 1D.
    toughness : float
        ``G_c``, an energy per area; infinite for the linear law.
    density : float
        Mass per volume.

    Examples
    --------
    >>> round(Elastic(lame=3.0, young=8.0, poisson=1 / 3, toughness=1.0, density=1.0).pressure_speed, 12)
    3.0
    """

    lame: float
    young: float
    poisson: float | None
    toughness: float
    density: float

    @property
    def pressure_speed(self) -> float:
        """``sqrt((lambda + 2 mu) / rho)``"""
        return sqrt(3.0 * self.lame / self.density)

    @property
    def shear_speed(self) -> float:
        """``sqrt(mu / rho)``"""
        return sqrt(self.lame / self.density)

    @property
    def rayleigh_speed(self) -> float:
        """Surface wave speed: for ``lambda = mu`` Rayleigh's cubic has the root ``(c/c_s)^2 = 2 - 2/sqrt(3)``."""
        return sqrt(2.0 - 2.0 / sqrt(3.0)) * self.shear_speed


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
        ``lambda = mu``.
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
        Only checked: a bond-based law has one ratio.
    compression : {"soften", "elastic"}
        What bonds do that are pressed.

    Raises
    ------
    ValueError
        For constants that are missing, doubled, not positive, or that a bond-based law cannot have.

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
    ) -> Material:
        """Describe a material by what handbooks give.

        Parameters
        ----------
        young : float, optional
            Young's modulus, a stress; or ``lame``.
        lame : float, optional
            Lame's constant ``lambda = mu``; or ``young``.
        toughness : float, optional
            ``G_c``, an energy per area; or ``K_Ic``. Neither is needed for ``potential="linear"``.
        K_Ic : float, optional
            The stress intensity at which a crack grows.
        density : float
            Mass per volume.
        plane : {"stress", "strain"}, optional
            In 2D; absent in 1D and 3D.
        poisson : float, optional
            Checked against the one ratio that a bond-based law has: 1/3 in plane stress, 1/4 else.
        potential : str or object, optional
            ``"exponential"``, ``"rational"``, ``"linear"``, a :class:`Potential`, or an object for
            :func:`own_potential`.
        convention : {"physical", "paper"}, optional
            ``"paper"`` takes the factors ``C_d`` as the paper prints them: waves run sqrt(2) too fast in 2D and 3D.
        calibrate : {"continuum", "discrete"}, optional
            ``"discrete"`` uses the moment of the bonds at hand in place of ``M_d``.
        compression : {"soften", "elastic"}, optional
            ``"elastic"`` lets bonds soften in tension only; the paper's law softens both ways.

        Returns
        -------
        Material
            The material.

        Raises
        ------
        ValueError
            For constants that are missing, doubled, not positive, or that a bond-based law cannot have.

        Examples
        --------
        >>> glass = Material.from_elastic(young=72e9, toughness=135.0, density=2440.0, plane="stress")
        >>> law = glass.law(dim=2, moment=1 / 3)
        >>> law.slope, round(law.limit, 6)             # f'(0) = 4 * 27e9 / (2/3), f_inf = pi 135 / (4/3)
        (162000000000.0, 318.086256)
        """
        return cls(young, lame, toughness, density, plane, potential, convention, calibrate, K_Ic, poisson, compression)

    def __post_init__(self) -> None:
        for name in ("young", "lame", "toughness", "K_Ic", "density"):
            value = getattr(self, name)
            if value is not None and not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} = {value} must be a positive number")
        if (self.young is None) == (self.lame is None):
            raise ValueError(f"give one of young = {self.young} and lame = {self.lame}, not both and not none")
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
        if self.poisson is not None:  # without a plane state it may be a body in 3D; 1D is refused by the law
            _check_poisson(self.poisson, state(2 if self.plane else 3, self.plane)[1])
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

    def law(self, dim: int, moment: float, crack_moment: float | None = None) -> Potential:
        """Return the calibrated potential for a dimension and a moment of the influence function.

        ``f'(0) = lambda / (factor M_d)``, ``f_inf = G_c omega_d / (2 omega_{d-1} M_d)``, with the factor of
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
            For a ratio of Poisson that a bond-based law cannot have, and for K_Ic in 1D.

        References
        ----------
        Paper, section 2.1.
        """
        crack_moment = moment if crack_moment is None else crack_moment
        ratio, nu = state(dim, self.plane)
        if self.poisson is not None:
            _check_poisson(self.poisson, nu)
        lame = self.lame if self.lame is not None else ratio * float(self.young or 0.0)
        slope = lame / (FACTOR[self.convention][dim] * moment)
        toughness = self.toughness
        if self.K_Ic is not None:
            if nu is None:
                raise ValueError(f"K_Ic = {self.K_Ic} has no meaning in 1D; give toughness")
            young = lame / ratio
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
        ratio, nu = state(dim, self.plane)
        lame = FACTOR["physical"][dim] * law.slope * moment
        toughness = law.limit * crossing(dim, crack_moment or moment)
        return Elastic(lame, lame / ratio, nu, toughness, self.density)
