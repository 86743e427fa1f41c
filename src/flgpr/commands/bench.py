"""``flgpr bench``: measure speed on this machine."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated

from typer import Option

from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    import pandas as pd


def _lines(table: pd.DataFrame, _: Arguments) -> Iterator[str]:
    """Yield the table in Markdown."""
    from flgpr.commands.imaging_speed import format_bench

    yield format_bench(table)


@command(lines=_lines, quiet=False)
def bench_imaging(
    peers: Annotated[
        bool, Option("--peers", help="Measure the installed peers beside it.")
    ] = False,
    rounds: Annotated[int, Option(help="Rounds; medians are reported.", min=1)] = 7,
    device: Annotated[str, Option(help="cpu or cuda.")] = "cpu",
) -> pd.DataFrame:
    """Time the imaging operator on one scan of sri-array.

    Returns
    -------
    pandas.DataFrame
        A row for each code and piece of work, see
        :func:`flgpr.commands.imaging_speed.bench_imaging`.
    """
    from flgpr.commands import imaging_speed

    return imaging_speed.bench_imaging(peers, rounds, device)
