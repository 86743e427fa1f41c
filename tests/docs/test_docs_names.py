"""Every function, class, entry and program file that a page names without its whole path exists in the sources.

Names with their whole path (`flgpr.scoring.roc`) are looked up in `test_docs_pages.py`.
"""

import ast
import re
from collections import defaultdict
from pathlib import Path

import pytest

from reading import FENCE, PAGES, ROOT, identify, read

pytestmark = pytest.mark.slow("imports all that the pages name")

SOURCES = (ROOT / "src", ROOT / "benchmarks", ROOT / "evidence", ROOT / "docs")
HOMES = (
    ROOT / "src",
    ROOT,
    ROOT / "src" / "flgpr",
    ROOT / "src" / "flgpr_papers",
    ROOT / "tests",
    ROOT / "benchmarks",
    ROOT / "evidence",
)
"""Folders from which a page may name a file."""

CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]
MODELS = ROOT / "docs" / "reference" / "physics" / "models.csv"
PHYSICS = [page for page in PAGES if page.parent.name == "theory" or page.name == "physics.md"]
PHYSICS.append(MODELS)
"""Pages on which every dotted name is one of the sources."""

MATHEMATICS = {"exp", "sqrt", "k_s", "p_e"}
OTHERS = {
    # Python, and the environment
    "FLGPR_MEASURED_DATA", "NUMBA_CACHE_DIR", "ValueError",
    # Dask and its relatives
    "DaskCluster", "job_script",
    # scikit-learn, Zarr, finufft
    "check_complex_data", "check_estimator", "n_trans", "set",
    # servers that ours is compared with
    "channel_timeout", "connection_limit", "header_read_timeout", "keep_alive_timeout", "limit_concurrency",
    "read_timeout",
    # patterns of columns, and columns of somebody
    "FEATURE_SUBBAND", "s10_2", "y_ft",
}  # fmt: skip
"""Names of other programs."""

SPAN = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
NAME = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*)(\(.*\))?", re.ASCII)
WORD = re.compile(r"[A-Za-z_]\w*")
DATA = {".csv", ".html", ".js", ".json", ".toml", ".txt"}


class Sources:
    """What the program files define, and the words of their code and their data."""

    def __init__(self) -> None:
        self.definitions: set[str] = set()
        self.words: set[str] = set()
        self.members: dict[str, set[str]] = defaultdict(set)
        for folder in SOURCES:
            for path in folder.rglob("*.py"):
                if "examples" not in path.parts:
                    self._read_program(path)
        for path in (ROOT / "src").rglob("*"):
            if path.suffix in DATA:
                self.words |= set(WORD.findall(path.read_text(encoding="utf-8", errors="ignore")))

    def _read_program(self, path: Path) -> None:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        names = _defined_in(tree.body)
        # A page may name a function by its module or by a folder above it.
        for owner in (path.stem, path.parent.name):
            self.members[owner] |= names
            self.words.add(owner)
        for node in ast.walk(tree):
            self.words |= _words_of(node)
            if isinstance(node, ast.ClassDef):
                self.members[node.name] |= _defined_in(node.body)
            if isinstance(node, ast.ClassDef | ast.FunctionDef):
                self.definitions.add(node.name)

    def defines(self, name: str) -> bool:
        """Whether the last part of a dotted name is defined in the module or class before it."""
        owner, _, member = name.rpartition(".")
        if not owner:
            return member in self.definitions
        return member in self.members[owner.rpartition(".")[2]]


def _words_of(node: ast.AST) -> set[str]:
    """Return the names that a piece of code uses; texts count (columns, entries), docstrings do not."""
    if isinstance(node, ast.Name):
        return {node.id}
    if isinstance(node, ast.Attribute):
        return {node.attr}
    if isinstance(node, ast.arg):
        return {node.arg}
    if isinstance(node, ast.keyword):
        return {node.arg or ""}
    if isinstance(node, ast.FunctionDef):
        return {node.name}
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and "\n" not in node.value:
        return set(WORD.findall(node.value))
    return set()


def _defined_in(body: list[ast.stmt]) -> set[str]:
    """Return the names that statements define: functions, classes, constants and fields."""
    names = set()
    for statement in body:
        if isinstance(statement, ast.ClassDef | ast.FunctionDef):
            names.add(statement.name)
        elif isinstance(statement, ast.Assign):
            names |= {target.id for target in statement.targets if isinstance(target, ast.Name)}
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            names.add(statement.target.id)
    return names


@pytest.fixture(scope="module")
def sources():
    return Sources()


def spans(page):
    """Inline code of a page's running text and tables."""
    return SPAN.findall(FENCE.sub("", read(page)))


def wrong_names(found_spans, sources, dotted):
    """Collect the names that no program defines; ``dotted`` asks for those with a module, too."""
    wrong = []
    for span in found_spans:
        match = NAME.fullmatch(span)
        if match is None:
            continue
        name, arguments = match.groups()
        last = name.rpartition(".")[2]
        if last in OTHERS | MATHEMATICS or name.split(".")[0].startswith("flgpr"):
            continue
        is_class = re.search("[a-z][A-Z]", last)
        if "." in name and dotted:
            known = sources.defines(name)
        elif arguments or is_class:
            known = last in sources.definitions
        elif "_" in last.strip("_"):
            known = last in sources.words
        else:
            continue
        if not known:
            wrong.append(span)
    return wrong


@pytest.mark.parametrize("page", CURRENT, ids=identify)
def test_functions_classes_and_entries_that_a_page_names_exist(page, sources):
    assert not wrong_names(spans(page), sources, dotted=page in PHYSICS)


@pytest.fixture(scope="module")
def program_files():
    """Names of all program files of the repository."""
    return {path.name for home in HOMES for path in home.rglob("*.py")}


@pytest.mark.parametrize("page", CURRENT, ids=identify)
def test_program_files_that_a_page_names_exist(page, program_files):
    wrong = []
    for span in spans(page):
        if not re.fullmatch(r"[\w./-]+\.py", span):
            continue
        known = span in program_files or any((home / span).is_file() for home in HOMES)
        if not known:
            wrong.append(span)
    assert not wrong


def test_names_that_are_gone_are_noticed(sources):
    gone = ["soil.mironof", "terrain.Field", "no_such_function()", "NoSuchClass", "no_such_entry"]
    assert wrong_names(gone, sources, dotted=True) == gone
    there = ["soil.mironov", "Soil.loss_tangent", "clopper_pearson(n, n)", "ImagingOperator"]
    assert wrong_names([*there, "rms_height", "exp(-jkL)"], sources, dotted=True) == []


def test_the_physics_pages_name_what_computes_each_row(sources):
    """A check that finds nothing would pass."""
    names = [span for span in spans(MODELS) if re.fullmatch(r"[A-Za-z]\w*\.[A-Za-z_]\w*", span)]
    assert sum(sources.defines(name) for name in names) > 25
