"""Every page: links lead somewhere, names exist, commands are ones the command line has, and programs run."""

import ast
import importlib
import re
import shlex
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import typer

from flgpr.cli import app

ROOT = Path(__file__).parents[2]
PAGES = sorted(p for p in (ROOT / "docs").rglob("*.md") if not {"_build", "examples"} & set(p.parts))
PAGES += [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
EXAMPLES = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)


def identify(path):
    return str(path.relative_to(ROOT))


def read(page):
    return page.read_text(encoding="utf-8")


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
def test_files_of_the_repository_named_in_the_text_exist(page):
    named = re.findall(r"`((?:src|tests|docs|benchmarks|viewer)/[\w./-]*\w)/?`", FENCE.sub("", read(page)))
    wrong = [name for name in named if not any((base / name).exists() for base in (ROOT, ROOT / "src" / "flgpr"))]
    assert not wrong


def test_every_page_is_in_a_table_of_contents():
    listed = {ROOT / "docs" / "index.md"}
    for page in PAGES:
        for kind, body in FENCE.findall(read(page)):
            if kind == "{toctree}":
                entries = [line.strip() for line in body.splitlines() if line.strip() and not line.startswith(":")]
                listed |= {page.parent / f"{entry}.md" for entry in entries}
    missing = [identify(page) for page in PAGES if page.is_relative_to(ROOT / "docs") and page not in listed]
    assert not missing, f"list these in docs/index.md: {missing}"


def resolves(name):
    """Whether a dotted name is a module or something in one."""
    parts = name.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            found = importlib.import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            if part in getattr(found, "model_fields", {}):
                return True
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_names_in_the_text_exist(page):
    text = re.sub(r"^import .*$|^from .*$", "", read(page), flags=re.MULTILINE)
    names = set(re.findall(r"`(flgpr(?:\.[A-Za-z_]\w*)+)", text))
    wrong = [name for name in sorted(names) if not resolves(name)]
    assert not wrong


def command_of(words):
    """Find the command and return it with what is left of the words."""
    found, words = typer.main.get_command(app), list(words)
    while hasattr(found, "commands"):
        if not words or words[0].startswith("-"):
            return found, words
        if words[0] not in found.commands:
            raise AssertionError(f"no command {words[0]!r} in flgpr")
        found = found.commands[words.pop(0)]
    return found, words


def commands_in(text):
    for kind, body in FENCE.findall(text):
        if kind in ("", "sh", "bash", "console"):
            lines = re.sub(r"\\\n\s*", " ", body).splitlines()
            yield from (line.strip().removeprefix("$ ") for line in lines if re.match(r"\s*(\$ )?flgpr ", line))
    yield from re.findall(r"(?<!`)`(flgpr [^`]+)`", FENCE.sub("", text).replace("``", "`").replace("\n# ", " "))


@pytest.mark.parametrize("page", [*PAGES, *EXAMPLES], ids=identify)
def test_commands_and_their_options_exist(page):
    for line in commands_in(read(page)):
        words = shlex.split(line, comments=True)[1:]
        if "…" in words[:2]:  # any of several commands
            continue
        found, rest = command_of(words)
        known = {name for one in found.params for name in (*one.opts, *one.secondary_opts)} | {"--help"}
        for word in rest:
            if word.startswith("-") and not re.fullmatch(r"-\d.*|-", word):
                assert word.split("=")[0] in known, f"{line}: no option {word}"


def rvm_page():
    rng = np.random.default_rng(0)
    X = np.concatenate([rng.normal(0, 1, (30, 2)), rng.normal(2, 1, (30, 2))])
    return {"X": X, "y": np.repeat([0, 1], 30), "mines": X[30:]}


RUN = {"imaging.md": dict, "rvm.md": rvm_page, "scoring.md": dict, "extending.md": dict}
"""Pages whose programs run here as they stand. The others' run in the examples or in tests of their own."""


def programs():
    return [(page, body) for page in PAGES for kind, body in FENCE.findall(read(page)) if kind == "python"]


@pytest.mark.parametrize(("page", "body"), programs(), ids=lambda one: identify(one) if isinstance(one, Path) else "")
def test_programs_are_valid_and_import_what_exists(page, body):
    for node in ast.walk(ast.parse(body)):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("flgpr"):
            assert all(resolves(f"{node.module}.{alias.name}") for alias in node.names), ast.unparse(node)
        elif isinstance(node, ast.Import):
            assert all(resolves(alias.name) for alias in node.names if alias.name.startswith("flgpr"))


@pytest.mark.parametrize("name", RUN)
def test_programs_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = ModuleType("program_of_the_page")  # a module, so that classes it defines can be found again
    monkeypatch.setitem(sys.modules, module.__name__, module)
    vars(module).update(RUN[name]())
    bodies = [body for page, body in programs() if page.name == name]
    assert bodies
    for body in bodies:
        exec(body, vars(module))
