"""``flgpr demo``: process the packaged lane."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Option

from flgpr.commands.options import Output, Overwrite, Progress
from flgpr.commands.score_words import score_lines, score_summary
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.results.result import Result
    from flgpr.scoring import Score

VIEW = Annotated[bool, Option("--view", help="Open the result in the browser.")]


def _lines(returned: tuple[Result, list[Score]], _: Arguments) -> Iterator[Any]:
    result, scores = returned
    yield from score_lines(scores)
    yield f"report: {(result.folder / 'report.html').resolve()}"


def _as_json(returned: tuple[Result, list[Score]], _: Arguments) -> dict[str, Any]:
    result, scores = returned
    return score_summary(result.folder, scores)


@contextmanager
def _page(call: Arguments) -> Iterator[None]:
    """Show the result in the browser when it is made."""
    yield
    if call.view:
        import typer

        from flgpr import viewer
        from flgpr.commands.exporting import map_bytes

        viewer.serve(Path(call.output), announce=typer.echo, make_map=map_bytes)


@command(lines=_lines, as_json=_as_json, around=_page, extra={"view": (VIEW, False)}, compiles=True)
def demo(
    output: Output = "demo-result", overwrite: Overwrite = True, *, track: Progress = None
) -> tuple[Result, list[Score]]:
    """Process the packaged lane: image, detect, score, report.

    Returns
    -------
    result, scores
        The result folder, read, and a score for each of its detections.

    Raises
    ------
    FileExistsError
        If something that is no result lies at the output, or another result that is not to be
        overwritten.
    """
    from flgpr.chain.progress import silent
    from flgpr.commands.detect import detect
    from flgpr.commands.scoring import score_result
    from flgpr.store import sample_lane

    lane = sample_lane()
    detect(
        lane / "run.zarr",
        "demo",
        output,
        section=math.inf,
        overwrite=overwrite,
        report=False,  # scoring writes the report
        track=track,
    )
    return score_result(
        output,
        lane / "truth.csv",
        lane / "objects.csv",
        track=track or silent,
        overwrite=overwrite,
    )
