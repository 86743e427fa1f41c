"""Time the imaging operator on one scan of ``sri-array``, beside other codes and the machine's limits.

``make bench ARGS="--peers"``, or ``python benchmarks/imaging_speed [--peers] [--rounds 7] [--device
cuda]``, prints a table in Markdown.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from imaging_speed.speed import bench_imaging, format_bench


def main(arguments: list[str] | None = None) -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--peers", action="store_true", help="measure the installed peers beside it"
    )
    parser.add_argument("--rounds", type=int, default=7, help="rounds; medians are reported")
    parser.add_argument("--device", choices=("cpu", "cuda"), default="cpu")
    given = parser.parse_args(arguments)
    try:
        table = bench_imaging(given.peers, given.rounds, given.device)
    except ValueError as error:
        parser.error(str(error))
    print(format_bench(table))


if __name__ == "__main__":
    main()
