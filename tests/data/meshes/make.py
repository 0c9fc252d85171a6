"""Make the meshes of this folder anew: ``python tests/data/meshes/make.py``; needs gmsh and h5py."""

from __future__ import annotations

from pathlib import Path

import gmsh
import meshio
import numpy as np

HERE = Path(__file__).parent


def plate(size: float = 0.3) -> None:
    """A plate 2 x 1 of a soft and a hard half, with tagged sides and a tagged slit between the halves."""
    model = gmsh.model
    corner = [model.geo.addPoint(x, y, 0, size) for x, y in ((0, 0), (2, 0), (2, 1), (0, 1))]
    left, tip, right = (model.geo.addPoint(x, 0.5, 0, size) for x in (0, 1, 2))
    line = model.geo.addLine
    bottom, top = line(corner[0], corner[1]), line(corner[2], corner[3])
    cut, rest = line(left, tip), line(tip, right)
    low = [bottom, line(corner[1], right), -rest, -cut, line(left, corner[0])]
    high = [cut, rest, line(right, corner[2]), top, line(corner[3], left)]
    soft, hard = (model.geo.addPlaneSurface([model.geo.addCurveLoop(loop)]) for loop in (low, high))
    model.geo.synchronize()
    for name, dim, tags in (
        ("soft", 2, [soft]),
        ("hard", 2, [hard]),
        ("plate", 2, [soft, hard]),
        ("slit", 1, [cut]),
        ("bottom", 1, [bottom]),
        ("top", 1, [top]),
        ("corner", 0, [corner[0]]),
    ):
        model.addPhysicalGroup(dim, tags, name=name)


def block(size: float = 0.6) -> None:
    """A cube of two slabs, with a tagged face and a tagged square between the slabs."""
    model = gmsh.model
    low = model.occ.addBox(0, 0, 0, 1, 1, 0.5)
    high = model.occ.addBox(0, 0, 0.5, 1, 1, 0.5)
    model.occ.fragment([(3, low)], [(3, high)])
    model.occ.synchronize()

    def at(z: float) -> list[int]:
        found = model.getEntitiesInBoundingBox(-0.1, -0.1, z - 0.1, 1.1, 1.1, z + 0.1, 2)
        return [tag for _, tag in found]

    model.addPhysicalGroup(3, [low], name="lower")
    model.addPhysicalGroup(3, [high], name="upper")
    model.addPhysicalGroup(2, at(0.0), name="floor")
    model.addPhysicalGroup(2, at(0.5), name="between")
    gmsh.option.setNumber("Mesh.MeshSizeMin", size)


def write(name: str, version: float = 4.1, binary: bool = False) -> None:
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.option.setNumber("Mesh.Binary", binary)
    gmsh.write(str(HERE / name))


def name_only(path: Path) -> None:
    """Gmsh puts the whole path under the heading of an Abaqus file: leave the name."""
    lines = path.read_text().split("\n")
    lines[1] = f" {path.stem}"
    path.write_text("\n".join(lines))


def fresh(what: str) -> None:
    gmsh.clear()
    gmsh.model.add(what)
    gmsh.option.setNumber("Mesh.RecombineAll", 0)
    gmsh.option.setNumber("Mesh.ElementOrder", 1)


def main() -> None:
    gmsh.initialize()
    gmsh.option.setNumber("General.Terminal", 0)
    fresh("plate")
    plate()
    gmsh.model.mesh.generate(2)
    write("plate_22.msh", 2.2)
    write("plate_22_binary.msh", 2.2, binary=True)
    write("plate_41.msh")
    write("plate_41_binary.msh", binary=True)
    write("plate.inp")
    name_only(HERE / "plate.inp")
    gmsh.model.mesh.setOrder(2)
    write("plate_quadratic.msh")
    fresh("mixed")
    plate()
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setRecombine(2, 2)
    gmsh.model.mesh.recombine()
    write("plate_mixed.msh")
    fresh("block")
    block()
    gmsh.model.mesh.generate(3)
    write("block.msh")
    gmsh.model.mesh.setOrder(2)
    write("block_quadratic.msh")
    gmsh.finalize()

    plain = meshio.read(HERE / "plate_41.msh")
    cells, physical = [], []
    for kind in ("line", "triangle"):
        some = [k for k, one in enumerate(plain.cells) if one.type == kind]
        cells.append((kind, np.concatenate([plain.cells[k].data for k in some])))
        physical.append(np.concatenate([plain.cell_data["gmsh:physical"][k] for k in some]))
    tagged = meshio.Mesh(plain.points, cells, cell_data={"gmsh:physical": physical})
    tagged.write(HERE / "plate.vtu", binary=False)
    tagged.write(HERE / "plate_inline.xdmf", data_format="XML")
    tagged.write(HERE / "plate_hdf.xdmf", data_format="HDF")


if __name__ == "__main__":
    main()
