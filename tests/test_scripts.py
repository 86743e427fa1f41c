"""Scripts beside the package import what it has: they run seldom, and names move."""

import ast
import importlib
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOLDERS = ("evidence", "benchmarks", "docs/gallery", "docs/reference/theory")
SCRIPTS = sorted(path for folder in FOLDERS for path in (ROOT / folder).rglob("*.py"))


def imported_names(path):
    """Yield the module and the name of every import from the package."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and str(node.module).split(".")[0] in {
            "flgpr",
            "flgpr_papers",
        }:
            for alias in node.names:
                yield node.module, alias.name


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_script_imports_what_the_package_has(path):
    absent = []
    for module, name in imported_names(path):
        if not hasattr(importlib.import_module(module), name) and not find_spec(f"{module}.{name}"):
            absent.append(f"{module}.{name}")
    assert not absent


def test_there_are_scripts_to_look_at():
    assert len(SCRIPTS) > 30
