"""A small scene, changes of it, and what the command says of a bad one."""

from skfem_peridynamics.app.cli.main import main

GOOD = """
title = "small"
mesh = {box = [[0, 1], [0, 0.5]], divisions = [16, 8]}
material = {young = 1.0, toughness = 1e-3, density = 1.0, plane = "stress"}
bonds = {horizon = 0.13}
crack = [{points = [[0.0, 0.25], [0.5, 0.25]]}]
load = [{traction = [0, 0.01], on = "top", layer = 0.13}, {traction = [0, -0.01], on = "bottom"}]
fixed = [{on = "left", component = "x", displacement = 0}]
no_fail = [{on = "top", width = 0.13}]
initial = {velocity = ["0", "1e-3*y"]}
time = {until = 0.5}
output = {frames = 2, history = 5, pictures = false}
"""


def complaint(capsys, tmp_path, content, *more):
    scene = tmp_path / "scene.toml"
    scene.write_text(content)
    code = main(["run", str(scene), "--out", str(tmp_path / "out"), "--quiet", *more])
    told = capsys.readouterr().err
    assert code == 2, told
    assert told.count("\n") == 1, told
    assert "Traceback" not in told
    assert not (tmp_path / "out").exists()
    assert [p.name for p in tmp_path.iterdir() if p.suffix != ".msh" and p.suffix != ".vtu"] == ["scene.toml"]
    return told


def change(old, new):
    assert old in GOOD
    return GOOD.replace(old, new)
