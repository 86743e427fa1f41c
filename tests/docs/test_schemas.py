"""JSON Schemas of TOML files: as the models are, and every packaged file keeps to them."""

import importlib.util
import json
import tomllib
from pathlib import Path

import jsonschema
import pytest

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "docs" / "reference" / "schemas"
SOURCES = ROOT / "src"
FOLDERS = {
    "recipe": [SOURCES / "flgpr" / "chain" / "recipes"],
    "scene": [SOURCES / "flgpr" / "simulate" / "scene" / "sites"],
    "sensor": [SOURCES / "flgpr" / "model" / "presets"],
    "mapping": [ROOT / "tests" / "data" / "mappings"],
}


def maker():
    spec = importlib.util.spec_from_file_location("schemas", ROOT / "evidence" / "make_schemas.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def schema_of(kind):
    return json.loads((SCHEMAS / f"{kind}.schema.json").read_text(encoding="utf-8"))


def packaged():
    for kind, folders in FOLDERS.items():
        for folder in folders:
            for file in sorted(folder.rglob("*.toml")):
                yield pytest.param(kind, file, id=f"{kind}-{file.stem}")


@pytest.mark.parametrize("kind", ["recipe", "scene", "sensor", "mapping", "anchor"])
def test_the_published_schemas_are_those_of_the_models(kind):
    """After a change of a model: ``python evidence/make_schemas.py``."""
    schema = schema_of(kind)
    assert schema == maker().schema_of(kind)
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize(("kind", "file"), list(packaged()))
def test_a_packaged_file_keeps_to_its_schema(kind, file):
    jsonschema.Draft202012Validator(schema_of(kind)).validate(tomllib.loads(file.read_text()))


def recipe():
    return tomllib.loads((FOLDERS["recipe"][0] / "wang2007.toml").read_text())


def test_a_wrong_entry_breaks_the_schema():
    check = jsonschema.Draft202012Validator(schema_of("recipe"))
    check.validate(recipe())
    for change in (
        {"nonsense": 1},
        {"clutter": [{"stage": "standing", "nonsense": 1}]},
        {"clutter": [{}]},
        {"confidence": 3},
        {"name": None},
    ):
        assert not check.is_valid(recipe() | change), change
    assert check.is_valid(recipe() | {"clutter": [{"stage": "of another package", "any": 1}]})
