"""Bodies of several materials: which law a bond has whose ends are in different subdomains."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._types import Floats, Longs, Mesh
from .material import Material
from .potential import Potential
from .volumetric import Volumetric

MOST = 62  # materials: one bit of an integer each


def _harmonic(values: Floats) -> float:
    inverse = float(np.mean(1.0 / values))
    return 1.0 / inverse if inverse > 0.0 else float("inf")  # where no material ever fails


MEANS: dict[str, Callable[[Floats], float]] = {
    "harmonic": _harmonic,
    "arithmetic": lambda values: float(np.mean(values)),
    "weaker": lambda values: float(np.min(values)),
}


@dataclass(frozen=True)
class Composite:
    """A material, and others in subdomains of the mesh.

    Wherever a ``Material`` is taken, this is too: ``Peridynamics(bonds, composite)`` and, for the mass,
    ``density_on(mesh)``. A bond whose ends share a material is of that material, and a vertex between subdomains is
    of all of them; any other bond takes a mean of ``f'(0)`` and of ``f_inf``. The shape of its law is that of the
    material with the smallest ``f_inf``.

    Parameters
    ----------
    matrix : Material
        What is everywhere else.
    inclusions : mapping of str to Material
        By the names of the subdomains.
    between : {"harmonic", "arithmetic", "weaker"}
        The mean of bonds between materials; harmonic is two springs, or two links of a chain, in a row.

    Raises
    ------
    ValueError
        For an unknown mean, for materials in different plane states, for more than 62 of them.

    Examples
    --------
    >>> soft = Material.from_elastic(lame=1.0, toughness=1.0, density=1.0, plane="strain")
    >>> fibres = Composite(soft, {"fibre": soft.with_(lame=3.0)})
    >>> between = fibres.mixed(fibres.laws(2, 1 / 3), [0, 1])
    >>> between.slope                       # f'(0) is 6 and 18: 2 / (1/6 + 1/18)
    9.0
    """

    matrix: Material
    inclusions: Mapping[str, Material] = field(default_factory=dict)
    between: str = "harmonic"

    def __post_init__(self) -> None:
        object.__setattr__(self, "inclusions", dict(self.inclusions))
        if self.between not in MEANS:
            raise ValueError(f"between = {self.between!r} must be one of {', '.join(MEANS)}")
        if len(self.materials) > MOST:
            raise ValueError(
                f"inclusions names {len(self.inclusions)} subdomains; at most {MOST - 1} can be told apart"
            )
        for name, inclusion in self.inclusions.items():
            for attribute in ("plane", "convention", "calibrate"):
                if getattr(inclusion, attribute) != getattr(self.matrix, attribute):
                    raise ValueError(
                        f"inclusions[{name!r}].{attribute} = {getattr(inclusion, attribute)!r}: the matrix has "
                        f"{getattr(self.matrix, attribute)!r}, and a body has one"
                    )

    @property
    def materials(self) -> tuple[Material, ...]:
        """The matrix, then the inclusions in their order."""
        return (self.matrix, *self.inclusions.values())

    @property
    def calibrate(self) -> str:
        return self.matrix.calibrate

    @property
    def density(self) -> tuple[float, ...]:
        """One density a material."""
        return tuple(material.density for material in self.materials)

    def with_(self, **changes: Any) -> Composite:
        """Return a copy with another matrix, other inclusions or another mean.

        Parameters
        ----------
        **changes
            What is other.

        Returns
        -------
        Composite
            The copy.
        """
        return dataclasses.replace(self, **changes)

    def laws(self, dim: int, moment: float, crack_moment: float | None = None) -> tuple[Potential, ...]:
        """Return the calibrated potential of each material, see :meth:`Material.law`.

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
        tuple of Potential
            The matrix first, then the inclusions in their order.
        """
        return tuple(material.law(dim, moment, crack_moment) for material in self.materials)

    def volumetric_energies(self, laws: Sequence[Potential], dim: int, moment: float) -> list[Volumetric | None]:
        """Return the energy beside the bonds of each material, see :meth:`Material.volumetric_energy`.

        Parameters
        ----------
        laws : sequence of Potential
            Those of all materials.
        dim : int
            Dimension of the body, 1, 2 or 3.
        moment : float
            ``M_d`` of the influence function, for strains.

        Returns
        -------
        list of Volumetric or None
            The matrix first, then the inclusions in their order.
        """
        return [
            material.volumetric_energy(law, dim, moment) for material, law in zip(self.materials, laws, strict=True)
        ]

    def mixed(self, laws: Sequence[Potential], members: Sequence[int]) -> Potential:
        """Return the law of a bond between some of the materials, by their numbers.

        Parameters
        ----------
        laws : sequence of Potential
            Those of all materials.
        members : sequence of int
            The numbers of the materials that meet.

        Returns
        -------
        Potential
            The law of the bond.
        """
        if len(members) == 1:
            return laws[members[0]]
        mean = MEANS[self.between]
        slope = mean(np.array([laws[k].slope for k in members]))
        limit = mean(np.array([laws[k].limit for k in members]))
        weakest = min(members, key=lambda k: laws[k].limit)
        return self.materials[weakest].shaped(slope, limit)

    def member_of(self, mesh: Mesh) -> Longs:
        """Return the number of the material of each element, (nelements,).

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.

        Returns
        -------
        ndarray of int, (nelements,)
            0 for the matrix, then the inclusions in their order.

        Raises
        ------
        ValueError
            For a subdomain that the mesh does not have, and for elements in two of them.
        """
        member = np.zeros(int(mesh.nelements), dtype=np.int64)
        tags = mesh.subdomains or {}
        for k, name in enumerate(self.inclusions, start=1):
            if name not in tags:
                raise ValueError(
                    f"inclusions names the subdomain {name!r}; the mesh has {', '.join(map(repr, tags)) or 'none'}"
                )
            twice = tags[name][member[tags[name]] > 0]
            if len(twice):
                overlapped = list(self.inclusions)[member[twice[0]] - 1]
                raise ValueError(
                    f"element {twice[0]} is in the subdomains {overlapped!r} and {name!r}; one material, please"
                )
            member[tags[name]] = k
        return member

    def density_on(self, mesh: Mesh) -> Floats:
        """Return the density of each element, for :func:`~skfem_peridynamics.mass_matrix`.

        Parameters
        ----------
        mesh : skfem.Mesh
            Lines, triangles or tetrahedra.

        Returns
        -------
        ndarray, (nelements,)
            Mass per volume.
        """
        rho: Floats = np.array(self.density)[self.member_of(mesh)]
        return rho
