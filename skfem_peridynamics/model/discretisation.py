"""A scheme: a rule, a mass, balanced weights or not; central difference in time."""

from __future__ import annotations

from dataclasses import dataclass

from ..bonds.ball_rule import BallRule
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule


@dataclass(frozen=True)
class Scheme:
    """A rule, a mass and whether weights are balanced: all that makes a scheme, beside central difference in time.

    >>> Scheme(BallRule(3, 8), balanced=True).name
    'ball 3 x 8, Gauss points outside, balanced; consistent mass'
    """

    rule: Rule
    balanced: bool = False
    mass: str | None = None

    @property
    def kind(self) -> str:
        """The mass: consistent where Gauss points are outside, lumped where vertices are, unless given."""
        outside = getattr(self.rule, "outer", getattr(self.rule, "points", "vertices"))
        return self.mass or ("consistent" if outside == "gauss" else "lumped")

    @property
    def family(self) -> str:
        """Classical pairs, pairs or ball: what the tables compare."""
        if isinstance(self.rule, BallRule):
            return "ball"
        return "classical" if self == CLASSICAL else "pairs"

    @property
    def name(self) -> str:
        strong = isinstance(self.rule, BallRule) and not self.rule.symmetric and self.rule.outer == "vertices"
        form = "strong form, " if strong else ""
        return f"{form}{self.rule.name}{', balanced' if self.balanced else ''}; {self.kind} mass"


CLASSICAL = Scheme(PairRule())
