"""Stages meet in `model` only: the table of imports that are allowed."""

import ast
from pathlib import Path

import pytest

import flgpr

ROOT = Path(flgpr.__file__).parent
STAGES = {"calibrate", "imaging", "clutter", "screen", "features", "detect", "simulate"}
ALLOWED = {
    "model": set(),
    "kernels": set(),
    **{stage: {"model", "kernels"} for stage in STAGES},
    "scoring": {"model"},
    "io": {"model"},
    "pipeline": {"model", "kernels", "io", "scoring"} | STAGES,
    "viewer": {"model", "io"},
    "cli": {"pipeline", "viewer"},
    "__main__": {"cli", "viewer"},
    "__init__": set(),
}


def imports_of(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names = [node.module] if node.module != "flgpr" else [f"flgpr.{alias.name}" for alias in node.names]
        found |= {name.split(".")[1] for name in names if name and name.startswith("flgpr.")}
    return found


def modules() -> list[Path]:
    return sorted(ROOT.rglob("*.py"))


@pytest.mark.parametrize("path", modules(), ids=lambda path: str(path.relative_to(ROOT)))
def test_module_imports_only_what_its_folder_may(path):
    folder = path.relative_to(ROOT).parts[0].removesuffix(".py")
    assert folder in ALLOWED, f"{folder} has no row in the table"
    own = {folder} | ({"__version__"} if folder in {"cli", "pipeline", "io", "scoring"} else set())
    assert imports_of(path) - own <= ALLOWED[folder]


def test_only_the_pipeline_imports_dask():
    users = {p for p in modules() if "dask" in p.read_text(encoding="utf-8") and "import dask" in p.read_text()}
    assert all(p.relative_to(ROOT).parts[0] == "pipeline" for p in users)


def test_nothing_pickles():
    for path in modules():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = {a.name.split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names}
        names |= {(n.module or "").split(".")[0] for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        assert not names & {"pickle", "cloudpickle", "dill", "joblib", "shelve", "marshal"}, path
