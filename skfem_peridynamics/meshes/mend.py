"""Meshes as they come from meshers, made fit: what can be mended is, with a note; what cannot is refused.

Mended: quadratic cells, quadrilaterals and polyhedra (to simplices), elements listed twice, elements of no volume with
a vertex twice, vertices of no element, elements turned inside out, a plane mesh that does not lie in x and y. Refused:
elements that overlap, facets of more than two elements, elements of no volume, surfaces in space.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .._memory import free_memory
from .._types import Bools, Floats, Ints, Longs, Mesh
from ..geometry.boxes import mesh_class
from ..geometry.connected import connected
from ..geometry.simplices import check_simplices, describe_point
from .cells import kind_of, to_simplices
from .manifold import check_manifold, facet_numbers, parts_of, unique_rows

Tags = Mapping[str, Sequence[Longs | None]]
_FLAT = 1e-9  # of the extent: what coordinates of a plane mesh differ by
_NAMES = {1: "line", 2: "triangle", 3: "tetrahedron"}


@dataclass(frozen=True, eq=False)
class Raw:
    """A mesh file: points (n, k), blocks of cells (kind by its name in meshio, vertices (m, l)).

    ``tags`` lists, for each name and block, the cells that have it; ``points_of`` the vertices of named sets of them.
    ``declared`` are the names that the file announces, with their dimensions; ``cure`` says what to do where one of
    them comes to nothing.
    """

    points: Floats
    blocks: Sequence[tuple[str, Longs]]
    tags: Tags
    points_of: Mapping[str, Longs]
    declared: Sequence[tuple[str, int]] = ()
    cure: str = "look at the groups where the mesh was made"
    notes: Sequence[str] = ()


@dataclass(frozen=True, eq=False)
class Mended:
    """A mesh of simplices with its groups as boundaries and subdomains, and what was done to get there.

    A boundary or subdomain that the file announces and that came to nothing is there, and empty: to use it is an error.
    ``lost`` are names of other groups that came to nothing.
    """

    mesh: Mesh
    notes: tuple[str, ...]
    lost: tuple[str, ...] = ()


def mend(raw: Raw, join: bool = False) -> Mended:
    """Return the simplicial mesh of a file. ``join`` makes one vertex of those that coincide.

    Groups of elements become subdomains, groups of facets (also of vertices, for all facets of the boundary between
    them) boundaries. Raises ``ValueError`` for a mesh that cannot be mended.

    >>> square = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1], [9, 9]])
    >>> blocks = [("quad", np.array([[0, 1, 2, 3]])), ("line", np.array([[0, 1]]))]
    >>> found = mend(Raw(square, blocks, {"steel": [np.array([0]), None], "low": [None, np.array([0])]}, {}))
    >>> found.mesh.nelements, list(found.mesh.boundaries), found.mesh.subdomains["steel"].tolist()
    (2, ['low'], [0, 1])
    >>> found.notes
    ('1 quad element was cut into 2 triangles', '1 vertex of no element was left out')
    """
    notes: list[str] = [*raw.notes]
    dim = max((kind_of(name)[1] for name, cells in raw.blocks if len(cells)), default=0)
    if not dim:
        raise ValueError("it has no elements: no lines, triangles or tetrahedra")
    points = _plane(raw.points, raw.blocks, dim, notes)
    size = len(raw.tags) * sum(len(cells) for _, cells in raw.blocks)
    if size > free_memory():
        raise ValueError(
            f"its {len(raw.tags)} groups of elements take {size / 1e6:.3g} MB, and {free_memory() / 1e6:.3g} MB "
            "are free"
        )
    merged = _merged(points, notes) if join else np.arange(len(points))
    elements, marks = _collect(raw, dim, merged, notes)
    facets, facet_marks = _collect(raw, dim - 1, merged, [])
    elements, marks = _without_repeats(elements, marks, dim, notes)
    used, t = np.unique(elements, return_inverse=True)
    t = t.reshape(elements.shape)
    middle = sum(kind_of(name)[2] and kind_of(name)[1] == dim for name, _ in raw.blocks)
    left = len(np.setdiff1d(merged, used)) if not middle else 0
    if left:
        notes.append(f"{_some(left, 'vertex', 'vertices')} of no element {_was(left)} left out")
    p = np.ascontiguousarray(points[used].T)
    t = _turned(p, t, notes)
    mesh = _mesh(p, t, dim)
    check_simplices(mesh)
    check_manifold(mesh)
    number = np.full(len(points), -1, dtype=np.int64)
    number[used] = np.arange(len(used))
    lost: list[str] = []
    boundaries = _boundaries(mesh, number[facets] if len(facets) else facets, facet_marks, notes)
    for name, chosen in raw.points_of.items():
        if name not in boundaries:
            numbers = _between(mesh, number[merged[chosen]])
            if len(numbers):
                boundaries[name] = numbers
            else:
                lost.append(name)
                notes.append(f"the set of points {name!r} has no facet of the boundary between them, and was left out")
    subdomains = {name: np.flatnonzero(is_of).astype(np.int32) for name, is_of in marks.items() if is_of.any()}
    for name in raw.tags:
        if name not in subdomains and name not in boundaries:
            lost.append(name)
            notes.append(f"the group {name!r} is of neither elements nor facets of the body, and was left out")
    for name, own_dim in raw.declared:
        groups, what = (subdomains, "elements") if own_dim == dim else (boundaries, "facets of the boundary")
        if own_dim in (dim, dim - 1) and name not in groups:
            groups[name] = np.zeros(0, dtype=np.int32)
            notes.append(f"the group {name!r} is declared and has no {what}: {raw.cure}")
    notes += parts_of(mesh)
    if boundaries:
        mesh = mesh.with_boundaries(boundaries)
    return Mended(mesh.with_subdomains(subdomains) if subdomains else mesh, tuple(notes), tuple(lost))


def _some(count: int, noun: str, more: str | None = None) -> str:
    return f"{count} {noun if count == 1 else more or noun + 's'}"


def _was(count: int) -> str:
    return "was" if count == 1 else "were"


def _mesh(p: Floats, t: Longs, dim: int) -> Mesh:
    return mesh_class(dim)(p, np.ascontiguousarray(t.T.astype(np.int32)))


def _plane(points: Floats, blocks: Sequence[tuple[str, Longs]], dim: int, notes: list[str]) -> Floats:
    """The first coordinates; those of a plane that is not x and y take their place. Refuses surfaces in space."""
    corners = np.unique(np.concatenate([cells.ravel() for name, cells in blocks if kind_of(name)[1] == dim]))
    spread = np.ptp(points[corners], axis=0)
    wide = np.flatnonzero(spread > _FLAT * spread.max())
    if len(wide) > dim:
        raise ValueError(
            f"its {_NAMES[dim]} elements have {dim} dimensions, its points spread over "
            f"{describe_point(spread)}; a surface or a curve in space is not a body"
        )
    if len(wide) == dim and points.shape[1] > dim and wide.max() >= dim:
        axes = " and ".join("xyz"[k] for k in wide)
        notes.append(f"its points lie along {axes}, which {_was(dim)} taken for {' and '.join('xyz'[:dim])}")
        return points[:, wide]
    return points[:, :dim]


def _merged(points: Floats, notes: list[str]) -> Longs:
    """The vertex that stands for each, where several coincide."""
    from scipy.spatial import cKDTree

    near = cKDTree(points).query_pairs(_FLAT * float(np.ptp(points, axis=0).max()), output_type="ndarray")
    _, piece = connected(near.T.astype(np.int32), len(points)) if len(near) else (0, np.arange(len(points)))
    first = np.unique(piece, return_index=True)[1]
    count = len(points) - len(first)
    if count:
        notes.append(f"{_some(count, 'vertex', 'vertices')} {_was(count)} joined to others at the same place")
    return np.asarray(first[piece], dtype=np.int64)


def _collect(raw: Raw, dim: int, merged: Longs, notes: list[str]) -> tuple[Longs, dict[str, Bools]]:
    """All cells of a dimension as simplices, (n, dim + 1), and which of them each group has."""
    pieces = [np.empty((0, dim + 1), dtype=np.int64)]
    marks: dict[str, list[Bools]] = {name: [np.zeros(0, dtype=bool)] for name in raw.tags}
    straight, cut, counts = Counter[str](), Counter[str](), Counter[str]()
    for k, (name, cells) in enumerate(raw.blocks):
        kind, of_dim, quadratic = kind_of(name)
        if of_dim != dim or not len(cells):
            continue
        simplices, owner = to_simplices(name, merged[cells])
        if quadratic:
            straight[name] += len(cells)
        if kind not in ("line", "triangle", "tetra"):
            cut[kind] += len(cells)
            counts[kind] += len(simplices)
        pieces.append(simplices)
        for tag, blocks in raw.tags.items():
            has, block = np.zeros(len(cells), dtype=bool), blocks[k] if k < len(blocks) else None
            if block is not None and len(block):
                has[block] = True
            marks[tag].append(has[owner])
    for name, count in straight.items():
        notes.append(f"{_some(count, name + ' element')} lost the middle nodes: elements are straight here")
    for kind, count in cut.items():
        into = _some(counts[kind], _NAMES[dim]).replace("drons", "dra")
        notes.append(f"{_some(count, kind + ' element')} {_was(count)} cut into {into}")
    return np.concatenate(pieces), {tag: np.concatenate(parts) for tag, parts in marks.items()}


def _without_repeats(t: Longs, marks: dict[str, Bools], dim: int, notes: list[str]) -> tuple[Longs, dict[str, Bools]]:
    """Elements once each, with the groups of all that were the same, and without those that have a vertex twice."""
    ordered = np.sort(t, axis=1)
    crushed = (ordered[:, 1:] == ordered[:, :-1]).any(axis=1)
    if crushed.any():
        n = int(crushed.sum())
        notes.append(f"{_some(n, 'element')} with a vertex twice {_was(n)} left out")
        t, ordered = t[~crushed], ordered[~crushed]
        marks = {name: has[~crushed] for name, has in marks.items()}
    if not len(t):
        raise ValueError("it has no elements of any volume")
    first, same = unique_rows(ordered)
    merged = {}
    idle = np.ones(len(t), dtype=bool)  # listed again without a group that the first of them lacks
    idle[first] = False
    for name, has in marks.items():
        merged[name] = np.zeros(len(first), dtype=bool)
        merged[name][same[has]] = True
        idle &= ~(has & ~has[first][same])
    twice = int(idle.sum())
    if twice:
        notes.append(f"{_some(twice, 'element')} listed twice {_was(twice)} taken once")
    return t[first], merged


def _turned(p: Floats, t: Longs, notes: list[str]) -> Longs:
    """Elements of positive volume."""
    edges = p[:, t[:, 1:]] - p[:, t[:, :1]]
    negative = np.linalg.det(np.moveaxis(edges, 0, 2)) < 0.0
    if negative.any() and not negative.all():
        n = int(min(negative.sum(), (~negative).sum()))
        notes.append(f"{_some(n, 'element')} of {len(t)}, turned inside out, {_was(n)} turned back")
    t = t.copy()
    t[negative, -2:] = t[negative, -2:][:, ::-1]
    return t


def _boundaries(mesh: Mesh, facets: Longs, marks: dict[str, Bools], notes: list[str]) -> dict[str, Ints]:
    if not len(facets):
        return {}
    number = facet_numbers(mesh, facets)
    out = {}
    for name, has in marks.items():
        if not has.any():
            continue
        values = np.unique(number[has & (number >= 0)])
        stray = int((has & (number < 0)).sum())
        if stray:
            notes.append(f"{_some(stray, 'facet')} of the group {name!r}, of no element, {_was(stray)} left out")
        if len(values):
            out[name] = values.astype(np.int32)
    return out


def _between(mesh: Mesh, vertices: Longs) -> Ints:
    """Facets of the boundary all of whose vertices are given."""
    has = np.zeros(int(mesh.nvertices), dtype=bool)
    has[vertices[vertices >= 0]] = True
    outer = mesh.boundary_facets()
    return np.asarray(outer[has[mesh.facets[:, outer]].all(axis=0)], dtype=np.int32)
