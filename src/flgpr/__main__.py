"""Run the command line: the console script and ``python -m flgpr``."""

from __future__ import annotations

import sys


def main() -> None:
    """Run the command line; ``view``, which stays open for hours, without all that it does not need."""
    if sys.argv[1:2] == ["view"]:
        from flgpr.viewer.command import app
    else:
        from flgpr.cli import app
    app()


if __name__ == "__main__":
    main()
