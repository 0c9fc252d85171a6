"""Files of a run: frames for ParaView, the history, the summary. A file under its final name is complete."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from ..._files import remove
from ..._types import Basis, Floats, Ints
from ..scene.units import KNOWN, UnitsTable
from .vtu_writer import VtuWriter
from .whole_files import write_whole

_FRAME = re.compile(r"frame_(\d{4,})\.vtu(\.part)?")
_OTHERS = (
    *("frames.pvd", "history.csv", "summary.json", "report.html", "animation.gif"),
    *("damage.png", "course.png", "energies.png", "crack.png", "measures.png"),
    *("deformed.png", "stress.png", "setup.png"),
)


def clear(folder: Path, times: Sequence[float] = ()) -> None:
    """Remove what an earlier run left in a folder, by the names that runs use; other files stay.

    The frames of ``times``, which are continued, stay too, and the history, which takes the place of the old one.
    """
    for name in _OTHERS:
        remove(folder / f"{name}.part")
        if not (times and name in ("frames.pvd", "history.csv")):
            remove(folder / name)
    if times:
        list_frames(folder, times)
    clear_frames(folder, len(times))  # after the list: it never names what is not there


def files_of_runs(folder: Path) -> list[str]:
    """Return the files of a folder that have names which runs use."""
    return sorted(item.name for item in folder.iterdir() if item.name in _OTHERS or _FRAME.fullmatch(item.name))


def list_frames(folder: Path, times: Sequence[float]) -> None:
    """Write ``frames.pvd``, which lists the frames."""
    rows = "".join(f'    <DataSet timestep="{t!r}" file={quoteattr(frame_name(k))}/>\n' for k, t in enumerate(times))
    write_whole(
        folder / "frames.pvd",
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1">\n  <Collection>\n'
        f"{rows}  </Collection>\n</VTKFile>\n",
    )


def clear_frames(folder: Path, keep: int = 0) -> None:
    """Remove frames, but the first few."""
    for old in list(folder.iterdir()):
        name = _FRAME.fullmatch(old.name)
        if name is not None and (int(name[1]) >= keep or name[2]):
            remove(old)


def frame_name(number: int) -> str:
    """Return ``frame_0007.vtu``."""
    return f"frame_{number:04d}.vtu"


@dataclass(eq=False)
class Frames:
    """Write fields at vertices as ``frame_0000.vtu, ...`` and ``frames.pvd`` into a folder.

    Vectors (N,) of the basis get three components, as ParaView likes them; scalars are (nvertices,), symmetric
    tensors (nvertices, 6): xx, yy, zz, xy, yz, xz. Fields are in single precision, compressed. Frames that an
    earlier run left there are removed first, but those of ``times``, which are continued.

    Parameters
    ----------
    folder : str or Path
        Where to; made where it is not there.
    basis : skfem.Basis
        The vector P1 basis of the fields.
    times : sequence of float, optional
        Times of the frames that are there already and stay.
    units : UnitsTable, optional
        What each known field carries as its unit, in words.
    cells : mapping of str to ndarray, (nelements,), optional
        Numbers of the elements that all frames carry, such as that of the material.

    Raises
    ------
    OutputError
        Where a file cannot be written.

    Examples
    --------
    >>> import tempfile, skfem
    >>> basis = skfem.Basis(skfem.MeshTri(), skfem.ElementVector(skfem.ElementTriP1()))
    >>> frames = Frames(tempfile.mkdtemp(), basis)
    >>> frames.write(0.0, displacement=np.zeros(8), Z=np.zeros(4)).name
    'frame_0000.vtu'
    """

    folder: str | Path
    basis: Basis
    times: list[float] = field(default_factory=list)
    units: UnitsTable = field(default_factory=UnitsTable)
    cells: Mapping[str, Ints] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.folder = Path(self.folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        if not self.times:
            remove(self.folder / "frames.pvd")
        clear_frames(self.folder, len(self.times))
        self._writer = VtuWriter(self.basis.mesh, self.cells)

    def write(self, t: float, **fields: Floats) -> Path:
        """Write one frame and return its path.

        Parameters
        ----------
        t : float
            Its time.
        **fields
            Vectors, scalars and tensors by their names.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        ValueError
            For a field of another length.
        """
        mesh = self.basis.mesh
        n, dim = mesh.nvertices, mesh.dim()
        point_data = {}
        for name, values in fields.items():
            values = np.asarray(values)
            if values.shape == (n * dim,) and (dim > 1 or name in ("displacement", "velocity")):
                values = np.pad(values.reshape(n, dim), ((0, 0), (0, 3 - dim)))
            elif values.shape not in ((n,), (n, 6)):
                raise ValueError(f"field {name!r} has shape {values.shape}; it needs ({n},), ({n * dim},) or ({n}, 6)")
            point_data[name] = _single(values)
        path = Path(self.folder) / frame_name(len(self.times))
        units = {name: self.units.of(name) for name in point_data if name in KNOWN}
        write_whole(path, self._writer.frame(point_data, units))
        self.times.append(t)
        list_frames(Path(self.folder), self.times)
        return path


def _single(values: Floats) -> Floats:
    """Values in single precision; what is beyond its range becomes its largest number."""
    most = np.finfo(np.float32).max
    return np.clip(values, -most, most).astype(np.float32)
