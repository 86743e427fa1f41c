"""What `flgpr demo` prints and opens; no test opens a browser."""

import json
import shutil
import threading
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.demo import play_drive


@pytest.fixture
def output(demo, tmp_path):
    """A result of the demo, so that the command has to score it only."""
    return shutil.copytree(demo[0].folder, tmp_path / "result")


@pytest.fixture
def opened(monkeypatch):
    """Pages that would have been opened before somebody at a screen."""
    pages = []
    monkeypatch.setattr("flgpr.commands.demo.has_browser", lambda: True)
    monkeypatch.setattr("flgpr.commands.demo.open_page", pages.append)
    return pages


def call(*arguments):
    called = CliRunner().invoke(app, ["demo", *map(str, arguments)])
    assert called.exit_code == 0, called.output
    return called


def test_the_demo_ends_with_a_picture_a_sentence_and_the_page(output, opened):
    lines = call("-o", output).stdout.splitlines()
    assert lines[-2] == (
        "2 of 3 mines were found before the vehicle reached them, with 1 false alarm on "
        "6.04 m² of other ground (as many with none); missed: plastic 3 cm deep."
    )
    assert lines[-1] == f"report: {output / 'report.html'}"
    picture = "\n".join(lines[:-2])
    assert picture.count("●") == 2 + 1  # with the legend
    assert "interval" not in picture
    assert opened == [output / "report.html"]


@pytest.mark.slow("runs a whole command more than once")
def test_details_are_an_option_away(output):
    text = call("-o", output, "--details").stdout
    assert "What became of each target" in text
    assert "95 % interval" in text
    assert "chance" in text


@pytest.mark.slow("runs a whole command more than once")
@pytest.mark.parametrize("option", ["--no-open", "--quiet", "--json"])
def test_a_page_does_not_open_unless_it_is_wanted(output, opened, option):
    text = call("-o", output, option).stdout
    assert opened == []
    if option == "--json":
        assert json.loads(text)["found"] == 2


@pytest.mark.slow("runs a whole command more than once")
def test_there_is_no_browser_without_a_terminal(output, monkeypatch):
    monkeypatch.setattr("webbrowser.open", lambda _: pytest.fail("a browser opened"))
    call("-o", output)


def test_the_drive_is_shown_on_the_drivers_screen(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    seen = {}

    def serve(paths, live, open_browser, announce, answers):
        file = Path(live) / "live.jsonl"
        while not (file.is_file() and file.stat().st_size):
            time.sleep(0.02)
        first = file.read_text().splitlines()[0]
        seen.update(json.loads(first), opens=open_browser, paths=paths)
        assert answers  # the driver of the demo can try the buttons

    monkeypatch.setattr("flgpr.viewer.serve", serve)
    text = call("--live").stdout
    assert "simulated road with 10 mines" in text
    assert (seen["event"], seen["title"], seen["opens"], seen["paths"]) == (
        "start",
        "demo drive",
        False,
        [],
    )
    assert list(tmp_path.iterdir()) == []


def test_the_drive_begins_anew_until_it_is_stopped(monkeypatch, tmp_path):
    stop = threading.Event()
    played = []

    def play(recording, folder, rate, wait):
        played.append(folder)
        if len(played) == 3:
            stop.set()

    monkeypatch.setattr("flgpr.live.recording.play_recording", play)
    play_drive(tmp_path / "drive.jsonl.gz", tmp_path, stop, pause=0.0)
    assert played == [tmp_path] * 3
