"""Options of ``flgpr live`` and ``flgpr feed``."""

import json
import signal
import threading

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.live import feed, live
from flgpr.live.options import LiveReport
from flgpr.live.session import LiveRun
from flgpr.store import describe_for_live, encode_scan, save_run
from flgpr.store.scan_file import END_FILE, scan_name
from live_lane import make_lane_run, small_recipe

REPORT = LiveReport({"received": 1}, {"scans": 0}, 0, float("nan"))


@pytest.fixture
def stored(small_run, tmp_path):
    return save_run(small_run, tmp_path / "run.zarr")


@pytest.fixture
def started(monkeypatch):
    """Options of the live runs that were begun."""
    begun = []

    class Begun:
        def __init__(self, options, emit):
            begun.append((options, emit))

        def run(self):
            return REPORT

        def stop(self):
            pass

    monkeypatch.setattr("flgpr.live.session.LiveRun", Begun)
    return begun


def test_a_speed_is_in_kilometres_per_hour(started):
    assert live("scans", speed=36.0, looks=2, warm_up=7) == REPORT
    [(options, _)] = started
    assert options.vehicle.speed == pytest.approx(10.0)
    assert options.settings.looks == 2
    assert options.settings.warm_up == 7
    live("scans")
    assert started[1][0].vehicle.speed is None


def test_a_speed_that_no_vehicle_has_is_refused(started):
    with pytest.raises(ValueError, match="speed must lie between 0 and 360 km/h, got 400"):
        live("scans", speed=400.0)
    assert started == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_first_signal_lets_a_run_end_and_the_second_one_ends_it(monkeypatch, number):
    stops = []

    class Building:
        def __init__(self, options, emit):
            pass

        def run(self):
            signal.raise_signal(number)
            assert stops == ["asked"]
            signal.raise_signal(number)
            pytest.fail("it went on")

        def stop(self):
            stops.append("asked")

    monkeypatch.setattr("flgpr.live.session.LiveRun", Building)
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        live("scans")
    assert stops == ["asked"]
    assert signal.getsignal(number) is before


@pytest.mark.parametrize("makes_folder", [True, False])
def test_a_run_that_is_stopped_before_its_scans_says_so_and_is_no_error(
    makes_folder, tmp_path, monkeypatch
):
    class Stopped(LiveRun):
        def run(self):
            signal.raise_signal(signal.SIGINT)
            return super().run()

    monkeypatch.setattr("flgpr.live.session.LiveRun", Stopped)
    if makes_folder:
        (tmp_path / "scans").mkdir()
    words = ["live", str(tmp_path / "scans"), "-o", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert "stopped before a scan was taken" in done.output
    assert "no scan came" not in done.output


def test_scans_without_a_position_alone_came_all_the_same(small_run, tmp_path):
    """No recipe can be made for them: yet it is not said that none came."""
    description = describe_for_live(small_run)
    (tmp_path / "run.json").write_text(json.dumps(description.as_json()))
    signal = small_run["signal"].values[0]
    frame = encode_scan(0, signal, None, 0.0, description.run_id)
    (tmp_path / scan_name(0)).write_bytes(frame)
    (tmp_path / END_FILE).write_text("{}")
    report = live(tmp_path, output=tmp_path / "out")
    assert report.counts["received"] == report.counts["pose_missing"] == 1


def test_a_folder_that_is_made_while_it_is_watched_is_no_error(tmp_path):
    stored = save_run(make_lane_run(scans=4), tmp_path / "run.zarr")
    (tmp_path / "recipe.toml").write_text(small_recipe())
    scans = tmp_path / "scans"
    sender = threading.Timer(0.5, feed, [stored, scans, 0], {"lead": 0})
    sender.start()
    report = live(scans, tmp_path / "recipe.toml", output=tmp_path / "out")
    sender.join()
    assert report.counts["received"] == 4


def test_called_from_python_events_are_given_to_a_function_alone(started, capsys):
    events = []
    live("scans", emit=events.append)
    live("scans")
    for _, emit in started:
        emit('{"event": "alarm"}\n')
    assert events == ['{"event": "alarm"}\n']
    assert capsys.readouterr().out == ""


def test_a_run_is_played_as_fast_as_it_can(stored, tmp_path):
    words = ["feed", str(stored), str(tmp_path / "scans"), "--rate", "0", "--lead", "0"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    assert done.output == "played 4 scans\n"
    names = {path.name for path in (tmp_path / "scans").iterdir()}
    assert {scan_name(scan) for scan in range(4)} <= names
    assert END_FILE in names


def test_scans_that_are_lost_are_not_played(stored, tmp_path):
    count = feed(stored, tmp_path / "scans", rate=0, lead=0, fault=["lost:1:2"])
    assert count == 2
    assert not (tmp_path / "scans" / scan_name(1)).exists()


@pytest.mark.parametrize(
    ("options", "rule"),
    [
        ({}, "feed needs one of a folder, a socket and a TCP address"),
        (
            {"incoming": "scans", "socket": "s"},
            "feed needs one of a folder, a socket and a TCP address",
        ),
        ({"incoming": "scans", "rate": -1.0}, "rate must be positive, got -1"),
        ({"incoming": "scans", "first": 4}, r"first must be a scan of the run \(0 to 3\), got 4"),
        ({"incoming": "scans", "fault": ["burnt:1"]}, "fault must be lost, .* got 'burnt:1'"),
    ],
)
def test_what_cannot_be_played_is_refused(options, rule, stored, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=rule):
        feed(stored, **options)
    assert not (tmp_path / "scans").exists()
