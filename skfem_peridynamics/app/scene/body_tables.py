"""The tables of a scene that say what the body is: mesh, materials, bonds and cracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ...bonds.ball_rule import BallRule
from ...bonds.corner_rule import CornerRule
from ...bonds.pair_rule import PairRule
from ...bonds.rule import Rule
from ...material.tension_only import COMPRESSION
from .formula import Formula, FormulaError
from .reading import SceneError, key
from .shown import shown
from .values import choice, count, counts, flag, number, positive, rows, takes, text


@takes(type=["number", "string"])
def formula(value: Any, path: str) -> Formula:
    """A number or a text such as ``"1e6 * step(1e-5 - t)"``."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise SceneError(f"{path} = {shown(value)} must be a number or a formula in x, y, z, t")
    try:
        return Formula(value)
    except FormulaError as error:
        raise SceneError(f"{path}: {error}") from None


@takes(type="array", items={"type": ["number", "string"]}, minItems=1)
def formulas(value: Any, path: str) -> tuple[Formula, ...]:
    """One formula per component."""
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {shown(value)} must be an array with one number or formula per component")
    return tuple(formula(entry, f"{path}[{k}]") for k, entry in enumerate(value))


_NARROWEST = 1e-9  # extent of a box over its coordinates, as on a map: what is left of 16 digits tells points apart


@dataclass(frozen=True)
class MeshTable:
    """``[mesh]``: a ``file`` that meshio reads, or a ``box`` (one row per axis) with ``divisions``.

    Lengths in a file are multiplied by ``scale``; ``join`` makes one vertex of those at the same place.
    """

    file: str | None = key(text, None)
    box: tuple[tuple[float, ...], ...] | None = key(rows, None)
    divisions: tuple[int, ...] | None = key(counts, None)
    scale: float | None = key(positive, None)
    join: bool | None = key(flag, None)

    def __post_init__(self) -> None:
        for name in ("scale", "join"):
            if self.file is None and getattr(self, name) is not None:
                raise ValueError(f"{name} = {getattr(self, name)!r} goes with file")
        if (self.file is None) == (self.box is None):
            raise ValueError("give one of file and box, not both and not none")
        if (self.box is None) != (self.divisions is None):
            raise ValueError("box and divisions go together")
        if self.box is not None and self.divisions is not None:
            if not 1 <= len(self.box) <= 3 or len(self.box) != len(self.divisions):
                raise ValueError(f"box has {len(self.box)} axes and divisions {len(self.divisions)}; 1 to 3, alike")
            for axis in self.box:
                if len(axis) != 2 or not axis[1] - axis[0] > _NARROWEST * max(map(abs, axis)):
                    raise ValueError(
                        f"box = {list(map(list, self.box))}: each axis is [low, high] with low < high, "
                        "and not so close that the numbers cannot tell"
                    )
            if min(self.divisions) < 1:
                raise ValueError(f"divisions = {list(self.divisions)} must be at least 1 each")


@dataclass(frozen=True)
class MaterialTable:
    """``[material]``: what :meth:`Material.from_elastic` takes; ``between`` is the mean for bonds to an inclusion.

    Bonds beyond ``breaking`` times their critical strain break for good; without it those that close again heal.
    """

    density: float = key(positive)
    young: float | None = key(positive, None)
    lame: float | None = key(number, None)
    mu: float | None = key(positive, None)
    bulk: float | None = key(positive, None)
    toughness: float | None = key(positive, None)
    K_Ic: float | None = key(positive, None)
    plane: str | None = key(choice("stress", "strain"), None)
    poisson: float | None = key(number, None)
    potential: str = key(choice("exponential", "rational", "linear"), "exponential")
    convention: str = key(choice("physical", "paper"), "physical")
    calibrate: str = key(choice("continuum", "discrete"), "continuum")
    compression: str = key(choice(*COMPRESSION), "soften")
    breaking: float | None = key(positive, None)
    between: str = key(choice("harmonic", "arithmetic", "weaker"), "harmonic")


@dataclass(frozen=True)
class InclusionTable:
    """``[[inclusion]]``: another material in a subdomain of the mesh (``region``), or in elements ``where > 0``.

    What is not given is that of ``[material]``.
    """

    region: str | None = key(text, None)
    where: Formula | None = key(formula, None)
    density: float | None = key(positive, None)
    young: float | None = key(positive, None)
    poisson: float | None = key(number, None)
    lame: float | None = key(number, None)
    mu: float | None = key(positive, None)
    bulk: float | None = key(positive, None)
    toughness: float | None = key(positive, None)
    K_Ic: float | None = key(positive, None)
    potential: str | None = key(choice("exponential", "rational", "linear"), None)

    def __post_init__(self) -> None:
        if (self.region is None) == (self.where is None):
            raise ValueError("give one of region and where")
        if self.where is not None and self.where.uses("t"):
            raise ValueError(f"where = {self.where.text!r} must not depend on t")


@dataclass(frozen=True)
class BondsTable:
    """``[bonds]``: horizon, influence function, the paper's boundary function, and the rule of the double integral.

    ``rule`` is ``"pairs"`` of vertices, ``"gauss_pairs"``, ``"ball"``, ``"corners"`` (2D and 3D, always balanced),
    or ``"auto"``: chosen by the mesh, and by whether the body may break.
    ``partial_volume`` goes with pairs, ``radial`` and ``angular`` with balls and corners, ``outer``, ``order`` and
    ``symmetric`` with the ball. Weights that are ``balanced`` pass the patch test on any mesh, or nearly so.
    """

    horizon: float = key(positive)
    influence: str = key(choice("constant", "conical", "gaussian"), "constant")
    boundary_function: str | None = key(choice("smooth"), None)
    rule: str = key(choice("pairs", "gauss_pairs", "ball", "corners", "auto"), "pairs")
    partial_volume: bool | None = key(flag, None)
    radial: int | None = key(count, None)
    angular: int | None = key(count, None)
    outer: str | None = key(choice("gauss", "vertices"), None)
    symmetric: bool | None = key(flag, None)
    order: int | None = key(count, None)
    balanced: bool | None = key(flag, None)

    refused: ClassVar[Mapping[str, str]] = {
        "tolerance": 'rule = "auto" goes by the mesh; run --estimate tells the error, and a finer mesh makes it smaller'
    }

    def __post_init__(self) -> None:
        ball = ("radial", "angular", "outer", "symmetric", "order")
        theirs: tuple[str, ...] = ("partial_volume",) if self.rule == "ball" else ball
        if self.rule == "corners":
            theirs = ("partial_volume", "outer", "symmetric", "order")
            if self.balanced is False:
                raise ValueError("balanced = false does not go with rule = 'corners': unbalanced they are no good")
        if self.rule == "auto":
            theirs = ("partial_volume", *ball, "balanced")
        for name in theirs:
            if getattr(self, name) is not None:
                raise ValueError(f"{name} = {getattr(self, name)!r} does not go with rule = {self.rule!r}")
        if self.balanced and self.symmetric is False:
            raise ValueError("balanced = true does not go with symmetric = false: a one-sided rule needs no balance")

    def make_rule(self) -> Rule:
        """Return the rule that the keys describe. Raises ``ValueError`` for counts that make none."""
        names = ("radial", "angular", "outer", "symmetric", "order") if self.rule == "ball" else ("partial_volume",)
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if self.rule == "ball":
            return BallRule(**given)
        if self.rule == "corners":
            return CornerRule(self.radial, self.angular)
        if self.rule == "auto":
            raise ValueError("rule = 'auto' is chosen for a mesh; see study.choose_rule")
        return PairRule(points="gauss" if self.rule == "gauss_pairs" else "vertices", **given)


@dataclass(frozen=True)
class CrackTable:
    """``[[crack]]``: ``points`` (a polyline in 2D, a convex polygon in 3D) or tagged ``facets``."""

    points: tuple[tuple[float, ...], ...] | None = key(rows, None)
    facets: str | None = key(text, None)

    def __post_init__(self) -> None:
        if (self.points is None) == (self.facets is None):
            raise ValueError("give one of points and facets, not both and not none")
