"""A mesh file of any mesher as a sound simplicial mesh."""

from __future__ import annotations

import contextlib
import dataclasses
import io
import logging
import threading
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from .._memory import free_memory
from .._types import Floats, Mesh
from ..geometry.simplices import describe_point
from .entries import READING
from .mend import Mended, Raw, mend

_log = logging.getLogger("skfem_peridynamics")
_PRINTING = threading.Lock()
_LARGEST = 1e100  # of a coordinate: powers of it must stay numbers
_BETTER = "as .msh (Gmsh 4.1), .vtu or .inp"


@contextlib.contextmanager
def quietly(said: io.StringIO | None = None) -> Iterator[None]:
    """Keep what is printed, for one thread at a time: two that take the output at once would not give it back."""
    said = io.StringIO() if said is None else said
    with _PRINTING, contextlib.redirect_stderr(said), contextlib.redirect_stdout(said):
        yield


def read_mesh(path: Path, scale: float = 1.0, join: bool = False) -> Mesh:
    """Return the simplicial mesh in a file; its groups become boundaries and subdomains.

    Lengths are taken ``scale`` times; ``join`` makes one vertex of those that coincide. What had to be mended is
    said in the log. Raises ``ValueError`` for what is no mesh of a body.
    """
    return mended_mesh(path, scale, join).mesh


def mended_mesh(path: Path, scale: float = 1.0, join: bool = False) -> Mended:
    """Return what :func:`read_mesh` does, with what was mended and lost on the way."""
    name = repr(str(path))
    if not path.is_file():
        raise ValueError(f"{name} is not a file")
    if path.stat().st_size * READING > free_memory():
        raise ValueError(
            f"{name} has {path.stat().st_size / 1e6:.3g} MB; reading it takes about "
            f"{READING} times as much memory, and {free_memory() / 1e6:.3g} MB are free: take a coarser mesh"
        )
    try:
        own = _own_reader(path)
        raw = _by_meshio(path) if own is None else _by_own(own, path)
        _check_points(raw.points)
        raw = dataclasses.replace(raw, points=raw.points * scale)
        mended = mend(raw, join)
    except ValueError as error:
        raise ValueError(f"{name}: {error}") from None
    for note in mended.notes:
        _log.warning("mesh %s: %s", name, note)
    return mended


def _own_reader(path: Path) -> Callable[[Path], Raw] | None:
    """The reader for files of which meshio would lose groups, or None."""
    from .abaqus import read_abaqus
    from .exodus import SUFFIXES, read_exodus
    from .gmsh import VERSIONS, read_gmsh, version_of

    if path.suffix.lower() == ".inp":
        return read_abaqus
    if path.suffix.lower() in SUFFIXES:
        return read_exodus
    return read_gmsh if version_of(path) in VERSIONS else None


def _by_own(reader: Callable[[Path], Raw], path: Path) -> Raw:
    """What a reader of ours delivers; what it stumbles over in a damaged file is a sentence, too."""
    try:
        return reader(path)
    except ModuleNotFoundError as error:
        raise ValueError(_missing_module(str(error.name))) from None
    except (ArithmeticError, LookupError, MemoryError, TypeError) as error:
        raise ValueError(f"it cannot be read as a mesh: {_reason(error, '')}") from None


def _by_meshio(path: Path) -> Raw:
    """Points, cells and groups as meshio reads them."""
    from .groups import raw_mesh
    from .guarded_reader import read

    said = io.StringIO()  # meshio prints its reasons
    try:
        with quietly(said), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = read(path)
            check_cells(content)
            return raw_mesh(content)
    except ModuleNotFoundError as error:
        raise ValueError(_missing_module(str(error.name))) from None
    except TimeoutError as error:
        raise ValueError(f"it cannot be read as a mesh: {error}") from None
    except (SystemExit, Exception) as error:  # whatever a reader of a foreign format may raise
        raise ValueError(f"it cannot be read as a mesh: {_reason(error, said.getvalue())}") from None


def _missing_module(name: str) -> str:
    """What to do for a reader that lacks a library."""
    if name == "h5py":
        return (
            'it keeps its numbers in HDF, which needs h5py: install the extra "xdmf", or write the file with its '
            "numbers inline"
        )
    return f"its reader needs {name}: pip install {name}, or export the mesh in another format, {_BETTER}"


def _reason(error: BaseException, printed: str) -> str:
    """A sentence of what a reader met: its own words where it has some, and what to do where it merely broke down."""
    import meshio

    words = " ".join((printed or str(error)).split())
    words = "" if "NoneType" in words else words
    if isinstance(error, meshio.ReadError | ValueError | SystemExit) and len(words.split()) > 3:
        return words
    kind = "" if isinstance(error, SystemExit) else f" with {type(error).__name__}"
    stopped = f"its reader stopped{kind}{f' ({words[:200]})' if words else ''}"
    return f"{stopped}, as none does in a sound file: export it again, {_BETTER}"


def check_cells(content: Any) -> None:
    """Raise ``ValueError`` for elements of vertices that are not there, and vertices that are nowhere."""
    if np.ndim(content.points) != 2 or any(
        np.ndim(b.data) != 2 or b.data.dtype.kind not in "iu" for b in content.cells
    ):
        raise ValueError("its elements are not all of as many vertices")
    count = len(content.points)
    _check_points(content.points)
    for block in content.cells:
        if block.data.size and not 0 <= block.data.min() <= block.data.max() < count:
            raise ValueError(f"a {block.type} has vertex {block.data.max()}; the file has {count} vertices")


def _check_points(points: Floats) -> None:
    """Raise ``ValueError`` for vertices that are nowhere, or farther than can be computed with."""
    far = np.flatnonzero(~(np.abs(points) <= _LARGEST).all(axis=1))
    if len(far):
        raise ValueError(f"its vertex {far[0]} is at {describe_point(points[far[0]])}")
