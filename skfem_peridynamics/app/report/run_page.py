"""The report of a run: one file of HTML with its pictures inside, which opens anywhere and asks nobody for anything."""

from __future__ import annotations

import base64
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..._types import Mesh
from ...geometry.simplices import vertex_sizes
from ..files.results import Results, Snapshot, is_number
from ..files.whole_files import write_whole
from ..problem.domain import cracked_mesh
from ..scene.formula import FormulaError
from ..scene.reading import SceneError
from ..scene.scene import Scene
from ..scene.toml_text import to_toml
from .headline import known, number, verdict
from .page_style import STYLE
from .run_pictures import draw
from .setup_picture import SetUp, plot_setup

_CAPTIONS = {
    "damage.png": "Where bonds have softened at the end of the run: pale is whole, dark is torn.",
    "deformed.png": "The same beside its deformed shape; elements that are torn open are left out.",
    "course.png": "The same at four times.",
    "setup.png": "What the scene says: outline, slits, materials, loads (arrows), supports, no-fail regions, probes.",
    "stress.png": "What the bonds bear at the last frame.",
    "crack.png": "How far the crack has got, and how fast its tip runs, by the slope over five rows of the history.",
    "energies.png": "Energies over time.",
    "measures.png": "What the scene has measured.",
}


Pictures: TypeAlias = Mapping[str, tuple[str, str]]


def write_report(folder: Path, pictures: Pictures | None = None) -> Path:
    """Write ``report.html`` from the files of a run, and return its path. Raises :class:`SceneError` without a run.

    ``pictures`` are those of :func:`pictures_of`, where they have been drawn already.
    """
    results = Results.read(folder)
    path = folder / "report.html"
    write_whole(path, page(results, pictures_of(results) if pictures is None else pictures))
    return path


def pictures_of(
    results: Results, last: Snapshot | None = None, setup: tuple[Scene, Mesh] | None = None, there: Sequence[str] = ()
) -> Pictures:
    """Draw the pictures of a report, for wide screens and for phones; those ``there`` are taken from the folder.

    ``last`` is the last state, by default the last frame; ``setup`` the scene and its mesh, where they are at hand: the
    scene of a box is made again where they are not.
    """
    setup = _setup(results) if setup is None else setup
    drawn = None if setup is None else SetUp.of(*setup)
    sets: list[dict[str, str]] = []
    for phone in (False, True):
        with tempfile.TemporaryDirectory() as room:
            skipped = () if phone else tuple(there)
            names = draw(results, Path(room), last, course=True, phone=phone, without=skipped)
            if drawn is not None:
                plot_setup(Path(room) / "setup.png", drawn, phone=phone)
                names.append("setup.png")
            files = [*(Path(room) / name for name in names), *(results.folder / name for name in skipped)]
            sets.append({file.name: base64.b64encode(file.read_bytes()).decode() for file in files})
    return {name: (wide, sets[1][name]) for name, wide in sets[0].items()}


def _setup(results: Results) -> tuple[Scene, Mesh] | None:
    """The scene of a run and its mesh, where nothing but the scene is needed for it."""
    try:
        scene = Scene.of(results.scene)
        return (scene, cracked_mesh(scene)) if scene.mesh.file is None else None
    except (SceneError, FormulaError):
        return None


def page(results: Results, pictures: Pictures) -> str:
    """Return the HTML of a report; ``pictures`` are PNG in base 64 by their names, for wide screens and for phones."""
    summary, title = results.summary, escape(results.title)
    body = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{escape(verdict(results))}</p>',
        _date(results),
        _cards(results),
        *(_figure(name, pictures[name]) for name in _first(pictures)),
        *_section("The set-up", [_setup_table(results)], "setup.png", pictures),
        *_section("The crack", [_crack_table(results)], "crack.png", pictures),
        *_section("Energies", [f"<p>{escape(_balance(summary))}</p>"], "energies.png", pictures),
        *_section("Stress", [], "stress.png", pictures),
        *_section("Measured", [], "measures.png", pictures),
        *_material(results),
        "<h2>How far to trust it, and what it took</h2>",
        _trust(summary),
        _seconds(summary),
        _notes(summary),
        "<h2>To run it again</h2>",
        _again(results),
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">\n"
        f"<title>{title}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n<main>\n"
        + "\n".join(part for part in body if part)
        + "\n</main>\n</body>\n</html>\n"
    )


def _date(results: Results) -> str:
    """When the run ended, by its summary."""
    file = results.folder / "summary.json"
    if not file.is_file():
        return ""
    return f'<p class="date">{time.strftime("%Y-%m-%d %H:%M", time.localtime(file.stat().st_mtime))}</p>'


def _cards(results: Results) -> str:
    summary = results.summary
    units, cards = results.units, []
    if summary.get("crack_length") is None and summary.get("crack_area") is not None:
        cards.append(("crack area", number(summary["crack_area"]) + units.after("area")))
    if summary.get("crack_length") is not None:
        cards.append(("crack length", units.shown("length", summary["crack_length"])))
    if summary.get("largest_tip_speed") and not results.is_static:
        cards.append(("fastest tip", number(summary["largest_tip_speed"]) + units.after("velocity")))
    for name, label in (("energy_drift", "energy drift"), ("error_estimate", "estimated error of u")):
        if isinstance(summary.get(name), (int, float)):
            cards.append((label, f"{summary[name]:.2g}"))
    if summary.get("largest_Z"):
        cards.append(("largest |S|/S_c", f"{summary['largest_Z']:.3g}"))
    seconds = summary.get("seconds")
    if isinstance(seconds, dict):
        cards.append(("run time", f"{sum(seconds.values()):.3g} s"))
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in cards)
    return f'<dl class="cards">{items}</dl>' if items else ""


def _first(pictures: Pictures) -> list[str]:
    """The pictures at the top: the deformed shape has the plain one beside it."""
    first = "deformed.png" if "deformed.png" in pictures else "damage.png"
    return [name for name in (first, "course.png") if name in pictures]


def _figure(name: str, picture: tuple[str, str]) -> str:
    caption = escape(_CAPTIONS["damage.png"] if name == "deformed.png" else _CAPTIONS[name])
    if name == "deformed.png":
        caption += " " + escape(_CAPTIONS[name])
    wide, phone = (f"data:image/png;base64,{one}" for one in picture)
    small = f'<source media="(max-width: 34rem)" srcset="{phone}">'
    image = f'<picture>{small}<img src="{wide}" alt="{caption}"></picture>'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _setup_table(results: Results) -> str:
    """Horizon, mesh, and the materials with their constants."""
    scene, units = results.scene, results.units
    rows: list[tuple[str, str]] = []
    bonds = scene.get("bonds")
    horizon = bonds.get("horizon") if isinstance(bonds, dict) else None
    if horizon is not None and is_number(horizon):
        per = ""
        if results.last is not None:
            per = f", {horizon / float(np.median(vertex_sizes(results.last.mesh))):.1f} vertices (in the median)"
        rows.append(("horizon", units.shown("length", float(horizon)) + per))
    for key, name in (("nodes", "vertices"), ("bonds", "bonds")):
        if results.summary.get(key) is not None:
            rows.append((name, f"{results.summary[key]:,}"))
    inclusions = scene.get("inclusion")
    tables = [("material", scene.get("material"))]
    tables += [(f"inclusion {k}", one) for k, one in enumerate(inclusions)] if isinstance(inclusions, list) else []
    for name, table in tables:
        if isinstance(table, dict):
            rows.append((name, _constants(table, results)))
    return _table(rows)


def _constants(table: Mapping[str, Any], results: Results) -> str:
    """What a table of a material says, with units where they are known."""
    of = {"young": "stress", "lame": "stress", "mu": "stress", "bulk": "stress", "toughness": "toughness"}
    said = []
    for name, value in table.items():
        if is_number(value):
            unit = results.units.shown(of[name], float(value)) if name in of else number(value)
            said.append(f"{name} {unit}")
        elif name in ("region", "where", "plane", "potential") and isinstance(value, str):
            said.append(f"{name} {value}")
    return ", ".join(said)


def _section(title: str, parts: list[str], name: str, pictures: Pictures) -> list[str]:
    if name not in pictures:
        return []
    return [f"<h2>{escape(title)}</h2>", *parts, _figure(name, pictures[name])]


def _table(rows: Iterable[tuple[str, str]]) -> str:
    lines = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in rows)
    return f'<div class="scroll"><table>{lines}</table></div>'


def _crack_table(results: Results) -> str:
    summary, units, rows = results.summary, results.units, list[tuple[str, str]]()
    length = units.after("length")
    rayleigh, toughness = known(results, "rayleigh_speed"), known(results, "toughness")
    flat = summary.get("crack_length") is not None
    for name, label, unit in (
        ("crack_length", "length of all branches", length),
        ("crack_reach", "way of the first tip", length),
        ("crack_area", "the same by the bonds it has cut" if flat else "area", length if flat else units.after("area")),
    ):
        if summary.get(name) is not None:
            said = units.shown("length", summary[name]) if unit == length else number(summary[name]) + unit
            rows.append((label, said))
    if summary.get("tips") is not None:
        rows.append(("tips", str(summary["tips"])))
    if summary.get("largest_tip_speed") is not None and not results.is_static:
        of = f", {summary['largest_tip_speed'] / rayleigh:.2f} of the Rayleigh speed" if rayleigh else ""
        rows.append(("fastest tip", number(summary["largest_tip_speed"]) + units.after("velocity") + of))
    for size in ("length", "area"):
        release = summary.get(f"energy_per_crack_{size}")
        if release is not None and (size == "area") != flat:
            of = f", {release / toughness:.2f} of G_c" if toughness else ""
            rows.append((f"energy of softened bonds per {size}", number(release) + units.after("toughness") + of))
    return _table(rows)


def _material(results: Results) -> list[str]:
    """The constants that the material of a run had with its bonds, the matrix where there are inclusions."""
    units, rows = results.units, list[tuple[str, str]]()
    last = results.last
    bar = ("lame", "mu", "shear_speed", "rayleigh_speed") if last is not None and last.mesh.dim() == 1 else ()
    for name, label, quantity in (
        ("young", "Young's modulus", "stress"),
        ("poisson", "Poisson's ratio", ""),
        ("lame", "lambda", "stress"),
        ("mu", "mu", "stress"),
        ("toughness", "toughness G_c", "toughness"),
        ("density", "density", ""),
        ("pressure_speed", "P waves", "velocity"),
        ("shear_speed", "S waves", "velocity"),
        ("rayleigh_speed", "Rayleigh waves", "velocity"),
    ):
        # bonds alone have lambda = mu, said once
        value = known(results, "lame") if name == "mu" and known(results, "mu") is None else known(results, name)
        if value is not None and name not in bar:
            rows.append((label, units.shown(quantity, value) if quantity else number(value)))
    return ["<h2>The material</h2>", _table(rows)] if rows else []


def _balance(summary: Mapping[str, Any]) -> str:
    drift = summary.get("energy_drift")
    if not isinstance(drift, (int, float)):
        return "The energy balance is not known, for the run has not ended."
    said = f"The energy balance was off by at most {drift:.2g} of the largest energy."
    lost = summary.get("energy_lost")
    if isinstance(lost, (int, float)):
        said += f" Cracks that ran away between two equilibria lost {lost + 0.0:.2g} of it, which is no error."
    return said


def _trust(summary: Mapping[str, Any]) -> str:
    rows = []
    if isinstance(summary.get("energy_drift"), (int, float)):
        rows.append(("energy drift", f"{summary['energy_drift']:.2e} of the largest energy"))
    if isinstance(summary.get("error_estimate"), (int, float)):
        rows.append(("error of the discretisation", f"{summary['error_estimate']:.2e}: {summary.get('estimate_note')}"))
    else:
        why = summary.get("estimate_note") or "not estimated; run --estimate runs the scene on a refined mesh as well"
        rows.append(("error of the discretisation", str(why)))
    for name, label in (
        ("nodes", "vertices"),
        ("bonds", "bonds"),
        ("rule", "rule"),
        ("scheme", "scheme"),
        ("steps", "steps"),
        ("step", "step"),
        ("kernels", "kernels"),
        ("peak_memory_mb", "memory, MB"),
    ):
        if summary.get(name) is not None:
            rows.append((label, number(summary[name])))
    limit = summary.get("step_limits")
    if isinstance(limit, dict) and isinstance(limit.get("by_eigenvalue"), (int, float)) and summary.get("step"):
        rows.append(("step over its limit", f"{summary['step'] / limit['by_eigenvalue']:.3f}"))
    return _table(rows)


def _seconds(summary: Mapping[str, Any]) -> str:
    seconds = summary.get("seconds")
    if not isinstance(seconds, dict) or not sum(seconds.values()) > 0.0:
        return ""
    whole = sum(seconds.values())
    bars = "".join(
        f'<div class="bar"><span>{escape(str(name))}</span><i style="width:{100 * value / whole:.1f}%"></i>'
        f"<b>{value:.3g} s</b></div>"
        for name, value in seconds.items()
    )
    return f'<h3>Where the {whole:.3g} s went</h3><div class="bars">{bars}</div>'


def _notes(summary: Mapping[str, Any]) -> str:
    notes = summary.get("notes")
    if not isinstance(notes, list) or not notes:
        return ""
    return "<h3>Notes</h3><ul>" + "".join(f"<li>{escape(str(note))}</li>" for note in notes) + "</ul>"


def _again(results: Results) -> str:
    run = results.summary.get("run")
    run = run if isinstance(run, dict) else {}
    parts = []
    if results.scene:
        parts.append("<p>Save the scene as <code>scene.toml</code>")
        file = results.scene.get("mesh", {}).get("file") if isinstance(results.scene.get("mesh"), dict) else None
        parts.append(f", with the mesh <code>{escape(str(file))}</code> where it says," if file else "")
        parts.append(" and run</p><pre>skfem-peridynamics run scene.toml --out out --report</pre>")
        parts.append(
            f"<details><summary>The scene, with all defaults</summary><pre>{escape(to_toml(results.scene))}</pre>"
        )
        parts.append("</details>")
    versions = run.get("versions")
    rows = [(str(name), str(value)) for name, value in versions.items()] if isinstance(versions, dict) else []
    rows += [("vertices, elements and groups, SHA-256", str(run["mesh"]))] if run.get("mesh") else []
    return "".join(parts) + (_table(rows) if rows else "")
