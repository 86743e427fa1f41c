"""The papers step by step: every row says what kind it is, and names something that exists."""

import re

import pytest
from test_docs_pages import resolves

from flgpr.model import sensor_presets
from reading import PAGES, ROOT, identify, read

pytestmark = pytest.mark.slow("checks of pages")

STEPS = [page for page in PAGES if page.name.endswith("-steps.md")]
FUSE = ROOT / "docs" / "evidence" / "papers" / "fuse2018-steps.md"
HEAD = ["where", "the paper", "kind", "here"]
KINDS = ("exact", "a reading", "ours", "judged", "measured", "run for comparison")


def rows(page):
    """Rows of the tables of a page that say of every step of what kind it is, as lists of cells."""
    inside = False
    found = []
    for line in read(page).splitlines():
        cells = (
            [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
            if line.startswith("|")
            else []
        )
        if cells == HEAD:
            inside = True
        elif not cells:
            inside = False
        elif inside and set(cells[0]) != {"-"}:
            found.append(cells)
    return found


@pytest.mark.parametrize("page", STEPS, ids=identify)
def test_every_step_of_a_paper_has_a_kind_and_a_place(page):
    steps = rows(page)
    assert len(steps) > 20
    for cells in steps:
        assert len(cells) == 4, cells
        where, says, kind, here = cells
        assert where, cells
        assert says, cells
        assert here, cells
        assert kind.startswith(KINDS), cells
        assert "missing" not in kind, cells


@pytest.mark.parametrize("page", STEPS, ids=identify)
def test_the_names_in_a_papers_steps_exist(page):
    """Those of the studies, too, which the pages do not link."""
    names = set(re.findall(r"`(flgpr(?:_papers)?(?:\.[A-Za-z_]\w*)+)", read(page)))
    assert not [name for name in sorted(names) if not resolves(name)]
    presets = set(re.findall(r"preset `([\w-]+)`", read(page)))
    assert presets <= set(sensor_presets())


def test_all_figures_tables_and_equations_of_fuse2018_are_there():
    text = " ".join(" ".join(cells) for cells in rows(FUSE))
    for number in range(1, 9):
        assert re.search(rf"Eq\. (\d, )*{number}\b", text), f"Eq. {number}"
    shown = text.replace("Fig. 3 to 5", "Fig. 3, Fig. 4, Fig. 5")
    assert all(f"Fig. {number}" in shown for number in range(1, 10))
    assert "Table I " in f"{text} ".replace("Table I|", "Table I ")
    assert "Table II" in text
