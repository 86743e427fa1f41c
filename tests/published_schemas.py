"""The published JSON Schemas, by which tests check what the program reads and writes."""

import importlib.util
import json
from functools import cache
from pathlib import Path

import jsonschema

ROOT = Path(__file__).parents[1]
SCHEMAS = ROOT / "docs" / "reference" / "schemas"


@cache
def maker():
    """Return the script that makes the schemas, as a module."""
    spec = importlib.util.spec_from_file_location("schemas", ROOT / "evidence" / "make_schemas.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def validator(name):
    """Return the validator of a published schema."""
    schema = json.loads((SCHEMAS / f"{name}.schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


def check(name, document):
    """Fail where a document does not keep to a published schema."""
    validator(name).validate(document)


def keeps_to(name, document):
    """Return whether a document keeps to a published schema."""
    return validator(name).is_valid(document)
