"""JSON Schemas of files: as the models are, and every packaged file keeps to them."""

import json
import re
import tomllib

import pytest

from published_schemas import ROOT, SCHEMAS, check, keeps_to, maker

pytestmark = pytest.mark.slow("checks of pages")

SOURCES = ROOT / "src"
FOLDERS = {
    "recipe": [SOURCES / "flgpr" / "recipe" / "packaged"],
    "scene": [SOURCES / "flgpr" / "simulate" / "scene" / "sites"],
    "sensor": [SOURCES / "flgpr" / "model" / "presets"],
    "mapping": [ROOT / "tests" / "data" / "mappings"],
}


def packaged():
    for kind, folders in FOLDERS.items():
        for folder in folders:
            for file in sorted(folder.rglob("*.toml")):
                yield pytest.param(kind, file, id=f"{kind}-{file.stem}")


def test_the_published_schemas_are_those_that_the_script_writes(tmp_path, monkeypatch):
    """After a change of a model or a type: ``python evidence/make_schemas.py``."""
    monkeypatch.setattr("sys.argv", ["make_schemas.py", str(tmp_path)])
    maker().main()
    written = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    published = {file.name: file.read_bytes() for file in SCHEMAS.iterdir()}
    assert written == published
    page = (SCHEMAS.parent / "schemas.md").read_text(encoding="utf-8")
    assert [name for name in published if f"(schemas/{name})" not in page] == []


@pytest.mark.parametrize(("kind", "file"), list(packaged()))
def test_a_packaged_file_keeps_to_its_schema(kind, file):
    check(kind, tomllib.loads(file.read_text(encoding="utf-8")))


def recipe():
    return tomllib.loads((FOLDERS["recipe"][0] / "wang2007.toml").read_text())


def test_a_wrong_entry_breaks_the_schema():
    check("recipe", recipe())
    for change in (
        {"nonsense": 1},
        {"clutter": [{"stage": "standing", "nonsense": 1}]},
        {"clutter": [{}]},
        {"confidence": 3},
        {"name": None},
    ):
        assert not keeps_to("recipe", recipe() | change), change
    foreign_stage = {"stage": "of another package", "any": 1}
    assert keeps_to("recipe", recipe() | {"clutter": [foreign_stage]})


def references(schema):
    """Yield what all references in a schema lead to."""
    if isinstance(schema, dict):
        if "$ref" in schema:
            yield schema["$ref"]
        for value in schema.values():
            yield from references(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from references(value)


@pytest.mark.parametrize("name", sorted(file.stem for file in SCHEMAS.iterdir()))
def test_references_lead_to_definitions_by_names_that_addresses_may_hold(name):
    """Taplo refuses a schema with a space in a reference."""
    schema = json.loads((SCHEMAS / f"{name}.json").read_text(encoding="utf-8"))
    for reference in references(schema):
        definition = re.fullmatch(r"#/\$defs/([\w.-]+)", reference)
        assert definition, reference
        assert definition[1] in schema["$defs"]


def members(kind, *path):
    """Return the members of an object in a schema."""
    schema = maker().schema_of(kind)
    for name in path:
        schema = schema[name]
    return schema["properties"]


def test_comments_of_the_models_describe_the_members():
    """Beside a member, above it, and of several at once."""
    motion = members("recipe", "$defs", "MotionLimits")
    assert motion["speed"]["description"] == "most, m/s"
    assert motion["interval"]["description"].startswith("duration of a scan where no times")
    lane = members("live-event", "$defs", "LaneBorders")
    described = {name: member["description"] for name, member in lane.items()}
    borders = ("x_min", "x_max", "y_min", "y_max")
    assert described == dict.fromkeys(borders, "its borders in the lane frame, m")
    position = members("live-event", "$defs", "PositionEvent")  # of both of its bases
    assert position["words"]["description"] == "what was wrong"
    assert position["most"]["description"].startswith("largest value")
    target = members("score", "$defs", "TargetOutcome")
    assert target["depth"]["description"].endswith(", m")
