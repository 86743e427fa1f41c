"""The checklist cites what was read, and names commands that there are."""

import re

import typer

from alone import needs
from flgpr.commands.app import app
from flgpr.report import kit

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


@needs("flgpr_trials")
def test_commands_that_items_name_exist():
    words = typer.main.get_command(app).commands
    for topic, _, _, _, where in CHECKLIST.items:
        for first, second in re.findall(r"flgpr (\w+) (\w+)", where):
            assert first in words, topic
            group = getattr(words[first], "commands", None)
            assert group is None or second in group, topic
