"""``flgpr view``: show results in the browser."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from typer import Argument, Option

from flgpr.commands.exports import map_bytes
from flgpr.commands.messages import say
from flgpr.commands.options import AnchorOption, PathLike, Paths
from flgpr.commands.shell import command


@command(
    quiet=False,
)
def view(
    paths: Annotated[Paths | None, Argument()] = None,
    port: Annotated[int, Option(min=0, max=65535)] = 0,
    host: str = "127.0.0.1",
    allow_remote: bool = False,
    no_browser: bool = False,
    live: PathLike | None = None,
    answers: bool = False,
    anchor: AnchorOption = None,
    backdrop: Annotated[PathLike | None, Option("--map")] = None,
    verdicts: PathLike | None = None,
) -> None:
    """Show results in the browser, on this machine.

    Nothing is written, except with --verdicts and --answers.

    Parameters
    ----------
    paths
        Result, run, recording or score; two results or two scores are compared; none with
        --live.

    What is shown
    -------------
    live
        JSON lines of a live detection to follow.
    answers
        With --live: keep what the driver answers to alarms in its folder.
    anchor
    backdrop
        Map or photograph below the lane: GeoTIFF, MBTiles, GeoPackage.
    verdicts
        JSON beside the result that keeps an analyst's verdicts and notes.

    Server
    ------
    port
        Port; 0 takes a free one.
    host
        Address to listen on.
    allow_remote
        Let other machines see it.
    no_browser
        Print the address only.

    Raises
    ------
    ValueError
        If the paths name nothing that can be shown, or an option breaks its rule.

    Notes
    -----
    The page is served until the command is interrupted. In a notebook
    :func:`flgpr.notebook.view` shows it.
    """
    from flgpr import viewer

    viewer.serve(
        [Path(path) for path in paths or ()],
        host,
        port,
        not no_browser,
        allow_remote,
        live,
        None,
        anchor,
        say,
        raw=_raw_run,
        backdrop=backdrop,
        verdicts=verdicts,
        make_map=map_bytes,
        answers=answers,
    )


# The numerical modules take seconds to load; many pages never ask for them.
def _raw_run(path: Path) -> Any:
    """Return the raw data of a run for a page."""
    from flgpr.commands.raw_run import RawRun

    return RawRun(path)
