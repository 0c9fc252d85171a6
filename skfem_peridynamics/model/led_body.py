"""A body whose bonds are on other ranks: what is asked of bonds themselves, it answers itself."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

from .._types import Floats, Longs


@runtime_checkable
class LedBody(Protocol):
    """A whole body whose operators all ranks compute when the first one asks; its vectors are those of the whole."""

    def vertex_stiffness(self) -> Floats:
        """Return what vertices are held with at rest, (nvertices, dim, dim)."""

    def connected_parts(self) -> Longs:
        """Return the number of the part of the body that each vertex is in, (nvertices,)."""

    def largest_move(self, u: Floats, d: Floats, below: float) -> float:
        """Return the largest ``|S| / S_c`` by d of the bonds whose own at u is ``below``."""

    def left(self, u: Floats | None) -> Any:
        """Return what is left of the stiffness at u, as ``solve.left`` has it; None: all of it."""


_SCHEMES: dict[tuple[type, str], Callable[..., Any]] = {}


def offer(kind: type, name: str, scheme: Callable[..., Any]) -> None:
    """Have a scheme of this name take bodies of this kind, with vectors that are a rank's own part."""
    _SCHEMES[kind, name] = scheme


def offered(body: object, name: str) -> Callable[..., Any] | None:
    """Return the scheme of this name for a body that is dealt out over ranks, None for others.

    >>> offered(object(), "newmark") is None
    True
    """
    return next((_SCHEMES[kind, name] for kind in type(body).__mro__ if (kind, name) in _SCHEMES), None)
