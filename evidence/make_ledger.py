"""Write the ledger of features: what each costs, and whom it serves.

A feature is a command, a stage of recipes, a format, an export, an estimator or an extra. Its own
tokens are those of the modules that nothing but it needs: they would go with it. ::

    python evidence/make_ledger.py [--times RESULTS.xml]

``ledger.toml`` beside the page says whom a feature serves. RESULTS.xml is what ``pytest --junitxml`` wrote: the seconds
of the tests of a feature's own modules are taken from it. Without it they stay as they are in the
page.
"""

import argparse
import ast
import io
import re
import tokenize
import tomllib
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path

from flgpr.commands.app import COMMANDS
from flgpr.stages.named import PACKAGED

ROOT = Path(__file__).parent.parent
SOURCES = ROOT / "src"
PAGE = ROOT / "docs" / "reference" / "ledger.md"
DECLARED = PAGE.with_name("ledger.toml")
_NO_CODE = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip
_GROUPS = {"flgpr.formats": "format", "flgpr.exports": "export", "flgpr.estimators": "estimators"}


@dataclass
class Feature:
    """A row of the ledger."""

    kind: str  #: "command", "stage", "format", "export", "estimators" or "extra"
    name: str
    roots: set[str]  #: modules that it begins with
    user: str = ""  #: whom it serves
    own: set[str] = field(default_factory=set)  #: modules that nothing else needs

    @property
    def family(self) -> str:
        """What goes with it: the commands of a first word, or import, format and export of a kind."""
        words = self.name.split()
        return words[-1] if words[0] == "import" else words[0]


def code_tokens(path: Path) -> int:
    """Count the tokens of a file without comments, docstrings and layout."""
    source = path.read_text(encoding="utf-8")
    documented = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body else None
            if isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant):
                documented.update(range(first.lineno, first.end_lineno + 1))
    count = 0
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        count += token.type not in _NO_CODE and token.start[0] not in documented
    return count


def modules() -> dict[str, Path]:
    """Return the files of all modules by their dotted names."""
    found = {}
    for path in sorted(SOURCES.rglob("*.py")):
        parts = path.relative_to(SOURCES).with_suffix("").parts
        found[".".join(part for part in parts if part != "__init__")] = path
    return found


def imports(path: Path, known: dict[str, Path], faces: dict[str, dict[str, str]]) -> set[str]:
    """Return the modules that a module imports, a face's name as the module that has it."""
    used = set()
    as_face = {}  # packages with a stub by the names that they have here
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    for node in nodes:
        if isinstance(node, ast.Import):
            used |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                submodule = f"{node.module}.{alias.name}"
                home = faces.get(node.module, {}).get(alias.name, node.module)
                used.add(submodule if submodule in known else home)
                if submodule in faces:
                    as_face[alias.asname or alias.name] = faces[submodule]
    for node in nodes:
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            used.add(as_face.get(node.value.id, {}).get(node.attr, ""))
    return used & known.keys()


def face_names() -> dict[str, dict[str, str]]:
    """Return the modules that have the names of every package with a stub."""
    faces: dict[str, dict[str, str]] = {}
    for stub in SOURCES.rglob("__init__.pyi"):
        package = ".".join(stub.parent.relative_to(SOURCES).parts)
        names = faces.setdefault(package, {})
        for node in ast.parse(stub.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom) and node.module:
                for alias in node.names:
                    names[alias.asname or alias.name] = node.module
    return faces


def reached(roots: Iterable[str], uses: dict[str, set[str]]) -> set[str]:
    """Return the modules that modules need, themselves among them."""
    seen: set[str] = set()
    left = [name for name in roots if name in uses]
    while left:
        name = left.pop()
        if name not in seen:
            seen.add(name)
            left += uses[name]
    return seen


def features(declared: dict) -> list[Feature]:
    """Return every command, stage, format, export, estimator and extra."""
    rows = []
    for words, function in COMMANDS.items():
        rows.append(Feature("command", words, {function.__module__}))
    for kind, stages in PACKAGED.items():
        for name, value in stages.items():
            rows.append(Feature("stage", f"{kind}.{name}", {f"flgpr.stages.{value.split(':')[0]}"}))
    for offer in sorted(entry_points(group="flgpr.stages"), key=lambda one: one.name):
        rows.append(Feature("stage", offer.name, {offer.module}))
    for group, kind in _GROUPS.items():
        for offer in sorted(entry_points(group=group), key=lambda one: one.name):
            rows.append(Feature(kind, offer.name, {offer.module}))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for name in project["optional-dependencies"]:
        rows.append(Feature("extra", name, set()))
    for row in rows:
        row.user = declared.get(row.kind, {}).get(row.name, "")
    return rows


def fill_in_own(rows: list[Feature], uses: dict[str, set[str]], shared: set[str]) -> None:
    """Find the modules of every feature that no other family, and nothing shared, needs."""
    by_roots = {id(row): reached(row.roots, uses) for row in rows}
    for row in rows:
        needed_by_others = reached(shared - row.roots, uses)
        for other in rows:
            # What begins in the same module goes together, too.
            if other.family != row.family and not (other.roots & row.roots):
                needed_by_others |= by_roots[id(other)]
        row.own = by_roots[id(row)] - needed_by_others


def test_seconds(results: Path) -> dict[str, float]:
    """Return the seconds of the tests by the stem of their file, such as "test_info"."""
    seconds: dict[str, float] = {}
    for case in ET.parse(results).getroot().iter("testcase"):
        stem = next((part for part in case.get("classname", "").split(".") if "test_" in part), "")
        seconds[stem] = seconds.get(stem, 0.0) + float(case.get("time", 0))
    return seconds


def kept_seconds() -> dict[tuple[str, str], str]:
    """Return the seconds that the page states, by kind and name."""
    kept = {}
    if PAGE.is_file():
        for line in PAGE.read_text(encoding="utf-8").splitlines():
            cells = [cell.strip() for cell in line.strip("|").split("|")]
            if len(cells) == 5:
                kept |= {(cells[0], name): cells[4] for name in re.findall("`([^`]+)`", cells[1])}
    return kept


def table(rows: list[Feature], tokens: dict[str, int], times: dict[str, float] | None) -> list[str]:
    """Return the rows of the page; features that have all else in common share one."""
    kept = kept_seconds()
    names: dict[tuple[str, str, int | str, str], list[str]] = {}
    lines = [
        "| kind | feature | user | own code tokens | test seconds |",
        "|---|---|---|---:|---:|",
    ]
    for row in rows:
        own = sum(tokens[name] for name in row.own)
        seconds = kept.get((row.kind, row.name), "")
        if times is not None:
            stems = {f"test_{name.rsplit('.', 1)[-1]}" for name in row.own}
            seconds = f"{sum(times.get(stem, 0.0) for stem in stems):.1f}"
        names.setdefault((row.kind, row.user, own or "", seconds), []).append(f"`{row.name}`")
    for (kind, user, own_tokens, seconds), alike in names.items():
        lines.append(f"| {kind} | {', '.join(alike)} | {user} | {own_tokens} | {seconds} |")
    return lines


def main() -> None:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--times", type=Path, help="what pytest --junitxml wrote")
    given = parser.parse_args()
    declared = tomllib.loads(DECLARED.read_text(encoding="utf-8"))
    known = modules()
    faces = face_names()
    uses = {name: imports(path, known, faces) for name, path in known.items()}
    tokens = {name: code_tokens(path) for name, path in known.items()}
    # The table of commands imports them all, and a face its names: neither needs them.
    for name in declared["tables"]["modules"]:
        uses[name] = set()
    rows = features(declared)
    fill_in_own(rows, uses, set(declared["shared"]["modules"]))
    times = None if given.times is None else test_seconds(given.times)
    own = set().union(*(row.own for row in rows))
    totals = {}
    for name, count in tokens.items():
        package = name.split(".")[0]
        totals[package] = totals.get(package, 0) + count
    by_package = ", ".join(f"`{name}` {count / 1000:.0f}k" for name, count in totals.items())
    text = PAGE.read_text(encoding="utf-8")
    head = text[: text.index("<!-- table -->")]
    head = re.sub(
        r"Of .*? alone\.\n",
        f"Of {sum(tokens.values()) / 1000:.0f}k code tokens\n({by_package})\n"
        f"{sum(tokens[name] for name in own) / 1000:.0f}k belong to one feature alone.\n",
        head,
        count=1,
        flags=re.DOTALL,
    )
    lines = table(rows, tokens, times)
    PAGE.write_text(head + "<!-- table -->\n\n" + "\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
