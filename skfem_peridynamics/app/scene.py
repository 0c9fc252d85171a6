"""A scene: everything a run needs, as frozen dataclasses that TOML is read into."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..bonds.ball import BallRule
from ..bonds.rules import PairRule, Rule
from .formula import Formula, FormulaError
from .reading import SceneError, choice, count, counts, flag, key, number, positive, rows, table, tables, text

SAFETY = 0.9  # of the stable limit


def formula(value: Any, path: str) -> Formula:
    """A number or a text such as ``"1e6 * step(1e-5 - t)"``."""
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise SceneError(f"{path} = {value!r} must be a number or a formula in x, y, z, t")
    try:
        return Formula(value)
    except FormulaError as error:
        raise SceneError(f"{path}: {error}") from None


def formulas(value: Any, path: str) -> tuple[Formula, ...]:
    """One formula per component."""
    if not isinstance(value, list) or not value:
        raise SceneError(f"{path} = {value!r} must be an array with one number or formula per component")
    return tuple(formula(entry, f"{path}[{k}]") for k, entry in enumerate(value))


@dataclass(frozen=True)
class MeshTable:
    """``[mesh]``: a ``file`` that meshio reads, or a ``box`` (one row per axis) with ``divisions``."""

    file: str | None = key(text, None)
    box: tuple[tuple[float, ...], ...] | None = key(rows, None)
    divisions: tuple[int, ...] | None = key(counts, None)

    def __post_init__(self) -> None:
        if (self.file is None) == (self.box is None):
            raise ValueError("give one of file and box, not both and not none")
        if (self.box is None) != (self.divisions is None):
            raise ValueError("box and divisions go together")
        if self.box is not None and self.divisions is not None:
            if not 1 <= len(self.box) <= 3 or len(self.box) != len(self.divisions):
                raise ValueError(f"box has {len(self.box)} axes and divisions {len(self.divisions)}; 1 to 3, alike")
            for axis in self.box:
                if len(axis) != 2 or not axis[1] - axis[0] > 1e-6 * max(map(abs, axis)):
                    raise ValueError(
                        f"box = {list(map(list, self.box))}: each axis is [low, high] with low < high, "
                        "and not so close that the numbers cannot tell"
                    )
            if min(self.divisions) < 1:
                raise ValueError(f"divisions = {list(self.divisions)} must be at least 1 each")


@dataclass(frozen=True)
class MaterialTable:
    """``[material]``: what :meth:`Material.from_elastic` takes; ``between`` is the mean for bonds to an inclusion."""

    density: float = key(positive)
    young: float | None = key(positive, None)
    lame: float | None = key(positive, None)
    toughness: float | None = key(positive, None)
    K_Ic: float | None = key(positive, None)
    plane: str | None = key(choice("stress", "strain"), None)
    poisson: float | None = key(number, None)
    potential: str = key(choice("exponential", "rational", "linear"), "exponential")
    convention: str = key(choice("physical", "paper"), "physical")
    calibrate: str = key(choice("continuum", "discrete"), "continuum")
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
    lame: float | None = key(positive, None)
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

    ``rule`` is ``"pairs"`` of vertices, ``"gauss_pairs"``, ``"ball"``, or ``"auto"``: chosen by measured tables for the
    mesh, and for ``tolerance`` where the body does not break. ``partial_volume`` goes with pairs,
    ``radial``, ``angular``, ``outer`` and ``symmetric`` with the ball. Weights that are ``balanced`` pass the patch
    test on any mesh.
    """

    horizon: float = key(positive)
    influence: str = key(choice("constant", "conical", "gaussian"), "constant")
    boundary_function: str | None = key(choice("smooth"), None)
    rule: str = key(choice("pairs", "gauss_pairs", "ball", "auto"), "pairs")
    partial_volume: bool | None = key(flag, None)
    radial: int | None = key(count, None)
    angular: int | None = key(count, None)
    outer: str | None = key(choice("gauss", "vertices"), None)
    symmetric: bool | None = key(flag, None)
    balanced: bool | None = key(flag, None)
    tolerance: float | None = key(positive, None)

    def __post_init__(self) -> None:
        ball = ("radial", "angular", "outer", "symmetric")
        theirs: tuple[str, ...] = ("partial_volume",) if self.rule == "ball" else ball
        if self.rule == "auto":
            theirs = ("partial_volume", *ball, "balanced")
        elif self.tolerance is not None:
            raise ValueError(f"tolerance = {self.tolerance:g} goes with rule = 'auto'")
        for name in theirs:
            if getattr(self, name) is not None:
                raise ValueError(f"{name} = {getattr(self, name)!r} does not go with rule = {self.rule!r}")
        if self.balanced and self.symmetric is False:
            raise ValueError("balanced = true does not go with symmetric = false: a one-sided rule needs no balance")

    def make_rule(self) -> Rule:
        """Return the rule that the keys describe. Raises ``ValueError`` for counts that make none."""
        names = ("radial", "angular", "outer", "symmetric") if self.rule == "ball" else ("partial_volume",)
        given = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        if self.rule == "ball":
            return BallRule(**given)
        if self.rule == "auto":
            raise ValueError("rule = 'auto' is chosen for a mesh; see app.auto.choose")
        return PairRule(points="gauss" if self.rule == "gauss_pairs" else "vertices", **given)


@dataclass(frozen=True)
class CrackTable:
    """``[[crack]]``: ``points`` (a polyline in 2D, a convex polygon in 3D) or tagged ``facets``."""

    points: tuple[tuple[float, ...], ...] | None = key(rows, None)
    facets: str | None = key(text, None)

    def __post_init__(self) -> None:
        if (self.points is None) == (self.facets is None):
            raise ValueError("give one of points and facets, not both and not none")


@dataclass(frozen=True)
class Where:
    """Vertices: on a boundary (``on``), within ``width`` of it, in a subdomain (``region``) or ``where > 0``."""

    on: str | None = key(text, None)
    width: float | None = key(positive, None)
    region: str | None = key(text, None)
    where: Formula | None = key(formula, None)

    def __post_init__(self) -> None:
        if sum(entry is not None for entry in (self.on, self.region, self.where)) != 1:
            raise ValueError("give one of on, region and where")
        if self.width is not None and self.on is None:
            raise ValueError(f"width = {self.width} goes with on")
        if self.where is not None and self.where.uses("t"):
            raise ValueError(f"where = {self.where.text!r} must not depend on t")


@dataclass(frozen=True)
class NoFailTable(Where):
    """``[[no_fail]]``: vertices all of whose bonds stay linear."""


@dataclass(frozen=True)
class LoadTable:
    """``[[load]]``: a ``body`` force per volume, or a ``traction`` per area ``on`` a boundary or in a ``layer``."""

    body: tuple[Formula, ...] | None = key(formulas, None)
    traction: tuple[Formula, ...] | None = key(formulas, None)
    on: str | None = key(text, None)
    layer: float | None = key(positive, None)

    def __post_init__(self) -> None:
        if (self.body is None) == (self.traction is None):
            raise ValueError("give one of body and traction")
        if (self.traction is None) != (self.on is None):
            raise ValueError("traction and on go together")
        if self.layer is not None and self.traction is None:
            raise ValueError(f"layer = {self.layer} goes with traction")


@dataclass(frozen=True)
class FixedTable(Where):
    """``[[fixed]]``: prescribe ``displacement`` or ``velocity`` of all components, or of ``component`` x, y or z."""

    component: str = key(choice("all", "x", "y", "z"), "all")
    displacement: Formula | None = key(formula, None)
    velocity: Formula | None = key(formula, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.displacement is None) == (self.velocity is None):
            raise ValueError("give one of displacement and velocity")


@dataclass(frozen=True)
class InitialTable:
    """``[initial]``: displacement and velocity at t = 0, one formula per component."""

    displacement: tuple[Formula, ...] | None = key(formulas, None)
    velocity: tuple[Formula, ...] | None = key(formulas, None)

    def __post_init__(self) -> None:
        for name in ("displacement", "velocity"):
            for entry in getattr(self, name) or ():
                if entry.uses("t"):
                    raise ValueError(f"{name} = {entry.text!r} must not depend on t")


@dataclass(frozen=True)
class TimeTable:
    """``[time]``: run ``until``; the step is ``safety`` times the stable limit, or ``step`` as given.

    ``mass`` is ``"lumped"`` or ``"consistent"``; without it rules with Gauss points outside take the consistent one.
    ``scheme`` is ``"central_difference"``; ``"auto"`` is that too and leaves no room for a ``mass`` of your own;
    ``"newmark"`` takes implicit steps of length ``step`` with ``beta`` and ``gamma``; ``"static"`` follows equilibria
    in so many ``steps``, t being how far loads and displacements have come.
    """

    until: float = key(positive)
    safety: float | None = key(positive, None)
    step: float | None = key(positive, None)
    mass: str | None = key(choice("lumped", "consistent"), None)
    scheme: str = key(choice("central_difference", "newmark", "static", "auto"), "central_difference")
    beta: float | None = key(positive, None)
    gamma: float | None = key(positive, None)
    steps: int | None = key(count, None)
    mass_scaling: float | None = key(number, None)

    def __post_init__(self) -> None:
        if self.mass_scaling is not None:
            raise ValueError(
                f"mass_scaling = {self.mass_scaling:g}: there is none, for it buys a longer step with another motion; "
                'take scheme = "newmark", or "static" where inertia does not matter'
            )
        if self.scheme == "auto" and self.mass is not None:
            raise ValueError(f"mass = {self.mass!r} does not go with scheme = 'auto', which chooses it")
        mine = {
            "newmark": ("step", "mass", "beta", "gamma"),
            "static": ("steps",),
        }.get(self.scheme, ("safety", "step", "mass"))
        for name in ("safety", "step", "mass", "beta", "gamma", "steps"):
            if getattr(self, name) is not None and name not in mine:
                raise ValueError(f"{name} = {getattr(self, name)!r} does not go with scheme = {self.scheme!r}")
        if self.scheme == "newmark" and self.step is None:
            raise ValueError('scheme = "newmark" needs a step: how finely the motion is to be resolved')
        if self.scheme == "static" and not self.steps:
            raise ValueError(f'scheme = "static" needs steps, 1 or more, not {self.steps}')

    @property
    def part(self) -> float:
        """The part of the stable limit that an explicit step takes where none is given."""
        return SAFETY if self.safety is None else self.safety


@dataclass(frozen=True)
class OutputTable:
    """``[output]``: number of ``frames`` and of ``history`` rows spread over the run; ``pictures``.

    Where ``pictures`` is not given they are drawn if matplotlib is installed.
    """

    frames: int = key(count, 10)
    history: int = key(count, 50)
    pictures: bool | None = key(flag, None)


@dataclass(frozen=True)
class Scene:
    """One run, as read from TOML or built in Python.

    >>> scene = Scene.parse('''
    ... mesh = {box = [[0, 1]], divisions = [10]}
    ... material = {young = 1.0, toughness = 1.0, density = 1.0}
    ... bonds = {horizon = 0.2}
    ... time = {until = 1.0}
    ... ''')
    >>> scene.time.part
    0.9
    """

    mesh: MeshTable = key(table(MeshTable))
    material: MaterialTable = key(table(MaterialTable))
    bonds: BondsTable = key(table(BondsTable))
    time: TimeTable = key(table(TimeTable))
    title: str = key(text, "untitled")
    inclusion: tuple[InclusionTable, ...] = key(tables(InclusionTable), ())
    crack: tuple[CrackTable, ...] = key(tables(CrackTable), ())
    no_fail: tuple[NoFailTable, ...] = key(tables(NoFailTable), ())
    load: tuple[LoadTable, ...] = key(tables(LoadTable), ())
    fixed: tuple[FixedTable, ...] = key(tables(FixedTable), ())
    initial: InitialTable = field(default=InitialTable(), metadata={"read": table(InitialTable)})
    output: OutputTable = field(default=OutputTable(), metadata={"read": table(OutputTable)})
    folder: Path = Path()  # not a key: where the scene was read from

    @classmethod
    def parse(cls, content: str, folder: Path = Path()) -> Scene:
        """Read TOML text; a mesh file is looked for relative to ``folder``. Raises :class:`SceneError`."""
        try:
            data = tomllib.loads(content)
        except tomllib.TOMLDecodeError as error:
            raise SceneError(f"not TOML: {error}") from None
        except RecursionError:
            raise SceneError("not TOML that can be read: it is nested too deeply") from None
        except ValueError as error:  # an integer of thousands of digits
            raise SceneError(f"not TOML that can be read: {error}") from None
        return dataclasses.replace(table(cls)(data, ""), folder=folder)

    @classmethod
    def read(cls, path: str | Path) -> Scene:
        """Read a TOML file. Raises :class:`SceneError` with the file's name in front."""
        path = Path(path)
        try:
            content = path.read_bytes().decode()
        except OSError as error:
            raise SceneError(f"scene {str(path)!r} cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise SceneError(f"scene {str(path)!r} is not UTF-8 text") from None
        try:
            return cls.parse(content, path.parent)
        except SceneError as error:
            raise SceneError(f"{path}: {error}") from None
