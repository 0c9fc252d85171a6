"""Meshes of meshers: groups by name from every format, and each repair and refusal with its sentence."""

import subprocess
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest
import skfem

from skfem_peridynamics.geometry.simplices import element_volumes
from skfem_peridynamics.meshes.cells import to_simplices
from skfem_peridynamics.meshes.mend import Raw, mend
from skfem_peridynamics.meshes.read_mesh import read_mesh

MESHES = Path(__file__).parents[1] / "data" / "meshes"
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])
CUBE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]], dtype=float)


def raw(points, *blocks, tags=None, points_of=None):
    cells = [(name, np.asarray(some)) for name, some in blocks]
    return Raw(np.asarray(points, dtype=float), cells, tags or {}, points_of or {})


def volume(mesh, name):
    return element_volumes(mesh)[mesh.subdomains[name]].sum()


def places(mesh, name):
    """The middles of the facets of a boundary."""
    return mesh.p[:, mesh.facets[:, mesh.boundaries[name]]].mean(axis=1)


@pytest.mark.parametrize(
    "name",
    [
        *("plate_22.msh", "plate_22_binary.msh", "plate_41.msh", "plate_41_binary.msh", "plate.inp"),
        *("plate_quadratic.msh", "plate_mixed.msh"),
    ],
)
def test_named_groups_of_every_format(name):
    """One plate, two halves, a slit, in every format: the same names at the same places."""
    mesh = read_mesh(MESHES / name)
    assert volume(mesh, "soft") == pytest.approx(1.0, rel=1e-12)
    assert volume(mesh, "plate") == pytest.approx(2.0, rel=1e-12)
    assert (mesh.p[1, mesh.t[:, mesh.subdomains["soft"]]] <= 0.5 + 1e-9).all()
    assert np.allclose(places(mesh, "bottom")[1], 0.0)
    assert np.allclose(places(mesh, "top")[1], 1.0)
    middle = places(mesh, "slit")
    assert len(middle.T) == 4
    assert np.allclose(middle[1], 0.5)
    assert np.allclose(np.sort(middle[0]), [0.125, 0.375, 0.625, 0.875])


@pytest.mark.parametrize("name", ["plate.vtu", "plate_inline.xdmf", "plate_hdf.xdmf"])
def test_numbers_are_names_where_there_are_no_others(name):
    mesh, named = read_mesh(MESHES / name), read_mesh(MESHES / "plate_41.msh")
    assert np.allclose(mesh.p, named.p)
    assert volume(mesh, "1") == pytest.approx(1.0)
    assert np.allclose(np.sort(places(mesh, "4")), np.sort(places(named, "slit")))


@pytest.mark.parametrize("name", ["block.msh", "block_quadratic.msh"])
def test_groups_in_space(name):
    mesh = read_mesh(MESHES / name)
    assert volume(mesh, "upper") == pytest.approx(0.5, rel=1e-12)
    assert np.allclose(places(mesh, "floor")[2], 0.0)
    assert np.allclose(places(mesh, "between")[2], 0.5)
    assert len(mesh.boundaries["between"]) > 5


def test_notes_of_real_files(caplog):
    for name in ("plate_quadratic.msh", "plate_mixed.msh"):
        read_mesh(MESHES / name)
    said = caplog.text
    assert "triangle6 elements lost the middle nodes: elements are straight here" in said
    assert "35 quad elements were cut into 70 triangles" in said
    assert "the group 'corner' is of neither elements nor facets of the body, and was left out" in said
    assert said.count("lost the middle nodes") == 1


def test_hdf_without_its_library(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "h5py", None)
    with pytest.raises(ValueError, match='keeps its numbers in HDF, which needs h5py: install the extra "xdmf"'):
        read_mesh(MESHES / "plate_hdf.xdmf")
    assert read_mesh(MESHES / "plate_inline.xdmf").nelements == 78


def test_groups_of_skfem_itself(tmp_path, capsys):
    mesh = skfem.MeshTri().refined(2).with_defaults().with_subdomains({"low": lambda x: x[1] < 0.5})
    mesh.save(str(tmp_path / "mesh.vtu"))
    back = read_mesh(tmp_path / "mesh.vtu")
    assert volume(back, "low") == pytest.approx(0.5)
    assert np.allclose(np.sort(places(back, "left")), np.sort(places(mesh, "left")))


def test_groups_of_a_reader_in_a_process_of_its_own(tmp_path):
    """Nastran's reader may never end: what it gives back still has its groups."""
    cells = [("triangle", TWO)]
    meshio.Mesh(np.pad(SQUARE, ((0, 0), (0, 1))), cells, cell_data={"nastran:ref": [np.array([0, 7])]}).write(
        tmp_path / "a.nas"
    )
    mesh = read_mesh(tmp_path / "a.nas")
    assert volume(mesh, "7") == pytest.approx(0.5)
    assert list(mesh.subdomains) == ["7"]  # 0 is of no group


def test_scale_and_join(tmp_path, caplog):
    p = np.concatenate([SQUARE + np.array([k, 0.0]) for k in (0.0, 1.0, 3.0)])
    t = np.concatenate([TWO, TWO + 4, TWO + 8])
    meshio.Mesh(np.pad(p, ((0, 0), (0, 1))), [("triangle", t)]).write(tmp_path / "a.vtu")
    apart = read_mesh(tmp_path / "a.vtu", scale=1e-3)
    assert apart.nvertices == 12
    assert np.ptp(apart.p[0]) == pytest.approx(4e-3)
    assert "the mesh has 3 parts that share no vertex; the smallest has 2 elements" in caplog.text
    assert "2 of its vertices are where others are: join = true makes them one" in caplog.text
    caplog.clear()
    joined = read_mesh(tmp_path / "a.vtu", join=True)
    assert joined.nvertices == 10
    assert "2 vertices were joined to others at the same place" in caplog.text
    assert "the mesh has 2 parts" in caplog.text


@pytest.mark.parametrize("name", ["hexahedron", "wedge", "pyramid", "quad"])
def test_polyhedra_are_cut_to_fill_them(name):
    """Any numbering of the corners: positive simplices, the whole volume, and every face cut as its neighbour's is."""
    rng = np.random.default_rng(3)
    corners = {
        "hexahedron": CUBE,
        "wedge": CUBE[[0, 1, 3, 4, 5, 7]],
        "pyramid": np.vstack([CUBE[:4], [[0.4, 0.6, 1.0]]]),
        "quad": SQUARE,
    }[name]
    whole = {"hexahedron": 1.0, "wedge": 0.5, "pyramid": 1.0 / 3.0, "quad": 1.0}[name]
    for _ in range(20):
        number = rng.permutation(len(corners))
        p = np.empty_like(corners)
        p[number] = corners
        found = mend(raw(p, (name, number[None])))
        assert element_volumes(found.mesh).sum() == pytest.approx(whole, rel=1e-12)


def test_neighbours_cut_their_face_alike():
    """Three hexahedra, a wedge and a pyramid, numbered at random: a conforming mesh, or facets would be loose."""
    rng = np.random.default_rng(4)
    rows = np.concatenate([CUBE + np.array([k, 0, 0]) for k in range(3)])
    more = np.array([[3.5, 0.5, 0.5], [0, 0.5, 2.0], [1, 0.5, 2.0]])
    p, inverse = np.unique(np.concatenate([rows, more]), axis=0, return_inverse=True)
    blocks = {"hexahedron": [inverse[8 * k : 8 * k + 8] for k in range(3)]}
    last = inverse[16:24]
    blocks["pyramid"] = [np.array([*last[[1, 2, 6, 5]], inverse[24]])]
    first = inverse[:8]
    blocks["wedge"] = [np.array([first[4], first[7], inverse[25], first[5], first[6], inverse[26]])]
    for _ in range(20):
        number = rng.permutation(len(p))
        moved = np.empty_like(p)
        moved[number] = p
        turn = np.roll(np.arange(4), rng.integers(4))  # the corner that a mesher begins with is anybody's
        turned = blocks | {"hexahedron": [*(h[[*turn, *(turn + 4)]] for h in blocks["hexahedron"][:2]), last]}
        mesh = mend(raw(moved, *((name, number[np.array(cells)]) for name, cells in turned.items()))).mesh
        assert element_volumes(mesh).sum() == pytest.approx(3.0 + 0.5 / 3.0 + 0.5, rel=1e-12)
        outer = mesh.boundary_facets()
        middle = mesh.p[:, mesh.facets[:, outer]].mean(axis=1)
        inside = (np.abs(middle[0] % 1.0) < 1e-9) & (middle[0] > 0.1) & (middle[0] < 3.1) & (middle[2] < 1.0)
        assert not inside.any()


def test_tags_of_cut_and_repeated_elements():
    tags = {"a": [np.array([0]), None, None], "b": [None, np.array([0]), None], "low": [None, None, np.array([0])]}
    found = mend(raw(SQUARE, ("quad", [[0, 1, 2, 3]]), ("triangle", TWO[:1]), ("line", [[1, 0]]), tags=tags))
    assert found.mesh.nelements == 2
    assert len(found.mesh.subdomains["a"]) == 2
    assert len(found.mesh.subdomains["b"]) == 1
    assert places(found.mesh, "low").ravel().tolist() == [0.5, 0.0]
    assert found.notes == ("1 quad element was cut into 2 triangles",)


def test_elements_listed_twice():
    found = mend(raw(SQUARE, ("triangle", [*TWO, [2, 0, 1]])))
    assert found.mesh.nelements == 2
    assert found.notes == ("1 element listed twice was taken once",)


def test_elements_inside_out():
    found = mend(raw(SQUARE, ("triangle", [[0, 1, 2], [0, 3, 2]])))
    assert found.notes == ("1 element of 2, turned inside out, was turned back",)
    assert mend(raw(SQUARE, ("triangle", TWO[:, ::-1]))).notes == ()  # all the same way round is a convention
    solid = mend(raw(CUBE[[0, 1, 3, 4, 6]], ("tetra", [[0, 1, 2, 3], [1, 2, 4, 3], [3, 2, 1, 0]])))
    assert solid.notes[0] == "1 element listed twice was taken once"
    edges = solid.mesh.p[:, solid.mesh.t[1:]] - solid.mesh.p[:, solid.mesh.t[:1]]
    assert (np.linalg.det(np.moveaxis(edges, 2, 0)) > 0.0).all()
    assert "turned inside out" in solid.notes[1]


def test_orphans_and_crushed_elements():
    found = mend(raw([*SQUARE, [9.0, 9.0], [8.0, 8.0]], ("triangle", [*TWO, [1, 1, 2]])))
    assert found.mesh.nvertices == 4
    assert found.notes == ("1 element with a vertex twice was left out", "2 vertices of no element were left out")


def test_facets_of_no_element():
    lines = ("line", [[0, 1], [1, 3]])
    found = mend(raw(SQUARE, ("triangle", TWO), lines, tags={"x": [None, np.array([0, 1])]}))
    assert found.notes == ("1 facet of the group 'x', of no element, was left out",)
    assert len(found.mesh.boundaries["x"]) == 1


def test_sets_of_vertices():
    found = mend(raw(SQUARE, ("triangle", TWO), points_of={"low": np.array([0, 1]), "diagonal": np.array([0, 2])}))
    assert list(found.mesh.boundaries) == ["low"]  # the diagonal is inside
    assert places(found.mesh, "low").ravel().tolist() == [0.5, 0.0]


def test_a_plane_that_is_not_x_and_y():
    p = np.insert(SQUARE, 1, 5.0, axis=1)
    found = mend(raw(p, ("triangle", TWO)))
    assert found.notes == ("its points lie along x and z, which were taken for x and y",)
    assert element_volumes(found.mesh).sum() == pytest.approx(1.0)
    assert mend(raw(np.pad(SQUARE, ((0, 0), (0, 1)), constant_values=2.0), ("triangle", TWO))).notes == ()


REFUSED = {
    "folded": (raw([*SQUARE, [0.2, 0.9]], ("triangle", [*TWO, [0, 2, 4]])), "3 elements share the facet at (0.5, 0.5)"),
    "on one side": (
        raw([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.4, 0.6]], ("triangle", [[0, 1, 2], [0, 1, 3]])),
        "the two elements at the facet at (0.5, 0) lie on the same side of it: the mesh is folded over there",
    ),
    "flat": (raw([[0, 0], [1, 0], [2, 0], [0, 1]], ("triangle", [[0, 1, 2], [0, 1, 3]])), "element 0 has volume 0"),
    "empty": (raw(SQUARE, ("vertex", [[0]])), "it has no elements"),
    "all crushed": (raw(SQUARE, ("triangle", [[0, 0, 1]])), "it has no elements of any volume"),
    "a surface": (raw(CUBE, ("triangle", [[0, 1, 2], [0, 4, 5]])), "a surface or a curve in space is not a body"),
    "polygons": (raw(SQUARE, ("polygon", [[0, 1, 2, 3]])), "elements of the kind 'polygon'; those that can be used"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    content, message = REFUSED[name]
    with pytest.raises(ValueError) as error:
        mend(content)
    assert message in str(error.value)


def test_simplices_come_in_the_order_of_their_cells():
    _, cell = to_simplices("hexahedron20", np.arange(40).reshape(2, 20))
    assert cell.tolist() == [0] * 6 + [1] * 6


def test_a_scene_by_the_names_of_its_groups(tmp_path):
    """Materials, loads, supports and a crack of a real file, all by name."""
    from skfem_peridynamics import Scene
    from skfem_peridynamics.app.problem.problem import Problem

    scene = Scene.parse(
        """
        mesh = {file = "plate_41.msh", scale = 0.1}
        material = {young = 1.0, toughness = 1.0, density = 1.0, plane = "stress"}
        inclusion = [{region = "hard", young = 10.0}]
        crack = [{facets = "slit"}]
        bonds = {horizon = 0.06}
        load = [{traction = [0, 1], on = "top"}]
        fixed = [{on = "bottom", displacement = 0}]
        no_fail = [{region = "soft"}]
        time = {until = 1.0}
        """,
        MESHES,
    )
    problem = Problem(scene)
    assert problem.mesh.nvertices == 51 + 4
    assert problem.load(0.0).reshape(-1, 2).sum(axis=0) == pytest.approx([0.0, 0.2])
    assert len(problem.fixed[0].dofs) == 16
    assert problem.limit.dt > 0.0


def test_node_sets_of_abaqus(tmp_path):
    lines = ["*NODE", *(f"{k + 1}, {x}, {y}" for k, (x, y) in enumerate(SQUARE)), "*ELEMENT, TYPE=CPS3, ELSET=ALL"]
    lines += [f"{k + 1}, {', '.join(str(v + 1) for v in t)}" for k, t in enumerate(TWO)]
    (tmp_path / "a.inp").write_text("\n".join([*lines, "*NSET, NSET=EDGE", "3, 4", ""]))
    mesh = read_mesh(tmp_path / "a.inp")
    assert len(mesh.subdomains["ALL"]) == 2
    assert places(mesh, "EDGE").ravel().tolist() == [0.5, 1.0]


def test_code_of_the_working_folder_is_not_run(tmp_path):
    """Readers that may never end run in a process of their own: what lies beside the mesh is none of their modules."""
    for name in ("numpy", "meshio", "skfem", "io"):
        (tmp_path / f"{name}.py").write_text("open('run', 'w').close()\n")
    mesh = skfem.MeshTri().refined(2)
    meshio.Mesh(np.vstack([mesh.p, 0 * mesh.p[:1]]).T, [("triangle", mesh.t.T)]).write(tmp_path / "a.ply", binary=False)
    command = [Path(sys.executable).parent / "skfem-peridynamics", "cfl", "--mesh", "a.ply", "--horizon", "0.6"]
    result = subprocess.run(
        [*command, "--young", "1", "--density", "1", "--plane", "stress"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert not (tmp_path / "run").exists()
