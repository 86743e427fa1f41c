"""What the code never does, read from the code: pickle, run text as code, unpack archives to disk."""

import ast
from pathlib import Path

import pytest

import flgpr

ROOT = Path(flgpr.__file__).parent
MODULES = sorted(ROOT.rglob("*.py"))
PICKLES = {"pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "jsonpickle"}
CALLS = {"read_pickle", "to_pickle", "extractall", "extract", "unpack_archive", "HDFStore", "read_hdf"}
CODE = {"eval", "exec", "__import__"}


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


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
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
