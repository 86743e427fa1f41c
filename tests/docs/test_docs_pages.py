"""Every page: links lead somewhere, names exist, commands are ones the command line has, and programs run."""

import ast
import importlib
import itertools
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import typer

from flgpr.commands.app import app
from flgpr.commands.exports import export_formats
from flgpr.model import sensor_presets
from flgpr.recipe.schema import recipe_names
from flgpr.simulate import sites
from flgpr_papers import PAPERS
from reading import EXAMPLES, FENCE, PAGES, ROOT, identify, program_lines, read, shell_fences

pytestmark = pytest.mark.slow("checks of pages")

LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def anchors(page):
    """Anchors that headings get on a code host and in the built pages."""
    heads = re.findall(r"^#+ (.*)$", FENCE.sub("", read(page)), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).strip().replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES, ids=identify)
def test_links_lead_to_files_and_headings(page):
    prose = re.sub(r"`[^`]*`", "", FENCE.sub("", read(page)))
    for target in LINK.findall(prose):
        assert not target.startswith("/"), target
        if "://" in target:
            continue
        name, _, anchor = target.partition("#")
        file = (page.parent / name) if name else page
        assert file.exists(), f"{target} does not exist"
        if anchor:
            assert anchor in anchors(file), f"{target}: no such heading"


@pytest.mark.parametrize("page", PAGES, ids=identify)
def test_files_that_a_page_includes_exist(page):
    text = re.sub(r"<!--.*?-->", "", read(page), flags=re.DOTALL)
    included = re.findall(r"^```\{literalinclude\} (\S+)", text, re.MULTILINE)
    included += re.findall(r"^:file: (\S+)", text, re.MULTILINE)
    assert not [name for name in included if not (page.parent / name).is_file()]


# The changelog names files where they were when its line was written.
CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]


@pytest.mark.parametrize("page", CURRENT, ids=identify)
def test_files_of_the_repository_named_in_the_text_exist(page):
    named = re.findall(
        r"`((?:src|tests|docs|benchmarks|viewer|evidence(?=/\w+\.py|/worlds/worlds))/[\w./-]*\w)/?`",
        FENCE.sub("", read(page)),
    )
    wrong = [
        name
        for name in named
        if not any((base / name).exists() for base in (ROOT, ROOT / "src" / "flgpr"))
    ]
    assert not wrong


def test_every_page_is_in_a_table_of_contents():
    listed = {ROOT / "docs" / "index.md"}
    for page in PAGES:
        for kind, body in FENCE.findall(read(page)):
            if kind == "{toctree}":
                entries = [
                    line.strip()
                    for line in body.splitlines()
                    if line.strip() and not line.startswith(":")
                ]
                listed |= {page.parent / f"{entry}.md" for entry in entries}
    missing = [
        identify(page)
        for page in PAGES
        if page.is_relative_to(ROOT / "docs") and page not in listed
    ]
    assert not missing, f"list these in docs/index.md: {missing}"


def resolves(name):
    """Whether a dotted name is a module or something in one."""
    first, *parts = name.split(".")
    found = importlib.import_module(first)
    path = first
    for part in parts:
        path = f"{path}.{part}"
        if part in getattr(found, "model_fields", {}):
            return True
        # An attribute comes before a module: a folder of data has the name of the function that
        # lists it.
        if not hasattr(found, part):
            try:
                importlib.import_module(path)
            except ModuleNotFoundError:
                return False
        found = getattr(found, part)
    return True


GROUPS = set(tomllib.loads(read(ROOT / "pyproject.toml"))["project"]["entry-points"])
"""Groups of entry points, whose names look like those of modules."""


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_names_in_the_text_exist(page):
    text = re.sub(r"^import .*$|^from .*$", "", read(page), flags=re.MULTILINE)
    names = set(re.findall(r"`(flgpr(?:_papers)?(?:\.[A-Za-z_]\w*)+)", text))
    wrong = [name for name in sorted(names - GROUPS) if not resolves(name)]
    assert not wrong


COMMANDS = typer.main.get_command(app)


def command_of(words):
    """Find the command and return it with what is left of the words."""
    found = COMMANDS
    words = list(words)
    while hasattr(found, "commands"):
        if not words or words[0].startswith("-"):
            return found, words
        if words[0] not in found.commands:
            raise AssertionError(f"no command {words[0]!r} in flgpr")
        found = found.commands[words.pop(0)]
    return found, words


def commands_in(text):
    """Commands within running text."""
    yield from re.findall(
        r"(?<!`)`(flgpr [^`]+)`", FENCE.sub("", text).replace("``", "`").replace("\n# ", " ")
    )


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_commands_in_the_text_and_their_options_exist(page):
    for line in commands_in(read(page)):
        words = shlex.split(line, comments=True)[1:]
        if "…" in words[:2]:  # any of several commands
            continue
        found, rest = command_of(words)
        known = {name for one in found.params for name in (*one.opts, *one.secondary_opts)} | {
            "--help"
        }
        for word in rest:
            if word.startswith("-") and not re.fullmatch(r"-\d.*|-", word):
                assert word.split("=")[0] in known, f"{line}: no option {word}"


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_programs_of_the_repository_in_the_text_and_their_options_exist(page):
    for tool, rest in re.findall(
        r"(?<!`)`(make|python) ([^`]+)`", FENCE.sub("", read(page)).replace("``", "`")
    ):
        CHECKS[tool](shlex.split(rest))


def check_flgpr(words):
    """Parse a whole line as the command line does, and look whether what it names is packaged."""
    found, rest = command_of(words)
    if hasattr(found, "commands") or "--help" in rest:
        return
    given = found.make_context(found.name, list(rest)).params
    if isinstance(given.get("recipe"), str) and not given["recipe"].endswith(".toml"):
        assert given["recipe"] in recipe_names()
    for sensor in [given.get("sensor"), *(given.get("compare") or [])]:
        assert sensor is None or sensor.endswith((".toml", ".zarr")) or sensor in sensor_presets()
    assert given.get("site", "arid-sand") in sites()
    assert given.get("paper", "all") in {*PAPERS, "all"}
    assert given.get("to", "kml") in export_formats()
    assert given.get("engine", "flgpr") in {"flgpr", "gprmax"}


def check_make(words):
    targets = set(re.findall(r"^([a-z-]+):", read(ROOT / "Makefile"), re.MULTILINE))
    assert {word for word in words if "=" not in word} <= targets


def check_script(words):
    """Look whether a program of the repository exists and takes the options."""
    script, *options = words
    if script == "-m":
        return
    path = ROOT / script
    source = (path / "__main__.py" if path.is_dir() else path).read_text(encoding="utf-8")
    for word in options:
        assert not word.startswith("-") or f'"{word}"' in source, f"{script}: no option {word}"


def check_pip(words):
    extras = tomllib.loads(read(ROOT / "pyproject.toml"))["project"]["optional-dependencies"]
    for word in words:
        for named in re.findall(r"\[([\w,]+)\]", word):
            assert set(named.split(",")) <= set(extras), word


def check_shipped(words):
    wrong = [
        word
        for word in words
        if word.startswith(("src/", "viewer/")) and not (ROOT / word).exists()
    ]
    assert not wrong


def check_dask(words):
    assert words[0] in {
        "scheduler",
        "worker",
    }  # what they take is Dask's; tests/robustness/test_cluster.py starts both


def check_asv(words):
    """Look whether the suite has the benchmarks that a line names."""
    assert words[0] in {"run", "continuous", "publish", "preview"}
    source = "".join(read(path) for path in sorted((ROOT / "benchmarks/suite").glob("*.py")))
    for option, value in itertools.pairwise(words):
        assert option != "--bench" or f"class {value}:" in source, f"no benchmark {value}"


def check_folder(words):
    made_by_the_page = {"lane-7", ".."}
    assert words[0] in made_by_the_page or (ROOT / words[0]).is_dir()


CHECKS = {
    "asv": check_asv,
    "cd": check_folder,
    "flgpr": check_flgpr,
    "make": check_make,
    "python": check_script,
    "pip": check_pip,
    "cp": check_shipped,
    "sh": check_shipped,
    "dask": check_dask,
    **dict.fromkeys((".", "export", "python3"), lambda words: None),
}


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_every_line_for_the_shell_is_one_that_runs(page):
    lines = (
        program_lines(page)
        if page in EXAMPLES
        else (line for fence in shell_fences(page) for line in fence)
    )
    for line in lines:
        words = shlex.split(line, comments=True)
        assert words[0] in CHECKS, f"{line}: nobody checks {words[0]}"
        CHECKS[words[0]](words[1:])


def test_the_lines_for_the_shell_are_found():
    """A check that finds nothing would pass."""
    count = sum(
        line.startswith("flgpr ")
        for page in PAGES
        for fence in shell_fences(page)
        for line in fence
    )
    assert count > 45
    assert sum(1 for page in EXAMPLES for _ in program_lines(page)) >= 4
    assert sum(1 for page in PAGES for _ in commands_in(read(page))) > 40
    assert sum(len(LINK.findall(read(page))) for page in PAGES) > 80
    assert sum(len(re.findall(r"`flgpr\.", read(page))) for page in PAGES) > 80


@pytest.mark.parametrize(
    "line",
    [
        "flgpr detects a.zarr",
        "flgpr detect a.zarr -o b --lanes 3",
        "flgpr detect -o b",
        "flgpr detect a.zarr -o b --recipe wang",
        "flgpr design sri -o b.html",
        "flgpr simulate a.toml --seed one -o b",
        "make demos",
        "python evidence/live.py --agree",
        "pip install -e '.[seals]'",
        "asv run --bench Images",
        "cd bench",
    ],
)
def test_a_line_with_a_fault_is_noticed(line):
    words = shlex.split(line)
    try:
        CHECKS[words[0]](words[1:])
    except Exception:
        return
    raise AssertionError(f"{line} passed")


def programs():
    return [
        (page, body)
        for page in PAGES
        for kind, body in FENCE.findall(read(page))
        if kind == "python"
    ]


@pytest.mark.parametrize(
    ("page", "body"), programs(), ids=lambda one: identify(one) if isinstance(one, Path) else ""
)
def test_programs_are_valid_and_import_what_exists(page, body):
    for node in ast.walk(ast.parse(body)):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("flgpr"):
            assert all(resolves(f"{node.module}.{alias.name}") for alias in node.names), (
                ast.unparse(node)
            )
        elif isinstance(node, ast.Import):
            assert all(
                resolves(alias.name) for alias in node.names if alias.name.startswith("flgpr")
            )


def test_make_robustness_runs_every_test_that_the_page_of_promises_names():
    page = read(ROOT / "docs" / "evidence" / "guarantees.md")
    listed = re.search(r"^ROBUSTNESS := ((?:.*\\\n)*.*)$", read(ROOT / "Makefile"), re.MULTILINE)
    run = listed[1].replace("\\", "").split()
    folder = ROOT / "tests" / "robustness"
    named = set(re.findall(r"`(?:tests/)?((?:\w+/)*test_\w+\.py)`", page))
    elsewhere = {name for name in named if not (folder / Path(name).name).is_file()}
    assert len(elsewhere) > 15
    assert elsewhere <= set(run), "named on the page and not run"
    assert {path.name for path in folder.glob("test_*.py")} <= {Path(name).name for name in named}
    assert all((ROOT / "tests" / name).exists() for name in run)


@pytest.mark.parametrize("name", ["QUICK", "ROBUSTNESS"])
def test_lists_of_tests_in_the_makefile_name_what_exists(name):
    text = read(ROOT / "Makefile").replace("\\\n", " ")
    [paths] = re.findall(rf"^{name} := (.*)$", text, re.MULTILINE)
    missing = [path for path in paths.split() if not (ROOT / "tests" / path).exists()]
    assert len(paths.split()) > 2
    assert not missing
