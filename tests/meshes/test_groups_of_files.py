"""Groups, parts and pieces as mesh files declare them: read as they are meant, or refused with the construct named."""

import base64
import logging
import lzma
import re
import zlib

import meshio
import numpy as np
import pytest
import skfem
from scipy.io import netcdf_file

from skfem_peridynamics.app.problem.domain import make_mesh
from skfem_peridynamics.app.scene.body_tables import MeshTable
from skfem_peridynamics.app.scene.reading import SceneError
from skfem_peridynamics.geometry.layers import collar
from skfem_peridynamics.geometry.simplices import element_volumes
from skfem_peridynamics.meshes.read_mesh import read_mesh

# two rows of four squares on [0, 2] x [0, 1]
NODES = "".join(f"{1 + i + 5 * j}, {0.5 * i}, {0.5 * j}, 0.\n" for j in range(3) for i in range(5))
SQUARES = {
    1 + i + 4 * j: (1 + i + 5 * j, 2 + i + 5 * j, 7 + i + 5 * j, 6 + i + 5 * j) for j in range(2) for i in range(4)
}


def rows(*numbers):
    return "".join(f"{k}, {', '.join(map(str, SQUARES[k]))}\n" for k in numbers)


LOWER, UPPER = (1, 2, 3, 4), (5, 6, 7, 8)


def inp(tmp_path, text, **keys):
    (tmp_path / "a.inp").write_text(text)
    return read_mesh(tmp_path / "a.inp", **keys)


def area(mesh, name=None):
    chosen = slice(None) if name is None else mesh.subdomains[name]
    return float(element_volumes(mesh)[chosen].sum())


def centre(mesh, name):
    chosen = mesh.subdomains[name]
    middle = mesh.p[:, mesh.t[:, chosen]].mean(axis=1)
    return middle @ element_volumes(mesh)[chosen] / area(mesh, name)


def test_sets_take_their_own_elements(tmp_path):
    """Of a block that is not the first, after one without a name, and of several blocks under one name."""
    mesh = inp(
        tmp_path,
        f"*Node\n{NODES}*Element, type=CPS4\n{rows(*LOWER)}*Element, type=CPS4, elset=High\n{rows(*UPPER)}"
        "*Elset, elset=Steel\nHigh\n*Elset, elset=Left, generate\n1, 5, 4\n"
        f"*Element, type=CPS4, elset=High\n",
    )
    assert area(mesh) == pytest.approx(2.0)
    assert area(mesh, "Steel") == pytest.approx(1.0)
    assert centre(mesh, "Steel") == pytest.approx([1.0, 0.75])
    assert centre(mesh, "Left") == pytest.approx([0.25, 0.5])


def test_sets_of_sets_and_repeated_sets(tmp_path):
    mesh = inp(
        tmp_path,
        f"*NODE\n{NODES}*ELEMENT, TYPE=CPS4, ELSET=A\n{rows(1, 2)}*ELEMENT, TYPE=CPS4, ELSET=B\n{rows(3, 4, 5)}"
        f"*ELEMENT, TYPE=CPS4, ELSET=B\n{rows(6, 7, 8)}*ELSET, ELSET=Most\na,\n3, 4\n*ELSET, ELSET=MOST\n5\n"
        "*ELSET, ELSET=All\nA, B\n*ELSET, ELSET=Again\nMost\n",
    )
    assert [area(mesh, name) for name in ("A", "B", "Most", "All", "Again")] == pytest.approx([0.5, 1.5, 1.25, 2, 1.25])


def test_nodes_in_several_sections_make_boundaries(tmp_path):
    lines = NODES.splitlines(keepends=True)
    mesh = inp(
        tmp_path,
        f"*Node, nset=Bottom\n{''.join(lines[:5])}*Node\n{''.join(lines[5:])}*Element, type=CPS4\n{rows(*SQUARES)}"
        "*Nset, nset=right\n5, 10, 15\n",
    )
    assert mesh.nvertices == 15
    assert {name: len(facets) for name, facets in mesh.boundaries.items()} == {"Bottom": 4, "right": 2}


def test_quotes_and_line_ends_of_another_system(tmp_path):
    text = f'*Node\n{NODES}*Element, type=CPS4, elset="Steel Part"\n{rows(*SQUARES)}*Nset, nset="Left Edge"\n1, 6, 11\n'
    (tmp_path / "a.inp").write_bytes(text.replace("\n", "\r\n").encode())
    mesh = read_mesh(tmp_path / "a.inp")
    assert (list(mesh.boundaries), list(mesh.subdomains)) == (["Left Edge"], ["Steel Part"])


def test_instances_stand_where_they_are_put(tmp_path):
    part = f"*Part, name=Plate\n*Node\n{NODES}*Element, type=CPS4R, elset=E\n{rows(*SQUARES)}*End Part\n"
    mesh = inp(
        tmp_path,
        part + "*Assembly, name=All\n*Instance, name=A, part=plate\n*End Instance\n*Instance, name=B, part=Plate\n"
        "10., 0., 0.\n10., 0., 0., 10., 0., 1., 90.\n*End Instance\n"
        "*Elset, elset=Second, instance=B\nE\n*Nset, nset=Base, instance=A\n1, 2, 3, 4, 5\n*End Assembly\n",
    )
    assert area(mesh) == pytest.approx(4.0)
    assert area(mesh, "E") == pytest.approx(4.0)
    assert centre(mesh, "Second") == pytest.approx([9.5, 1.0])  # turned by 90 degrees about (10, 0)
    assert len(mesh.boundaries["Base"]) == 4
    assert np.ptp(mesh.p[0]) == pytest.approx(10.0)


def test_a_rotation_in_space(tmp_path):
    """Half a turn about the diagonal x = y, z = 1 takes (x, y, z) to (y, x, 2 - z)."""
    corners = [(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, 3)]
    nodes = "".join(f"{k + 1}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(corners))
    mesh = inp(
        tmp_path,
        f"*Part, name=P\n*Node\n{nodes}*Element, type=C3D4\n1, 1, 2, 3, 4\n*End Part\n*Assembly, name=A\n"
        "*Instance, name=I, part=P\n0., 0., 0.\n0., 0., 1., 1., 1., 1., 180.\n*End Instance\n*End Assembly\n",
    )
    turned = sorted((float(y), float(x), 2.0 - z) for x, y, z in corners)
    assert np.array(sorted(map(tuple, mesh.p.T.round(9).tolist()))) == pytest.approx(np.array(turned))


def test_parts_keep_their_sets_apart(tmp_path):
    parts = "".join(
        f"*Part, name={name}\n*Node\n{NODES}*Element, type=CPS4, elset=E{name}\n{rows(*SQUARES)}*End Part\n"
        for name in "AB"
    )
    mesh = inp(
        tmp_path,
        parts
        + "*Assembly, name=All\n*Instance, name=a-1, part=A\n*End Instance\n*Instance, name=b-1, part=B\n3., 0., 0.\n"
        "*End Instance\n*End Assembly\n",
    )
    assert centre(mesh, "EA") == pytest.approx([1.0, 0.5])
    assert centre(mesh, "EB") == pytest.approx([4.0, 0.5])


def test_surfaces_are_boundaries(tmp_path):
    mesh = inp(
        tmp_path,
        f"*Node\n{NODES}*Element, type=CPS4, elset=E\n{rows(*SQUARES)}*Elset, elset=_low, internal\n1, 2\n"
        "*Surface, type=ELEMENT, name=Pressed\n_low, S1\n8, S2\n",
    )
    middle = mesh.p[:, mesh.facets[:, mesh.boundaries["Pressed"]]].mean(axis=1)
    assert sorted(map(tuple, middle.T.round(9).tolist())) == [(0.25, 0.0), (0.75, 0.0), (2.0, 0.75)]
    assert list(mesh.subdomains) == ["E"]


def test_surfaces_of_solids(tmp_path):
    """Face S5 of a hexahedron is nodes 3, 7, 8, 4: here the side y = 1."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
    nodes = "".join(f"{k + 1}, {x}, {y}, {z}\n" for k, (x, y, z) in enumerate(corners))
    mesh = inp(
        tmp_path,
        f"*Node\n{nodes}*Element, type=C3D8R\n1, 1, 2, 3, 4, 5, 6, 7,\n8\n*Surface, name=Top\n1, S5\n",
    )
    assert mesh.p[1, mesh.facets[:, mesh.boundaries["Top"]]].min() == 1.0
    assert len(mesh.boundaries["Top"]) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*Ngen\n1, 5, 1\n", "*NGEN makes or moves nodes"),
        ("*Elset, elset=S\nnowhere\n", "lists 'nowhere', which is neither a number nor a set"),
        ("*Elset, elset=S\n99\n", "lists 99, and the file has none of that number"),
        ("*Elset, elset=S, generate\n1, 300000000\n", "generates numbers that the file does not have"),
        ("*Elset\n1\n", "*ELSET has no ELSET="),
        ("*Element, type=SPRING9\n9, 1, 2\n", "elements of type SPRING9 are not known"),
        ("*Element, type=CPS4\n9, 1, 2\n", "elements of type CPS4 have 4 nodes each"),
        ("*Element, type=CPS4\n9, 1, 2, 3, 77\n", "element 9 has a node that the file does not have"),
        ("*Element, type=CPS4\n9, 1, 2, 7, 6, 3\n", "have 4 nodes each, and element 9 has 5"),
        ("*Element, type=B31\n9, 1, 2, 3\n10, 1, 2, 3\n", "have 2 nodes each, and element 9 has 3"),
        ("*Element, type=CPS4\n9, 1, 2\n10, 3, 4, 9\n", "have 4 nodes each, and element 9 has 6"),
        ("*Element, type=CPS4\n1, 1, 2, 7, 8\n", "element 1 is listed twice, and not the same"),
        ("*Element, type=CPS4, offset=1\n1, 1, 2, 7, 8\n", "*ELEMENT has the parameter OFFSET, which is not read"),
        ("*Element, type=CPS4, input=e.inp\n", "*ELEMENT has INPUT=e.inp, which is not a file"),
        ("*Node\n3, 9., 9.\n", "node 3 is listed twice, and not the same"),
        ("*Node\n16.5, 9., 9.\n", "16.5 is not the number of a node"),
        ("*Node, nodal thickness\n16, 9., 9.\n", "*NODE has the parameter NODAL THICKNESS"),
        ("*Elset, elset=S, gen\n1, 4, 1\n", "*ELSET has the parameter GEN, which is not read"),
        ("*Elset, elset=S, generate\n1, 4, 1, 2\n", "'1, 4, 1, 2' has 4 numbers; GENERATE takes"),
        ("*Elset, elset=S, generate\n1, 4, 2\n1, 12, 4\n", "generates 9, and the file has none"),
        ("*Elset, elset=S, generate\n" + "1, 8\n" * 101, "generates numbers that the file does not have"),
        ("*Elset, elset=S, instance=Plate-1\n1\n", "is of the instance Plate-1, which the file does not have"),
        ("*Nset, nset=S, elset=nowhere\n", "lists 'nowhere', which is neither a number nor a set"),
        ("*Part, name=P\n*End Part\n", "elements or sets outside its parts as well"),
        ("*Include, input=nothing.inp\n", "nothing.inp', which is not a file"),
        ("*Node\n7, x, 0.\n", "is not a row of numbers"),
        ("*Elset, elset=S,", "the file ends in a keyword line that goes on"),
        ("*Elset, elset=S,\n1\n2\n", "goes on into a row of numbers"),
        ("*Element, type=CPS4\n9, 1, 2, 3, 1e999\n", "inf is not the number of a node or an element"),
    ],
)
def test_what_is_not_understood_is_named(text, words, tmp_path):
    with pytest.raises(ValueError, match=re.escape(words)) as error:
        inp(tmp_path, f"*Node\n{NODES}*Element, type=CPS4\n{rows(*SQUARES)}{text}")
    assert "a.inp" in str(error.value)


SHELLS = "*Node\n1,0,0\n2,2,0\n3,2,1\n4,0,1\n*Element, type={}, elset=E\n1, 1, 2, 3, 4\n*Surface, name=S\nE, {}\n"


@pytest.mark.parametrize(
    ("of_type", "face", "right"),
    [("S4R", "E1", [1.0, 0.0]), ("S4", "S4", [2.0, 0.5]), ("CPS4", "S1", [1.0, 0.0]), ("CPE4R", "S4", [0.0, 0.5])],
)
def test_edges_of_shells_and_of_plane_elements(of_type, face, right, tmp_path):
    """CalculiX counts S1 and S2 of a shell as its two sides, and its edges from S3."""
    mesh = inp(tmp_path, SHELLS.format(of_type, face))
    (facet,) = mesh.boundaries["S"]
    assert mesh.p[:, mesh.facets[:, facet]].mean(axis=1) == pytest.approx(right)


@pytest.mark.parametrize(("of_type", "face"), [("S4", "S1"), ("S4R", "SPOS"), ("CPS4", "E1"), ("CPS4", "S5")])
def test_a_face_that_is_no_edge_is_left_out_by_name(of_type, face, tmp_path, caplog):
    mesh = inp(tmp_path, SHELLS.format(of_type, face))
    assert "S" not in (mesh.boundaries or {})
    assert f"line 8: *SURFACE S has the face '{face}' of an element {of_type}" in caplog.text


PART = f"*Part, name={{}}\n*Node\n{NODES}*Element, type=CPS4, elset=E\n{rows(*SQUARES)}{{}}*End Part\n"
PLACED = (
    "*Assembly, name=All\n*Node\n1, 1., 1.\n*Instance, name=A-1, part=A\n*End Instance\n*Instance, name=B-1, part=B\n"
    "3., 0., 0.\n*End Instance\n"
)


def two_parts(tmp_path, text, a="", b=""):
    return inp(tmp_path, PART.format("A", a) + PART.format("B", b) + PLACED + text + "*End Assembly\n")


def test_sets_of_an_assembly(tmp_path, caplog):
    """Of numbers and sets of one instance, of other sets of the assembly, by names with the instance in them."""
    mesh = two_parts(
        tmp_path,
        "*Elset, elset=One, instance=A-1\n1, 2\n*Elset, elset=Both\nOne, B-1.3\n*Elset, elset=Most\nBoth, b-1.E\n"
        "*Nset, nset=Handle\n1\n*Elset, elset=_Top_S3, internal, instance=B-1, generate\n5, 8\n"
        "*Surface, type=ELEMENT, name=Top\n_Top_S3, S3\nA-1.8, S2\n",
    )
    assert [area(mesh, name) for name in ("One", "Both", "Most")] == pytest.approx([0.5, 0.75, 2.5])
    assert centre(mesh, "Both") == pytest.approx([(2 * 0.5 + 4.25) / 3, 0.25])
    middle = mesh.p[:, mesh.facets[:, mesh.boundaries["Top"]]].mean(axis=1)
    assert sorted(middle[0].round(9).tolist()) == [2.0, 3.25, 3.75, 4.25, 4.75]
    assert "_Top_S3" not in mesh.subdomains
    # a reference point is no part of the body, and its set no boundary of it
    assert "1 vertex of no element was left out" in caplog.text
    assert "'Handle' has no facet" in caplog.text


def test_sets_of_one_name_in_two_parts_are_called_by_their_instances(tmp_path, caplog):
    left, right = "*Nset, nset=Edge\n1, 6, 11\n", "*Nset, nset=Edge\n5, 10, 15\n"
    mesh = two_parts(tmp_path, "", left, right)
    assert set(mesh.boundaries) == {"A-1.Edge", "B-1.Edge"}
    assert set(mesh.subdomains) == {"A-1.E", "B-1.E"}
    assert centre(mesh, "B-1.E") == pytest.approx([4.0, 0.5])
    assert "'Edge' is a *NSET of several parts: it is called 'A-1.Edge', 'B-1.Edge'" in caplog.text
    # the assembly's own keeps the name
    mesh = two_parts(tmp_path, "*Nset, nset=Edge, instance=B-1\n1, 6, 11\n", left)
    assert mesh.p[0, mesh.facets[:, mesh.boundaries["Edge"]]].max() == 3.0
    assert mesh.p[0, mesh.facets[:, mesh.boundaries["A-1.Edge"]]].max() == 0.0


def test_an_internal_set_hides_no_other(tmp_path):
    """Neither one of its name in another part, nor nodes where it has elements."""
    mesh = two_parts(
        tmp_path, "", "*Elset, elset=Low, internal\n1, 2\n*Nset, nset=Low\n1, 2, 3\n", "*Elset, elset=Low\n3, 4\n"
    )
    assert centre(mesh, "Low") == pytest.approx([4.5, 0.25])
    assert len(mesh.boundaries["Low"]) == 2


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("*Nset, nset=S, instance=C-1\n1\n", "is of the instance C-1, which the file does not have"),
        ("*Nset, nset=S\nC-1.Edge\n", "lists 'C-1.Edge', which is neither a number nor a set"),
        ("*Elset, elset=S\n1\n", "*ELSET lists 1, and the file has none of that number"),
        ("*Element, type=CPS4\n1, 1, 1, 1, 1\n", "*ELEMENT in the assembly is not read"),
        ("*Instance, name=C-1, part=C\n*End Instance\n", "*INSTANCE C-1 is of the part 'C', which"),
        ("*Instance, name=a-1, part=B\n*End Instance\n", "two instances of the name A-1"),
        ("*Instance, name=C, part=A\n0,0,0\n1,0,0,1,0,0,90\n*End Instance\n", "two different points on its axis"),
    ],
)
def test_what_an_assembly_does_not_have_is_named(text, words, tmp_path):
    with pytest.raises(ValueError, match=re.escape(words)):
        two_parts(tmp_path, text)


def test_a_part_that_stands_nowhere_is_noted(tmp_path, caplog):
    mesh = two_parts(tmp_path, "", "*End Part\n*Part, name=Tool\n*Node\n1, 0., 0.\n")
    assert area(mesh) == pytest.approx(4.0)
    assert "parts that no instance places were left out: Tool" in caplog.text


def test_rows_in_another_file(tmp_path):
    (tmp_path / "nodes.txt").write_text(NODES)
    (tmp_path / "elements.txt").write_text(rows(*SQUARES))
    text = "*Node, input=nodes.txt, nset=N\n*Element, type=CPE4, elset=E, input=elements.txt\n"
    assert area(inp(tmp_path, text), "E") == pytest.approx(2.0)
    (tmp_path / "nodes.txt").write_text(f"*Node\n{NODES}")
    with pytest.raises(ValueError, match="has keywords"):
        inp(tmp_path, text)


def test_marks_and_letters_of_other_systems(tmp_path):
    """A byte order mark; names in Latin-1."""
    text = f"*Node\n{NODES}*Element, type=CPS4, elset=Träger\n{rows(*SQUARES)}"
    for code in ("utf-8", "utf-8-sig", "latin-1"):
        (tmp_path / "a.inp").write_bytes(text.encode(code))
        assert list(read_mesh(tmp_path / "a.inp").subdomains) == ["Träger"]


def test_the_same_row_twice_is_one(tmp_path, caplog):
    mesh = inp(tmp_path, f"*Node\n{NODES}1, 0., 0., 0.\n*Element, type=CPS4, elset=A\n{rows(*SQUARES)}{rows(3)}")
    assert (mesh.nvertices, area(mesh, "A")) == (15, pytest.approx(2.0))


def test_an_empty_entry_is_zero(tmp_path):
    mesh = inp(tmp_path, "*Node\n1, , 1.\n2, 2., 0.,\n3, 1., 1.\n*Element, type=CPS3\n1, 1, 2, 3\n")
    assert [0.0, 1.0] in mesh.p.T.tolist()


def test_files_that_include_each_other(tmp_path):
    (tmp_path / "nodes.inc").write_text(f"*Node\n{NODES}")
    mesh = inp(tmp_path, f"*Include, input=nodes.inc\n*Element, type=CPS4\n{rows(*SQUARES)}")
    assert area(mesh) == pytest.approx(2.0)
    with pytest.raises(ValueError, match="includes files more than 8 deep"):
        inp(tmp_path, "*Include, input=a.inp\n")
    # forty files of forty lines are 1600 readings
    (tmp_path / "leaf.inc").write_text("** nothing\n")
    (tmp_path / "branch.inc").write_text("*Include, input=leaf.inc\n" * 40)
    with pytest.raises(ValueError, match="includes more than 100 files"):
        inp(tmp_path, "*Include, input=branch.inc\n" * 40)


# ---- Gmsh
GMSH = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
{names}
$EndPhysicalNames
$Entities
4 4 1 0
1 0 0 0 0
2 1 0 0 0
3 1 1 0 0
4 0 1 0 0
1 0 0 0 1 0 0 {bottom} 2 1 -2
2 1 0 0 1 1 0 {right} 2 2 -3
3 0 1 0 1 1 0 0 2 3 -4
4 0 0 0 0 1 0 {left} 2 4 -1
1 0 0 0 1 1 0 {plate} 4 1 2 3 4
$EndEntities
$Nodes
1 4 1 4
2 1 0 4
1
2
3
4
0 0 0
1 0 0
1 1 0
0 1 0
$EndNodes
$Elements
4 5 1 5
1 1 1 1
1 1 2
1 2 1 1
2 2 3
1 4 1 1
3 4 1
2 1 2 2
4 1 2 3
5 1 3 4
$EndElements
"""


def gmsh(tmp_path, names, **groups):
    given = dict.fromkeys(("bottom", "right", "left", "plate"), "0") | groups
    (tmp_path / "a.msh").write_text(GMSH.format(names=names, **given))
    return read_mesh(tmp_path / "a.msh")


def side(mesh, name):
    return mesh.p[:, mesh.facets[:, mesh.boundaries[name]]].mean(axis=1).T.tolist()


def test_a_curve_taken_reversed_is_in_its_group(tmp_path):
    mesh = gmsh(tmp_path, '2\n1 2 "left"\n2 1 "plate"', left="1 -2", plate="1 1")
    assert side(mesh, "left") == [[0.0, 0.5]]
    assert mesh.subdomains["plate"].tolist() == [0, 1]


def test_an_entity_in_several_groups_and_groups_without_a_name(tmp_path):
    mesh = gmsh(tmp_path, '1\n1 7 "edge"', left="2 7 9", bottom="1 9", plate="1 3")
    assert side(mesh, "edge") == [[0.0, 0.5]]
    assert sorted(side(mesh, "9")) == [[0.0, 0.5], [0.5, 0.0]]
    assert list(mesh.subdomains) == ["3"]


def test_two_groups_of_one_name(tmp_path):
    mesh = gmsh(tmp_path, '2\n1 1 "edge"\n1 2 "edge"', left="1 1", right="1 2")
    assert sorted(side(mesh, "edge")) == [[0.0, 0.5], [1.0, 0.5]]


def test_one_name_for_a_boundary_and_a_region(tmp_path):
    mesh = gmsh(tmp_path, '2\n1 1 "steel"\n2 1 "steel"', right="1 1", plate="1 1")
    assert side(mesh, "steel") == [[1.0, 0.5]]
    assert mesh.subdomains["steel"].tolist() == [0, 1]


def test_elements_that_are_saved_without_a_group(tmp_path):
    mesh = gmsh(tmp_path, '1\n1 2 "left"', left="1 2")
    assert (list(mesh.boundaries), mesh.subdomains) == (["left"], None)
    assert mesh.nelements == 2


def test_counts_that_the_file_declares(tmp_path):
    (tmp_path / "a.msh").write_text(
        GMSH.format(names="0", bottom=0, right=0, left=0, plate=0).replace("4 5 1 5", "4 6 1 6")
    )
    with pytest.raises(ValueError, match="it declares 6 elements and lists 5"):
        read_mesh(tmp_path / "a.msh")


PLAIN = GMSH.format(names="0", bottom=0, right=0, left=0, plate=0)
OLD = (
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$EndNodes\n"
    "$Elements\n2\n1 1 2 7 1 1 2\n2 2 2 8 1 1 2 3\n$EndElements\n"
)


@pytest.mark.parametrize(
    ("text", "old", "new", "words"),
    [
        (
            PLAIN,
            "5 1 3 4\n",
            "5 1 3 4\n6 1 2 3\n",
            "its section Elements goes on beyond what it declares, by 4 numbers",
        ),
        (PLAIN, "0 1 0\n$EndN", "0 1 0\n9 9\n$EndN", "its section Nodes goes on beyond what it declares, by 2 numbers"),
        (PLAIN, "0 4 1 2 3 4\n", "0 4 1 2 3 4\n0\n", "its section Entities goes on"),
        (PLAIN, "$EndNodes", "x$EndNodes", "it has a word where a number belongs"),
        (PLAIN, "\n3\n4\n0 0 0", "\n3\n3\n0 0 0", "node 3 is listed twice, and not the same"),
        (PLAIN, "\n3\n4\n0 0 0", "\n3\n3.5\n0 0 0", "3.5 is not a whole number"),
        (PLAIN, "\n3\n4\n0 0 0", "\n3\n1e300\n0 0 0", "1e+300 is not a whole number"),
        (PLAIN, "1 1 1 1\n1 1 2", "1 1 1 -1\n1 1 2", "a count of -1 is none"),
        (
            PLAIN,
            "1 0 0 0 0\n2 1",
            f"1 0 0 0 101 {' '.join(map(str, range(1, 102)))}\n2 1",
            "is in 101 groups; at most 100",
        ),
        (PLAIN, "4.1 0 8", "4.1 0", "its $MeshFormat is not a version"),
        (PLAIN, "\n0\n$EndPh", '\n2\n2 1 "a"\n$EndPh', "it declares 2 names of groups and lists 1"),
        (OLD, "Elements\n2\n", "Elements\n1\n", "its section Elements goes on beyond what it declares, by 8 numbers"),
        (OLD, "Elements\n2\n", "Elements\n3\n", "it ends in the middle of a section"),
        (OLD, "Nodes\n3\n", "Nodes\n2\n", "its section Nodes goes on beyond what it declares, by 4 numbers"),
        (OLD, "Nodes\n3\n", "Nodes\nmany\n", "its section Nodes does not begin with a count"),
        (OLD, "\n1 1 2 7 1 1 2\n", "\n1 1 -1 1 2\n", "it has an element of -1 tags"),
        (OLD, "3 0 1 0\n", "2 0 1 0\n", "node 2 is listed twice, and not the same"),
    ],
)
def test_damage_of_a_gmsh_file_is_named(text, old, new, words, tmp_path):
    (tmp_path / "a.msh").write_text(text)
    assert read_mesh(tmp_path / "a.msh").nelements in (1, 2)
    assert text.count(old) == 1
    (tmp_path / "a.msh").write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=re.escape(words)):
        read_mesh(tmp_path / "a.msh")


def test_names_with_quotes_and_of_other_systems(tmp_path):
    text = GMSH.format(names='1\n2 1 "the \\"Träger\\""', bottom=0, right=0, left=0, plate="1 1")
    for code in ("utf-8", "utf-8-sig", "latin-1"):
        (tmp_path / "a.msh").write_bytes(text.encode(code))
        assert list(read_mesh(tmp_path / "a.msh").subdomains) == ['the \\"Träger\\"']


def test_a_declared_name_that_came_to_nothing_is_no_other_boundary(tmp_path, caplog):
    """``left`` of the file is nothing: it is not the left side of the box, and to use it is an error."""
    (tmp_path / "a.msh").write_text(GMSH.format(names='1\n1 2 "left"', bottom=0, right=0, left=0, plate=0))
    with caplog.at_level(logging.WARNING):
        mesh = make_mesh(MeshTable(file="a.msh"), tmp_path)
    assert "the group 'left' is declared and has no facets of the boundary" in caplog.text
    with pytest.raises(ValueError, match="'left' is an empty set"):
        collar(mesh, "left", 0.0)
    with pytest.raises(ValueError, match="boundary 'right' is not in the mesh"):
        collar(mesh, "right", 0.0)
    assert mesh.refined().nelements == 8


def test_sides_are_named_where_a_file_names_none(tmp_path):
    skfem.MeshTri().refined(1).save(str(tmp_path / "a.vtu"), encode_cell_data=False)
    assert set(make_mesh(MeshTable(file="a.vtu"), tmp_path).boundaries) == {"left", "right", "bottom", "top"}
    inp(tmp_path, f"*Node\n{NODES}*Element, type=CPS4\n{rows(*SQUARES)}*Nset, nset=left\n8\n")
    mesh = make_mesh(MeshTable(file="a.inp"), tmp_path)
    assert "left" not in mesh.boundaries  # a node inside: what the file calls left is not the side of the box
    assert "right" in mesh.boundaries
    with pytest.raises(SceneError, match="mesh.file = 'missing.msh' is not a file"):
        make_mesh(MeshTable(file="missing.msh"), tmp_path.relative_to(tmp_path))


# ---- VTU
def plate(x=0.0):
    axis = np.linspace(0, 2, 5)
    mesh = skfem.MeshTri.init_tensor(axis + x, np.linspace(0, 1, 3))
    return np.vstack([mesh.p, 0 * mesh.p[:1]]).T, mesh.t.T


def vtu(path, **data):
    p, t = plate()
    half = (p[t].mean(axis=1)[:, 0] > 1.0) + 1
    meshio.Mesh(p, [("triangle", t)], cell_data={key: [make(half)] for key, make in data.items()}).write(path)


def test_tags_of_shape_n_by_1(tmp_path):
    vtu(tmp_path / "a.vtu", region=lambda half: half[:, None])
    mesh = read_mesh(tmp_path / "a.vtu")
    assert [area(mesh, name) for name in ("1", "2")] == pytest.approx([1.0, 1.0])


@pytest.mark.parametrize("name", ["materials", "MaterialIds", "name_to_read", "gmsh:physical"])
def test_common_names_of_integers_are_groups(name, tmp_path):
    vtu(tmp_path / "a.vtu", **{name: lambda half: half.astype(np.int32)})
    mesh = read_mesh(tmp_path / "a.vtu")
    assert centre(mesh, "2") == pytest.approx([1.5, 0.5])


def test_integers_that_are_no_groups_are_named(tmp_path, caplog):
    vtu(tmp_path / "a.vtu", processor=lambda half: half.astype(np.int32))
    with caplog.at_level(logging.WARNING):
        assert read_mesh(tmp_path / "a.vtu").subdomains is None
    assert "the integers 'processor' of its elements are not taken for groups" in caplog.text


def pieces(tmp_path):
    parts = []
    for k, x in enumerate((0.0, 2.0)):
        p, t = plate(x)
        meshio.Mesh(p, [("triangle", t)], cell_data={"region": [np.full(len(t), k + 1)]}).write(
            tmp_path / "p.vtu", binary=False
        )
        text = (tmp_path / "p.vtu").read_text()
        parts.append(re.search(r"<Piece.*</Piece>", text, re.S)[0])
    return text.replace(parts[-1], "\n".join(parts))


def test_several_pieces(tmp_path):
    (tmp_path / "a.vtu").write_text(pieces(tmp_path))
    mesh = read_mesh(tmp_path / "a.vtu")
    assert (mesh.nvertices, area(mesh)) == (30, pytest.approx(4.0))
    assert centre(mesh, "2") == pytest.approx([3.0, 0.5])
    assert read_mesh(tmp_path / "a.vtu", join=True).nvertices == 27


def test_true_reasons(tmp_path):
    vtu(tmp_path / "a.vtu")
    text = (tmp_path / "a.vtu").read_text()
    (tmp_path / "lz4.vtu").write_text(text.replace("vtkZLibDataCompressor", "vtkLZ4DataCompressor"))
    with pytest.raises(
        ValueError, match=r"lz4.vtu'.*compressed by vtkLZ4DataCompressor, which is not read: save it again"
    ):
        read_mesh(tmp_path / "lz4.vtu")
    count = pieces(tmp_path).replace('NumberOfCells="16"', 'NumberOfCells="15"', 1)
    (tmp_path / "b.vtu").write_text(count)
    with pytest.raises(ValueError, match="b.vtu'"):
        read_mesh(tmp_path / "b.vtu")


def coded(tmp_path, mode, header="UInt32", order="<", block=100):
    """The pieces of a plate with their arrays written in another way, by the lines of VTK's own description."""
    text = pieces(tmp_path).replace('version="0.1"', f'version="1.0" header_type="{header}"')
    size = order + {"UInt32": "u4", "UInt64": "u8"}[header]
    packers = {"vtkZLibDataCompressor": zlib.compress, "vtkLZMADataCompressor": lzma.compress}
    packer = next((name for name in packers if name in mode), None)
    if order == ">":
        text = text.replace("LittleEndian", "BigEndian")
    if packer:
        text = text.replace("<VTKFile", f'<VTKFile compressor="{packer}"')
    kinds = {"Float64": "f8", "Int64": "i8", "Int32": "i4", "UInt8": "u1"}
    appended = b""

    def array(match):
        nonlocal appended
        data = np.array(match[3].split(), dtype=order + kinds[re.search(r'type="(\w+)"', match[1])[1]]).tobytes()
        if packer:
            parts = [data[k : k + block] for k in range(0, len(data), block)]
            packed = [packers[packer](part) for part in parts]
            last = len(parts[-1]) % block
            head = np.array([len(parts), block, last, *map(len, packed)], dtype=size).tobytes()
            data = b"".join(packed)
        else:
            head = np.array([len(data)], dtype=size).tobytes()
        if "raw" in mode:
            content = head + data
        elif packer:  # the numbers of the blocks are a run of their own
            content = base64.b64encode(head) + base64.b64encode(data)
        else:
            content = base64.b64encode(head + data)
        if "appended" not in mode:
            return f'{match[1]}format="binary"{match[2]}>{content.decode()}</DataArray>'
        appended += content
        return f'{match[1]}format="appended" offset="{len(appended) - len(content)}"{match[2]}/>'

    text = re.sub(r'(<DataArray[^>]*)format="ascii"([^>]*)>([^<]*)</DataArray>', array, text)
    if not appended:
        return text.encode()
    kind = "raw" if "raw" in mode else "base64"
    tail = b'<AppendedData encoding="' + kind.encode() + b'">_' + appended + b"</AppendedData></VTKFile>"
    return text.encode().replace(b"</VTKFile>", tail)


@pytest.mark.parametrize("mode", ["inline", "appended", "appended raw"])
@pytest.mark.parametrize("packer", ["", "vtkZLibDataCompressor", "vtkLZMADataCompressor"])
@pytest.mark.parametrize(("header", "order"), [("UInt32", "<"), ("UInt64", ">")])
def test_every_way_to_write_numbers(mode, packer, header, order, tmp_path):
    (tmp_path / "a.vtu").write_bytes(coded(tmp_path, f"{mode} {packer}", header, order))
    mesh = read_mesh(tmp_path / "a.vtu")
    assert (mesh.nvertices, area(mesh), area(mesh, "2")) == (30, pytest.approx(4.0), pytest.approx(2.0))
    assert centre(mesh, "2") == pytest.approx([3.0, 0.5])


def test_a_packed_array_is_as_long_as_it_says(tmp_path):
    """An array of zeros that unpacks to more than belongs there is not unpacked."""
    content = coded(tmp_path, "inline vtkZLibDataCompressor", block=10**6).decode()
    zeros = zlib.compress(bytes(10**8))
    for declared, words in ((10**8, "1e\\+08 bytes when unpacked"), (128, "a block of it is not as long as declared")):
        head = np.array([1, declared, 0, len(zeros)], dtype="<u4").tobytes()
        junk = (base64.b64encode(head) + base64.b64encode(zeros)).decode()
        text = re.sub(r'(Name="region"[^>]*>)[^<]*<', rf"\g<1>{junk}<", content, count=1)
        assert text != content
        (tmp_path / "a.vtu").write_text(text)
        with pytest.raises(ValueError, match=words):
            read_mesh(tmp_path / "a.vtu")


ASCII = """<VTKFile type="UnstructuredGrid" byte_order="LittleEndian"><UnstructuredGrid>
<Piece NumberOfPoints="6" NumberOfCells="2"><Points><DataArray type="Float64" NumberOfComponents="3">
0 0 0 1 0 0 2 0 0 0 1 0 1 1 0 2 1 0</DataArray></Points><Cells>
<DataArray type="Int32" Name="connectivity">{connectivity}</DataArray>
<DataArray type="Int32" Name="offsets">{offsets}</DataArray>
<DataArray type="UInt8" Name="types">{types}</DataArray></Cells>
<CellData><DataArray type="Float64" Name="{name}">{data}</DataArray></CellData>
</Piece></UnstructuredGrid></VTKFile>"""
SOUND = {"connectivity": "0 1 3 4 1 2 5 4", "offsets": "4 8", "types": "8 9", "name": "material", "data": "0 1"}


def test_rows_of_cells_and_regions_from_zero(tmp_path):
    """A pixel is a quadrilateral by rows; a region of number 0 is one where numbers are of all elements."""
    (tmp_path / "a.vtu").write_text(ASCII.format(**SOUND))
    mesh = read_mesh(tmp_path / "a.vtu")
    assert [area(mesh, name) for name in ("0", "1")] == pytest.approx([1.0, 1.0])
    assert centre(mesh, "1") == pytest.approx([1.5, 0.5])


def test_copies_of_elements_for_other_pieces_are_left_out(tmp_path, caplog):
    (tmp_path / "a.vtu").write_text(ASCII.format(**SOUND | {"name": "vtkGhostType", "data": "1 0"}))
    assert read_mesh(tmp_path / "a.vtu").p[0].min() == 1.0
    assert "1 ghost elements, copies for other pieces, were left out" in caplog.text


def test_numbers_that_are_not_whole_are_no_groups(tmp_path, caplog):
    (tmp_path / "a.vtu").write_text(ASCII.format(**SOUND | {"data": "1.2 1.7"}))
    assert read_mesh(tmp_path / "a.vtu").subdomains is None
    assert "the numbers 'material' of its elements are not whole" in caplog.text


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("offsets", "4 7", "offsets that do not cut its 8 connectivity entries"),
        ("offsets", "4", "declares 2 cells and lists 1 offsets"),
        ("connectivity", "0 1 3 4 1 2 5 6", "a quad has vertex 6; there are 6, counted from 0"),
        ("connectivity", "0 1 3 4 1 2 5 -1", "a quad has vertex -1"),
        ("connectivity", "0 1 3 4 1 2 5 x", "a word where a number belongs"),
        ("types", "8 6", "cells of VTK's type 6 with 4 vertices"),
        ("types", "8 10 10", "lists 2 offsets and 3 types"),
        ("data", "1 2 3", "has 3 numbers of 'material' for 2 cells"),
    ],
)
def test_arrays_that_do_not_fit_are_named(key, value, words, tmp_path):
    (tmp_path / "a.vtu").write_text(ASCII.format(**SOUND | {key: value}))
    with pytest.raises(ValueError, match=re.escape(words)):
        read_mesh(tmp_path / "a.vtu")


# ---- other formats
def test_families_of_med_have_names(tmp_path):
    """A family is a number with several names; a name is that of several families."""
    p, t = plate()
    half = np.where(p[t].mean(axis=1)[:, 0] > 1.0, -2, -1)
    mesh = meshio.Mesh(p[:, :2], [("triangle", t)], cell_data={"cell_tags": [half]})
    mesh.cell_tags = {-1: ["soft", "all"], -2: ["stiff", "all"]}
    mesh.write(tmp_path / "a.med")
    mesh = read_mesh(tmp_path / "a.med")
    assert {name: area(mesh, name) for name in mesh.subdomains} == pytest.approx(
        {"soft": 1.0, "stiff": 1.0, "all": 2.0}
    )


@pytest.mark.parametrize(
    "name", ["a.med", "a.xdmf", "a.off", "a.vtk", "a.mesh", "a.nas", "a.bdf", "a.ply", "a.stl", "a.e"]
)
def test_what_a_reader_breaks_down_with_becomes_a_sentence(name, tmp_path):
    """Garbage, and the first half of a file: the file, what was met, what to do."""
    for content in (b"", b"CDF\x01\x00\x00", b"\x89HDF\r\n\x1a\nx", b"OFF\nnonsense\n", b"\x00\x01"):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=name) as error:
            read_mesh(tmp_path / name)
        words = str(error.value)
        assert len(words.split()) > 6, words
        assert words.strip()[-1] not in ":(", words
        assert "None" not in words.split(), words


# two blocks of the plate [0, 2] x [0, 1] cut along x = 1, with sets of nodes and of sides
EXODUS = {
    "coordx": ("f8", [0.0, 1.0, 2.0, 0.0, 1.0, 2.0]),
    "coordy": ("f8", [0.0, 0.0, 0.0, 1.0, 1.0, 1.0]),
    "connect1": ("i4", [[1, 2, 5], [1, 5, 4]]),
    "connect2": ("i4", [[2, 3, 6, 5]]),
    "eb_prop1": ("i4", [10, 20]),
    "eb_names": ("S1", [list("steel\0\0"), list("\0\0\0\0\0\0\0")]),
    "node_ns1": ("i4", [1, 4]),
    "ns_prop1": ("i4", [7]),
    "elem_ss1": ("i4", [3, 1, 2]),
    "side_ss1": ("i4", [2, 1, 2]),
    "ss_names": ("S1", [list("loaded\0")]),
}


def exodus(path, **changed):
    """A file of the classic form by SciPy, which writes what it also reads, or of HDF by h5py."""
    arrays = EXODUS | {name: (EXODUS[name][0], value) for name, value in changed.items()}
    kinds = {"connect1": "TRI3", "connect2": "QUAD4"}
    if path.suffix == ".exo":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            for name, (kind, value) in arrays.items():
                file[name] = np.array(value, dtype=kind)
                if name in kinds:
                    file[name].attrs["elem_type"] = kinds[name]
        return read_mesh(path)
    with netcdf_file(path, "w", version=2) as file:
        for name, (kind, value) in arrays.items():
            data = np.array(value, dtype=kind)
            axes = tuple(f"{name}_{k}" for k in range(data.ndim))
            for axis, size in zip(axes, data.shape, strict=True):
                file.createDimension(axis, size)
            variable = file.createVariable(name, "c" if kind == "S1" else kind, axes)
            variable[:] = data
            if name in kinds:
                variable.elem_type = kinds[name]
    return read_mesh(path)


@pytest.mark.parametrize("name", ["a.e", "a.exo"])
def test_blocks_and_sets_of_exodus(name, tmp_path):
    mesh = exodus(tmp_path / name)
    assert {key: area(mesh, key) for key in mesh.subdomains} == pytest.approx({"steel": 1.0, "20": 1.0})
    assert centre(mesh, "20") == pytest.approx([1.5, 0.5])
    assert side(mesh, "7") == [[0.0, 0.5]]
    assert sorted(side(mesh, "loaded")) == [[0.5, 0.0], [0.5, 1.0], [2.0, 0.5]]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"side_ss1": [5, 1, 1]}, "the set of sides loaded has side 5 of a quad, which has 4"),
        ({"elem_ss1": [4, 1, 1]}, "the set of sides loaded lists 4 of 3"),
        ({"node_ns1": [0, 1]}, "the set of nodes 7 lists 0 of 6"),
        ({"connect1": [[1, 2, 7], [1, 5, 4]]}, "block steel has vertex 7 of 6"),
        ({"connect2": [[2, 3]]}, "block 20 has elements of type 'QUAD4' with 2 nodes"),
    ],
)
def test_sets_of_exodus_that_do_not_fit(changed, words, tmp_path):
    with pytest.raises(ValueError, match=re.escape(words)):
        exodus(tmp_path / "a.e", **changed)


@pytest.mark.parametrize(
    ("kind", "corners"),
    [
        ("TETRA", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]),
        ("PYRAMID", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, 1)]),
        ("WEDGE", [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (0, 1, 1)]),
        ("HEX", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]),
    ],
)
def test_all_sides_of_a_solid_are_its_surface(kind, corners, tmp_path):
    """Each side is facets of the boundary, and together they are all of it, once."""
    from skfem_peridynamics.meshes.exodus import _SIDES, read_exodus

    sides = len(next(value for key, value in _SIDES.items() if key.startswith(kind[:3].lower())))
    arrays = {"coord": np.array(corners, float).T, "connect1": np.arange(1, len(corners) + 1)[None]}
    with netcdf_file(tmp_path / "a.e", "w") as file:
        for number in range(1, sides + 1):
            arrays |= {f"elem_ss{number}": np.array([1]), f"side_ss{number}": np.array([number])}
        for name, data in arrays.items():
            axes = tuple(f"{name}_{k}" for k in range(data.ndim))
            for axis, size in zip(axes, data.shape, strict=True):
                file.createDimension(axis, size)
            file.createVariable(name, "f8" if data.dtype == float else "i4", axes)[:] = data
        file.variables["connect1"].elem_type = kind
    assert read_exodus(tmp_path / "a.e").blocks[0][0].startswith(kind.lower()[:3])
    mesh = read_mesh(tmp_path / "a.e")
    found = np.concatenate([mesh.boundaries[str(number)] for number in range(1, sides + 1)])
    assert sorted(found.tolist()) == sorted(mesh.boundary_facets().tolist())


def test_a_reader_that_lacks_a_library_names_it(tmp_path, monkeypatch):
    from skfem_peridynamics.meshes import guarded_reader

    def missing(path):
        raise ModuleNotFoundError("No module named 'netCDF4'", name="netCDF4")

    monkeypatch.setattr(guarded_reader, "read", missing)
    (tmp_path / "a.nc").write_bytes(b"")
    with pytest.raises(ValueError, match="a.nc'.*its reader needs netCDF4: pip install netCDF4, or export"):
        read_mesh(tmp_path / "a.nc")


def test_groups_that_do_not_fit_into_memory(tmp_path, monkeypatch):
    """Each of them is a mark for every element; a few lines can name thousands."""
    text = f"*Node\n{NODES}*Element, type=CPS4, elset=E\n{rows(*SQUARES)}" + "".join(
        f"*Elset, elset=S{k}\nE\n" for k in range(200)
    )
    assert len(inp(tmp_path, text).subdomains) == 201
    monkeypatch.setattr("skfem_peridynamics.meshes.mend.free_memory", lambda: 1600.0)
    with pytest.raises(ValueError, match="its 201 groups of elements take 0.00161 MB, and 0.0016 MB are free"):
        inp(tmp_path, text)
    monkeypatch.setattr("skfem_peridynamics.meshes.abaqus_sets.free_memory", lambda: 100.0)
    with pytest.raises(ValueError, match="its set E of 8 members needs more memory"):
        inp(tmp_path, text)
