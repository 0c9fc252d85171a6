"""What a scene does to its body: selected vertices, prescribed motions, loads, the initial state."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from ..._types import Basis, Csr, Floats, Load, Longs, Mesh
from ...geometry.simplices import describe_point, vertex_volumes
from ...model.loads import facet_mass, layer_share
from ...solve.constraints import FixedConflict, Prescribed, check_fixed
from ..scene.formula import Formula
from ..scene.reading import Mistakes, SceneError, blame
from ..scene.scene import FixedTable, LoadTable, Scene
from .domain import vertices

_AXES = ("x", "y", "z")


def fixed(scene: Scene, basis: Basis) -> list[Prescribed]:
    """Return the prescribed motions of a scene."""
    mesh = basis.mesh
    out: list[Prescribed] = []
    dim = mesh.dim()
    mistakes = Mistakes()
    for k, table in enumerate(scene.fixed):
        with mistakes.noted():
            out.append(_fixed(table, mesh, f"fixed[{k}]"))
    mistakes.tell()
    try:
        check_fixed(out, basis.N, scene.time.until)
    except FixedConflict as error:
        vertex, axis = divmod(error.dof, dim)
        raise SceneError(
            f"fixed[{error.first}] and fixed[{error.second}] both move {_AXES[axis]} of vertex {vertex} at "
            f"{describe_point(mesh.p[:, vertex])}, and not the same: {error.how}"
        ) from None
    return out


def _fixed(table: FixedTable, mesh: Mesh, path: str) -> Prescribed:
    """The motion of a table."""
    dim = int(mesh.dim())
    if table.component != "all" and _AXES.index(table.component) >= dim:
        raise SceneError(f"{path}.component = {table.component!r}: the body has {dim} dimensions")
    return motion_of(table, mesh, vertices(mesh, table, path), path)


def motion_of(table: FixedTable, mesh: Mesh, chosen: Longs, path: str) -> Prescribed:
    """Return the motion of a table for some vertices."""
    dim = int(mesh.dim())
    axes = range(dim) if table.component == "all" else [_AXES.index(table.component)]
    points, each = mesh.p[:, chosen], len(list(axes))
    dofs = (chosen[:, None] * dim + np.array(list(axes))).ravel()
    name = "displacement" if table.displacement is not None else "velocity"
    formula = getattr(table, name)
    with blame(f"{path}.{name}"):
        formula(points, 0.0)
    return Prescribed(dofs, **{name: _motion(formula, points, each)})


@dataclass(frozen=True, eq=False)
class LoadTerms:
    """The load of a scene: a constant vector (N,), and tables of formulas of time with what spreads their values.

    The matrices are (nvertices, vertices of the formulas).
    """

    constant: Floats
    moving: list[tuple[int, Csr]]

    def of(self, scene: Scene, p: Floats) -> Load:
        """Return the load vector as a function of time; ``p`` (dim, n) are the places of the formulas."""
        constant, moving = self.constant, [(spread, _vector(scene.load[k])) for k, spread in self.moving]
        if not moving:
            return lambda t: constant

        def at(t: float) -> Floats:
            total = constant.copy()
            for spread, vector in moving:
                total += (spread @ np.stack([f(p, t) for f in vector]).T).ravel()
            return total

        return at


def _vector(table: LoadTable) -> tuple[Formula, ...]:
    vector = table.body if table.body is not None else table.traction
    assert vector is not None
    return vector


def load_terms(scene: Scene, basis: Basis) -> LoadTerms | None:
    """Return what the load of a scene is made of, None where it has none."""
    mesh = basis.mesh
    terms = LoadTerms(np.zeros(basis.N), [])
    mistakes = Mistakes()
    for k, table in enumerate(scene.load):
        path, vector = f"load[{k}]", _vector(table)
        name = f"{path}.{'body' if table.body is not None else 'traction'}"
        with mistakes.noted():
            _components(mesh, vector, name)
            with blame(name):
                first = np.stack([f(mesh.p, 0.0) for f in vector])
            spread = _spread(basis, table, path)
            if any(f.uses("t") for f in vector):
                terms.moving.append((k, spread))
            else:
                terms.constant[:] += (spread @ first.T).ravel()
    mistakes.tell()
    return terms if scene.load else None


def _spread(basis: Basis, table: LoadTable, path: str) -> Csr:
    """The load of a field by its values at the vertices, (nvertices, nvertices): over the body, a layer or facets."""
    if table.body is not None:
        return sparse.diags_array(vertex_volumes(basis.mesh)).tocsr()
    with blame(path):
        if table.layer is not None:
            return sparse.diags_array(layer_share(basis, table.on, table.layer)).tocsr()
        return facet_mass(basis.mesh, table.on)


def _components(mesh: Mesh, vector: tuple[Formula, ...], path: str) -> None:
    if len(vector) != mesh.dim():
        raise SceneError(f"{path} has {len(vector)} components; the body has {mesh.dim()} dimensions")


def initial(scene: Scene, basis: Basis, name: str) -> Floats | None:
    """Return the initial ``displacement`` or ``velocity`` at the vertices, (N,), or None where the scene has none."""
    mesh = basis.mesh
    vector: tuple[Formula, ...] | None = getattr(scene.initial, name)
    if vector is None:
        return None
    _components(mesh, vector, f"initial.{name}")
    with blame(f"initial.{name}"):
        return np.stack([f(mesh.p) for f in vector]).T.ravel()


def _motion(formula: Formula, points: Floats, each: int) -> float | Floats | Callable[[float], Floats]:
    if formula.uses("t"):
        return lambda t: np.repeat(formula(points, t), each)
    if formula.uses("x", "y", "z"):
        return np.repeat(formula(points), each)
    return float(formula(points[:, :1])[0])
