"""The guide is short and by task: no page is long, none is a wall of numbers, and the first page leads to each."""

import itertools
import re

import pytest

from reading import FENCE, PAGES, ROOT, identify, read, shell_fences

pytestmark = pytest.mark.slow("checks of pages")

DOCS = ROOT / "docs"
FIRST = DOCS / "index.md"
GUIDE = [page for page in PAGES if page.parent == DOCS / "guide"]
LONGEST_PAGE = 2000
LONGEST_LINE = {"guide": 120, "reference": 120, "evidence": 200}
EXAMPLE_ROWS = 4
"""A table of at most so many rows is an example of what a command prints."""

NUMBER = re.compile(r"[-+]?\d[\d.,/]*( ?%| [a-zA-Z²/]{1,5})?")


def tables(text):
    """Cells of the rows of every table, without its head."""
    for block in re.findall(r"(?:^\|.*\n)+", FENCE.sub("", text), re.MULTILINE):
        rows = [re.split(r"(?<!\\)\|", line)[1:-1] for line in block.splitlines()]
        yield [[cell.strip() for cell in row] for row in rows[2:]]


def share_of_numbers(rows):
    cells = [cell for row in rows for cell in row if cell]
    numbers = [cell for cell in cells if NUMBER.fullmatch(cell)]
    return len(numbers) / max(len(cells), 1)


@pytest.mark.parametrize("page", [FIRST, *GUIDE], ids=identify)
def test_no_page_of_the_guide_is_long(page):
    assert len(read(page).split()) <= LONGEST_PAGE


@pytest.mark.parametrize("page", [FIRST, *GUIDE], ids=identify)
def test_tables_of_figures_stand_in_the_evidence(page):
    for rows in tables(read(page)):
        assert len(rows) <= EXAMPLE_ROWS or share_of_numbers(rows) < 0.5, rows[0]


def test_a_wall_of_numbers_is_noticed():
    text = "| a | b |\n|---|---|\n" + "| metal | 0.5 | 12 dB |\n" * 5
    ((*rows,),) = tables(text)
    assert share_of_numbers(rows) > 0.5
    assert share_of_numbers([["`--gain`", "a step"], ["limit", "5 s"]]) < 0.5


def test_the_first_page_installs_shows_three_pictures_and_leads_to_every_task():
    text = read(FIRST)
    assert any("make demo" in line for fence in shell_fences(FIRST) for line in fence)
    assert len(re.findall(r"!\[[^\]]*\]\(images/", text)) == 3
    tasks = set(re.findall(r"\]\(guide/([\w-]+)\.md", text))
    assert {page.stem for page in GUIDE} == tasks


@pytest.mark.parametrize("book", ["evidence", "reference"])
def test_the_first_page_of_a_book_leads_to_its_pages(book):
    text = read(DOCS / book / "index.md")
    listed = {target.partition("#")[0] for target in re.findall(r"\]\(([^)]+\.md)", text)}
    pages = {
        str(page.relative_to(DOCS / book))
        for page in PAGES
        if page.is_relative_to(DOCS / book) and page.parent.name not in ("theory", "api")
    }
    assert pages - {"index.md"} <= listed


@pytest.mark.parametrize(
    "page", [page for page in PAGES if page.is_relative_to(DOCS)], ids=identify
)
def test_lines_of_a_page_are_short(page):
    longest = LONGEST_LINE.get(page.relative_to(DOCS).parts[0], 120)
    prose = FENCE.sub("", read(page)).splitlines()
    assert not [line for line in prose if len(line) > longest and not line.startswith("|")]


def header_rows(page):
    """Yield the first row of every table of a page."""
    lines = FENCE.sub("", read(page)).splitlines()
    for row, rule in itertools.pairwise(lines):
        is_rule = re.fullmatch(r"\s*\|[\s:|-]*-[\s:|-]*\|\s*", rule)
        if is_rule and row.lstrip().startswith("|"):
            yield row


@pytest.mark.parametrize("page", PAGES, ids=identify)
def test_every_column_of_a_table_has_a_header(page):
    """Who hears a page read aloud is told a cell's column by its header."""
    for row in header_rows(page):
        cells = row.strip().strip("|").split("|")
        assert all(cell.strip() for cell in cells), row
