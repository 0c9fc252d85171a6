"""Headlines: of bodies whose cracks are known by construction, and of two runs that are no single crack."""

import numpy as np
import pytest

from bodies import grid
from skfem_peridynamics import Crack, Scene, run, slit
from skfem_peridynamics.analysis.crack import crack_path
from skfem_peridynamics.app.files.results import Results
from skfem_peridynamics.app.report.headline import verdict

EPS = 0.1  # four vertices


def square(*lines):
    mesh = grid((1, 40), (1, 40))
    return slit(mesh, *[Crack(line) for line in lines]) if lines else mesh


def distance(mesh, a, b):
    """From a line between two points, in 2D, or in 3D from a plane strip along z."""
    a, b = np.array(a, float), np.array(b, float)
    x = mesh.p[:2].T - a
    along = np.clip(x @ (b - a) / ((b - a) @ (b - a)), 0, 1)
    return np.linalg.norm(x - along[:, None] * (b - a), axis=1)


def torn(mesh, *lines, disc=None, width=0.026):
    """What a row beside cracks has left of its bonds, and what a crushed disc has."""
    intact = np.ones(mesh.nvertices)
    for a, b in lines:
        intact[distance(mesh, a, b) < width] = 0.55
    if disc is not None:
        middle, radius = disc
        intact[np.linalg.norm(mesh.p[:2].T - middle, axis=1) < radius] = 0.1
    return intact


def said(mesh, intact, speed=0.4, energy=1.1, horizon=EPS, tmp=None):
    path = crack_path(mesh, intact, horizon)
    flat = mesh.dim() == 2
    summary = {
        "status": "finished",
        "crack_reach": float(path.reach[0]) if path.found else 0.0,
        "crack_area": path.length if flat else 0.36,
        "cracks": path.cracks,
        "crushed": path.crushed,
        "largest_tip_speed": speed,
        "largest_Z": 0.4,
        "elastic": {"rayleigh_speed": 1.0, "toughness": 2.0},
        "energy_per_crack_area": 2.0 * energy,
    }
    if flat:
        summary |= {"crack_length": path.length, "tips": len(path.tips), "energy_per_crack_length": 2.0 * energy}
    return path, verdict(Results(tmp, summary, {}, ()))


THREE = (([0.0, 0.2], [0.6, 0.2]), ([0.2, 0.6], [0.2, 1.0]), ([0.6, 0.5], [0.9, 0.8]))
BODIES = {
    "whole": (square, (), {}, "No bond has softened", None),
    "straight": (square, ([0.0, 0.5], [0.6, 0.5]), {}, "The crack grew by 0.", 0.6),
    "from a slit": (
        lambda: square([[0.0, 0.5], [0.3, 0.5]]),
        ([0.32, 0.5], [0.7, 0.5]),
        {},
        "The crack grew by 0.",
        0.4,
    ),
    "inside": (square, ([0.3, 0.3], [0.7, 0.7]), {}, "The crack grew by 0.", 0.4 * 2**0.5),
    "through": (square, ([0.0, 0.5], [1.0, 0.5]), {}, "The crack grew by ", 1.0),
    "faster than waves": (
        square,
        ([0.0, 0.5], [0.6, 0.5]),
        {"speed": 3.15},
        "not as a single crack. What was farthest",
        0.6,
    ),
    "too much energy": (
        square,
        ([0.0, 0.5], [0.6, 0.5]),
        {"energy": 14.9},
        "Its bonds hold 14.9 times the toughness",
        0.6,
    ),
}


@pytest.mark.parametrize("name", BODIES)
def test_what_is_said_of_one_crack(name, tmp_path):
    make, line, keys, words, length = BODIES[name]
    mesh = make()
    path, sentence = said(mesh, torn(mesh, *((line,) if line else ())), tmp=tmp_path, **keys)
    print(f"{name}: {sentence}")
    assert words in sentence
    assert ("Rayleigh speed" in sentence) == (name not in ("whole", "too much energy"))
    assert path.cracks == (length is not None)
    if length is not None:
        assert path.length == pytest.approx(length, abs=0.06)
        assert path.crushed == 0.0


def test_a_branching_crack_and_three_at_once(tmp_path):
    mesh = square([[0.0, 0.5], [0.2, 0.5]])
    branches = ([0.22, 0.5], [0.5, 0.5]), ([0.5, 0.5], [0.8, 0.8]), ([0.5, 0.5], [0.7, 0.3])
    path, sentence = said(mesh, torn(mesh, *branches), tmp=tmp_path)
    assert path.length == pytest.approx(0.28 + 0.5 * 2**0.5, abs=0.08)
    assert sentence.startswith("The crack grew by 1.0")
    assert ", and has 2 tips; its tip ran at up to 0.40" in sentence
    mesh = square()
    path, sentence = said(mesh, torn(mesh, *THREE), speed=3.15, energy=14.9, tmp=tmp_path)
    exact = 0.6 + 0.4 + 0.3 * 2**0.5
    print(sentence)
    assert sentence.startswith("3 cracks have opened, 1.")
    assert "advanced at up to 3.15 of the Rayleigh speed, which no crack outruns; its bonds hold 14.9 times" in sentence
    assert path.length == pytest.approx(exact, abs=0.11)  # 0.097 measured: three cracks, each within its band
    assert path.cracks == 3
    assert path.tips[0] == pytest.approx([0.6, 0.2], abs=0.04)  # from the boundary, the longest of them


def test_what_is_crushed_is_no_crack(tmp_path):
    mesh = square()
    path, sentence = said(mesh, torn(mesh, disc=([0.5, 1.0], 0.3)), tmp=tmp_path)
    exact = ((0.3 - 0.75 * EPS) / 0.3) ** 2  # half a disc, and what lies deep in it
    print(f"{path.crushed:.3f}, by area {exact:.3f}: {sentence}")
    assert path.crushed == pytest.approx(exact, abs=0.03)  # 0.010 measured
    assert sentence.startswith("A zone has been crushed, and is no crack: ")


def test_bonds_that_break_early_make_a_crack_all_the_same(tmp_path):
    """At the critical strain they take 39 % of the toughness with them."""
    mesh = square()
    path = crack_path(mesh, torn(mesh, ([0.0, 0.5], [0.6, 0.5])), EPS)
    summary = {
        "status": "finished",
        "crack_reach": 0.6,
        "crack_length": path.length,
        "cracks": 1,
        "elastic": {"toughness": 1.0},
    }
    summary["energy_per_crack_length"] = 0.39
    assert verdict(Results(tmp_path, summary, {}, (), {"material": {"breaking": 1.0}})).startswith(
        "The crack grew by 0."
    )
    assert "not as a single crack" in verdict(Results(tmp_path, summary, {}, (), {"material": {}}))


def test_a_crack_in_space_by_its_area(tmp_path):
    mesh = grid((1, 20), (1, 20), (0.3, 6))
    path, sentence = said(mesh, torn(mesh, ([0.0, 0.5], [0.6, 0.5]), width=0.051), horizon=0.2, tmp=tmp_path)
    assert path.cracks == 1
    assert path.reach[0] == pytest.approx(np.hypot(0.6, 0.3), abs=0.06)  # the diagonal of the strip
    assert sentence.startswith("A crack of 0.36 has opened, 0.")


def test_where_a_crack_begins_stays():
    """A crack inside the body grows at one end: its first tip follows that end, and its way grows."""
    mesh, before = square(), None
    for end in np.linspace(0.4, 0.8, 9):
        path = crack_path(mesh, torn(mesh, ([0.3, 0.5], [end, 0.5])), EPS)
        assert path.tips[0] == pytest.approx([end, 0.5], abs=0.05)
        assert before is None or path.reach[0] >= before
        before = path.reach[0]


IMPACT = """
mesh = {box = [[0, 1], [0, 1]], divisions = [32, 32]}
material = {young = 1.0, toughness = 4e-5, density = 1.0, plane = "stress"BREAKING}
bonds = {horizon = 0.12}
initial = {velocity = ["0", "WHERE"]}
time = {until = 0.6}
output = {frames = 0, history = 30, pictures = false}
"""


@pytest.mark.slow
@pytest.mark.parametrize("breaking", ["", ", breaking = 1.0"])
def test_an_impact_crushes(breaking, tmp_path):
    scene = IMPACT.replace("WHERE", "-0.3*step(y - 0.75)*step(0.2 - abs(x - 0.5))").replace("BREAKING", breaking)
    summary = run(Scene.parse(scene), tmp_path)
    sentence = verdict(Results(tmp_path, summary, {}, (), summary["run"]["scene"]))
    print(f"crushed {summary['crushed']:.2f}, {summary['cracks']} cracks, {summary['crack_length']:.3g}: {sentence}")
    assert "The crack grew" not in sentence
    history = np.genfromtxt(tmp_path / "history.csv", delimiter=",", names=True)
    if breaking:
        for name in ("crack_length", "crack_reach", "crack_area"):
            assert (np.diff(history[name]) >= 0.0).all()
