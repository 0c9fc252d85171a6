"""From a scene to the objects of the library, each made when first asked for."""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from ..._memory import free_memory
from ..._types import Basis, Csr, Floats, Load, Longs, Mesh
from ...bonds.ball_rule import BallRule
from ...bonds.bond_basis import BondBasis
from ...bonds.rule import Rule
from ...geometry.slit import Crack, facets_on, slit
from ...material.composite import Composite
from ...material.influence import as_influence
from ...material.material import Material
from ...model.breaking import Breaking
from ...model.discretisation import Scheme
from ...model.mass import mass_matrix
from ...model.peridynamics import Peridynamics
from ...model.space import vector_basis
from ...solve.cfl import StepLimit, stable_time_step
from ...solve.constraints import Prescribed
from ...solve.newton import Effort
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene, Where
from . import conditions
from .cost import PER_IMPLICIT_STEP, PRODUCTS, SPARE, memory_of_run, worth_compiling
from .domain import make_mesh, tag, tagged, vertices

if TYPE_CHECKING:
    from ...study.choose_rule import Choice

_log = logging.getLogger("skfem_peridynamics")
_MOST_STEPS = 1e10


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene made concrete. Nothing is built before it is asked for, and nothing that the scene does not name.

    ``refinements`` refines its mesh uniformly, at the same horizon; a ``known_limit`` is not computed again.
    """

    scene: Scene
    refinements: int = 0
    known_limit: StepLimit | None = None

    @cached_property
    def mesh(self) -> Mesh:
        return self._unrefined.refined(self.refinements) if self.refinements else self._unrefined

    @cached_property
    def _unrefined(self) -> Mesh:
        """The mesh with its cracks; refinement keeps their faces apart, for it goes by elements."""
        mesh = make_mesh(self.scene.mesh, self.scene.folder)
        cuts: list[str | Longs] = []
        for k, table in enumerate(self.scene.crack):
            if table.points is not None:
                with blame(f"crack[{k}].points"):
                    cuts.append(facets_on(mesh, Crack(table.points)))
            elif table.facets is not None:
                cuts.append(table.facets)
        if self.scene.crack:
            with blame("crack"):
                mesh = slit(mesh, facets=cuts)
        return tagged(mesh, self.scene) if self.scene.inclusion else mesh

    @cached_property
    def basis(self) -> Basis:
        if self.mass_kind == "consistent":
            return self.whole_basis
        # a run sums over bonds, not over elements: the basis only numbers, so one element is all it tabulates
        return vector_basis(self.mesh, elements=np.array([0]), intorder=1)

    @cached_property
    def whole_basis(self) -> Basis:
        """The basis with all elements tabulated, for what is integrated over the body."""
        return vector_basis(self.mesh)

    @cached_property
    def material(self) -> Material | Composite:
        """The material, or with inclusions what is where."""
        table = dataclasses.asdict(self.scene.material)
        between, _ = table.pop("between"), table.pop("breaking")
        with blame("material"):
            matrix = Material.from_elastic(**table)
        if not self.scene.inclusion:
            return matrix
        inclusions = {}
        for k, one in enumerate(self.scene.inclusion):
            given = {key: value for key, value in dataclasses.asdict(one).items() if value is not None}
            for name in ("region", "where"):
                given.pop(name, None)
            for pair in (("young", "lame"), ("toughness", "K_Ic")):
                if any(name in given for name in pair):  # one replaces the other
                    given = dict.fromkeys(pair) | given
            with blame(f"inclusion[{k}]"):
                inclusions[tag(one, k)] = matrix.with_(**given)
        composite = Composite(matrix, inclusions, between)
        with blame("inclusion"):
            composite.member_of(self._unrefined)
        return composite

    @property
    def materials(self) -> tuple[Material, ...]:
        return self.material.materials if isinstance(self.material, Composite) else (self.material,)

    @cached_property
    def bonds(self) -> BondBasis:
        table = self.scene.bonds
        with blame("bonds"):
            bonds = BondBasis(self.basis, table.horizon, table.influence, self.rule, table.boundary_function)
        extent = float(np.ptp(self.mesh.p, axis=1).max())
        if table.horizon > extent:
            _log.warning("bonds.horizon = %g is larger than the body, which measures %g", table.horizon, extent)
        self.check_memory()
        with blame("bonds"):
            _ = bonds.parts  # made here, where a vertex without a bond has a key to blame
            if self.form.balanced:
                bonds = bonds.balanced()
        return bonds

    @cached_property
    def form(self) -> Scheme:
        """The rule, its balance and the mass: as the scene says, or as the measured tables advise."""
        table = self.scene.bonds
        if table.rule == "auto":
            form = self.choice.scheme
        else:
            with blame("bonds"):
                form = Scheme(table.make_rule(), bool(table.balanced))
        return dataclasses.replace(form, mass=self.scene.time.mass)

    @cached_property
    def choice(self) -> Choice:
        """What ``rule = "auto"`` chooses on the mesh before refinement, and why; said in the log."""
        from ...study.choose_rule import choose

        scene, mesh = self.scene, self._unrefined
        influence = as_influence(scene.bonds.influence)
        dim = int(mesh.dim())
        with blame("material"):
            slope = max(one.law(dim, influence.moment(dim)).slope for one in self.materials)
        # in 1D the closed form knows no step: half the time a wave takes across the horizon is about it
        mean = influence.mean_inverse_power(1.0, dim)
        lam = 8.0 * slope * (mean if np.isfinite(mean) else 4.0) / (self.lightest * dim * scene.bonds.horizon**2)
        dt = scene.time.step or scene.time.part * 2.0 / np.sqrt(lam)
        chosen = choose(
            mesh,
            scene.bonds.horizon,
            fracturing=any(one.potential != "linear" for one in self.materials),
            tolerance=scene.bonds.tolerance,
            steps=scene.time.until / dt,
        )
        _log.warning('bonds.rule = "auto" takes %s', chosen.why)
        return chosen

    @property
    def rule(self) -> Rule:
        return self.form.rule

    @property
    def mass_kind(self) -> str:
        """Lumped, or consistent where Gauss points are outside: what each kind of bonds is accurate with."""
        return self.form.kind

    @property
    def scheme(self) -> str:
        """The name of the scheme, for the summary."""
        if self.scene.time.scheme == "static":
            return "statics"
        strong = isinstance(self.rule, BallRule) and not self.rule.symmetric and self.rule.outer == "vertices"
        form = "strong form" if strong else "weak form"
        named = "Newmark" if self.scene.time.scheme == "newmark" else "central difference"
        return f"{named}, {form}, {self.mass_kind} mass"

    @cached_property
    def expected_bonds(self) -> int:
        return self.rule.estimate(self.mesh, self.scene.bonds.horizon)

    @property
    def expected_bytes(self) -> int:
        """Memory of the run."""
        return memory_of_run(self.mesh, self.rule, self.expected_bonds, self.form.balanced)

    def check_memory(self) -> None:
        """Raise :class:`SceneError` where the run would take more memory than there is."""
        need, free = self.expected_bytes, free_memory()
        if need > SPARE * free:
            raise SceneError(
                f"bonds.horizon = {self.scene.bonds.horizon:g} makes about {self.expected_bonds:.3g} bonds, which need "
                f"{need / 1e9:.3g} GB; {free / 1e9:.3g} GB are free: take a smaller horizon or a coarser mesh"
            )

    @cached_property
    def resting(self) -> Peridynamics:
        """The body for what is asked of it at rest, the step limit before all: some forty products."""
        spared = [self.vertices(table, f"no_fail[{k}]") for k, table in enumerate(self.scene.no_fail)]
        no_fail = np.unique(np.concatenate(spared)) if spared else None
        breaking = self.scene.material.breaking
        body = Peridynamics(self.bonds, self.material, no_fail=no_fail)
        if breaking is not None:
            with blame("material"):
                body = Breaking(self.bonds, self.material, no_fail=no_fail, at=breaking)
        with blame("material"):
            _ = body.laws
        return body if worth_compiling(self.bonds.nbonds, PRODUCTS) else body.with_(compiled=False)

    @cached_property
    def body(self) -> Peridynamics:
        """The body that is stepped: by compiled loops where they save more than it takes to load them."""
        evaluations = self.scene.time.until / self.dt * (1 if self.explicit else PER_IMPLICIT_STEP)
        worth = worth_compiling(self.bonds.nbonds, evaluations)
        return self.resting.with_(compiled=None if worth else False)

    @cached_property
    def mass(self) -> Csr:
        material = self.material
        density = material.density_on(self.mesh) if isinstance(material, Composite) else material.density
        return mass_matrix(self.basis, density=density, kind=self.mass_kind)

    @property
    def lightest(self) -> float:
        """The smallest density."""
        return min(one.density for one in self.materials)

    @cached_property
    def limit(self) -> StepLimit:
        if self.known_limit is not None:
            return self.known_limit
        with blame("bonds"):
            return stable_time_step(self.resting, self.mass)

    @property
    def dt(self) -> float:
        """The step: as given, or the safe part of the limit, shortened so that a whole number of them fits."""
        time = self.scene.time
        if time.steps is not None:
            if time.steps > _MOST_STEPS:
                raise SceneError(f"time.steps = {time.steps} would never end; take at most {_MOST_STEPS:g}")
            return time.until / time.steps
        dt = time.step if time.step is not None else time.part * self.limit.dt
        if time.until > _MOST_STEPS * dt:
            steps = time.until / dt
            raise SceneError(f"time.until = {time.until:g} takes {steps:.3g} steps of {dt:.3g}; that would never end")
        if time.step is None:
            return self.limit.step_for(time.until, time.part)
        return time.until / max(1, ceil(time.until / dt - 1e-9))

    @cached_property
    def effort(self) -> Effort:
        """What implicit steps and equilibria have cost so far."""
        return Effort()

    @property
    def explicit(self) -> bool:
        """Whether the scheme has a stable limit, which is then computed."""
        return self.scene.time.scheme not in ("newmark", "static")

    def vertices(self, where: Where, path: str) -> Longs:
        """Return the vertices a table selects. Raises :class:`SceneError` when there are none."""
        return vertices(self.mesh, where, path)

    @cached_property
    def fixed(self) -> list[Prescribed]:
        return conditions.fixed(self.scene, self.basis)

    @cached_property
    def load(self) -> Load | None:
        """The load vector as a function of time, or None where the scene has none."""
        return conditions.load(self.scene, self.basis)

    @cached_property
    def u0(self) -> Floats | None:
        return conditions.initial(self.scene, self.basis, "displacement")

    @cached_property
    def v0(self) -> Floats | None:
        return conditions.initial(self.scene, self.basis, "velocity")
