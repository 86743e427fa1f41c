"""Make the JSON Schemas of flgpr's TOML files: ``python evidence/make_schemas.py [docs/reference/schemas]``.

Editors complete and check TOML files by them, see docs/reference/schemas.md. Rules that join several entries, and the
bounds that a number has by default, are not in them: ``flgpr recipe check`` and the commands have the last word.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from flgpr.chain.recipe import Recipe
from flgpr.chain.stages import PACKAGED, find_stage
from flgpr.formats.mapping import Mapping
from flgpr.geo.anchor import _AnchorFile
from flgpr.model.sensor import Sensor
from flgpr.simulate.scene.scene import Scene

DRAFT = "https://json-schema.org/draft/2020-12/schema"
FILES: dict[str, tuple[type[BaseModel], str]] = {
    "recipe": (Recipe, "Recipe of a detection"),
    "scene": (Scene, "Scene of a simulated lane"),
    "sensor": (Sensor, "Sensor: antennas, tones and errors of an array"),
    "mapping": (Mapping, "Mapping of a recording to a run"),
    "anchor": (_AnchorFile, "Anchor of a lane on Earth"),
}
STAGE_ENTRIES = {"clutter": "clutter", "map": "map", "screen": "screen", "columns": "features"}
"""Kind of the stages that an entry of a recipe names."""


def main() -> None:
    """Write a schema for every kind of file."""
    output = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/reference/schemas")
    output.mkdir(parents=True, exist_ok=True)
    for name in FILES:
        text = json.dumps(schema_of(name), indent=1, ensure_ascii=False)
        (output / f"{name}.schema.json").write_text(text + "\n", encoding="utf-8")


def schema_of(name: str) -> dict[str, Any]:
    """Return the schema of a kind of file."""
    model, title = FILES[name]
    schema = model.model_json_schema()
    if model is Recipe:
        schema = with_stages(schema)
    if model is Sensor:
        allow_lines(schema)
    schema.pop("title", None)
    return {"$schema": DRAFT, "title": title, **plain_text(schema)}


def allow_lines(schema: dict[str, Any]) -> None:
    """Let antennas be an array along a line, too, as :class:`Sensor` takes them."""
    position = {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3}
    line = {
        "type": "object",
        "properties": {
            "first": position,
            "last": position,
            "count": {"type": "integer", "minimum": 1},
        },
        "required": ["first", "last", "count"],
        "additionalProperties": False,
    }
    for side in ("tx", "rx"):
        schema["properties"][side] = {"anyOf": [schema["properties"][side], line]}


def with_stages(schema: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a recipe in which every packaged stage has its own entries."""
    definitions = schema["$defs"]
    del definitions["Named"]
    for kind in dict.fromkeys(STAGE_ENTRIES.values()):
        choices = [stage_schema(kind, stage, definitions) for stage in PACKAGED[kind]]
        choices.append(foreign_stage(list(PACKAGED[kind])))
        definitions[f"{kind} stage"] = {"anyOf": choices}
    for entry, kind in STAGE_ENTRIES.items():
        replace_reference(schema["properties"][entry], f"#/$defs/{kind} stage")
    return schema


def stage_schema(kind: str, stage: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a packaged stage's table, and add what it refers to."""
    settings = find_stage(kind, stage).Settings.model_json_schema()
    definitions.update(settings.pop("$defs", {}))
    settings["properties"] = {"stage": {"const": stage}, **settings.get("properties", {})}
    settings["required"] = ["stage", *settings.get("required", [])]
    settings.pop("title", None)
    return settings


def foreign_stage(packaged: list[str]) -> dict[str, Any]:
    """Return the schema of a stage that another package brings: its entries are not known here."""
    name = {"type": "string", "not": {"enum": packaged}}
    return {"type": "object", "properties": {"stage": name}, "required": ["stage"]}


def replace_reference(schema: Any, reference: str) -> None:
    """Let every reference to a stage in a schema be one to the stages of a kind."""
    if isinstance(schema, dict):
        if schema.get("$ref") == "#/$defs/Named":
            schema["$ref"] = reference
        for value in schema.values():
            replace_reference(value, reference)
    elif isinstance(schema, list):
        for value in schema:
            replace_reference(value, reference)


def plain_text(schema: Any) -> Any:
    """Return a schema whose descriptions are one line each, without marks of reStructuredText."""
    if isinstance(schema, dict):
        plain = {key: plain_text(value) for key, value in schema.items()}
        if isinstance(plain.get("description"), str):
            plain["description"] = " ".join(plain["description"].replace("``", "").split())
        return plain
    if isinstance(schema, list):
        return [plain_text(value) for value in schema]
    return schema


if __name__ == "__main__":
    main()
