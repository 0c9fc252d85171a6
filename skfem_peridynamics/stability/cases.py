"""The matrix of cases, by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .change_of_units import units
from .extreme_materials import any_strain, brittle_and_tough, contrasts
from .extreme_meshes import extreme_geometry, refusals
from .long_runs import a_million_linear_steps, near_softening
from .step_limit import around_the_limit
from .stiff_race import race
from .sudden_loads import both_ways, energy_balance
from .torn_plate import tear
from .verdicts import Verdict, Verdicts, reported


@dataclass(frozen=True)
class Case:
    """What is tried, in one line, and how."""

    what: str
    runs: tuple[Callable[[Verdicts, bool], None], ...]


CASES: dict[str, Case] = {
    "limit": Case("steps of 0.90 to 1.01 of the stable limit", (around_the_limit,)),
    "long": Case("a million linear steps, a hundred thousand near softening", (a_million_linear_steps, near_softening)),
    "geometry": Case("horizons and meshes that no one should make", (extreme_geometry, refusals)),
    "contrast": Case("stiffness 1:1e8 and density 1:1e6 between subdomains", (contrasts,)),
    "brittle": Case("toughness from 1e-250 to 1e250", (brittle_and_tough,)),
    "strains": Case("strains from 1e-300 to 1e150, and round-off", (any_strain,)),
    "units": Case("one run in many units", (units,)),
    "loads": Case("impulses, pulses, reversal and unloading", (energy_balance,)),
    "tear": Case("a plate torn in two, quasi-statically", (tear,)),
    "both": Case("explicit and implicit steps as dt -> 0", (both_ways,)),
    "race": Case("stiff scenes: seconds to 1 % error", (race,)),
}


def run_cases(names: Sequence[str], quick: bool, report: Callable[[Verdict], None]) -> Verdicts:
    """Run some cases; what fails with an exception does not hold, and the next case goes on.

    >>> verdicts = run_cases(["strains"], quick=True, report=lambda verdict: None)
    >>> verdicts.holds, len(verdicts.entries) > 10
    (True, True)
    """
    verdicts = Verdicts(report)
    for name in names:
        for case in CASES[name].runs:
            with reported(verdicts, name, case.__name__.replace("_", " "), "runs to its end"):
                case(verdicts, quick)
    return verdicts
