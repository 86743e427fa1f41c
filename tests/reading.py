"""The pages as the tests read them: fences, files that they show, lines for the shell."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    p for p in (ROOT / "docs").rglob("*.md") if not {"_build", "examples"} & set(p.parts)
)
PAGES += [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
EXAMPLES = sorted((ROOT / "docs" / "gallery").glob("plot_*.py"))
FENCE = re.compile(r"^```([^\n]*)\n(.*?)^```", re.DOTALL | re.MULTILINE)
SHELL = ("", "sh", "bash", "console")


def identify(path):
    return str(path.relative_to(ROOT))


def read(page):
    return page.read_text(encoding="utf-8")


def shell_lines(body):
    """Commands of a fence: continued lines joined, comments left out."""
    joined = re.sub(r"\\\n\s*", " ", body)
    return [
        line.strip().removeprefix("$ ")
        for line in joined.splitlines()
        if line.strip() and line.strip()[0] != "#"
    ]


def shell_fences(page):
    """Fences that hold commands, as lists of lines; a fence without language may be a drawing or a formula."""
    for kind, body in FENCE.findall(read(page)):
        lines = shell_lines(body)
        if kind in SHELL and lines and re.match(r"[\w.~-]+( |$)", lines[0]) and "─" not in body:
            yield lines


def program_lines(example):
    """Commands that an example's text shows in literal blocks."""
    for line in read(example).splitlines():
        found = re.match(r"(?:#     |    )((?:flgpr|dask) .*)$", line)
        if found:
            yield found[1]


def file_shown(text, start):
    """Name of the file that a fence shows: the last one that the paragraph before it names."""
    paragraph = text[:start].rstrip().rsplit("\n\n", 1)[-1]
    named = re.findall(r"`([\w-]+\.(?:toml|csv))`", paragraph)
    return named[-1] if named else None
