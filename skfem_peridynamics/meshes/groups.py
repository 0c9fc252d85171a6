"""The groups of a mesh file, by name: what meshio calls cell sets, field data, cell data and point sets."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._types import Longs
from .mend import Raw

# integers that some formats keep for each cell; one that is 0 is of no group
_NUMBERED = ("gmsh:physical", "medit:ref", "nastran:ref", "flac3d:group", "tetgen:ref", "avsucd:material", "cell_tags")
# what people call them elsewhere; the first of these that a file has is taken
_COMMON = (
    *("material", "materials", "MaterialIds", "MaterialID", "material_id", "region", "regions", "RegionId"),
    *("CellEntityIds", "attribute", "label", "labels", "name_to_read"),
)
# integers that are no groups, and are passed over without a word
_PASSED = ("gmsh:geometrical", "gmsh:element_id", "vtkOriginalCellIds", "vtkGhostType")
_NOT_GROUPS = ("gmsh:bounding_entities",)
# facets of elements in the order in which scikit-fem counts them
_FACETS = {
    "line": ((0,), (1,)),
    "triangle": ((0, 1), (1, 2), (0, 2)),
    "tetra": ((0, 1, 2), (0, 1, 3), (0, 2, 3), (1, 2, 3)),
}


def raw_mesh(content: Any, scale: float = 1.0) -> Raw:
    """Return points, cells and groups of what meshio has read; points times ``scale``."""
    blocks = [(block.type, np.asarray(block.data)) for block in content.cells]
    tags: dict[str, list[Longs | None]] = {}
    for name, parts in content.cell_sets.items():
        if name not in _NOT_GROUPS:
            tags[str(name)] = [None if part is None else np.asarray(part, dtype=np.int64) for part in parts]
    _add_skfem_tags(content, blocks, tags)
    known = {(int(entry[0]), int(entry[1])): str(name) for name, entry in content.field_data.items() if len(entry) > 1}
    for key in _used_numbers(content, bool(tags)):
        _add_numbered(content, key, known, tags)
    points_of = {str(name): np.asarray(part, dtype=np.int64) for name, part in content.point_sets.items()}
    return Raw(
        np.asarray(content.points, dtype=float) * scale,
        blocks,
        tags,
        points_of,
        notes=[*getattr(content, "notes", ()), *_unread(content, bool(content.cell_sets))],
    )


def _used_numbers(content: Any, has_sets: bool) -> list[str]:
    """The integers of cells that are taken for groups."""
    # where gmsh's groups are sets already, the numbers say less
    fit = [key for key, parts in content.cell_data.items() if all(map(_are_whole, parts))]
    own = [key for key in _NUMBERED if key in fit and not (has_sets and key == "gmsh:physical")]
    return own or [key for key in _COMMON if key in fit][:1]


def _unread(content: Any, has_sets: bool) -> list[str]:
    """Notes of integers of the cells that are taken for no groups, and of what is called as they are and is none."""
    used = _used_numbers(content, has_sets)
    fractions = [
        f"the numbers {key!r} of its elements are not whole, and are not taken for groups"
        for key, parts in content.cell_data.items()
        if key in (*_COMMON, *_NUMBERED) and not all(map(_are_whole, parts))
    ]
    return fractions + [
        f"the integers {key!r} of its elements are not taken for groups; "
        + (f"{used[0]!r} are" if used else f"they would be under one of the names {', '.join(_COMMON)}")
        for key, parts in content.cell_data.items()
        if key not in (*used, *_PASSED, *_NUMBERED)
        and not key.startswith("skfem:")
        and all(np.asarray(part).dtype.kind in "iu" and np.asarray(part).size == len(part) for part in parts)
    ]


def _are_whole(values: Any) -> bool:
    """Whether values can be the numbers of groups."""
    values = np.asarray(values)
    return values.dtype.kind in "iu" or (values.dtype.kind == "f" and bool((values == np.rint(values)).all()))


def _add_numbered(
    content: Any, key: str, known: dict[tuple[int, int], str], tags: dict[str, list[Longs | None]]
) -> None:
    """Groups of cells with the same number, by the name of the number where it has one."""
    highest = max((block.dim for block in content.cells if len(block.data)), default=0)
    for k, values in enumerate(content.cell_data.get(key, ())):
        values = np.asarray(values)
        if values.ndim == 2 and values.shape[1] == 1:
            values = values[:, 0]
        if values.ndim != 1 or not _are_whole(values):
            continue
        dim = content.cells[k].dim
        # the tools that have a number for each region count from 0, those that tag some cells have 0 for none
        counted = key in _COMMON and dim == highest
        for number in np.unique(values if counted else values[values != 0]).tolist():
            # the families of MED have several names each, and a name several families
            families = getattr(content, "cell_tags", {}).get(int(number)) if key == "cell_tags" else None
            for name in families or [known.get((number, dim), str(int(number)))]:
                cells = np.flatnonzero(values == number)
                before = tags.setdefault(name, [None] * len(content.cells))[k]
                tags[name][k] = cells if before is None else np.union1d(before, cells)


def _add_skfem_tags(content: Any, blocks: list[tuple[str, Longs]], tags: dict[str, list[Longs | None]]) -> None:
    """Groups as scikit-fem writes them: cell data ``skfem:s:NAME``, 1 in them, and ``skfem:b:NAME``, a bit a facet."""
    count = len(content.cells)
    for key, parts in content.cell_data.items():
        _, mark, name = key.split(":", 2) if key.startswith("skfem:") and key.count(":") > 1 else ("", "", "")
        if mark == "s":
            tags[name] = [np.flatnonzero(np.asarray(part)) for part in parts]
        if mark != "b":
            continue
        for block, part in zip(content.cells[:count], parts, strict=True):
            bits = np.asarray(part).astype(np.int64)
            for k, corners in enumerate(_FACETS.get(block.type, ())):
                chosen = np.asarray(block.data)[bits >> k & 1 == 1][:, corners]
                if len(chosen):
                    blocks.append((("vertex", "line", "triangle")[len(corners) - 1], chosen))
                    tags.setdefault(name, [])
                    tags[name] += [None] * (len(blocks) - 1 - len(tags[name])) + [np.arange(len(chosen))]
