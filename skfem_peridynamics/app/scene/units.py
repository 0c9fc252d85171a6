"""Names of units: what the numbers of a run are in, where the scene says it; nothing is ever converted."""

from __future__ import annotations

from dataclasses import dataclass, fields

from .reading import key
from .values import text

# quantities as powers of length, force and time
_POWERS = {
    "displacement": (1, 0, 0),
    "velocity": (1, 0, -1),
    "stress": (-2, 1, 0),
    "strain": (0, 0, 0),
    "intact": (0, 0, 0),
    "Z": (0, 0, 0),
    "length": (1, 0, 0),
    "area": (2, 0, 0),
    "time": (0, 0, 1),
    "force": (0, 1, 0),
    "energy": (1, 1, 0),
    "toughness": (-1, 1, 0),
    "J": (-1, 1, 0),
}
KNOWN = frozenset(_POWERS)
_NAMED = {("m", "N"): {(-2, 1, 0): "Pa", (1, 1, 0): "J"}, ("mm", "N"): {(-2, 1, 0): "MPa", (1, 1, 0): "mJ"}}


@dataclass(frozen=True)
class UnitsTable:
    """``[units]``: what lengths, forces and times are in, for pictures, frames and the report."""

    length: str = key(text, "length")
    force: str = key(text, "force")
    time: str = key(text, "time")

    def after(self, quantity: str, dim: int = 3) -> str:
        """Return the unit as it stands after a number, nothing where the scene names none.

        >>> UnitsTable("m", "N", "s").after("velocity"), UnitsTable().after("velocity")
        (' m/s', '')
        """
        unit = self.of(quantity, dim)
        return "" if any(unit_field.name in unit for unit_field in fields(self)) else f" {unit}"

    def of(self, quantity: str, dim: int = 3) -> str:
        """Return the unit of a quantity, ``"1"`` for a number; in 2D forces and energies are per unit thickness.

        >>> UnitsTable("m", "N", "s").of("stress"), UnitsTable().of("velocity"), UnitsTable().of("Z")
        ('Pa', 'length/time', '1')
        >>> UnitsTable("mm", "N", "ms").of("energy", dim=2)
        'mJ/mm'
        """
        powers = _POWERS[quantity]
        per = {2: 1, 1: 2}.get(dim, 0) if quantity in ("force", "energy") else 0
        named = _NAMED.get((self.length, self.force), {}).get(powers)
        if named is None:
            length, force, time = powers
            factors = [(self.force, force), (self.length, length), (self.time, time)]
            named = "*".join(_power(name, n) for name, n in factors if n > 0) or "1"
            named += "".join(f"/{_power(name, -n)}" for name, n in factors if n < 0)
        return named + (f"/{_power(self.length, per)}" if per else "")


def _power(name: str, n: int) -> str:
    return name if n == 1 else f"{name}^{n}"
