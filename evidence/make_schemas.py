"""Make the JSON Schemas of flgpr's files: ``python evidence/make_schemas.py [docs/reference/schemas]``.

Editors complete and check TOML files by them, and other programs the JSON that flgpr writes, see
docs/reference/schemas.md. Rules that join several entries, and the bounds that a number has by
default, are not in them: ``flgpr recipe check`` and the commands have the last word.
"""

from __future__ import annotations

import ast
import functools
import inspect
import json
import operator
import re
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pydantic import BaseModel, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue

from flgpr.formats.mapping import Mapping
from flgpr.geo.anchor import _AnchorFile
from flgpr.live.event_types import EVENTS, CountsEvent, EndEvent, ReportEntries
from flgpr.live.intake import COUNTS
from flgpr.model.sensor import Sensor
from flgpr.model.tables import TRUTH_COLUMNS
from flgpr.recipe.schema import Recipe
from flgpr.scoring.score_entries import (
    BlindNotes,
    BlindScoreFile,
    ComparisonFile,
    ScoreFile,
    ScoreSummary,
    TargetOutcome,
)
from flgpr.simulate.scene.scene import Scene
from flgpr.stages.named import find_stage, stage_names

DRAFT = "https://json-schema.org/draft/2020-12/schema"
FILES: dict[str, tuple[type[BaseModel], str]] = {
    "recipe": (Recipe, "Recipe of a detection"),
    "scene": (Scene, "Scene of a simulated lane"),
    "sensor": (Sensor, "Sensor: antennas, tones and errors of an array"),
    "mapping": (Mapping, "Mapping of a recording to a run"),
    "anchor": (_AnchorFile, "Anchor of a lane on Earth"),
}
DOCUMENTS: dict[str, tuple[Any, str]] = {
    "live-event": (
        functools.reduce(operator.or_, EVENTS),
        "Event of a live detection: one line of live.jsonl",
    ),
    "live-report": (ReportEntries, "Outcome of a live detection: live.json"),
    "score": (ScoreFile | BlindScoreFile, "Score of alarm lists: roc.json"),
    "score-summary": (ScoreSummary, "Score as flgpr score --json prints it"),
    "comparison": (ComparisonFile, "Detectors side by side: comparison.json"),
}
OPEN_OBJECTS = (TargetOutcome, BlindNotes)
"""Objects that hold members of their users' own, too."""
STAGE_ENTRIES = {"clutter": "clutter", "map": "map", "screen": "screen", "columns": "features"}
"""Kind of the stages that an entry of a recipe names."""


class DescribedSchema(GenerateJsonSchema):
    """Makes schemas whose members are described by the comments beside them."""

    def model_schema(self, schema: Any) -> JsonSchemaValue:
        """Return the schema of a model with descriptions."""
        return describe_members(super().model_schema(schema), schema["cls"])

    def dataclass_schema(self, schema: Any) -> JsonSchemaValue:
        """Return the schema of a dataclass with descriptions; it holds no other members."""
        made = describe_members(super().dataclass_schema(schema), schema["cls"])
        return {**made, "additionalProperties": False}

    def typed_dict_schema(self, schema: Any) -> JsonSchemaValue:
        """Return the schema of a typed dictionary with descriptions.

        It holds no other members, unless these are added here or are its users' own.
        """
        of_type = schema["cls"]
        made = describe_members(super().typed_dict_schema(schema), of_type)
        made["description"] = first_paragraph(of_type)
        if of_type in (CountsEvent, EndEvent):
            add_counts(made)
        if of_type is TargetOutcome:
            add_truth_columns(made)
        made["additionalProperties"] = of_type in OPEN_OBJECTS
        return made


def main() -> None:
    """Write a schema for every kind of file."""
    output = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/reference/schemas")
    output.mkdir(parents=True, exist_ok=True)
    for name in (*FILES, *DOCUMENTS):
        (output / f"{name}.schema.json").write_text(schema_text(name), encoding="utf-8")


def schema_text(name: str) -> str:
    """Return the content of a schema's file."""
    return json.dumps(schema_of(name), indent=1, ensure_ascii=False) + "\n"


def schema_of(name: str) -> dict[str, Any]:
    """Return the schema of a kind of file."""
    if name in DOCUMENTS:
        of_type, title = DOCUMENTS[name]
        schema = TypeAdapter(of_type).json_schema(schema_generator=DescribedSchema)
    else:
        model, title = FILES[name]
        schema = model.model_json_schema(schema_generator=DescribedSchema)
        if model is Recipe:
            schema = with_stages(schema)
        if model is Sensor:
            allow_lines(schema)
    schema.pop("title", None)
    for part in parts_of(schema):
        if isinstance(part.get("description"), str):
            part["description"] = without_marks(part["description"])
    return {"$schema": DRAFT, "title": title, **schema}


def describe_members(schema: JsonSchemaValue, of_type: type) -> JsonSchemaValue:
    """Describe the members of a schema that the comments of its class tell something of."""
    comments = member_comments(of_type)
    for name, member in schema.get("properties", {}).items():
        if name in comments:
            member["description"] = comments[name]
    return schema


def member_comments(of_type: type) -> dict[str, str]:
    """Return what the comments ``#:`` of a class and its bases tell of its members.

    A comment stands beside a member or above it. One that begins with names, ``x, y: ...``, is of
    all these.
    """
    comments: dict[str, str] = {}
    bases = getattr(of_type, "__orig_bases__", of_type.__bases__)
    for base in bases:
        if isinstance(base, type) and base.__module__.startswith("flgpr"):
            comments |= member_comments(base)
    lines = textwrap.dedent(inspect.getsource(of_type)).splitlines()
    [definition] = ast.parse("\n".join(lines)).body
    for member in definition.body:
        if not (isinstance(member, ast.AnnAssign) and isinstance(member.target, ast.Name)):
            continue
        text = comment_of(lines, member.lineno - 1, member.end_lineno - 1)
        shared = re.fullmatch(r"((?:\w+, )+\w+): (.*)", text)
        if shared:
            comments |= dict.fromkeys(shared[1].split(", "), shared[2])
        elif text:
            comments[member.target.id] = text.removeprefix(f"{member.target.id}: ")
    return comments


def comment_of(lines: list[str], first: int, last: int) -> str:
    """Return the comment ``#:`` beside the last line of a member, or in the lines above it."""
    beside = lines[last].partition("#: ")[2]
    if beside:
        return beside
    above: list[str] = []
    number = first - 1
    while number >= 0 and lines[number].strip().startswith("#:"):
        above.insert(0, lines[number].strip().removeprefix("#:").strip())
        number -= 1
    return " ".join(above)


def first_paragraph(of_type: type) -> str:
    """Return the first paragraph of a class's docstring."""
    return (inspect.getdoc(of_type) or "").partition("\n\n")[0]


def add_counts(schema: JsonSchemaValue) -> None:
    """Add the counts of a live run to the members of an event."""
    for name, meaning in COUNTS.items():
        schema["properties"][name] = {"type": "integer", "minimum": 0, "description": meaning}
        schema["required"].append(name)


def add_truth_columns(schema: JsonSchemaValue) -> None:
    """Add the columns of a truth table to the members of a target."""
    types = {"number": "number", "text": "string"}
    columns = {}
    for column in TRUTH_COLUMNS:
        of_column: dict[str, Any] = {"type": types[column.kind]}
        if column.missing:
            of_column = {"anyOf": [of_column, {"type": "null"}]}
        unit = f", {column.unit}" if column.unit else ""
        columns[column.name] = {**of_column, "description": column.meaning + unit}
        if column.required:
            schema["required"].append(column.name)
    schema["properties"] = {**columns, **schema["properties"]}


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
        known = stage_names(kind)
        choices = [stage_schema(kind, stage, definitions) for stage in known]
        choices.append(foreign_stage(known))
        definitions[f"{kind}-stage"] = {"anyOf": choices}
    for entry, kind in STAGE_ENTRIES.items():
        # Every reference to a stage is one to the stages of the entry's kind.
        for part in parts_of(schema["properties"][entry]):
            if part.get("$ref") == "#/$defs/Named":
                part["$ref"] = f"#/$defs/{kind}-stage"
    return schema


def stage_schema(kind: str, stage: str, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of a packaged stage's table, and add what it refers to."""
    settings = find_stage(kind, stage).Settings.model_json_schema(schema_generator=DescribedSchema)
    definitions.update(settings.pop("$defs", {}))
    settings["properties"] = {"stage": {"const": stage}, **settings.get("properties", {})}
    settings["required"] = ["stage", *settings.get("required", [])]
    settings.pop("title", None)
    return settings


def foreign_stage(packaged: list[str]) -> dict[str, Any]:
    """Return the schema of a stage that another package brings: its entries are not known here."""
    name = {"type": "string", "not": {"enum": packaged}}
    return {"type": "object", "properties": {"stage": name}, "required": ["stage"]}


def parts_of(schema: Any) -> Iterator[dict[str, Any]]:
    """Yield every table in a schema, itself first."""
    if isinstance(schema, dict):
        yield schema
    below = schema.values() if isinstance(schema, dict) else schema
    if isinstance(schema, dict | list):
        for value in below:
            yield from parts_of(value)


def without_marks(text: str) -> str:
    """Return a text on one line, without marks of reStructuredText."""
    without_roles = re.sub(r":\w+:`~?([^`]+)`", r"\1", text)
    return " ".join(without_roles.replace("``", "").split())


if __name__ == "__main__":
    main()
