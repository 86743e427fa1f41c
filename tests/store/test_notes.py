"""Notes on what was read go to a logger, not to standard output."""

import logging

from flgpr.store.notes import LOGGER, log_note


def test_a_note_is_a_record_of_the_logger(caplog, capsys):
    with caplog.at_level(logging.INFO, LOGGER):
        log_note("a.csv: x is the column 'quer'")
    assert [(record.name, record.message) for record in caplog.records] == [
        (LOGGER, "a.csv: x is the column 'quer'")
    ]
    assert capsys.readouterr().out == ""
