"""``flgpr live`` raises alarms while scans come in; ``flgpr feed`` plays a stored run."""

from __future__ import annotations

import contextlib
import math
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from typer import Argument, Option

from flgpr.commands.messages import say
from flgpr.commands.options import (
    OVERWRITE_HELP,
    AnchorOption,
    LaneOption,
    Output,
    PathLike,
    Paths,
    one_or_more,
)
from flgpr.commands.shell import Arguments, ErrorStreamText, command

if TYPE_CHECKING:
    from flgpr.live.options import LiveOptions, LiveReport
    from flgpr.live.session import LiveRun

Socket = Annotated[PathLike | None, "Unix socket that scans arrive on."]
Tcp = Annotated[
    str | None,
    "TCP port of this machine that scans arrive on, or ADDRESS:PORT.",
]
SecretFile = Annotated[
    PathLike | None,
    "With --tcp: file of a secret that sender and receiver share.",
]


def _summary_lines(report: LiveReport, call: Arguments) -> Iterator[ErrorStreamText]:
    """Yield latency and rate, then how many scans were treated in each way."""
    from flgpr.live.intake import COUNTS

    latency = asdict(report)["latency_ms"]
    if latency["scans"]:
        yield ErrorStreamText(
            f"{report.alarms} alarms; {latency['median']:g} ms from scan to alarms (median), "
            f"{latency['p95']:g} ms at the 95th percentile, {latency['largest']:g} ms at most; "
            f"{report.rate:.2f} scans/s"
        )
    for name, count in report.counts.items():
        if count:
            yield ErrorStreamText(f"  {count:6d} {COUNTS[name]}")
    yield ErrorStreamText(f"wrote {call.output}")


def _nothing_came(options: LiveOptions) -> str:
    """Return in words that no scan came from where they should."""
    sources = [str(one) for one in (options.incoming, options.socket, options.tcp) if one]
    there = ""
    if options.incoming is not None and not Path(options.incoming).exists():
        there = ", which does not exist"
    came = f"no scan came from {' or '.join(sources)}{there}"
    return f"{came}: `flgpr.feed` plays a run into a folder or to a socket"


@contextlib.contextmanager
def _page(call: Arguments) -> Iterator[None]:
    """Show the detection in the browser while it runs, and until the page is closed.

    The viewer is a process of its own: all it shares with the detection is the file of events.
    """
    if not call.view:
        if call.no_browser:
            raise ValueError("--no-browser goes with --view, got it alone")
        yield
        return
    command = [sys.executable, "-m", "flgpr", "view", "--live", str(call.output), "--answers"]
    if call.no_browser:
        command.append("--no-browser")
    # In a session of its own an interrupt on the terminal reaches the detection alone.
    with subprocess.Popen(command, stdout=sys.stderr.fileno(), start_new_session=True) as page:  # noqa: S603
        # In good order, so that ``finally`` is run.
        previous_handler = signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
        try:
            yield
            say("the page stays open until interrupted", err=True)
            with contextlib.suppress(KeyboardInterrupt):
                page.wait()
        finally:
            signal.signal(signal.SIGTERM, previous_handler)
            page.terminate()


@contextlib.contextmanager
def _stopped_by_signals(run: LiveRun) -> Iterator[threading.Event]:
    """On an interrupt finish the scan in hand and write the last snapshot; a second one ends it.

    Yields whether it was asked to.
    """
    is_asked = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield is_asked  # Python delivers signals to the main thread alone
        return

    def stop(*_: Any) -> None:
        """Let the run end; asked again, even while it builds its detector, it ends at once."""
        if is_asked.is_set():
            raise KeyboardInterrupt
        is_asked.set()
        run.stop()

    previous_handlers = {}
    for number in (signal.SIGINT, signal.SIGTERM):
        previous_handlers[number] = signal.signal(number, stop)
    try:
        yield is_asked
    finally:
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


def _print_event(line: str) -> None:
    """Print a line of JSON at once, for programs that read along."""
    sys.stdout.write(line)
    sys.stdout.flush()


@command(
    lines=_summary_lines,
    context=_page,
    shell_flags={
        "view": "Show it in the browser.",
        "no_browser": "With --view: print the address only.",
    },
    python_values=lambda call: {} if call.quiet else {"emit": _print_event},
    panels={"Page": ("view", "no_browser")},
    compiles_kernels=True,
)
def live(
    incoming: Annotated[PathLike | None, Argument()] = None,
    recipe: str | None = None,
    model: PathLike | None = None,
    output: Output = "live-result",
    socket: Socket = None,
    tcp: Tcp = None,
    secret_file: SecretFile = None,
    lane: LaneOption = None,
    anchor: AnchorOption = None,
    speed: float | None = None,
    reaction: float | None = None,
    deceleration: float | None = None,
    front: float | None = None,
    looks: int = 3,
    warm_up: Annotated[int, Option(min=3)] = 5,
    span: int | None = None,
    snapshot: int = 20,
    idle: float | None = None,
    threshold: float | None = None,
    rate: float | None = None,
    worth: float = 0.1,
    mcap: bool = False,
    before: Paths | None = None,
    fresh: Annotated[bool, Option("--overwrite", "--fresh", help=OVERWRITE_HELP)] = False,
    *,
    emit: Callable[[str], Any] | None = None,
) -> LiveReport:
    """Raise alarms while scans come in.

    Events are printed as lines of JSON, a summary on the error stream.

    Parameters
    ----------
    snapshot
        Scans between snapshots; 0 writes only the last.
    idle
        End after this time without a scan, s.
    mcap
        At the end write live.mcap, which Foxglove plays.
    emit
        Takes every event, a line of JSON; none by default.
    incoming
        Folder that the radar writes scans into, or a recording (.mcap) to play.
    output
        folder of events, snapshot and alarms

    Where scans come from
    ---------------------
    socket
    tcp
    secret_file
    rate
        Recording: scans per second, 0 as fast as it can; default as recorded.

    Recipe and lane
    ---------------
    recipe
        Packaged recipe or TOML file; else one is made for the run.
    model
        Trained classifier.
    lane
    anchor
    before
        Earlier run of the same road; may repeat. What they predict is subtracted: what has changed
        stands out.

    Detection
    ---------
    looks
        Scans that must have seen a point before an alarm.
    warm_up
        The first scan to be cleaned; earlier ones only train the background.
    span
        Scans that the background is estimated from; all by default.
    worth
        Probability of another decision from which an alarm advises one more look.

    Vehicle
    -------
    speed
        Speed of the vehicle, km/h: alarms then state whether it can stop.
    threshold
        Confidence from which an alarm counts; default the recipe's, else all.
    reaction
        Time until the brakes hold, s; default the recipe's.
    deceleration
        Deceleration of the braking vehicle, m/s²; default the recipe's.
    front
        Vehicle's foremost point ahead of the array, m; default the recipe's.

    Returns
    -------
    LiveReport
        Counts of scans by treatment, latency (ms) and rate (scans/s).

    Raises
    ------
    ValueError
        If the recipe has a stage that cannot work scan by scan, an option breaks its rule, or the
        run ends before a scan came.
    MissingExtraError
        If a recording in MCAP is asked for and its library is not installed.
    """
    from flgpr.live.begin_and_end import LIVE_RECORDING
    from flgpr.live.detector import LiveSettings
    from flgpr.live.options import LiveOptions
    from flgpr.live.session import LiveRun
    from flgpr.model.vehicle import Vehicle
    from flgpr.recipe.schema import load_recipe
    from flgpr.store.extras import optional
    from flgpr.store.notes import log_note

    if mcap:
        optional("mcap.writer", "bags")  # that it is missing is told before the drive
    played = None
    if incoming is not None and Path(incoming).is_file():
        from flgpr.commands.positions import read_recorded

        played = read_recorded(incoming, anchor)
    if speed is not None and not 0 < speed < 360:
        raise ValueError(f"speed must lie between 0 and 360 km/h, got {speed:g}")
    vehicle = Vehicle() if recipe is None else load_recipe(recipe).vehicle
    vehicle = vehicle.changed(
        speed=None if speed is None else speed / 3.6,
        reaction=reaction,
        deceleration=deceleration,
        front=front,
        threshold=threshold,
    )
    for name, value in (("reaction", reaction), ("deceleration", deceleration)):
        if value is not None and vehicle.speed is None:
            raise ValueError(
                f"{name} goes with a speed, here or in the recipe, got {value:g} alone"
            )
    options = LiveOptions(
        recipe=recipe,
        output=output,
        incoming=None if played is not None else incoming,
        socket=socket,
        model=model,
        before=one_or_more(before),
        lane=lane,
        anchor=anchor,
        settings=LiveSettings(looks, warm_up, span),
        vehicle=vehicle,
        snapshot=snapshot,
        idle=idle,
        fresh=fresh,
        worth=worth,
        tcp=tcp,
        secret_file=secret_file,
        played=played,
        rate=math.inf if rate == 0 else rate,
    )
    run = LiveRun(options, emit or (lambda _: None))
    with _stopped_by_signals(run) as is_stopped:
        report = run.run()
    if not any(report.counts.values()):
        if not is_stopped.is_set():
            raise ValueError(_nothing_came(options))
        log_note("stopped before a scan was taken")
    if mcap:
        from flgpr.commands.exports import Wish, write_export

        write_export(Wish(output, Path(output) / LIVE_RECORDING, "mcap", replace=True))
    return report


@command(lines=lambda count, _: [f"played {count} scans"])
def feed(
    run: PathLike,
    incoming: Annotated[PathLike | None, Argument()] = None,
    rate: float = 4.2,
    socket: Socket = None,
    tcp: Tcp = None,
    secret_file: SecretFile = None,
    first: int = 0,
    count: int | None = None,
    lead: float = 2.0,
    fault: Sequence[str] | None = None,
) -> int:
    """Play a stored run as the radar would write it.

    Parameters
    ----------
    run
        Run store.
    rate
        Scans per second; 0 plays as fast as it can.
    first
        First scan.
    count
        Number of scans; default all.
    lead
        Time between the run's description and its first scan, s.
    fault
        Rehearse a fault: lost, late, twice, nan or jump, as lost:40:13; may repeat.
    incoming
        Folder to write scans into.

    Returns
    -------
    int
        Number of scans that were played.

    Raises
    ------
    ValueError
        If not one of folder, socket and TCP address is given, or an option breaks its rule.
    """
    from flgpr.live import feeding

    return feeding.feed(
        run,
        incoming,
        math.inf if rate == 0 else rate,
        socket,
        first,
        count,
        lead,
        faults=fault or (),
        tcp=tcp,
        secret_file=secret_file,
    )
