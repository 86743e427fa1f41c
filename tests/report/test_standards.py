"""The checklist cites what was read, and the docs hold it item by item."""

from pathlib import Path

from flgpr.report.standards import ITEMS, SOURCES, checklist_rows, source_rows

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "test-standards.md"


def test_items_cite_sources_that_say_what_was_read():
    keys = {source.key for source in SOURCES}
    for item in ITEMS:
        assert item.sources, item.topic
        assert set(item.sources) <= keys, item.topic
    assert all(source.read for source in SOURCES)
    # Its clauses could not be read, so nothing may be said to follow from it.
    assert not [item.topic for item in ITEMS if "IMAS 03.40" in item.sources]


def test_some_is_covered_and_some_is_not():
    assert {item.covered for item in ITEMS} == {"yes", "partly", "no"}


def test_the_page_of_the_docs_has_the_same_tables():
    text = PAGE.read_text(encoding="utf-8")
    for row in [*checklist_rows(), *source_rows()]:
        assert "| " + " | ".join(row) + " |" in text, row[0]
