"""A scene: everything a run needs, as frozen dataclasses that TOML is read into."""

from __future__ import annotations

import dataclasses
import re
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from ..._files import MB, read_regular
from ...solve.cfl import SAFETY
from .body_tables import BondsTable, CrackTable, InclusionTable, MaterialTable, MeshTable, formula, formulas
from .changes import Change, changed
from .formula import Formula
from .reading import SceneError, key, table, tables
from .shown import cut, named, shown
from .units import UnitsTable
from .values import Every, choice, choices, count, count_up_to, flag, interval, numbers, positive, text

_LARGEST = MB  # bytes of a scene
# a dotted key of many parts, which takes memory with their square
_DEEP = re.compile(r"""(?<![\w.-])(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*){20,}""")


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
            raise ValueError(f"where = {shown(self.where.text)} must not depend on t")


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
    """``[[fixed]]``: prescribe ``displacement`` (0 if nothing is said) or ``velocity``, of all or one ``component``."""

    component: str = key(choice("all", "x", "y", "z"), "all")
    displacement: Formula | None = key(formula, None)
    velocity: Formula | None = key(formula, None)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.displacement is None and self.velocity is None:
            object.__setattr__(self, "displacement", formula(0, "displacement"))
        elif self.displacement is not None and self.velocity is not None:
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
                    raise ValueError(f"{name} = {shown(entry.text)} must not depend on t")


@dataclass(frozen=True)
class TimeTable:
    """``[time]``: run ``until``; the step is ``safety`` times the stable limit, or ``step`` as given.

    An explicit step above the limit is refused, but for ``above_limit``: then the run stops as soon as it shows.

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
    above_limit: bool | None = key(flag, None)

    refused: ClassVar[Mapping[str, str]] = {
        "mass_scaling": "there is none, for it buys a longer step with another motion; "
        'take scheme = "newmark", or "static" where inertia does not matter'
    }

    def __post_init__(self) -> None:
        if self.scheme == "auto" and self.mass is not None:
            raise ValueError(f"mass = {self.mass!r} does not go with scheme = 'auto', which chooses it")
        allowed = {
            "newmark": ("step", "mass", "beta", "gamma"),
            "static": ("steps",),
        }.get(self.scheme, ("safety", "step", "mass", "above_limit"))
        for name in ("safety", "step", "mass", "beta", "gamma", "steps", "above_limit"):
            if getattr(self, name) is not None and name not in allowed:
                raise ValueError(f"{name} = {getattr(self, name)!r} does not go with scheme = {self.scheme!r}")
        if self.scheme == "newmark" and self.step is None:
            raise ValueError('scheme = "newmark" needs a step: how finely the motion is to be resolved')
        if self.scheme == "static" and not self.steps:
            given = "" if self.steps is None else f", not {self.steps}"
            raise ValueError(f'scheme = "static" needs steps, 1 or more{given}')

    @property
    def part(self) -> float:
        """The part of the stable limit that an explicit step takes where none is given."""
        return SAFETY if self.safety is None else self.safety


@dataclass(frozen=True)
class MeasureTable:
    """``[measure]``: columns of the history besides the energies.

    ``crack``: length, area, tips (by default where a body of two dimensions or three can break); ``j_integral``: the
    radius of the ring about the tip; ``reactions``: forces by name of what is ``[[fixed]]`` (by default where it is).
    """

    crack: bool | None = key(flag, None)
    j_integral: float | None = key(positive, None)
    reactions: bool | None = key(flag, None)


@dataclass(frozen=True)
class ProbeTable:
    """``[[probe]]``: displacement and velocity ``at`` a point of the body, under a ``name``."""

    at: tuple[float, ...] = key(numbers)
    name: str | None = key(text, None)


@dataclass(frozen=True)
class OutputTable:
    """``[output]``: number of ``frames`` and of ``history`` rows spread over the run; ``pictures``; checkpoints.

    Frames hold displacement, velocity and damage, and what ``fields`` adds: ``"stress"``, ``"strain"``.

    Where ``pictures`` is not given they are drawn if matplotlib is installed. ``checkpoint_every`` is a number of
    steps, or a text like ``"30 s"``; 0 is never.
    """

    frames: int = key(count_up_to(10_000), 10)
    history: int = key(count_up_to(100_000), 50)
    pictures: bool | None = key(flag, None)
    checkpoint_every: int | str = key(interval, "60 s")
    fields: tuple[str, ...] = key(choices("stress", "strain"), ())

    @property
    def every(self) -> Every:
        """How often a checkpoint is written."""
        return Every.read(self.checkpoint_every)


@dataclass(frozen=True)
class Scene:
    """One run, as read from TOML or built in Python; docs/howto/scenes.md has every key.

    Parameters
    ----------
    mesh : MeshTable
        A box or a file.
    material : MaterialTable
        Constants.
    bonds : BondsTable
        Horizon, influence, rule.
    time : TimeTable
        Until when, and how.
    title : str
        What reports call it.
    inclusion : tuple of InclusionTable
        Other materials.
    crack : tuple of CrackTable
        Pre-cracks.
    no_fail : tuple of NoFailTable
        Regions whose bonds stay linear.
    load : tuple of LoadTable
        Body forces and tractions.
    fixed : tuple of FixedTable
        Prescribed motions.
    initial : InitialTable
        Displacement and velocity at t = 0.
    measure : MeasureTable
        Columns of the history.
    probe : tuple of ProbeTable
        Points of the body.
    units : UnitsTable
        Words for units.
    output : OutputTable
        Frames, rows, pictures, checkpoints.
    folder : Path
        Where it was read from; not a key.

    Raises
    ------
    SceneError
        Where something is not as it should be; the message names the key and its value.

    Examples
    --------
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
    inclusion: tuple[InclusionTable, ...] = key(tables(InclusionTable, 100), ())
    crack: tuple[CrackTable, ...] = key(tables(CrackTable, 1000), ())
    no_fail: tuple[NoFailTable, ...] = key(tables(NoFailTable, 1000), ())
    load: tuple[LoadTable, ...] = key(tables(LoadTable, 1000), ())
    fixed: tuple[FixedTable, ...] = key(tables(FixedTable, 1000), ())
    initial: InitialTable = field(default=InitialTable(), metadata={"read": table(InitialTable)})
    measure: MeasureTable = field(default=MeasureTable(), metadata={"read": table(MeasureTable)})
    probe: tuple[ProbeTable, ...] = key(tables(ProbeTable, 1000), ())
    units: UnitsTable = field(default=UnitsTable(), metadata={"read": table(UnitsTable)})
    output: OutputTable = field(default=OutputTable(), metadata={"read": table(OutputTable)})
    folder: Path = Path()  # not a key: where the scene was read from

    @classmethod
    def parse(cls, content: str, folder: Path = Path(), changes: Sequence[Change] = ()) -> Scene:
        """Read TOML text.

        Parameters
        ----------
        content : str
            The text.
        folder : Path, optional
            Where a mesh file is looked for.
        changes : sequence, optional
            Keys that are set anew, as in ``"time.until=1e-5"`` or ``("time.until", 1e-5)``.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            For text that is not TOML, and for keys and values that make no sense.
        """
        deep = _DEEP.search(content)
        if deep:
            raise SceneError(f"not TOML that can be read: the key {cut(deep[0])} is nested too deeply")
        try:
            tables = tomllib.loads(content)
        except tomllib.TOMLDecodeError as error:
            raise SceneError(f"not TOML: {error}") from None
        except RecursionError:
            raise SceneError("not TOML that can be read: it is nested too deeply") from None
        except ValueError as error:  # an integer of thousands of digits
            raise SceneError(f"not TOML that can be read: {error}") from None
        return cls.of(changed(tables, changes) if changes else tables, folder)

    @classmethod
    def of(cls, tables: Mapping[str, Any], folder: Path = Path()) -> Scene:
        """Read the tables of a scene, as TOML gives them and as ``summary.json`` keeps them under ``run.scene``.

        Parameters
        ----------
        tables : mapping
            Tables and their keys.
        folder : Path, optional
            Where a mesh file is looked for.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            For keys and values that make no sense.
        """
        return dataclasses.replace(table(cls)(tables, ""), folder=folder)

    @classmethod
    def read(cls, path: str | Path, changes: Sequence[Change] = ()) -> Scene:
        """Read a TOML file.

        Parameters
        ----------
        path : str or Path
            The file.
        changes : sequence, optional
            Keys that are set anew, as in ``"time.until=1e-5"`` or ``("time.until", 1e-5)``.

        Returns
        -------
        Scene
            The scene.

        Raises
        ------
        SceneError
            With the file's name in front.
        """
        path = Path(path)
        try:
            content = read_regular(path, _LARGEST).decode()
        except OSError as error:
            raise SceneError(f"scene {named(path)} cannot be read: {error.strerror}") from None
        except UnicodeDecodeError:
            raise SceneError(f"scene {named(path)} is not UTF-8 text") from None
        except ValueError as error:  # a name that is none to the system
            raise SceneError(f"scene {named(path)} cannot be read: {error}") from None
        try:
            return cls.parse(content, path.parent, changes)
        except SceneError as error:
            raise SceneError(f"{cut(str(path))}: {error}", error.mistakes) from None
