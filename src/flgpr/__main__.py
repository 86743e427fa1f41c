"""Run the command line: the console script and ``python -m flgpr``."""

from __future__ import annotations

import sys

from flgpr.commands.app import app


def main() -> None:
    """Run the command line."""
    if not any(argument.startswith("--scheduler") for argument in sys.argv):
        # Else xarray loads Dask, where it is installed, as soon as it sees an array, and that takes
        # as long as it does.
        sys.modules["dask"] = None  # type: ignore[assignment]
    app()


if __name__ == "__main__":
    main()
