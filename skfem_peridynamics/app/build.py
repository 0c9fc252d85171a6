"""From a scene to the objects of the library, each made when first asked for."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TypeVar

import numpy as np

from .._types import Basis, Csr, Floats, Load, Longs, Mesh
from ..bonds.bond_basis import BondBasis
from ..bonds.rules import PairRule
from ..geometry.layers import collar, named_facets, region
from ..geometry.simplices import check_simplices, vertex_volumes
from ..geometry.slit import Crack, slit
from ..material.calibration import Material, state
from ..model.kernels import block_bytes
from ..model.loads import layer_share, traction
from ..model.mass import mass_matrix
from ..model.peridynamics import Peridynamics
from ..solve.cfl import StepLimit, stable_time_step
from ..solve.constraints import Prescribed, check_fixed
from .formula import Formula
from .reading import SceneError
from .scene import LoadTable, MeshTable, Scene, Where

_T = TypeVar("_T")
_AXES = ("x", "y", "z")
_SPARE = 0.8  # of the free memory that a run may plan to take


def blame(path: str, make: Callable[[], _T]) -> _T:
    """Run ``make``; a ValueError becomes a SceneError that starts with the path of the key."""
    try:
        return make()
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None
    except ValueError as error:
        raise SceneError(f"{path}: {error}") from None


def read_mesh(path: Path) -> Mesh:
    """Return the simplicial mesh in a file that meshio reads; physical groups become boundaries and subdomains."""
    import skfem

    if not path.is_file():
        raise SceneError(f"mesh.file = {str(path)!r} is not a file")
    said = io.StringIO()  # meshio prints its reasons
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
            mesh = skfem.Mesh.load(str(path), ignore_orientation=True)
    except (SystemExit, Exception) as error:  # whatever a reader of a foreign format may raise
        reason = " ".join((said.getvalue() or str(error)).split())
        raise SceneError(f"mesh.file = {str(path)!r} cannot be read as a mesh: {reason}") from None
    blame(f"mesh.file = {str(path)!r}", lambda: check_simplices(mesh))
    return mesh


def make_mesh(spec: MeshTable, folder: Path) -> Mesh:
    """Return the mesh of a ``[mesh]`` table; a box has the boundaries left, right, bottom, top, front, back."""
    if spec.file is not None:
        mesh = read_mesh(folder / spec.file)
        return mesh if mesh.boundaries else _with_sides(mesh)
    assert spec.box is not None
    assert spec.divisions is not None
    import skfem

    nodes = np.prod([n + 1.0 for n in spec.divisions])
    if nodes * 400.0 > free_memory():
        raise SceneError(f"mesh.divisions = {list(spec.divisions)} makes {nodes:.3g} vertices, more than memory holds")
    grid = [np.linspace(low, high, n + 1) for (low, high), n in zip(spec.box, spec.divisions, strict=True)]
    kind = (skfem.MeshLine, skfem.MeshTri, skfem.MeshTet)[len(grid) - 1]
    return _with_sides(kind(grid[0]) if len(grid) == 1 else kind.init_tensor(*grid))


def _with_sides(mesh: Mesh) -> Mesh:
    """Name the facets on the sides of the bounding box."""
    names = (("left", "right"), ("bottom", "top"), ("front", "back"))
    facets = mesh.boundary_facets()
    middle = mesh.p[:, mesh.facets[:, facets]]
    sides = {}
    for axis, pair in enumerate(names[: mesh.dim()]):
        low, high = mesh.p[axis].min(), mesh.p[axis].max()
        for name, at in zip(pair, (low, high), strict=True):
            on = facets[(np.abs(middle[axis] - at) <= 1e-9 * (high - low)).all(axis=0)]
            if len(on):
                sides[name] = on
    return mesh.with_boundaries(sides)


def free_memory() -> float:
    """Return the bytes of memory that are free now, or infinity where the system does not tell."""
    try:
        with open("/proc/meminfo") as table:
            for line in table:
                if line.startswith("MemAvailable"):
                    return 1024.0 * float(line.split()[1])
    except OSError:
        pass
    try:
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (ValueError, OSError, AttributeError):
        return float("inf")


@dataclass(frozen=True, eq=False)
class Problem:
    """A scene made concrete. Nothing is built before it is asked for, and nothing that the scene does not name."""

    scene: Scene

    @cached_property
    def mesh(self) -> Mesh:
        mesh = make_mesh(self.scene.mesh, self.scene.folder)
        cracks = []
        for k, table in enumerate(self.scene.crack):
            if table.points is not None:
                points = table.points
                cracks.append(blame(f"crack[{k}].points", lambda points=points: Crack(points)))  # type: ignore[misc]
        tagged = [table.facets for table in self.scene.crack if table.facets is not None]
        if not self.scene.crack:
            return mesh
        return blame("crack", lambda: slit(mesh, *cracks, facets=tagged or None))

    @cached_property
    def basis(self) -> Basis:
        from skfem import Basis, ElementLineP1, ElementTetP1, ElementTriP1, ElementVector

        element = (ElementLineP1, ElementTriP1, ElementTetP1)[self.mesh.dim() - 1]()
        return Basis(self.mesh, ElementVector(element), intorder=2)

    @cached_property
    def material(self) -> Material:
        table = dataclasses.asdict(self.scene.material)
        material = blame("material", lambda: Material.from_elastic(**table))
        blame("material", lambda: state(self.mesh.dim(), material.plane))
        return material

    @cached_property
    def bonds(self) -> BondBasis:
        table = self.scene.bonds
        rule = PairRule(partial_volume=table.partial_volume)
        bonds = blame("bonds", lambda: BondBasis(self.basis, table.horizon, table.influence, rule, table.boundary_function))
        expected = self.expected_bonds
        need = self.expected_bytes
        if need > _SPARE * free_memory():
            raise SceneError(
                f"bonds.horizon = {table.horizon:g} makes about {expected:.3g} bonds, which need {need / 1e9:.3g} GB; "
                f"{free_memory() / 1e9:.3g} GB are free: take a smaller horizon or a coarser mesh"
            )
        blame("bonds", lambda: bonds.bonds)
        return bonds

    @cached_property
    def expected_bonds(self) -> int:
        rule = PairRule(partial_volume=self.scene.bonds.partial_volume)
        return rule.estimate(self.mesh, self.scene.bonds.horizon)

    @property
    def expected_bytes(self) -> int:
        """Memory of the run: bonds as listed and as blocks, search and temporary arrays, fields."""
        dim = self.mesh.dim()
        return self.expected_bonds * (16 + 24) + block_bytes(self.expected_bonds, dim) + 60 * 8 * dim * self.mesh.nvertices

    @cached_property
    def body(self) -> Peridynamics:
        material = self.material
        spared = [self.vertices(table, f"no_fail[{k}]") for k, table in enumerate(self.scene.no_fail)]
        no_fail = np.unique(np.concatenate(spared)) if spared else None
        body = Peridynamics(self.bonds, material, no_fail=no_fail)
        blame("material", lambda: body.law)
        return body

    @cached_property
    def mass(self) -> Csr:
        return mass_matrix(self.basis, density=self.scene.material.density)

    @cached_property
    def limit(self) -> StepLimit:
        return blame("bonds", lambda: stable_time_step(self.body, self.mass))

    @property
    def dt(self) -> float:
        """The step: as given, or the safe part of the limit, shortened so that a whole number of them fits."""
        time = self.scene.time
        dt = time.step if time.step is not None else time.safety * self.limit.dt
        if dt > time.until:
            dt = time.until
        return time.until / int(np.ceil(time.until / dt - 1e-9))

    def vertices(self, where: Where, path: str) -> Longs:
        """Return the vertices a table selects. Raises :class:`SceneError` when there are none."""
        if where.on is not None:
            found = blame(f"{path}.on", lambda: collar(self.mesh, where.on, where.width or 0.0))
        elif where.region is not None:
            found = blame(f"{path}.region", lambda: region(self.mesh, where.region))
        else:
            assert where.where is not None
            formula = where.where
            found = np.flatnonzero(blame(f"{path}.where", lambda: formula(self.mesh.p)) > 0.0)
        if not len(found):
            raise SceneError(f"{path} selects no vertex: the set is empty")
        return found

    @cached_property
    def fixed(self) -> list[Prescribed]:
        out: list[Prescribed] = []
        dim = self.mesh.dim()
        for k, table in enumerate(self.scene.fixed):
            path = f"fixed[{k}]"
            if table.component != "all" and _AXES.index(table.component) >= dim:
                raise SceneError(f"{path}.component = {table.component!r}: the body has {dim} dimensions")
            axes = range(dim) if table.component == "all" else [_AXES.index(table.component)]
            vertices = self.vertices(table, path)
            points, each = self.mesh.p[:, vertices], len(list(axes))
            dofs = (vertices[:, None] * dim + np.array(list(axes))).ravel()
            name = "displacement" if table.displacement is not None else "velocity"
            formula = getattr(table, name)
            blame(f"{path}.{name}", lambda formula=formula, points=points: formula(points, 0.0))  # type: ignore[misc]
            motion = _motion(formula, points, each)
            out.append(Prescribed(dofs, **{name: motion}))
        blame("fixed", lambda: check_fixed(out, self.basis.N))
        return out

    @cached_property
    def load(self) -> Load | None:
        """The load vector as a function of time, or None where the scene has none."""
        constant = np.zeros(self.basis.N)
        moving: list[tuple[Floats, tuple[Formula, ...]]] = []
        p = self.mesh.p
        for k, table in enumerate(self.scene.load):
            path = f"load[{k}]"
            vector = table.body if table.body is not None else table.traction
            assert vector is not None
            name = f"{path}.{'body' if table.body is not None else 'traction'}"
            self._components(vector, name)
            first = blame(name, lambda vector=vector: np.stack([f(p, 0.0) for f in vector]))  # type: ignore[misc]
            if any(f.uses("t") for f in vector):
                moving.append((self._share(table, path), vector))
            elif table.traction is not None and table.layer is None:
                on = table.on
                constant += blame(path, lambda on=on, f=first: self._traction(on, f))  # type: ignore[misc]
            else:
                constant += (self._share(table, path) * first).T.ravel()
        if not self.scene.load:
            return None
        if not moving:
            return lambda t: constant

        def at(t: float) -> Floats:
            total = constant.copy()
            for share, vector in moving:
                total += (share * np.stack([f(p, t) for f in vector])).T.ravel()
            return total

        return at

    def _traction(self, on: str | None, values: Floats) -> Floats:
        mesh = self.mesh
        return traction(self.basis, on, lambda x: values[:, mesh.facets[:, named_facets(mesh, on)]])

    def _share(self, table: LoadTable, path: str) -> Floats:
        """What each vertex carries of a unit load: volume, area, or a part of a layer."""
        if table.body is not None:
            return vertex_volumes(self.mesh)
        if table.layer is not None:
            width = table.layer
            return blame(path, lambda: layer_share(self.basis, table.on, width))
        unit = np.eye(self.mesh.dim())[0]
        return blame(path, lambda: traction(self.basis, table.on, unit))[:: self.mesh.dim()]

    def _components(self, vector: tuple[Formula, ...], path: str) -> None:
        if len(vector) != self.mesh.dim():
            raise SceneError(f"{path} has {len(vector)} components; the body has {self.mesh.dim()} dimensions")

    def _initial(self, name: str) -> Floats | None:
        vector: tuple[Formula, ...] | None = getattr(self.scene.initial, name)
        if vector is None:
            return None
        self._components(vector, f"initial.{name}")
        return blame(f"initial.{name}", lambda: np.stack([f(self.mesh.p) for f in vector])).T.ravel()

    @cached_property
    def u0(self) -> Floats | None:
        return self._initial("displacement")

    @cached_property
    def v0(self) -> Floats | None:
        return self._initial("velocity")


def _motion(formula: Formula, points: Floats, each: int) -> float | Floats | Callable[[float], Floats]:
    if formula.uses("t"):
        return lambda t: np.repeat(formula(points, t), each)
    if formula.uses("x", "y", "z"):
        return np.repeat(formula(points), each)
    return float(formula(points[:, :1])[0])
