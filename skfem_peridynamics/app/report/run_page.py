"""The report of a run: one file of HTML with its pictures inside, which opens anywhere and asks nobody for anything."""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any

from ..files.results import Results, Snapshot
from ..files.whole_files import write_whole
from ..scene.toml_text import to_toml
from .headline import known, number, verdict
from .page_style import STYLE
from .run_pictures import draw

_CAPTIONS = {
    "damage.png": "Where bonds have softened at the end of the run: pale is whole, dark is torn.",
    "course.png": "The same at four times.",
    "crack.png": "How far the crack has got, and how fast its tip runs; the slope over five rows of the history.",
    "energies.png": "Energies over time.",
    "measures.png": "What the scene has measured.",
}


def write_report(folder: Path, last: Snapshot | None = None) -> Path:
    """Write ``report.html`` from the files of a run, and return its path. Raises :class:`SceneError` without a run."""
    results = Results.read(folder)
    with tempfile.TemporaryDirectory() as room:
        names = draw(results, Path(room), last, course=True)
        pictures = {name: base64.b64encode((Path(room) / name).read_bytes()).decode() for name in names}
    path = folder / "report.html"
    write_whole(path, page(results, pictures))
    return path


def page(results: Results, pictures: Mapping[str, str]) -> str:
    """Return the HTML of a report; ``pictures`` are PNG in base 64 by their names."""
    summary, title = results.summary, escape(results.title)
    body = [
        f"<h1>{title}</h1>",
        f'<p class="lead">{escape(verdict(results))}</p>',
        _cards(results),
        *(_figure(name, pictures[name]) for name in ("damage.png", "course.png") if name in pictures),
        *_section("The crack", [_crack_table(results)], "crack.png", pictures),
        *_section("Energies", [f"<p>{escape(_balance(summary))}</p>"], "energies.png", pictures),
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


def _cards(results: Results) -> str:
    summary = results.summary
    units, cards = results.units, []
    if summary.get("crack_length") is None and summary.get("crack_area") is not None:
        cards.append(("crack area", number(summary["crack_area"]) + units.after("area")))
    if summary.get("crack_length") is not None:
        cards.append(("crack length", number(summary["crack_length"]) + units.after("length")))
    if summary.get("largest_tip_speed"):
        cards.append(("fastest tip", number(summary["largest_tip_speed"]) + units.after("velocity")))
    for name, label in (("energy_drift", "energy drift"), ("error_estimate", "estimated error of u")):
        if isinstance(summary.get(name), (int, float)):
            cards.append((label, f"{summary[name]:.2g}"))
    if isinstance(summary.get("largest_Z"), (int, float)):
        cards.append(("largest |S|/S_c", f"{summary['largest_Z']:.3g}"))
    seconds = summary.get("seconds")
    if isinstance(seconds, dict):
        cards.append(("run time", f"{sum(seconds.values()):.3g} s"))
    items = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in cards)
    return f'<dl class="cards">{items}</dl>' if items else ""


def _figure(name: str, picture: str) -> str:
    caption = escape(_CAPTIONS[name])
    image = f'<img src="data:image/png;base64,{picture}" alt="{caption}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


def _section(title: str, parts: list[str], name: str, pictures: Mapping[str, str]) -> list[str]:
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
            rows.append((label, number(summary[name]) + unit))
    if summary.get("tips") is not None:
        rows.append(("tips", str(summary["tips"])))
    if summary.get("largest_tip_speed") is not None:
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
        if value is not None:
            rows.append((label, number(value) + (units.after(quantity) if quantity else "")))
    return ["<h2>The material</h2>", _table(rows)] if rows else []


def _balance(summary: Mapping[str, Any]) -> str:
    drift = summary.get("energy_drift")
    if not isinstance(drift, (int, float)):
        return "The energy balance is not known, for the run has not ended."
    said = f"The energy balance was off by at most {drift:.2g} of the largest energy."
    lost = summary.get("energy_lost")
    if isinstance(lost, (int, float)):
        said += f" Cracks that ran away between two equilibria lost {lost:.2g} of it, which is no error."
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
