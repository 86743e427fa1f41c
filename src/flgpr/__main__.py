"""Run the command line with ``python -m flgpr``."""

from flgpr.cli import app

app()
