"""What a mesh is like: its size, its groups, how even it is, and a horizon that suits it."""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial, floor, log10, sqrt
from typing import Any

import numpy as np

from ..._types import Floats, Mesh
from ...geometry.simplices import element_volumes, vertex_sizes

VERTICES_PER_HORIZON = 4.0  # docs/evidence/validation.md: the toughness of a crack is right from there on


@dataclass(frozen=True)
class MeshInfo:
    """Sizes of a mesh. ``edges`` and ``quality`` are least, median and largest, ``boundaries`` and
    ``subdomains`` names and counts; ``inner`` are boundaries inside the body, as slits are.
    """

    dim: int
    nvertices: int
    nelements: int
    box: tuple[tuple[float, float], ...]
    volume: float
    edges: tuple[float, float, float]
    quality: tuple[float, float, float]
    boundaries: dict[str, int]
    inner: frozenset[str]
    subdomains: dict[str, int]
    horizon: float

    @classmethod
    def of(cls, mesh: Mesh) -> MeshInfo:
        """Measure a mesh; the quality of an element is 1 where it is regular, and 0 where it is flat.

        >>> import skfem
        >>> info = MeshInfo.of(skfem.MeshTri().refined(2))
        >>> info.nvertices, info.edges[0], info.horizon
        (25, 0.25, 1.0)
        """
        dim, length = int(mesh.dim()), _edges(mesh)
        boundaries, subdomains = dict(mesh.boundaries or {}), dict(mesh.subdomains or {})
        outside = np.zeros(mesh.facets.shape[1], dtype=bool)
        outside[mesh.boundary_facets()] = True
        low, high = mesh.p.min(axis=1), mesh.p.max(axis=1)
        return cls(
            dim,
            int(mesh.nvertices),
            int(mesh.nelements),
            tuple((float(a), float(b)) for a, b in zip(low, high, strict=True)),
            float(element_volumes(mesh).sum()),
            _spread(np.sqrt(length).ravel()),
            _spread(_quality(mesh, length)),
            {name: len(which) for name, which in boundaries.items()},
            frozenset(
                name for name, which in boundaries.items() if len(which) and not outside[np.asarray(which)].any()
            ),
            {name: len(which) for name, which in subdomains.items()},
            _round_up(VERTICES_PER_HORIZON * float(np.quantile(vertex_sizes(mesh), 0.9))),
        )

    def rows(self) -> list[tuple[str, str]]:
        """Return names and what is said of them."""
        size = " x ".join(f"{b - a:.6g}" for a, b in self.box)
        corner = ", ".join(f"{a:.6g}" for a, _ in self.box)
        kind = ("", "line", "triangle", "tetrahedron")[self.dim]
        rows = [
            ("dimension", f"{self.dim}: {self.nvertices} vertices, {self.nelements} elements ({kind})"),
            ("size", f"{size}, from ({corner}); {('', 'length', 'area', 'volume')[self.dim]} {self.volume:.6g}"),
            ("edges", f"{self.edges[0]:.4g} to {self.edges[2]:.4g}, median {self.edges[1]:.4g}"),
            ("quality", f"{self.quality[0]:.2f} at the worst, {self.quality[1]:.2f} in the median (1: regular)"),
        ]
        facets = [f"{name} ({n} facets{' inside' * (name in self.inner)})" for name, n in self.boundaries.items()]
        elements = [f"{name} ({n} elements)" for name, n in self.subdomains.items()]
        rows += [("boundaries", ", ".join(facets) or "none is named"), ("subdomains", ", ".join(elements) or "none")]
        enough = f"{VERTICES_PER_HORIZON:g} vertices or more nearly everywhere"
        rows.append(("horizon", f"{self.horizon:g} to begin with: {enough}"))
        return rows

    def as_json(self) -> dict[str, Any]:
        """Return plain numbers under their names."""
        named = ("least", "median", "largest")
        return (
            self.__dict__
            | {"inner": sorted(self.inner)}
            | {name: dict(zip(named, getattr(self, name), strict=True)) for name in ("edges", "quality")}
        )


def _edges(mesh: Mesh) -> Floats:
    """Squared lengths of the edges of each element, (nedges, nelements)."""
    corners = [mesh.p[:, t] for t in mesh.t]
    pairs = [(i, j) for i in range(len(corners)) for j in range(i)]
    return np.array([((corners[i] - corners[j]) ** 2).sum(axis=0) for i, j in pairs])


def _quality(mesh: Mesh, squares: Floats) -> Floats:
    """Volume over that of a regular element with edges of the same mean square."""
    dim = int(mesh.dim())
    regular = sqrt((dim + 1) / 2.0**dim) / factorial(dim)
    return np.asarray(element_volumes(mesh) / (regular * squares.mean(axis=0) ** (dim / 2)), dtype=float)


def _spread(values: Floats) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())


def _round_up(value: float) -> float:
    """Two digits, upward."""
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{unit * np.ceil(value / unit - 1e-9):.2g}")
