"""Notes on what was read: whoever starts the program says where they are shown."""

from __future__ import annotations

import logging

LOGGER = "flgpr.notes"


def tell_note(text: str) -> None:
    """Tell in a line what was found, replaced or assumed on reading; the command line prints it."""
    logging.getLogger(LOGGER).info(text)
