"""What the code never does, read from the code: pickle, run text as code, unpack archives, open files past the door."""

import ast

import pytest

from sources import BESIDE, ROOT, modules_of, place

pytestmark = pytest.mark.slow("reads all sources")

MODULES = modules_of(ROOT, *(path for path in BESIDE if path.name != "flgpr_papers"))
PICKLES = {
    "pickle", "_pickle", "cPickle", "cloudpickle", "dill", "joblib", "shelve", "marshal", "jsonpickle", "skops", "yaml",
}  # fmt: skip
"""What makes objects of files, or names in them to call."""
CALLS = {
    "read_pickle",
    "to_pickle",
    "extractall",
    "extract",
    "unpack_archive",
    "HDFStore",
    "read_hdf",
}
CODE = {"eval", "exec", "compile", "__import__"}
BY_NAME = {
    "__init__.py": "the package's own parts",
    "lazy.py": "names of a package's own stub",
    "io/__init__.py": "the rooms of files, which a constant names",
    "store/extras.py": "packages of the extras, by constants of its callers",
    "stages/named.py": "packaged stages by a table, and what installed distributions offer",
    "commands/app.py": "what installed distributions offer",
    "commands/exports.py": "what installed distributions offer",
    "commands/simulate.py": "what installed distributions offer",
    "commands/trials.py": "what installed distributions offer",
    "formats/reader.py": "what installed distributions offer",
    "detect/estimator_table.py": "estimators by a table, and what installed distributions offer",
    "flgpr_ground/own.py": "the class that a user names on the command line, and no file names",
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


@pytest.mark.parametrize("path", MODULES, ids=place)
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
            isinstance(function, ast.Call)
            and isinstance(function.func, ast.Name)
            and function.func.id == "getattr"
        )
        if called and not isinstance(function.args[1], ast.Constant):
            yield "getattr(...)(...)"


@pytest.mark.parametrize("path", MODULES, ids=place)
def test_code_is_found_by_name_where_the_name_is_ours(path):
    found = list(names_of_code(ast.parse(path.read_text(encoding="utf-8"))))
    assert not found or place(path) in BY_NAME


def test_every_module_that_may_find_code_by_name_does():
    found = {place(path): path for path in MODULES}
    for name in BY_NAME:
        assert list(names_of_code(ast.parse(found[name].read_text(encoding="utf-8")))), name


@pytest.mark.parametrize(
    "text", ["import_module(name)", "importlib.import_module(a + b)", "getattr(x, name)(1)"]
)
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


DOORS = {"door.py", "json_text.py", "toml_text.py", "archive.py", "append_log.py"}
"""Modules that open files for all others, regular ones of a checked size, or parse them within limits."""
OWN = "what comes with the package"
JUST_WRITTEN = "it writes the file, or reads what it has just written"
LOCKED = "a folder that is locked and not read"
RECORDING = "a recording that a user named: `existing` refuses pipes, and its own headers bound what is read of it"
GUARDED = "a library reads it, of a file that `existing` let pass; of damaged ones a child process tries that before"
BROWSER = "the browser opens a page that this process wrote"
IN_HAND = "no file: text or bytes in hand, or what this process made"
THROUGH_FOLDER = "the door's own folder opens it, under another name than the check knows"
PAST_THE_DOOR = {  # what a function calls, and why that leads around no door
    "flgpr_ground/ground.py packaged_text": ({"read_text"}, OWN),
    "flgpr_ground/board.py packaged_board": ({"read_bytes"}, OWN),
    "recipe/schema.py recipe_text": ({"read_text"}, OWN),
    "recipe/suggest.py evidence": ({"read_text", "tomllib.loads"}, OWN),
    "flgpr_ground/own.py _digest_of": (
        {"read_bytes"},
        "sources of a class that a user runs: Python has read them",
    ),
    "commands/open.py _is_log": ({"open"}, RECORDING),
    "jit/compiled.py _text": ({"read_bytes"}, OWN),
    "lazy.py face": ({"read_text"}, OWN),
    "model/faults.py load_preset": ({"read_bytes"}, OWN),
    "commands/demo.py open_page": ({"open"}, BROWSER),
    "commands/recipe.py list_recipes": ({"tomllib.loads"}, OWN),
    "simulate/scene/scene.py site_tables": ({"read_text", "tomllib.loads"}, OWN),
    "simulate/bodies/signature/table.py load_table": ({"read_bytes"}, OWN),
    "flgpr_exchange/gprmax/deck_results.py deck_texts": ({"read_text", "tomllib.loads"}, OWN),
    "flgpr_exchange/gpr/antennas.py ": ({"read_text", "tomllib.loads"}, OWN),
    "flgpr_exchange/bags/foxglove.py ": ({"read_bytes"}, OWN),
    "viewer/server.py _static": ({"read_bytes"}, OWN),
    "store/bundle.py write_bundle": ({"open"}, JUST_WRITTEN),
    "flgpr_exchange/cphd/phase_history.py write_cphd": ({"open"}, JUST_WRITTEN),
    "store/files.py sync_file": ({"open"}, JUST_WRITTEN),
    "store/files.py _open_alone": ({"open"}, JUST_WRITTEN),
    "store/files.py _write_under_own_name": ({"open"}, JUST_WRITTEN),
    "geo/geotiff.py _cloud_optimized": ({"open"}, JUST_WRITTEN),
    "flgpr_exchange/sigmf/writing.py write_sigmf": ({"open"}, JUST_WRITTEN),
    "store/outputs.py _hold": ({"open"}, LOCKED),
    "store/outputs.py _hold_beside": ({"open"}, LOCKED),
    "store/run_writer.py RunWriter._write_piece": ({"read_bytes"}, JUST_WRITTEN),
    "store/run_writer.py _write_manifest": ({"read_bytes"}, JUST_WRITTEN),
    "jit/compiled.py _held": ({"open"}, JUST_WRITTEN),
    "flgpr_trials/sealing.py seal_truth": ({"open"}, JUST_WRITTEN),
    "flgpr_exchange/commands/exporting.py _pack": ({"read_bytes"}, JUST_WRITTEN),
    "commands/exports.py map_bytes": ({"read_bytes"}, JUST_WRITTEN),
    "flgpr_exchange/cphd/phase_history.py read_cphd": ({"open"}, RECORDING),
    "flgpr_exchange/cphd/phase_history.py CphdReader.explain": ({"open"}, RECORDING),
    "flgpr_exchange/gpr/parts.py read_records": ({"fromfile"}, RECORDING),
    "formats/arrays.py _open_hdf5": ({"File"}, GUARDED),
    "formats/arrays.py _open_npy": ({"load"}, RECORDING),
    "geo/basemap.py map_backdrop": ({"open"}, GUARDED),
    "geo/basemap.py _png_bytes": ({"open"}, IN_HAND),
    "formats/child.py probe_hdf5": ({"File"}, GUARDED),
    "flgpr_exchange/gprmax/explain.py GprmaxReader.owns": ({"File"}, GUARDED),
    "flgpr_exchange/gprmax/explain.py explain_merged": ({"File"}, GUARDED),
    "flgpr_exchange/gprmax/output.py _read": ({"File"}, GUARDED),
    "flgpr_exchange/sigmf/reading.py SigmfRecording._find_samples": ({"open"}, THROUGH_FOLDER),
    "flgpr_exchange/sigmf/reading.py SigmfRecording._read_samples": ({"open"}, THROUGH_FOLDER),
    "formats/arrays.py _open_mat": ({"load"}, IN_HAND),
    "formats/child.py unpack": ({"open"}, IN_HAND),
    "commands/design.py _as_json": ({"json.loads"}, IN_HAND),
    "commands/picture.py Picture.as_json": ({"json.loads"}, IN_HAND),
    "commands/score_text.py score_summary": ({"json.loads"}, IN_HAND),
    "flgpr_trials/sealing.py _as_json": ({"json.loads"}, IN_HAND),
    "jobs/simulated_lane.py _digest": ({"json.loads"}, IN_HAND),
}
READS = {
    "read_bytes",
    "read_text",
    "open",
    "read_csv",
    "fromfile",
    "memmap",
    "File",
    "loadtxt",
    "genfromtxt",
}


def readings(tree):
    """Name what opens a file, or parses what may be nested or large, by the function that does: (function, call)."""

    def within(node, names):
        for inner in ast.iter_child_nodes(node):
            below = (
                [*names, inner.name] if isinstance(inner, ast.ClassDef | ast.FunctionDef) else names
            )
            if isinstance(inner, ast.Call) and (call := reading(inner)):
                yield owner(names), call
            yield from within(inner, below)

    def owner(names):
        """Name the outermost function, of a class with the class."""
        classes = [node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
        return ".".join(names[: 2 if names and names[0] in classes else 1])

    return set(within(tree, []))


def reading(call):
    """Name a call that reads past the door; "" for another."""
    function = call.func
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    base = ast.unparse(function.value) if isinstance(function, ast.Attribute) else ""
    if base in ("json", "tomllib") and name in ("load", "loads"):
        return f"{base}.{name}"
    if base in ("np", "numpy") and name == "load":
        return "" if in_hand(call) else name
    if name not in READS or (name == "read_csv" and in_hand(call)):
        return ""
    through = {ast.unparse(word.value) for word in call.keywords if word.arg == "opener"} & {
        "open_own",
        "open_at_once",
    }
    return "" if through or base.startswith("Folder(") else name


def in_hand(call):
    """Tell whether a call reads bytes or text that are made at the place."""
    return bool(call.args) and ast.unparse(call.args[0]).startswith(("io.BytesIO(", "io.StringIO("))


def test_no_file_is_read_past_the_door():
    """What is listed and not found any more is taken out of the list."""
    found = {}
    for path in MODULES:
        name = place(path)
        if name not in DOORS:
            for function, call in readings(ast.parse(path.read_text(encoding="utf-8"))):
                found.setdefault(f"{name} {function}", set()).add(call)
    assert found == {place: calls for place, (calls, _) in PAST_THE_DOOR.items()}


@pytest.mark.parametrize(
    "text",
    [
        "path.read_bytes()",
        "json.loads(path.read_text())",
        "json.loads(data)",
        "tomllib.loads(text)",
        "np.load(path, allow_pickle=False)",
        "np.load(file, allow_pickle=False)",
        "pd.read_csv(path)",
        "with path.open('rb') as file: pass",
        "open(path)",
        "os.open(path, os.O_RDONLY)",
        "np.fromfile(path)",
        "np.memmap(path)",
        "h5py.File(path)",
    ],
)
def test_the_check_of_doors_finds_what_it_looks_for(text):
    assert readings(ast.parse(f"def read(path):\n    {text}"))
    assert readings(ast.parse(f"class A:\n    def read(self):\n        {text}"))


@pytest.mark.parametrize(
    "text",
    [
        "Folder(home).open(name)",
        "open(path, 'ab', opener=open_own)",
        "pd.read_csv(io.BytesIO(data))",
        "np.load(io.BytesIO(data), allow_pickle=False)",
        "parse_json(data)",
        "parse_toml(data)",
    ],
)
def test_the_check_of_doors_lets_doors_be(text):
    assert not readings(ast.parse(f"def read(path):\n    {text}"))
