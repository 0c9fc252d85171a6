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
    "von_mises": (-2, 1, 0),
    "damage": (0, 0, 0),
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
# what a unit is multiplied by, and its name, the largest first; of energies and forces per thickness the front alone
_PREFIXES = {
    "m": [(1e-3, "km"), (1.0, "m"), (1e3, "mm"), (1e6, "um"), (1e9, "nm")],
    "s": [(1.0, "s"), (1e3, "ms"), (1e6, "us"), (1e9, "ns")],
    "Pa": [(1e-9, "GPa"), (1e-6, "MPa"), (1e-3, "kPa"), (1.0, "Pa")],
    "J": [(1e-6, "MJ"), (1e-3, "kJ"), (1.0, "J"), (1e3, "mJ"), (1e6, "uJ")],
    "N": [(1e-6, "MN"), (1e-3, "kN"), (1.0, "N"), (1e3, "mN")],
}
_PREFIXED = {("m", ""), ("s", ""), ("Pa", ""), ("J", ""), ("J", "m"), ("N", ""), ("N", "m")}
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
        powers = _powers(quantity, dim)
        nameless = [
            one.name for one, n in zip(fields(self), powers, strict=True) if n and getattr(self, one.name) == one.name
        ]
        unit = self.of(quantity, dim)
        return "" if nameless or unit == "1" else f" {unit}"

    def reading(self, quantity: str, largest: float, dim: int = 3) -> tuple[float, str]:
        """Return a factor, and the unit of what is multiplied by it: numbers up to the largest are then read easily.

        SI alone has prefixes here; other units stay as they are.

        >>> UnitsTable("m", "N", "s").reading("length", 0.08529)
        (1000.0, 'mm')
        >>> UnitsTable("m", "N", "s").reading("stress", 7.2e10), UnitsTable("mm", "N", "ms").reading("length", 0.5)
        ((1e-09, 'GPa'), (1.0, 'mm'))
        """
        unit = self.after(quantity, dim).strip()
        head, slash, per = unit.partition("/")
        if (head, per) not in _PREFIXED or not 0.0 < abs(largest) < float("inf"):
            return 1.0, unit
        # the largest unit of which it is one or more, or the smallest
        found = next((entry for entry in _PREFIXES[head] if abs(largest) * entry[0] >= 1.0), _PREFIXES[head][-1])
        return found[0], found[1] + slash + per

    def shown(self, quantity: str, value: float, dim: int = 3) -> str:
        """Return a value with the unit it is read in.

        >>> UnitsTable("m", "N", "s").shown("time", 4.5e-05), UnitsTable().shown("time", 4.5e-05)
        ('45 us', '4.5e-05')
        """
        factor, unit = self.reading(quantity, value, dim)
        return f"{value * factor:.4g}" + (f" {unit}" if unit else "")

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


def _powers(quantity: str, dim: int) -> tuple[int, int, int]:
    """The powers of length, force and time in the unit of a quantity; in 2D forces and energies are per thickness."""
    length, force, time = _POWERS[quantity]
    per = {2: 1, 1: 2}.get(dim, 0) if quantity in ("force", "energy") else 0
    return length - per, force, time
