"""Run the command line: the console script and ``python -m flgpr``."""

from __future__ import annotations

from flgpr.cli import app


def main() -> None:
    """Run the command line."""
    app()


if __name__ == "__main__":
    main()
