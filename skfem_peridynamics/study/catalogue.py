"""The studies that the command knows by name: problems, schemes and sizes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..bonds.ball_rule import BallRule
from ..bonds.corner_rule import CornerRule
from ..bonds.pair_rule import PairRule
from ..geometry.boxes import unit_box
from ..model.discretisation import CLASSICAL, Discretisation
from .known_motion import Motion, law_of
from .manufactured import Manufactured
from .measure import TIME_SHARE, Row, measure, time_constant
from .result import Result
from .standing_wave import StandingWave

Report = Callable[[str], None]


@dataclass(frozen=True)
class Contestant:
    """A scheme in a study: a family of rules, one for each number of vertices per horizon, and the sizes it runs at."""

    make: Callable[[float], Discretisation]
    name: str
    largest: float = np.inf  # vertices per horizon up to which it runs
    more: tuple[int, ...] = ()  # sizes beyond those of the study, where it needs them to get as far as others
    claims: bool = True  # to converge with h^2 at a fixed horizon, on a regular mesh


def fixed(
    scheme: Discretisation, largest: float = np.inf, claims: bool = False, more: tuple[int, ...] = ()
) -> Contestant:
    """One rule at every size."""
    return Contestant(lambda per_horizon: scheme, scheme.name, largest, more, claims)


def contestants(dim: int, quick: bool) -> list[Contestant]:
    """Return the schemes of a dimension. Those that grow with the mesh claim to converge; fixed balls do not."""
    balanced = Discretisation(PairRule(), balanced=True)
    pairs = [
        fixed(CLASSICAL, claims=True, more={1: (), 2: (192,), 3: (24, 32)}[dim]),
        fixed(balanced, claims=True, more={1: (), 2: (), 3: (24,)}[dim]),
    ]
    gauss = fixed(Discretisation(PairRule(points="gauss")), 64.5 if dim == 1 else 6.1 if dim == 2 else 2.1, claims=True)
    if dim == 1:

        def grown(**options: Any) -> Callable[[float], BallRule]:
            return lambda m: BallRule(max(3, round(4 * m)), 1, **options)

        ball, strong = grown(), grown(outer="vertices", symmetric=False)
        return [
            *pairs,
            gauss,
            Contestant(lambda m: Discretisation(ball(m), balanced=True), "ball 4 eps/h, balanced; consistent mass"),
            Contestant(
                lambda m: Discretisation(grown(symmetric=False)(m)),
                "ball 4 eps/h, one-sided; consistent mass",
                claims=False,
            ),
            Contestant(lambda m: Discretisation(ball(m), mass="lumped"), "ball 4 eps/h; lumped mass"),
            Contestant(lambda m: Discretisation(strong(m)), "ball 4 eps/h, strong form; lumped mass", claims=False),
            fixed(Discretisation(BallRule(3, 1))),
            fixed(Discretisation(BallRule(3, 1), balanced=True)),
            fixed(Discretisation(BallRule(3, 1, "vertices"), balanced=True)),
            fixed(Discretisation(BallRule(3, 1, symmetric=False))),
        ]
    if dim == 2:
        usual = [
            *pairs,
            fixed(Discretisation(CornerRule(), balanced=True), 16.1),
            gauss,
            fixed(Discretisation(BallRule(3, 8)), 8.1),
            fixed(Discretisation(BallRule(3, 8), balanced=True), 8.1),
            fixed(Discretisation(BallRule(3, 8, symmetric=False)), 8.1),
            fixed(Discretisation(BallRule(3, 8, "vertices"), balanced=True), 8.1),
            fixed(Discretisation(BallRule(4, 12, "vertices", symmetric=False)), 8.1),
        ]
        if quick:
            return usual
        return [
            *usual,
            fixed(Discretisation(BallRule(), balanced=True), 8.1, claims=True),
            fixed(Discretisation(BallRule(3, 8), mass="lumped"), 8.1),
            fixed(Discretisation(BallRule(4, 12), balanced=True), 6.1),
            fixed(Discretisation(BallRule(5, 16), balanced=True), 8.1),
            fixed(Discretisation(BallRule(5, 16, symmetric=False)), 8.1),
        ]
    if quick:
        return [
            pairs[0],
            gauss,
            fixed(Discretisation(BallRule(2, 13))),
            fixed(Discretisation(BallRule(2, 13, symmetric=False))),
        ]
    return [
        *pairs,
        fixed(Discretisation(CornerRule(), balanced=True), more=(24,)),
        gauss,
        fixed(Discretisation(BallRule(2, 13)), 3.1),
        fixed(Discretisation(BallRule(2, 13), balanced=True), 3.1),
        fixed(Discretisation(BallRule(2, 13, symmetric=False)), 3.1),
        fixed(Discretisation(BallRule(2, 13, "vertices"), balanced=True), 4.1),
        fixed(Discretisation(BallRule(3, 25)), more=(24,)),
        fixed(Discretisation(BallRule(3, 25), balanced=True), 3.1),
        fixed(Discretisation(BallRule(3, 25, symmetric=False)), more=(24,)),
    ]


@dataclass(frozen=True)
class Comparison:
    """Schemes against each other on one motion."""

    motion: Callable[[], Motion]
    sizes: tuple[int, ...]
    quick_sizes: tuple[int, ...]
    kinds: tuple[str, ...] = ("regular", "random", "graded")
    share: float = TIME_SHARE  # of the error that the time step may make
    far: bool = False  # whether schemes run at the sizes beyond these that they ask for

    def run(self, name: str, quick: bool, report: Report, known: Sequence[Row] = ()) -> Iterator[Row]:
        """Run it, but for the rows that are known."""
        motion = self.motion()
        there = {(row.mesh, row.scheme, row.n): row for row in known}
        constant = time_constant(motion)
        for kind in self.kinds[:2] if quick else self.kinds:
            for contestant in contestants(motion.dim, quick):
                for n in self.quick_sizes if quick else (*self.sizes, *(contestant.more if self.far else ())):
                    per_horizon = n * motion.horizon
                    if per_horizon > contestant.largest:
                        continue
                    if (kind, contestant.name, n) in there:
                        yield there[kind, contestant.name, n]
                        continue
                    scheme = contestant.make(per_horizon)
                    mesh = unit_box(motion.dim, n, kind)
                    try:
                        row = measure(motion, name, kind, mesh, n, scheme, constant, contestant.name, self.share)
                    except ValueError as error:  # a rule that does not go with this mesh
                        report(f"{kind}, {contestant.name}, eps/h = {per_horizon:.3g}: left out: {error}")
                        continue
                    report(
                        f"{kind}, {row.scheme}, eps/h = {per_horizon:.3g}: error {row.error_l2:.2e}, set-up "
                        f"{row.seconds_setup:.3g} s, {row.steps} steps {row.seconds_steps:.3g} s"
                    )
                    yield row


@dataclass(frozen=True)
class Study:
    """A study: what it is in one line, and how it runs."""

    what: str
    comparison: Comparison | None = None


def _smooth(dim: int, horizon: float, boundary: str | None = None, **options: Any) -> Callable[[], Motion]:
    return lambda: Manufactured(dim, horizon, law_of(dim, horizon), boundary, **options)


STUDIES: dict[str, Study] = {
    "smooth-1d": Study(
        "manufactured motion, nonlinear law, free boundary, 1D",
        Comparison(_smooth(1, 0.2, table=14), (20, 40, 80, 160), (20, 40, 80), share=0.03),
    ),
    "smooth-2d": Study(
        "manufactured motion, nonlinear law, free boundary, 2D",
        Comparison(_smooth(2, 0.125, table=12), (16, 32, 48, 64, 128), (16, 24), far=True),
    ),
    "smooth-3d": Study(
        "manufactured motion, nonlinear law, free boundary, 3D",
        Comparison(_smooth(3, 0.25, order=6, table=6), (8, 12, 16), (6, 8), far=True),
    ),
    "layer-1d": Study(
        "the same with the paper's boundary function, 1D",
        Comparison(_smooth(1, 0.2, "smooth", table=14), (40, 80, 160, 320), (40, 80, 160), share=0.03),
    ),
    "layer-2d": Study(
        "the same with the paper's boundary function, 2D",
        Comparison(_smooth(2, 0.125, "smooth", table=14), (16, 24, 32, 48), (16, 24), ("regular", "random")),
    ),
    "layer-3d": Study(
        "the same with the paper's boundary function, 3D",
        Comparison(_smooth(3, 0.25, "smooth", order=5, table=5), (8, 12), (6, 8), ("regular",)),
    ),
    "waves-1d": Study(
        "linear standing waves, exact by the dispersion relation, 1D",
        Comparison(
            lambda: StandingWave(1, 0.08, law_of(1, 0.08, True), 0.4), (25, 50, 100, 200), (25, 50, 100), share=0.03
        ),
    ),
    "waves-2d": Study(
        "linear standing shear waves, exact by the dispersion relation, 2D",
        Comparison(lambda: StandingWave(2, 0.1, law_of(2, 0.1, True), 0.5, "S"), (20, 30, 40, 60), (20, 30)),
    ),
    "local-2d": Study("eps -> 0 at fixed eps/h against scikit-fem's local elasticity, 2D"),
    "theorems": Study("the paper's estimates, their constants, and what is measured beside them"),
}


def run_study(
    name: str,
    quick: bool,
    report: Report,
    keep: Callable[[Result], None] | None = None,
    known: Sequence[Row] = (),
) -> Result:
    """Run a study by its name; ``keep`` gets the rows so far, ``known`` are rows that need not be run again.

    Raises ``KeyError`` for another name.
    """
    study = STUDIES[name]
    outcome = Result(name, study.what, quick)
    if study.comparison is not None:
        for row in study.comparison.run(name, quick, report, known):
            outcome.rows.append(row)
            if keep is not None:
                keep(outcome)
    elif name == "local-2d":
        from .theorems import local_tables

        outcome.tables = local_tables(quick, report)
    else:
        from .theorems import theorem_tables

        outcome.tables = theorem_tables(quick, report)
    return outcome
