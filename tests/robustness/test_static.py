"""What the code never does, read from the code: pickle, run text as code, unpack archives to disk."""

import ast
from pathlib import Path

import pytest

import flgpr

ROOT = Path(flgpr.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
PICKLES = {
    "pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "jsonpickle", "skops", "yaml",
}  # fmt: skip
"""What makes objects of files, or names in them to call."""
CALLS = {"read_pickle", "to_pickle", "extractall", "extract", "unpack_archive", "HDFStore", "read_hdf"}
CODE = {"eval", "exec", "compile", "__import__"}
BY_NAME = {
    "__init__.py": "the package's own parts",
    "lazy.py": "names of a package's own stub",
    "io/extras.py": "packages of the extras, by constants of its callers",
    "chain/estimators.py": "the classes of a table, for training alone",
    "chain/stages/__init__.py": "packaged stages by a table, and what installed distributions offer",
    "detect/scorers/__init__.py": "the scorers of a table",
}
"""Modules that may find code by a name that is no constant, and where the name comes from."""


def offences(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] in PICKLES)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PICKLES:
            yield node.module
        elif isinstance(node, ast.Call):
            yield from offending_call(node)


def offending_call(node):
    function = node.func
    if isinstance(function, ast.Name) and function.id in CODE:
        yield function.id
    if isinstance(function, ast.Attribute):
        if function.attr in CALLS:
            yield function.attr
        numpy = isinstance(function.value, ast.Name) and function.value.id in ("np", "numpy")
        if numpy and function.attr in ("load", "save"):
            told = {word.arg: word.value for word in node.keywords}.get("allow_pickle")
            if not (isinstance(told, ast.Constant) and told.value is False):
                yield f"np.{function.attr} without allow_pickle=False"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_pickle_and_no_code_from_text(path):
    assert list(offences(ast.parse(path.read_text(encoding="utf-8")))) == []


def names_of_code(tree):
    """Find modules imported, and attributes called, by names that are no constants."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        function = node.func
        name = function.id if isinstance(function, ast.Name) else getattr(function, "attr", "")
        if name in ("import_module", "entry_points", "load_entry_point"):
            constant = node.args and isinstance(node.args[0], ast.Constant)
            if not constant:
                yield name
        # An attribute by a name from elsewhere that is called at once: getattr(x, name)(...).
        called = (
            isinstance(function, ast.Call) and isinstance(function.func, ast.Name) and function.func.id == "getattr"
        )
        if called and not isinstance(function.args[1], ast.Constant):
            yield "getattr(...)(...)"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_code_is_found_by_name_where_the_name_is_ours(path):
    found = list(names_of_code(ast.parse(path.read_text(encoding="utf-8"))))
    assert not found or str(path.relative_to(ROOT)) in BY_NAME


def test_every_module_that_may_find_code_by_name_does():
    for name in BY_NAME:
        assert list(names_of_code(ast.parse((ROOT / name).read_text(encoding="utf-8")))), name


@pytest.mark.parametrize("text", ["import_module(name)", "importlib.import_module(a + b)", "getattr(x, name)(1)"])
def test_the_check_of_names_finds_what_it_looks_for(text):
    assert list(names_of_code(ast.parse(text)))


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from skops.io import loads",
        "import yaml",
        "from joblib import load",
        "import numpy as np\nnp.load('x')",
        "np.load('x', allow_pickle=True)",
        "np.save('x', y)",
        "pd.read_pickle('x')",
        "archive.extractall()",
        "eval('1')",
    ],
)
def test_the_check_finds_what_it_looks_for(text):
    assert list(offences(ast.parse(text)))
