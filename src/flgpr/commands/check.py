"""``flgpr check``: say whether a recording is right, before anybody detects on it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from flgpr.commands.options import LaneOption, RunArgument
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.health.checking import Checked


def _lines(checked: Checked, _: Arguments) -> Iterator[Any]:
    """Yield the answer, then everything that was asked, what is wrong first."""
    from rich.table import Table

    yield checked.answer
    yield ""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    for width in (14, 22):
        table.add_column(min_width=width, max_width=width)
    table.add_column()
    for one in checked.checks:
        table.add_row(one.verdict, one.what, one.sentence)
    yield table


@command(
    lines=_lines,
    as_json=True,
    status=lambda checked: 1 if checked.verdict == "wrong" else 0,
    quiet=False,
)
def check(
    run: RunArgument,
    lane: LaneOption = None,
) -> Checked:
    """Say whether a recording is right; exit status 1 if something is wrong.

    Tried is which sign of phase, orders of tones and pairs, heading, lag of poses, height and units
    make the looks of consecutive scans agree best. Channels, tones, scans and positions are judged
    as `flgpr detect` judges them.

    Parameters
    ----------
    lane
        with it the course is checked, too

    Returns
    -------
    Checked
        ``answer``, one sentence; ``verdict``; and ``checks``, everything that was asked.

    Raises
    ------
    ValueError
        If the run cannot be read.
    """
    from flgpr.commands.run_report import geometry_doubts
    from flgpr.health.checking import check_run
    from flgpr.model.motion import judge_run
    from flgpr.store import open_run, read_lane
    from flgpr.store.lane_file import lane_file_of

    stored = open_run(run)
    beside = lane_file_of(run)
    known = lane or (beside if beside.is_file() else None)
    borders = None if known is None else read_lane(known)
    return check_run(stored, borders, geometry_doubts(stored) + judge_run(stored).notes())
