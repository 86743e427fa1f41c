"""``flgpr demo``: process the packaged lane."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from flgpr.commands.exports import map_bytes
from flgpr.commands.messages import say
from flgpr.commands.options import Output, Overwrite, PathLike, Progress
from flgpr.commands.runs import DEMO_COMPARISONS, detect_compared
from flgpr.commands.score_text import score_lines, score_summary
from flgpr.commands.shell import Arguments, command

if TYPE_CHECKING:
    from flgpr.method.detection import Detection
    from flgpr.results.result import Result
    from flgpr.scoring import Score
    from flgpr.scoring.score_entries import ScoreSummary

_REPORT = "report"  # the last step of the demo
_RATE = 2.25  # scans/s, a metre each: a speed at which the driver's screen says all its words
_PAUSE = 5.0  # s between the end of the drive and its beginning anew


def _lines(returned: tuple[Result, list[Score]], call: Arguments) -> Iterator[Any]:
    """Yield the road as a picture, what was found in a sentence, and where the report is."""
    from flgpr.commands.road_text import road_lines

    result, scores = returned
    if call.details:
        yield from score_lines(scores)
    yield from road_lines(scores[0])
    detected = scores[0].outcomes[scores[0].outcomes["found"]]
    last = max(pose[1] for pose in result.manifest["run"]["pose"])
    is_ahead = len(detected) and bool((detected["y"] > last).all())
    when = " before the vehicle reached them" if is_ahead else ""
    yield f"{scores[0].in_plain_words(when)}."
    yield f"report: {(result.folder / 'report.html').resolve()}"


def _as_json(returned: tuple[Result, list[Score]], _: Arguments) -> ScoreSummary:
    """Return the figures of the score."""
    from flgpr.commands.scoring import Scored

    result, scores = returned
    return score_summary(Scored(result.folder, scores))


@contextmanager
def _page(call: Arguments) -> Iterator[None]:
    """Show the result in the browser after the command, or a drive in its place."""
    opens = not (call.no_open or call.quiet or call.as_json) and has_browser()
    if call.live:
        _show_drive(opens)
        raise typer.Exit
    yield
    if call.view:
        from flgpr import viewer

        viewer.serve(Path(call.output), open_browser=opens, announce=say, make_map=map_bytes)
    elif opens:
        open_page(Path(call.output) / "report.html")


def _show_drive(opens: bool) -> None:
    """Play the packaged drive on the driver's screen, again and again, until interrupted."""
    from flgpr import viewer
    from flgpr.store import read_table, sample_drive

    mines = len(read_table(sample_drive() / "truth.csv", "truth"))
    say(f"A drive at 8 km/h on a simulated road with {mines} mines, as flgpr live recorded it.")
    say("It begins anew when it is over; Ctrl-C ends it.")
    stop = threading.Event()
    with tempfile.TemporaryDirectory(prefix="flgpr-") as folder:
        player = threading.Thread(
            target=play_drive, args=(sample_drive() / "drive.jsonl.gz", folder, stop)
        )
        player.start()
        try:
            viewer.serve([], open_browser=opens, live=folder, announce=say, answers=True)
        finally:
            stop.set()
            player.join()


def play_drive(
    recording: Path, folder: PathLike, stop: threading.Event, pause: float = _PAUSE
) -> None:
    """Play a recording into a folder again and again until ``stop`` is set.

    Parameters
    ----------
    recording : path
        The recording, see ``play_recording``.
    folder : path
        Folder for the file of events.
    stop : threading.Event
        Ends the playing.
    pause : float
        Time between the end and the beginning anew, s.
    """
    from flgpr.live.recording import play_recording

    while not stop.is_set():
        play_recording(recording, folder, _RATE, stop.wait)
        stop.wait(pause)


@command(
    lines=_lines,
    as_json=_as_json,
    context=_page,
    shell_flags={
        "details": "Print what became of each target, counts, chance and interval.",
        "no_open": "Open no browser: print where the page is.",
        "view": "Open the result in the viewer.",
        "live": "Show a recorded drive of half a minute on the driver's screen.",
    },
    compiles_kernels=True,
)
def demo(
    output: Output = "demo-result", overwrite: Overwrite = True, *, track: Progress = None
) -> tuple[Result, list[Score]]:
    """Process the packaged lane: image, detect, score, report.

    Returns
    -------
    result, scores
        The result, and a score for each of its detections.

    Raises
    ------
    FileExistsError
        If something that is no result lies at the output, or another result that is not to be
        overwritten.
    """
    from flgpr.commands.score_request import ScoreRequest
    from flgpr.commands.scoring import score_result
    from flgpr.method.method import detect
    from flgpr.method.stands_out import what_stands_out
    from flgpr.progress import silent
    from flgpr.recipe.fit import area_of
    from flgpr.recipe.schema import parse_recipe, recipe_text
    from flgpr.results.description import describe_run
    from flgpr.results.result import check_free, write_result
    from flgpr.store import open_run, sample_lane
    from flgpr.store.outputs import OVERWRITE, log_finished

    track = track or silent
    lane_folder = sample_lane()
    store = lane_folder / "run.zarr"
    folder = check_free(output)

    text = recipe_text("demo")
    compared = {name: recipe_text(f"demo-{name}") for name in DEMO_COMPARISONS}

    run = open_run(store)
    recipe = parse_recipe(text)
    description = describe_run(run, store, recipe.motion)

    # The same recipes on the same run: there is nothing to do but to score.
    steps = [_REPORT]
    if not overwrite and _holds_demo(folder, description, text, compared):
        log_finished(folder, OVERWRITE)
    else:
        steps = ["demo", *compared, _REPORT]

    lane = area_of(run, recipe)
    detections: list[Detection] = []
    # One bar for all of it: what a detection does in turn, `flgpr detect` shows.
    for step in track(steps, "searching the packaged lane", len(steps)):
        if step == "demo":
            detections.append(detect(run, recipe, lane, silent))
        elif step != _REPORT:
            detections.append(detect_compared(run, step, compared[step], lane, silent))
        else:
            if detections:
                stands_out = what_stands_out(detections[0].alarms, lane)
                description["stands_out"] = stands_out.as_json()
                write_result(folder, detections, text, lane, description)
            request = ScoreRequest(
                lists=[folder],
                truth=lane_folder / "truth.csv",
                objects=lane_folder / "objects.csv",
                output=folder,
                overwrite=overwrite,
            )
            scored = score_result(request)
    result, scores = scored
    return result, scores


def _holds_demo(
    folder: Path, description: dict[str, Any], text: str, compared: dict[str, str]
) -> bool:
    """Return whether a folder holds this result of the packaged lane.

    Another result is a FileExistsError.
    """
    import flgpr
    from flgpr.results.manifest import ResultError
    from flgpr.results.result import read_result
    from flgpr.results.sections import SECTIONS
    from flgpr.store.outputs import OVERWRITE, output_exists_error

    if not any((folder / name).is_file() for name in ("manifest.json", SECTIONS)):
        return False

    refusal = output_exists_error(folder, f"{OVERWRITE}, or choose another output")
    try:
        result = read_result(folder)
    except ResultError:
        raise refusal from None

    recipes = {detection.name: detection.recipe_text for detection in result.detections[1:]}
    same_run = result.manifest["run"].get("store_sha256") == description["store_sha256"]
    same_version = result.manifest["flgpr"] == flgpr.__version__
    same_recipes = (result.recipe_text, recipes) == (text, compared)

    if not (same_run and same_version and same_recipes):
        raise refusal
    return True


def has_browser(
    environment: Mapping[str, str] | None = None,
    platform: str = sys.platform,
    is_terminal: bool | None = None,
) -> bool:
    """Return whether somebody sits at a screen on which a browser can open.

    Not where ``CI`` is set, the output goes to a file or a program, or there is no display.

    Parameters
    ----------
    environment : mapping, optional
        Environment variables, by default those of the process.
    platform : str
        As ``sys.platform``.
    is_terminal : bool, optional
        Whether the output is shown on a terminal, by default that of the process.

    Returns
    -------
    bool
        Whether one can open.
    """
    variables = os.environ if environment is None else environment
    if is_terminal is None:
        is_terminal = sys.stdout.isatty()
    if variables.get("CI") or not is_terminal:
        return False
    if platform in ("darwin", "win32", "cygwin"):
        return not variables.get("SSH_CONNECTION")
    return bool(variables.get("DISPLAY") or variables.get("WAYLAND_DISPLAY"))


def open_page(path: Path) -> bool:
    """Open a page of this machine in the browser, and return whether there was one."""
    try:
        return webbrowser.open(path.resolve().as_uri())
    except webbrowser.Error:
        return False
