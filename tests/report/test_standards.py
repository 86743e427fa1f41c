"""The checklist cites what was read, and the docs hold it item by item."""

from pathlib import Path

from flgpr.report import kit

PAGE = Path(__file__).parents[2] / "docs" / "guide" / "test-standards.md"
CHECKLIST = kit._environment("flgpr.report").get_template("checklist.html").module


def test_items_cite_sources_that_say_what_was_read():
    keys = {key for key, _, _ in CHECKLIST.sources}
    for topic, _, cited, _, _ in CHECKLIST.items:
        assert cited, topic
        assert set(cited.split("; ")) <= keys, topic
    assert all(read for _, _, read in CHECKLIST.sources)
    # Its clauses could not be read, so nothing may be said to follow from it.
    assert not [topic for topic, _, cited, _, _ in CHECKLIST.items if "IMAS 03.40" in cited]


def test_some_is_covered_and_some_is_not():
    assert {covered for _, _, _, covered, _ in CHECKLIST.items} == {"yes", "partly", "no"}


def test_the_page_of_the_docs_has_the_same_tables():
    text = PAGE.read_text(encoding="utf-8")
    for row in [*CHECKLIST.items, *CHECKLIST.sources]:
        assert "| " + " | ".join(row) + " |" in text, row[0]
