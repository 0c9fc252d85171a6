"""The validation cases, coarsely: what they judge must hold. All of it is  python examples/validation/run_all.py"""

import importlib
import sys
from pathlib import Path

import numpy as np
import pytest

CASES = Path(__file__).parents[2] / "examples" / "validation"


@pytest.fixture(scope="module", autouse=True)
def way():
    sys.path.insert(0, str(CASES))
    yield
    sys.path.remove(str(CASES))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["waves", "toughness", "static_crack", "kalthoff", "poisson"])
def test_a_case_holds_coarsely(name, tmp_path):
    page = importlib.import_module(name).run(tmp_path, quick=True)
    assert len(page.figures) >= 2
    assert [one.what for one in page.figures if not one.holds] == []
    assert page.seconds > 0.0
    assert len(page.runs) >= 1
    text = page.markdown()
    assert "**does not hold**" not in text
    assert text.count("| holds |") == len(page.figures)


def test_a_page_tells_what_does_not_hold(capsys):
    from page import Page

    page = Page("x", "Title", "Words.")
    page.judge("a", 1.0, 0.0, 2.0)
    page.judge("b", 3.0, 0.0, 2.0, "a book")
    page.judge("c", float("nan"), 0.0, 2.0)
    with page.timed("a run") as said:
        said["steps"], said["error"] = 3, 0.5
    assert not page.holds
    assert [one.holds for one in page.figures] == [True, False, False]
    assert capsys.readouterr().out.count("DOES NOT HOLD") == 2
    text = page.markdown()
    assert "| b | 3 | 0 to 2 | a book | **does not hold** |" in text
    assert "| a run | 0.0 | 3 | 0.5 |" in text


def test_scenes_are_changed_by_their_keys(tmp_path):
    import meshio
    from scenes import mesh_file, read

    tables = read("kalthoff.toml", bonds__horizon=1.0, crack__1__points=[[0.0, 1.0]])
    assert tables["bonds"]["horizon"] == 1.0
    assert tables["crack"][1]["points"] == [[0.0, 1.0]]
    assert read("kalthoff.toml")["bonds"]["horizon"] == 4e-3
    box, divisions = [[0.0, 1.0], [0.0, 2.0]], [4, 8]
    for kind in ("crossed", "random"):
        mesh_file(tmp_path / "a.vtu", box, divisions, kind, lambda p: np.abs(p[1] - 1.0) < 1e-9)
        content = meshio.read(tmp_path / "a.vtu")
        p, t = content.points, content.cells[0].data
        area = np.abs(np.linalg.det((p[t][:, 1:] - p[t][:, :1])[:, :, :2])) / 2
        assert area.min() > 0.01
        assert area.sum() == pytest.approx(2.0)
        rising = ((p[t] - np.roll(p[t], 1, axis=1))[:, :, :2].prod(axis=2) > 1e-3).any(axis=1)
        assert kind != "crossed" or rising.sum() == 32  # of 64: every other cell
        assert p.min(axis=0).tolist()[:2] == [0.0, 0.0]
        assert p.max(axis=0).tolist()[:2] == [1.0, 2.0]
        assert (np.abs(p[:, 1] - 1.0) < 1e-9).sum() == 5
        assert (np.abs(p[:, 1] - 1.25) < 1e-9).sum() == (5 if kind == "crossed" else 2)


def test_known_figures():
    from static_crack import handbook
    from waves import SPEED, rayleigh

    assert pytest.approx(0.919402, abs=1e-6) == SPEED
    # a / W = 0.4: the factor on sqrt(pi a) is 1.1094 in the tables
    assert handbook() / np.sqrt(np.pi * 0.4) == pytest.approx(1.1094, rel=2e-3)
    # Rayleigh's wave leaves its surface free: no shear there, du_x/dy + du_y/dx = 0, by differences
    h, x = 1e-5, np.array([2.3, 2.41])
    (below, _), (at, _) = rayleigh(x, np.full(2, h), SPEED), rayleigh(x, np.zeros(2), SPEED)
    (right, _), (left, _) = rayleigh(x + h, np.zeros(2), SPEED), rayleigh(x - h, np.zeros(2), SPEED)
    shear = (at[0] - below[0]) / h + (right[1] - left[1]) / (2 * h)
    assert np.abs(shear).max() < 0.05 * np.abs((right[1] - left[1]) / (2 * h)).max()


@pytest.mark.long
def test_all_cases(tmp_path):
    """Everything, within an hour. The angle of Kalthoff's cracks may lack a degree, and the page says so."""
    pages = [importlib.import_module(name).run(tmp_path) for name in importlib.import_module("run_all").CASES]
    wrong = [(page.name, one.what, one.value) for page in pages for one in page.figures if not one.holds]
    assert len(wrong) <= 1, wrong
    assert sum(page.seconds for page in pages) < 3600.0
