"""From a scene to the objects of the library, each made when first asked for."""

from __future__ import annotations

import dataclasses
import logging
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from ..._types import Basis, Csr, Floats, Load, Longs, Mesh
from ...analysis.damage import Census, Damage, Intact, census, census_and_damage
from ...analysis.damage import damage as damage_of
from ...analysis.stress import stress
from ...bonds.ball_rule import BallRule
from ...bonds.bond_basis import BondBasis
from ...bonds.corner_rule import CornerRule
from ...bonds.rule import Rule
from ...material.composite import Composite
from ...material.influence import Influence, as_influence
from ...material.material import Material
from ...model.breaking import Breaking
from ...model.discretisation import Discretisation
from ...model.mass import mass_matrix
from ...model.peridynamics import Peridynamics
from ...model.rigidity import check_rigid
from ...model.space import numbering_basis, vector_basis
from ...solve.cfl import SAFETY, StepLimit, stable_time_step
from ...solve.constraints import Prescribed
from ...solve.newton import Effort
from ...solve.state import Equilibrium, State
from ..scene.reading import SceneError, blame
from ..scene.scene import Scene, Where
from . import conditions
from .cost import PER_IMPLICIT_STEP, PRODUCTS, check_memory, memory_of_run, worth_compiling
from .domain import cracked_mesh, vertices
from .materials import make_material

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
        """The mesh of the run, with its slits, refined as often as asked."""
        return self._unrefined.refined(self.refinements) if self.refinements else self._unrefined

    @cached_property
    def _unrefined(self) -> Mesh:
        return cracked_mesh(self.scene)

    @cached_property
    def basis(self) -> Basis:
        """The vector P1 basis; with a lumped mass only a numbering of its degrees of freedom."""
        if self.mass_kind == "consistent":
            return self.full_basis
        # a run sums over bonds, not over elements
        return numbering_basis(self.mesh)

    @cached_property
    def full_basis(self) -> Basis:
        """The basis with all elements tabulated, for what is integrated over the body."""
        return vector_basis(self.mesh)

    @cached_property
    def material(self) -> Material | Composite:
        """The material, or with inclusions what is where."""
        return make_material(self.scene, self._unrefined)

    @property
    def materials(self) -> tuple[Material, ...]:
        """All materials of the body, the matrix first."""
        return self.material.materials if isinstance(self.material, Composite) else (self.material,)

    @cached_property
    def bonds(self) -> BondBasis:
        """The bonds, made and balanced. Raises :class:`SceneError` where they would not fit into memory."""
        table = self.scene.bonds
        with blame("bonds"):
            bonds = BondBasis(self.basis, table.horizon, table.influence, self.rule, table.boundary_function)
        self.check_horizon()
        self.check_memory()
        with blame("bonds"):
            _ = bonds.parts  # made here, where a vertex without a bond has a key to blame
            if self.discretisation.balanced:
                bonds = bonds.balanced()
        return bonds

    def check_horizon(self) -> None:
        """Say in the log where the horizon is larger than the body."""
        horizon, extent = self.scene.bonds.horizon, float(np.ptp(self.mesh.p, axis=1).max())
        if horizon > extent:
            _log.warning("bonds.horizon = %g is larger than the body, which measures %g", horizon, extent)

    @cached_property
    def discretisation(self) -> Discretisation:
        """The rule, its balance and the mass: as the scene says, or as the measured tables advise."""
        table = self.scene.bonds
        if table.rule == "auto":
            discretisation = self.choice.scheme
        else:
            with blame("bonds"):
                discretisation = Discretisation(table.make_rule(), bool(table.balanced) or table.rule == "corners")
        return dataclasses.replace(discretisation, mass=self.scene.time.mass)

    @cached_property
    def choice(self) -> Choice:
        """What ``rule = "auto"`` chooses on the mesh before refinement, and why; said in the log."""
        from ...study.choose_rule import choose

        breakable = any(material.potential != "linear" for material in self.materials)
        chosen = choose(self._unrefined, self.scene.bonds.horizon, fracturing=breakable)
        _log.warning('bonds.rule = "auto" takes %s', chosen.why)
        return chosen

    @property
    def influence(self) -> Influence:
        """The influence function that the scene names."""
        return as_influence(self.scene.bonds.influence)

    @property
    def largest_slope(self) -> float:
        """The largest ``f'(0)`` of the materials with the exact moment, before there are bonds."""
        dim = int(self.mesh.dim())
        with blame("material"):
            return max(material.law(dim, self.influence.moment(dim)).slope for material in self.materials)

    @property
    def rule(self) -> Rule:
        """The rule of the double integral."""
        return self.discretisation.rule

    @property
    def rule_name(self) -> str:
        """The name of the rule, with the counts that it has on the mesh."""
        rule = self.rule
        if isinstance(rule, BallRule | CornerRule):  # its counts follow the mesh
            rule = rule.fitted(self.mesh, self.scene.bonds.horizon)
        return rule.name

    @property
    def mass_kind(self) -> str:
        """Lumped, or consistent where Gauss points are outside: what each kind of bonds is accurate with."""
        return self.discretisation.kind

    @property
    def scheme_name(self) -> str:
        """The name of the scheme, for the summary."""
        scheme = self.scene.time.scheme
        if scheme == "static":
            return "statics"
        form = "strong form" if self.discretisation.strong else "weak form"
        return f"{'Newmark' if scheme == 'newmark' else 'central difference'}, {form}, {self.mass_kind} mass"

    @cached_property
    def expected_bonds(self) -> int:
        """About how many bonds the rule makes, before it makes them."""
        return self.rule.estimate(self.mesh, self.scene.bonds.horizon)

    @cached_property
    def dilated(self) -> float:
        """By how much a dilatation beside the bonds can raise the largest eigenvalue, in parts; -1 without one."""
        dim, most = int(self.mesh.dim()), -1.0
        for material in self.materials:
            with blame("material"):
                law = material.law(dim, 1.0)
                beside = material.volumetric_energy(law, dim, 1.0)
            if beside is not None:
                shear = material.elastic(law, dim, 1.0).shear
                most = max(most, 0.0, dim * beside.modulus / (shear * (dim + 2)))
        return most

    @property
    def expected_bytes(self) -> int:
        """Memory of the run."""
        output, time = self.scene.output, self.scene.time
        steps = time.steps or (time.until / time.step if time.step else 0.0)
        return memory_of_run(
            self.mesh,
            self.rule,
            self.expected_bonds,
            self.discretisation.balanced,
            evaluations=PRODUCTS + steps * (1 if self.explicit else PER_IMPLICIT_STEP),
            pictures=output.pictures is not False and find_spec("matplotlib") is not None,
            dilated=self.dilated >= 0.0,
        )

    def check_memory(self) -> None:
        """Raise :class:`SceneError` where the run would take more memory than there is."""
        need = self.expected_bytes
        try:
            check_memory(need)
        except ValueError as error:
            raise SceneError(
                f"bonds.horizon = {self.scene.bonds.horizon:g} makes about {self.expected_bonds:.3g} bonds, {error}"
            ) from None

    @cached_property
    def no_fail(self) -> Longs | None:
        """The vertices all of whose bonds stay linear, None where the scene names none."""
        regions = [self.vertices(table, f"no_fail[{k}]") for k, table in enumerate(self.scene.no_fail)]
        return np.unique(np.concatenate(regions)) if regions else None

    @cached_property
    def body_at_rest(self) -> Peridynamics:
        """The body for what is asked of it at rest, the step limit before all: some forty products."""
        no_fail = self.no_fail
        breaking = self.scene.material.breaking
        with blame("material"):
            body = Peridynamics(self.bonds, self.material, no_fail=no_fail)
            if breaking is not None:
                body = Breaking(self.bonds, self.material, no_fail=no_fail, at=breaking)
        with blame("material"):
            _ = body.laws
        return body if worth_compiling(self.bonds.nbonds, PRODUCTS) else body.with_(compiled=False)

    @cached_property
    def body(self) -> Peridynamics:
        """The body that is stepped: by compiled loops where they save more than it takes to load them."""
        evaluations = self.scene.time.until / self.dt * (1 if self.explicit else PER_IMPLICIT_STEP)
        worth = worth_compiling(self.bonds.nbonds, evaluations)
        return self.body_at_rest.with_(compiled=None if worth else False)

    @cached_property
    def mass(self) -> Csr:
        """The lumped or consistent mass matrix."""
        material = self.material
        density = material.density_on(self.mesh) if isinstance(material, Composite) else material.density
        return mass_matrix(self.basis, density=density, kind=self.mass_kind)

    @property
    def smallest_density(self) -> float:
        """The smallest density."""
        return min(material.density for material in self.materials)

    @cached_property
    def limit(self) -> StepLimit:
        """The stable time step of the body at rest."""
        if self.known_limit is not None:
            return self.known_limit
        with blame("bonds"):
            return stable_time_step(self.body_at_rest, self.mass)

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
        taken = time.until / max(1, ceil(time.until / dt - 1e-9))
        if self.explicit and not time.above_limit and taken > (1.0 + 1e-9) * self.limit.dt:
            given = f"step = {time.step:g}" if time.step is not None else f"safety = {time.safety:g}"
            raise SceneError(
                f"time.{given} makes a step of {taken:.6g}, {taken / self.limit.dt:.4g} times the stable limit "
                f"{self.limit.dt:.6g}: the run would blow up; take at most that, or leave out both for "
                f"{SAFETY:g} of it (time.above_limit = true runs it all the same)"
            )
        return taken

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
        """The prescribed motions."""
        return conditions.fixed(self.scene, self.basis)

    @cached_property
    def load_terms(self) -> conditions.LoadTerms | None:
        """What the load is made of, or None where the scene has none."""
        return conditions.load_terms(self.scene, self.basis)

    @cached_property
    def load(self) -> Load | None:
        """The load vector as a function of time, or None where the scene has none."""
        return None if self.load_terms is None else self.load_terms.of(self.scene, self.mesh.p)

    def check_rigid(self) -> None:
        """Raise :class:`SceneError` where bonds leave a vertex or the whole body free to move."""
        with blame("bonds"):
            check_rigid(self.body_at_rest)

    def look(self, state: State | Equilibrium, count: bool, damage: bool) -> tuple[Census | None, Damage | None]:
        """Return the census and the damage at a state, those that are asked for, from one walk over the bonds."""
        if count and damage:
            return census_and_damage(self.body, state.u)
        return census(self.body, state.u) if count else None, damage_of(self.body, state.u) if damage else None

    def stress(self, state: State | Equilibrium) -> Floats:
        """Return the stress at the vertices at a state, (nvertices, dim, dim)."""
        return stress(self.body, state.u)

    def intact(self, count: Census) -> Floats:
        """Return the fraction of each vertex's bonds that are left after a census."""
        return self._intact.after(count)

    @cached_property
    def _intact(self) -> Intact:
        return Intact(self.body)

    @cached_property
    def u0(self) -> Floats | None:
        """The initial displacement (N,), or None where the scene has none."""
        return conditions.initial(self.scene, self.basis, "displacement")

    @cached_property
    def v0(self) -> Floats | None:
        """The initial velocity (N,), or None where the scene has none."""
        return conditions.initial(self.scene, self.basis, "velocity")
