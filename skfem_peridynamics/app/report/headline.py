"""What a run has found, in a sentence or two; what it says of cracks has passed a gate that could have stopped it.

A crack is called a crack where the figures are those of one: its tip slower than Rayleigh waves, the energy in its
bonds near the toughness for each unit of it, and hardly any damage that lies deeper than the rows beside a crack.
"""

from __future__ import annotations

from typing import Any

from ..files.results import Results

_CRUSHED = 0.2  # part of the damaged volume from which on a zone counts as crushed; beside a crack it is 0
_ENERGY = (
    0.5,
    2.0,
)  # of the toughness: opened cracks hold 0.96 to 1.12 (docs/evidence/verification.md); this leaves room


def verdict(results: Results) -> str:
    """Say in a sentence or two what the run has found."""
    summary = results.summary
    if not summary:
        return "The run has not ended; this is what it has written so far."
    status = str(summary.get("status", ""))
    begin = "" if status == "finished" else f"The run did not finish: {status.removeprefix('stopped: ')}. "
    if summary.get("crack_reach"):
        return begin + _of_cracks(results)
    if summary.get("softened_bonds") or summary.get("broken_bonds"):
        return f"{begin}Bonds have softened, and no crack has grown from that that could be followed."
    if _is_linear(results):
        return f"{begin}The law is linear: no bond can soften."
    Z = summary.get("largest_Z") or 0.0
    return f"{begin}No bond has softened; the largest strain of a bond was {Z:.2g} of the critical one."


def _is_linear(results: Results) -> bool:
    """Whether no material of the scene has bonds that soften."""
    matrix, others = results.scene.get("material"), results.scene.get("inclusion")
    tables = [matrix, *(others if isinstance(others, list) else [])]
    names = [one.get("potential", "linear" if one is not matrix else "") for one in tables if isinstance(one, dict)]
    return bool(names) and set(names) == {"linear"}


def known(results: Results, name: str) -> float | None:
    """Return a constant of the material, or None where the summary does not have it."""
    elastic = results.summary.get("elastic")
    value = elastic.get(name) if isinstance(elastic, dict) else None
    return float(value) if isinstance(value, (int, float)) and abs(value) < float("inf") else None


def number(value: Any) -> str:
    """Return a figure as it is printed."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _of_cracks(results: Results) -> str:
    summary, doubts = results.summary, _doubts(results)
    flat = bool(summary.get("crack_length"))
    unit = results.units.after("area")
    units = results.units
    size = units.shown("length", summary["crack_length"]) if flat else number(summary["crack_area"]) + unit
    far = units.shown("length", summary["crack_reach"])
    cracks, tips = int(summary.get("cracks") or 1), int(summary.get("tips") or 1)
    if (summary.get("crushed") or 0.0) > _CRUSHED:
        part = f"{summary['crushed']:.0%} of the damaged volume lies deeper than damage beside a crack"
        return f"A zone has been crushed, and is no crack: {part}.{_told(doubts)}"
    if cracks > 1:
        return f"{cracks} cracks have opened, {size} together; the farthest has come {far}.{_told(doubts)}"
    if doubts:
        return f"Damage has spread over {size}, and not as a single crack.{_told(doubts)}"
    ratio = _speed(results)
    speed = f"; its tip ran at up to {ratio:.2f} of the Rayleigh speed" if ratio else ""
    if not flat:
        return f"A crack of {size} has opened, {far} far{speed}."
    branches = f", and has {tips} tips" if tips > 1 else ""
    return f"The crack grew by {size}{branches}{speed}."


def _speed(results: Results) -> float | None:
    if results.is_static:
        return None
    fastest, rayleigh = results.summary.get("largest_tip_speed"), known(results, "rayleigh_speed")
    return fastest / rayleigh if fastest and rayleigh else None


def _doubts(results: Results) -> list[str]:
    """What a single crack would not show."""
    summary, out = results.summary, []
    ratio, toughness = _speed(results), known(results, "toughness")
    if ratio is not None and ratio > 1.0:
        out.append(f"what was farthest advanced at up to {ratio:.2f} of the Rayleigh speed, which no crack outruns")
    name = "length" if summary.get("crack_length") else "area"
    energy = summary.get(f"energy_per_crack_{name}")
    material = results.scene.get("material")
    # bonds that break early take less with them than the toughness, and mean to
    least = 0.0 if isinstance(material, dict) and material.get("breaking") else _ENERGY[0]
    if energy is not None and toughness and not least <= energy / toughness <= _ENERGY[1]:
        out.append(f"its bonds hold {energy / toughness:.1f} times the toughness for each unit of {name}")
    return out


def _told(doubts: list[str]) -> str:
    text = "; ".join(doubts)
    return f" {text[0].upper()}{text[1:]}." if text else ""
