"""The JSON Schema of scenes, from the dataclasses that read them: what an editor completes and checks with."""

from __future__ import annotations

import dataclasses
from typing import Any

from .scene import Scene
from .values import schema_of

_FIRST = "https://json-schema.org/draft/2020-12/schema"


def scene_schema() -> dict[str, Any]:
    """Return the schema of a scene.

    >>> schema = scene_schema()
    >>> schema["required"]
    ['mesh', 'material', 'bonds', 'time']
    >>> schema["properties"]["bonds"]["properties"]["horizon"]
    {'type': 'number', 'exclusiveMinimum': 0}
    """
    about = {"$schema": _FIRST, "title": "skfem-peridynamics scene"}
    return about | _of_table(Scene) | {"description": "One run: docs/howto/scenes.md has every key."}


def _of_table(kind: Any) -> dict[str, Any]:
    fields = [field for field in dataclasses.fields(kind) if field.metadata]
    properties = {field.name: _of_key(field) for field in fields}
    required = [field.name for field in fields if field.default is dataclasses.MISSING]
    text = " ".join((kind.__doc__ or "").split("\n\n")[0].split()).replace("``", "`")
    found = {"type": "object", "description": text, "properties": properties, "additionalProperties": False}
    return found | ({"required": required} if required else {})


def _of_key(field: dataclasses.Field[Any]) -> dict[str, Any]:
    read = field.metadata["read"]
    about = read.__dict__
    if "most" in about:
        return {"type": "array", "items": _of_table(about["kind"]), "maxItems": about["most"]}
    if "kind" in about:
        return _of_table(about["kind"])
    plain = isinstance(field.default, str | int | float) and field.default is not None
    return schema_of(read) | ({"default": field.default} if plain else {})
