"""How a body is discretised: a rule, balanced weights or not, a mass."""

from __future__ import annotations

from dataclasses import dataclass

from ..bonds.ball_rule import BallRule
from ..bonds.pair_rule import PairRule
from ..bonds.rule import Rule


@dataclass(frozen=True)
class Discretisation:
    """A rule, whether its weights are balanced, and a mass: all that a space discretisation is.

    >>> Discretisation(BallRule(3, 8), balanced=True).name
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
    def strong(self) -> bool:
        """Whether it is the strong form: a force at each vertex, of the bonds that begin there."""
        return isinstance(self.rule, BallRule) and not self.rule.symmetric and self.rule.outer == "vertices"

    @property
    def name(self) -> str:
        """What tables call it."""
        form = "strong form, " if self.strong else ""
        return f"{form}{self.rule.name}{', balanced' if self.balanced else ''}; {self.kind} mass"


CLASSICAL = Discretisation(PairRule())
