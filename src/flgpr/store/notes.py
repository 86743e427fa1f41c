"""Notes on what was read, as records of a logger.

The program that uses flgpr decides where they are shown; the command line prints them.
"""

from __future__ import annotations

import logging

LOGGER = "flgpr.notes"


def log_note(text: str) -> None:
    """Log a line on what was found, replaced or assumed while a file was read."""
    logging.getLogger(LOGGER).info(text)
