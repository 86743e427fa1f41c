"""The step-by-step page of each paper names every equation, figure and table, and says how each step was taken."""

import re

import pytest

from reading import ROOT, read

pytestmark = pytest.mark.slow("checks of pages")

PRINTED = {
    # page: equations, figures, tables (Roman) of the paper
    "flsar2004": (4, 10, ()),
    "fuse2018": (8, 9, ("I", "II")),
    "wang2007": (21, 14, ("I", "II", "III", "IV")),
    "cosgrove2004": (12, 7, ()),
}
KINDS = ("exact", "a reading", "ours", "measured", "judged", "run for comparison")


def page(name):
    return read(ROOT / "docs" / "evidence" / "papers" / f"{name}-steps.md")


def tables(text):
    """Yield the head and the rows of every table."""
    for block in re.findall(r"(?:^\|.*\n)+", text, re.MULTILINE):
        rows = [
            [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            for line in block.splitlines()
        ]
        yield rows[0], rows[2:]


def numbers(text, word):
    """Collect the numbers after a word: one, several with commas, or from one to another."""
    found = set()
    for part in re.findall(rf"{word}\.? (\d+(?:(?:, | to )\d+)*)", text):
        for span in part.split(", "):
            first, _, last = span.partition(" to ")
            found |= set(range(int(first), int(last or first) + 1))
    return found


@pytest.mark.parametrize("name", PRINTED)
def test_every_equation_figure_and_table_has_its_row(name):
    equations, figures, roman = PRINTED[name]
    places = []
    drawn = []
    for head, rows in tables(page(name)):
        (drawn if head[0] == "figure" else places).extend(row[0] for row in rows)
    assert numbers("; ".join(places), "Eq") >= set(range(1, equations + 1))
    seen = "; ".join([*places, *(f"Fig {row}" for row in drawn if row[0].isdigit())])
    assert numbers(seen, "Fig") >= set(range(1, figures + 1))
    rows = [*places, *drawn]
    named = {
        number
        for row in rows
        if row.startswith("Table")
        for number in row.removeprefix("Table ").split(", ")
    }
    assert named == set(roman)


@pytest.mark.parametrize("name", PRINTED)
def test_every_step_says_its_kind_and_names_what_computes_it(name):
    steps = [row for head, rows in tables(page(name)) if "kind" in head for row in rows]
    assert len(steps) > 30
    for place, said, kind, here in steps:
        assert kind.startswith(KINDS), (place, kind)
        assert re.search(r"`|as above|\]\(", here), (place, said)
        if kind.startswith("a reading"):
            assert len(kind) > len("a reading: "), place


def test_a_page_that_leaves_something_out_is_noticed():
    text = "| where | the paper | kind | here |\n|---|---|---|---|\n| Eq. 1, 3 to 5; II | a | exact | `b` |\n"
    ((head, rows),) = tables(text)
    assert head[2] == "kind"
    assert numbers(rows[0][0], "Eq") == {1, 3, 4, 5}
