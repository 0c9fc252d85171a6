"""Elastic constants: from what handbooks give to lambda and mu, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite, sqrt

# lambda / E and the Poisson ratio of bonds alone, lambda = mu
_STATES = {
    (1, None): (1.0 / 3.0, None),
    (2, "stress"): (3.0 / 8.0, 1.0 / 3.0),
    (2, "strain"): (2.0 / 5.0, 1.0 / 4.0),
    (3, None): (2.0 / 5.0, 1.0 / 4.0),
}
SAME = 1e-6  # ratios this near to that of bonds alone are that one: nothing is added for 0.333333


def state(dim: int, plane: str | None) -> tuple[float, float | None]:
    """Return ``(lambda / E, nu)`` of bonds alone in that dimension and plane state.

    >>> state(2, "stress")
    (0.375, 0.3333333333333333)
    """
    if (dim, plane) not in _STATES:
        if dim == 2:
            raise ValueError(f'plane = {plane!r}: a body in 2D is in plane "stress" or plane "strain"')
        raise ValueError(f"plane = {plane!r} has no meaning in {dim}D; leave it out")
    return _STATES[dim, plane]


def check_poisson(nu: float, plane: str | None, said: str) -> None:
    """Raise ``ValueError`` for a ratio that no elastic solid has in its state; ``said`` is what the user wrote."""
    most = 1.0 if plane == "stress" else 0.5
    if not -1.0 < nu < most:
        state_name = f"plane {plane}" if plane else "3D"
        why = "its volume" if nu >= most else "its shape"
        raise ValueError(
            f"{said}: in {state_name} Poisson's ratio lies between -1 and {most:g}, both left out "
            f"(beyond, a body would change {why} for nothing)"
        )


def lame_constants(
    dim: int,
    plane: str | None,
    young: float | None = None,
    lame: float | None = None,
    poisson: float | None = None,
    mu: float | None = None,
    bulk: float | None = None,
) -> tuple[float, float]:
    """Return ``(lambda, mu)``, in 2D the plane ones, of one of the pairs that :class:`Material` takes.

    Without a second constant, and at the ratio of bonds alone, both are the same number.

    >>> lame_constants(2, "stress", young=8.0), lame_constants(3, None, bulk=2.0, mu=1.5)
    ((3.0, 3.0), (1.0, 1.5))
    >>> [round(constant, 12) for constant in lame_constants(3, None, young=2.6, poisson=0.3)]
    [1.5, 1.0]
    """
    ratio, of_bonds = state(dim, plane)
    second = {"poisson": poisson, "mu": mu, "bulk": bulk}
    given = [f"{name} = {value:g}" for name, value in second.items() if value is not None]
    if of_bonds is None and given:
        raise ValueError(f"{given[0]} has no meaning in 1D, where one elastic constant is all there is; leave it out")
    if mu is not None:
        pair = lame if lame is not None else float(bulk or 0.0) - (1.0 if plane == "stress" else 2.0 / 3.0) * mu
        name = f"lame = {lame:g}" if lame is not None else f"bulk = {bulk:g}"
        nu = poisson_of(pair, mu, plane)
        check_poisson(nu, plane, f"{name} with mu = {mu:g} is Poisson's ratio {nu:.4g}")
        return (mu, mu) if abs(nu - float(of_bonds or 0.0)) <= SAME else (pair, mu)
    if poisson is None or abs(poisson - float(of_bonds or 0.0)) <= SAME:
        both = lame if lame is not None else ratio * float(young or 0.0)
        return both, both
    if young is None:
        raise ValueError(f"poisson = {poisson:g} goes with young; beside lame give mu")
    check_poisson(poisson, plane, f"poisson = {poisson:g}")
    shear = young / (2.0 * (1.0 + poisson))
    return 2.0 * shear * poisson / (1.0 - (1.0 if plane == "stress" else 2.0) * poisson), shear


def poisson_of(lame: float, mu: float, plane: str | None) -> float:
    """Return Poisson's ratio of lambda and mu, the plane ones in 2D.

    >>> poisson_of(1.0, 1.0, "stress"), poisson_of(1.0, 1.0, None)
    (0.3333333333333333, 0.25)
    """
    whole = lame + 2.0 * mu if plane == "stress" else 2.0 * (lame + mu)
    return lame / whole if whole > 0.0 else -1.0


def check_pairs(
    young: float | None, lame: float | None, poisson: float | None, mu: float | None, bulk: float | None
) -> None:
    """Raise ``ValueError`` for constants that are none of the pairs, or no numbers that they can be."""
    for name, value in (("young", young), ("mu", mu), ("bulk", bulk)):
        if value is not None and not (isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value} must be a positive number")
    if lame is not None and not (isfinite(lame) and (lame > 0.0 or mu is not None)):
        raise ValueError(
            f"lame = {lame} must be a positive number" + ("" if mu is None else " or, beside mu, a number")
        )
    if poisson is not None and not isfinite(poisson):
        raise ValueError(f"poisson = {poisson} must be a number")
    given = [name for name, value in (("young", young), ("lame", lame), ("bulk", bulk)) if value is not None]
    if len(given) != 1:
        raise ValueError(
            f"give one of young = {young} and lame = {lame} (or bulk = {bulk} beside mu), not both and not none"
        )
    if mu is not None and (given == ["young"] or poisson is not None):
        other = "young" if given == ["young"] else "poisson"
        raise ValueError(f"mu = {mu:g} goes with lame or with bulk, not with {other}: give young and poisson, or mu")
    if bulk is not None and mu is None:
        raise ValueError(f"bulk = {bulk:g} goes with mu: give both, or young and poisson")


@dataclass(frozen=True)
class Elastic:
    """The macroscopic constants of a law; units follow from the input.

    Parameters
    ----------
    lame : float
        ``lambda``, a stress; in plane stress the plane one.
    young : float
        Young's modulus.
    poisson : float or None
        Poisson's ratio, None in 1D.
    toughness : float
        ``G_c``, an energy per area; infinite for the linear law.
    density : float
        Mass per volume.
    mu : float, optional
        The shear modulus; by default ``lame``, as bonds alone have it.

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
    mu: float | None = None

    @property
    def shear(self) -> float:
        """``mu``"""
        return self.lame if self.mu is None else self.mu

    @property
    def pressure_speed(self) -> float:
        """``sqrt((lambda + 2 mu) / rho)``"""
        if self.mu is None:
            return sqrt(3.0 * self.lame / self.density)
        return sqrt((self.lame + 2.0 * self.mu) / self.density)

    @property
    def shear_speed(self) -> float:
        """``sqrt(mu / rho)``"""
        return sqrt(self.shear / self.density)

    @property
    def rayleigh_speed(self) -> float:
        """Surface wave speed: for ``lambda = mu`` Rayleigh's cubic has the root ``(c/c_s)^2 = 2 - 2/sqrt(3)``."""
        if self.mu is None:
            return sqrt(2.0 - 2.0 / sqrt(3.0)) * self.shear_speed
        from scipy.optimize import brentq

        k = (self.shear_speed / self.pressure_speed) ** 2
        # Rayleigh's equation over its root 0; it is -16 (1 - k) at 0 and 1 at 1
        root = brentq(lambda x: ((x - 8.0) * x + 8.0 * (3.0 - 2.0 * k)) * x - 16.0 * (1.0 - k), 0.0, 1.0, xtol=1e-15)
        return float(sqrt(root)) * self.shear_speed
