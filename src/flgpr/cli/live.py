"""Commands that work scan by scan: live, feed."""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Argument, Option

from flgpr import tasks
from flgpr.cli.common import Quiet, plain_errors

if TYPE_CHECKING:
    from flgpr.tasks import LiveReport, LiveRun

Lane = Annotated[Path | None, Option(help="TOML with x_min, x_max, y_min, y_max in metres.")]
Socket = Annotated[Path | None, Option(help="Unix socket on which scans come.")]


def live(
    incoming: Annotated[
        Path | None, Argument(help="Folder that the radar writes scans into.")
    ] = None,
    recipe: Annotated[str, Option(help="Packaged recipe or TOML file.")] = "wang2007",
    model: Annotated[Path | None, Option(help="Trained classifier.")] = None,
    output: Annotated[
        Path, Option("-o", "--output", help="Folder for events, snapshot and alarms.")
    ] = Path("live-result"),
    socket: Socket = None,
    lane: Lane = None,
    anchor: Annotated[Path | None, Option(help="TOML that ties the lane to the Earth.")] = None,
    speed: Annotated[
        float | None, Option(help="Speed of the vehicle, km/h: tells what it can stop for.")
    ] = None,
    reaction: Annotated[float, Option(help="Time until the brakes hold, s.")] = 1.5,
    deceleration: Annotated[float, Option(help="Deceleration of the braking vehicle, m/s².")] = 3.0,
    front: Annotated[float, Option(help="Vehicle's foremost point ahead of the array, m.")] = 0.0,
    looks: Annotated[int, Option(help="Scans that must have seen a place before an alarm.")] = 3,
    warm_up: Annotated[
        int, Option(min=3, help="The first scan to be cleaned; those before only teach.")
    ] = 5,
    span: Annotated[
        int | None, Option(help="Scans that the background remembers; default all.")
    ] = None,
    snapshot: Annotated[int, Option(help="Scans between snapshots; 0 writes only the last.")] = 20,
    idle: Annotated[float | None, Option(help="End after so many seconds without a scan.")] = None,
    threshold: Annotated[
        float | None, Option(help="Confidence from which the page shows alarms; default all.")
    ] = None,
    worth: Annotated[
        float,
        Option(
            help="Probability of another decision from which an alarm tells to wait for one more look."
        ),
    ] = 0.1,
    fresh: Annotated[
        bool, Option("--fresh", help="Begin anew, whatever the output folder holds.")
    ] = False,
    view: Annotated[bool, Option("--view", help="Show it in the browser.")] = False,
    no_browser: Annotated[
        bool, Option("--no-browser", help="With --view: print the address only.")
    ] = False,
    quiet: Quiet = False,
) -> None:
    """Raise alarms while scans come in: JSON lines on the output, a summary on the error stream."""
    with plain_errors(quiet):
        vehicle = tasks.Vehicle(
            None if speed is None else speed / 3.6, reaction, deceleration, front
        )
        options = tasks.LiveOptions(
            recipe, output, incoming, socket, model, lane, anchor, tasks.LiveSettings(looks, warm_up, span), vehicle,
            snapshot, idle, threshold, fresh, worth,
        )  # fmt: skip
        run = tasks.LiveRun(options, (lambda _: None) if quiet else _print)
        with _viewer(output, no_browser) if view else contextlib.nullcontext() as page:
            with tasks.compiled_beside(), _stopped_by_signals(run):
                report = run.run()
            if not quiet:
                _tell(report, output)
            if page is not None:
                _wait(page)


def feed(
    run: Annotated[Path, Argument(help="Run store.")],
    incoming: Annotated[Path | None, Argument(help="Folder to write scans into.")] = None,
    rate: Annotated[float, Option(help="Scans per second; 0 plays as fast as it can.")] = 4.2,
    socket: Socket = None,
    first: Annotated[int, Option(help="First scan.")] = 0,
    count: Annotated[int | None, Option(help="Number of scans; default all.")] = None,
    lead: Annotated[
        float, Option(help="Time between the run's description and its first scan, s.")
    ] = 2.0,
    fault: Annotated[
        list[str] | None,
        Option(help="Rehearse a fault: lost, late, twice, nan or jump, as lost:40:13; may repeat."),
    ] = None,
    quiet: Quiet = False,
) -> None:
    """Play a stored run as the radar would write it."""
    with plain_errors(quiet):
        played = tasks.feed(
            run,
            incoming,
            rate if rate != 0 else math.inf,
            socket,
            first,
            count,
            lead,
            faults=fault or [],
        )
    if not quiet:
        typer.echo(f"played {played} scans")


def _print(line: str) -> None:
    sys.stdout.write(line)
    sys.stdout.flush()


def _tell(report: LiveReport, output: Path) -> None:
    told = asdict(report)
    latency = told["latency_ms"]
    if latency["scans"]:
        typer.echo(
            f"{report.alarms} alarms; {latency['median']:g} ms from scan to alarms (median), {latency['p95']:g} ms at "
            f"the 95th percentile, {latency['largest']:g} ms at most; {report.rate:.2f} scans/s",
            err=True,
        )
    for name, count in report.counts.items():
        if count:
            typer.echo(f"  {count:6d} {tasks.COUNTS[name]}", err=True)
    typer.echo(f"wrote {output}", err=True)


@contextlib.contextmanager
def _stopped_by_signals(run: LiveRun) -> Iterator[None]:
    """Let the scan in hand be finished and the last snapshot be written."""
    before = {
        number: signal.signal(number, lambda *_: run.stop())
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def _viewer(output: Path, no_browser: bool) -> Iterator[subprocess.Popen[bytes]]:
    """Run the viewer in a process of its own: all it shares with detection is the file of events."""
    command = [sys.executable, "-m", "flgpr", "view", "--live", str(output)] + [
        "--no-browser"
    ] * no_browser
    with subprocess.Popen(command, stdout=sys.stderr.fileno(), start_new_session=True) as page:  # noqa: S603
        before = signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        try:
            yield page
        finally:
            signal.signal(signal.SIGTERM, before)
            page.terminate()


def _wait(page: subprocess.Popen[bytes]) -> None:
    typer.echo("the page stays open until interrupted", err=True)
    with contextlib.suppress(KeyboardInterrupt):
        page.wait()
