"""Stages meet in `model` only: the table of imports that are allowed, and what a cheap command may load."""

import ast
import importlib
import re
import subprocess
import sys
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

import alone
import flgpr
import flgpr.io
from flgpr.store import sample_lane
from sources import BESIDE, ROOT, modules_of, place

PAPERS = ROOT.parent / "flgpr_papers"
EXCHANGE = ROOT.parent / "flgpr_exchange"
STAGES = {"health", "calibrate", "imaging", "clutter", "screen", "features", "detect", "simulate"}
NUMBERS = {"model", "jit", "kernels", "scoring"} | STAGES
METHOD = {"engine", "progress", "stages", "recipe", "method"}
BELOW_METHOD = {"model", "jit", "kernels", "store", "engine", "progress", "stages", "recipe"}
FILES = {"store", "formats", "geo"}
BELOW = NUMBERS | FILES
ALLOWED = {
    "lazy": set(),
    "system": set(),
    "types": set(),
    "door": set(),
    "budget": set(),
    "json_text": set(),
    "toml_text": set(),
    "archive": set(),
    "append_log": set(),
    "model": set(),
    "jit": set(),
    "kernels": {"jit"},
    **{stage: {"model", "jit", "kernels"} for stage in STAGES},
    "calibrate": {"model", "jit", "kernels", "health", "progress"},
    "scoring": {"model"},
    "store": {"model", "append_log"},
    "geo": {"model", "store"},
    "formats": {"model", "store", "geo"},
    "io": FILES,
    "trials": {"report"},
    "engine": {"model", "jit", "kernels", "progress"},
    "progress": set(),
    "stages": {"model", "jit", "kernels", "store", "engine", "progress"} | STAGES,
    "recipe": {"model", "kernels", "store", "stages"} | STAGES,
    "method": BELOW_METHOD | STAGES,
    "chain": {"stages"},
    "results": {"model", "store", "geo", "scoring", *METHOD},
    "design": {"model", "kernels", "imaging", "simulate", *METHOD},
    "report": {"model", "screen", "scoring", *METHOD, "results", "design"} | FILES,
    "jobs": {
        "model",
        "jit",
        "store",
        "geo",
        *METHOD,
        "results",
        "report",
        "scoring",
        "simulate",
        "live",
        "health",
    },
    "live": {"health", "model", "store", "geo", *METHOD, "append_log"} | STAGES,
    "proving_ground": set(),
    "accessor": {"model", "imaging", "health", "screen", *METHOD, "results"},
    "viewer": {"model"} | FILES,
    "notebook": {"commands", "results", "viewer"},
    "commands": BELOW | {*METHOD, "results", "report", "design", "jobs", "live", "viewer"},
    "__main__": {"commands"},
    "__init__": {*METHOD, "results", "notebook", "commands"} | BELOW,
}
BELOW_ALL = {
    "lazy",
    "system",
    "types",
    "door",
    "budget",
    "json_text",
    "toml_text",
    "archive",
    "__version__",
}
"""Modules that every room may import."""
ALLOWED_BESIDE = {
    "flgpr_exchange": set(),
    "flgpr_ground": {"flgpr_trials"},
    "flgpr_papers": set(),
    "flgpr_trials": set(),
}
"""What a package beside the instrument may import of the others; of the instrument everything."""
ROOMS_BESIDE = {
    "flgpr_ground/features": ALLOWED["features"],
    "flgpr_ground/detect": ALLOWED["detect"] | {"detect"},
    "flgpr_ground/scorers": {"detect"},
    "flgpr_ground/stages": ALLOWED["stages"] | {"stages"},
}
"""Rooms beside the instrument that hold what its rooms of that name hold, and what they may import of it."""
FACES = sorted(path.parent for path in ROOT.rglob("__init__.pyi") if path.parent.name != "io")
HEAVY = {
    "numba",
    "scipy",
    "matplotlib",
    "sklearn",
    "h5py",
    "pyproj",
    "starlette",
    "uvicorn",
    "jinja2",
}


@cache
def nodes(path: Path) -> list[ast.AST]:
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def imported(path: Path) -> frozenset[str]:
    """Full names of what a module imports, wherever in it the import stands."""
    found = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found |= (
                {f"flgpr.{alias.name}" for alias in node.names}
                if node.module == "flgpr"
                else {node.module}
            )
    return frozenset(found)


@cache
def modules(root: Path = ROOT) -> list[Path]:
    return modules_of(root, stubs=True)


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_module_imports_only_what_its_folder_may(path):
    folder = path.relative_to(ROOT).parts[0].split(".")[0]
    assert folder in ALLOWED, f"{folder} has no row in the table"
    rooms = {name.split(".")[1] for name in imported(path) if name.startswith("flgpr.")}
    assert rooms - {folder} - BELOW_ALL <= ALLOWED[folder]


def packages_beside(path: Path) -> set[str]:
    """Top-level names of packages beside the instrument that a module imports."""
    tops = {name.partition(".")[0] for name in imported(path)}
    return {name for name in tops if name.startswith("flgpr_")}


@pytest.mark.parametrize("folder", BESIDE, ids=place)
def test_a_package_beside_the_instrument_rests_on_it_alone(folder):
    assert folder.name in ALLOWED_BESIDE, f"{folder.name} has no row in the table"
    for path in modules(folder):
        assert packages_beside(path) - {folder.name} <= ALLOWED_BESIDE[folder.name], place(path)


@pytest.mark.parametrize("room", ROOMS_BESIDE)
def test_a_rival_imports_what_its_like_in_the_instrument_may(room):
    for path in modules(ROOT.parent / room):
        rooms = {name.split(".")[1] for name in imported(path) if name.startswith("flgpr.")}
        assert rooms - BELOW_ALL <= ROOMS_BESIDE[room], place(path)


def test_the_instrument_imports_nothing_that_lies_beside_it():
    """A stub may say where a public name has moved; the face leaves it out where it is not installed."""
    assert not [place(path) for path in modules_of(ROOT) if packages_beside(path)]
    beside = re.compile(rf"[\"']({'|'.join(ALLOWED_BESIDE)})\b")
    named = [path for path in modules_of(ROOT) if beside.search(path.read_text(encoding="utf-8"))]
    assert [place(path) for path in named] == []


ALONE = """
import alone
alone.hide_packages_beside()
import flgpr
from typer.testing import CliRunner
from flgpr.commands.app import app
for package in alone.BESIDE:
    try:
        __import__(package)
    except ModuleNotFoundError:
        continue
    raise SystemExit(f"{package} is found")
shown = CliRunner().invoke(app, ["--help"])
assert shown.exit_code == 0 and "benchmark" not in shown.output, shown.output
import flgpr.proving_ground
assert flgpr.proving_ground.__all__ == []
import flgpr.trials
assert flgpr.trials.__all__ == ["figure_bytes", "patch_figure", "roc_figure"]
assert "Plan a test" not in shown.output
assert "MultipleKernelClassifier" not in flgpr.detect.__all__
from flgpr.method.method import detect
from flgpr.recipe.fit import area_of
run, recipe = flgpr.open_run(flgpr.sample_lane() / "run.zarr"), flgpr.load_recipe("demo")
found = detect(run, recipe, area_of(run, recipe))
assert len(found.alarms)
"""


@pytest.mark.slow("detects in a process of its own")
def test_the_instrument_works_without_what_lies_beside_it():
    tests = Path(alone.__file__).parent
    done = subprocess.run(
        [sys.executable, "-c", ALONE], cwd=tests, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


def circles() -> set[frozenset[str]]:
    """Modules that import one another in a circle, an import for the eyes of type checkers alone among them."""
    names = {}
    for path in modules_of(ROOT, *BESIDE):
        if path.name != "__init__.py":
            names[".".join(path.relative_to(ROOT.parent).with_suffix("").parts)] = path
    uses = {name: imported(path) & names.keys() - {name} for name, path in names.items()}
    reach = {name: set(used) for name, used in uses.items()}
    grown = True
    while grown:
        grown = False
        for seen in reach.values():
            more = set().union(*(reach[one] for one in seen)) - seen
            grown = grown or bool(more)
            seen |= more
    return {
        frozenset(other for other in seen if name in reach[other])
        for name, seen in reach.items()
        if name in seen
    }


def test_no_module_imports_itself_by_a_detour():
    assert not circles()


def test_the_engine_knows_no_pass_and_a_pass_no_other_way_through():
    """The engine is handed passes; what they do stands under method/passes, which only the method puts together."""
    assert not {name for name in imported(ROOT / "engine.py") if "passes" in name}
    users = {
        str(path.relative_to(ROOT))
        for path in modules()
        if any(name.startswith("flgpr.method.passes") for name in imported(path))
    }
    others = {name for name in users if not name.startswith("method/passes/")}
    assert others == {"method/method.py", "method/detection.py"}


@pytest.mark.parametrize("path", modules(PAPERS), ids=lambda path: str(path.relative_to(PAPERS)))
def test_a_study_uses_its_own_paper_and_the_kit(path):
    """One paper's study may not lean on another's, nor the kit on a study."""
    room = path.relative_to(PAPERS).parts[0].partition(".")[0]
    rooms = {name.split(".")[1] for name in imported(path) if name.startswith("flgpr_papers.")}
    assert rooms <= ({"overview", "kit"} if room == "__init__" else {room, "kit"})


EXCHANGE_ROOMS = {
    "gpr": set(),
    "sigmf": set(),
    "cphd": {"documents"},
    "bags": set(),
    "gprmax": set(),
    "documents": set(),
    "maps": {"documents"},
    "motive": set(),
    "touchstone": set(),
    "commands": {"gpr", "sigmf", "cphd", "bags", "gprmax", "maps"},
    "__init__": set(),
}
"""Rooms of the files of other programs, and what each may import of the others."""


@pytest.mark.parametrize(
    "path", modules(EXCHANGE), ids=lambda path: str(path.relative_to(EXCHANGE))
)
def test_a_format_stands_alone(path):
    """A family of formats knows no other; commands put them side by side."""
    room = path.relative_to(EXCHANGE).parts[0].removesuffix(".py")
    rooms = {name.split(".")[1] for name in imported(path) if name.startswith("flgpr_exchange.")}
    assert rooms - {room} <= EXCHANGE_ROOMS[room]
    used = {name.split(".")[1] for name in imported(path) if name.startswith("flgpr.")}
    above = {"commands", "results", "method", "live"}
    assert room == "commands" or not used & above


def test_the_instrument_knows_no_format_by_its_reader():
    """Its faces alone name what users have always found in them."""
    named = {
        path
        for path in modules()
        if any(name.startswith("flgpr_exchange") for name in imported(path))
    }
    assert {path.name for path in named} <= {"__init__.pyi"}


def test_only_execution_imports_dask():
    users = {
        p
        for p in modules()
        if {"dask", "distributed"} & {name.split(".")[0] for name in imported(p)}
    }
    assert {p.relative_to(ROOT).parts[0] for p in users} <= {"jobs"}


def test_nothing_pickles():
    for path in modules_of(ROOT, *BESIDE, stubs=True):
        names = {name.split(".")[0] for name in imported(path)}
        assert not names & {"pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"}, path


def test_io_passes_on_the_names_of_three_rooms():
    """`flgpr.io` is no home of its own: what it offers is what the rooms of files offer, the same objects."""
    homes = {}
    for room in sorted(FILES):
        module = importlib.import_module(f"flgpr.{room}")
        for name in module.__all__:
            assert name not in homes, f"{name} has two homes, {homes[name].__name__} and {room}"
            homes[name] = module
    assert flgpr.io.__all__ == sorted(homes)
    assert flgpr.io.open_run is homes["open_run"].open_run
    assert flgpr.io.read_anchor is homes["read_anchor"].read_anchor
    with pytest.raises(AttributeError, match="no attribute 'read_nothing'"):
        flgpr.io.read_nothing


@pytest.mark.parametrize("folder", FACES, ids=lambda folder: str(folder.relative_to(ROOT.parent)))
def test_a_face_tells_the_names_that_it_loads(folder):
    package = importlib.import_module(".".join(folder.relative_to(ROOT.parent).parts))
    stub = ast.parse((folder / "__init__.pyi").read_text(encoding="utf-8"))
    listed = [ast.literal_eval(one.value) for one in stub.body if isinstance(one, ast.Assign)]
    if (
        listed
    ):  # some names stand for others there, which type checkers take for exports only from a list
        assert sorted(listed[0]) == sorted({*package.__all__, "__version__"})
    else:
        found = [one for one in stub.body if find_spec(one.module.partition(".")[0])]
        aliases = [alias for one in found for alias in one.names]
        assert all(alias.asname == alias.name for alias in aliases), (
            "what is not `x as x` type checkers hide"
        )
        assert len(aliases) == len(package.__all__), "a name stands twice"
    for name in package.__all__:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        package.nothing
    hidden = {path.stem for path in folder.glob("*.py")} & set(package.__all__)
    assert not hidden, "loading a module of that name would hide what the face means by it"


def loaded_by(code: str) -> set[str]:
    """Top-level packages that a fresh interpreter has loaded after running some code."""
    told = f"{code}\nimport sys; print(*sorted({{name.split('.')[0] for name in sys.modules}}))"
    ran = subprocess.run([sys.executable, "-c", told], capture_output=True, text=True, check=True)
    return set(ran.stdout.splitlines()[-1].split())


def running(arguments: list[str]) -> str:
    """Return code that runs a command, which must succeed."""
    return (
        f"import sys; sys.argv = ['flgpr', *{arguments!r}]\nfrom flgpr.__main__ import main\ntry:\n    main()\n"
        "except SystemExit as end:\n    assert not end.code"
    )


@pytest.mark.slow("runs in processes of its own")
@pytest.mark.parametrize(
    ("arguments", "besides"),
    [
        (["--version"], {"numpy", "pandas", "xarray", "zarr", "pydantic"}),
        (["--help"], {"numpy", "pandas", "xarray", "zarr", "pydantic"}),
        (["detect", "--help"], {"numpy", "pandas", "xarray", "zarr"}),
        (["recipe", "list"], {"pandas", "xarray", "zarr"}),
        (["info", str(sample_lane() / "run.zarr")], {"zarr"}),
    ],
)
def test_a_command_loads_what_it_needs(arguments, besides):
    """Dask, which xarray would load where it is installed, and SciPy and Jinja with it, is kept away."""
    assert not loaded_by(running(arguments)) & (HEAVY | besides)


@pytest.mark.slow("runs in a process of its own")
def test_scoring_a_table_loads_neither_hdf5_nor_geodesy(tmp_path):
    (tmp_path / "alarms.csv").write_text("alarm_id,x,y,confidence\na,0,1,2\n")
    (tmp_path / "truth.csv").write_text("target_id,x,y,kind,depth\nt,0,1,metal,0.1\n")
    (tmp_path / "lane.toml").write_text("x_min = -1.0\nx_max = 1.0\ny_min = 0.0\ny_max = 5.0\n")
    names = {name: str(tmp_path / name) for name in ("alarms.csv", "truth.csv", "lane.toml")}
    words = [names["alarms.csv"], "--truth", names["truth.csv"], "--lane", names["lane.toml"]]
    words += ["-o", str(tmp_path / "score")]
    assert not loaded_by(running(["score", *words])) & {"h5py", "pyproj"}


def test_the_demo_and_anchors_load_no_geodesy_before_it_is_needed():
    assert "pyproj" not in loaded_by("import flgpr.geo.anchor, flgpr.commands.demo")


def test_importing_the_package_loads_nothing_else():
    loaded = loaded_by("import flgpr; assert not flgpr.__doc__ is None")
    assert not loaded & (HEAVY | {"numpy", "pandas", "xarray", "zarr", "pydantic", "typer"})


def test_two_packages_are_verbs(monkeypatch):
    """`flgpr.detect` holds the detectors, and called it detects; the same for `flgpr.simulate`."""
    asked = []
    monkeypatch.setattr("flgpr.commands.detect.detect", lambda *a, **k: asked.append((a, k)))
    monkeypatch.setattr("flgpr.simulate.simulate", lambda *a, **k: asked.append((a, k)))
    flgpr.detect("run.zarr", "demo", "out", report=False)
    flgpr.simulate("scene", seed=3)
    assert asked == [(("run.zarr", "demo", "out"), {"report": False}), (("scene",), {"seed": 3})]
    assert flgpr.detect.FisherDiscriminant.__module__ == "flgpr.detect.fisher"
    assert flgpr.simulate.Scene is flgpr.Scene


MOST_PARAMETERS = 12
MANY = {  # names that are public, one parameter for each thing a user may set
    "flgpr/imaging/operator.py:ImagingOperator.__init__",
    # scikit-learn wants them one by one
    "flgpr/detect/one_class.py:OneClassRelevanceVectorMachine.__init__",
    "flgpr/scoring/lane_roc.py:roc",
}


def test_no_function_takes_more_parameters_than_a_reader_can_hold():
    """Commands have one for each option, and what numba compiles takes bare arrays and numbers."""
    found = set()
    for path in modules_of(ROOT, *BESIDE):
        classes = [node for node in nodes(path) if isinstance(node, ast.ClassDef)]
        owners = {one: f"{owner.name}." for owner in classes for one in owner.body}
        for node in nodes(path):
            if isinstance(node, ast.FunctionDef):
                named = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = len([one for one in named if one.arg not in ("self", "cls")])
                if count <= MOST_PARAMETERS or path.parent.name == "commands":
                    continue
                if not re.search(
                    r"jit|shared|intrinsic", " ".join(map(ast.unparse, node.decorator_list))
                ):
                    found.add(f"{path.relative_to(ROOT.parent)}:{owners.get(node, '')}{node.name}")
    assert found == MANY
