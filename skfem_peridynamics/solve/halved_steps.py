"""Steps of one length that are cut in half where they fail, and grown again once they are easy."""

from __future__ import annotations

from dataclasses import dataclass
from math import log2

CUTS = 10  # times a step may be cut in half


@dataclass
class HalvedSteps:
    """Time in ticks, so that steps that were cut end where whole ones do: ``2^CUTS`` of them a step of length dt.

    >>> steps = HalvedSteps(dt=1.0)
    >>> steps.halve(), steps.length, steps.end
    (True, 0.5, 0.5)
    >>> steps.advance()
    >>> steps.time, steps.ticks
    (0.5, 512)
    """

    dt: float
    ticks: int = 0
    cuts: int = 0
    count: int = 0

    @property
    def whole(self) -> int:
        """Ticks of a whole step."""
        return 1 << CUTS

    def _at(self, ticks: int) -> float:
        # whole steps by one product, so that time does not drift by the round-off of sums
        return ticks // self.whole * self.dt + ticks % self.whole * (self.dt / self.whole)

    @property
    def time(self) -> float:
        """Where the last step ended."""
        return self._at(self.ticks)

    @property
    def part(self) -> int:
        """Ticks of the step at hand."""
        return self.whole >> self.cuts

    @property
    def length(self) -> float:
        """Length of the step at hand."""
        return self.dt / (1 << self.cuts)

    @property
    def end(self) -> float:
        """Where the step at hand will end."""
        return self._at(self.ticks + self.part)

    def grow(self) -> None:
        """Double a step that was cut, at the end of the one that it was cut from twice."""
        # at multiples of four of the steps at hand, where one that was cut twice would have ended
        while self.cuts and self.count and self.ticks % (self.whole >> max(self.cuts - 2, 0)) == 0:
            self.cuts -= 1

    def halve(self) -> bool:
        """Cut the step at hand in half; return False where it was cut as often as it may be."""
        if self.cuts == CUTS:
            return False
        self.cuts += 1
        return True

    def advance(self) -> None:
        """Go to the end of the step at hand."""
        self.ticks, self.count = self.ticks + self.part, self.count + 1

    def resume(self, time: float, length: float, count: int) -> bool:
        """Go to where an earlier run was, with the step it had; return False where it was none of these."""
        self.ticks, self.cuts, self.count = round(time / self.dt * self.whole), round(log2(self.dt / length)), count
        return abs(self.time - time) <= 1e-9 * self.dt and 0 <= self.cuts <= CUTS and self.length == length
