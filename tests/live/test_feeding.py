import json
from types import SimpleNamespace

import pytest

from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.model.vehicle import Vehicle
from flgpr.store import save_run
from flgpr.store.scan_file import scan_name
from live_lane import SCANS, make_lane_run, small_recipe

FAST = float("inf")
RUN = make_lane_run(scans=2)

"""A stored run is played as a radar would hand it over, with its faults."""


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("live")
    save_run(make_lane_run(), folder / "run.zarr")
    (folder / "recipe.toml").write_text(small_recipe())
    feed(folder / "run.zarr", folder / "incoming", FAST)
    return folder


def options(home, output, incoming=None, **more):
    return LiveOptions(home / "recipe.toml", output, incoming or home / "incoming", **more)


def events(folder, kind=None):
    lines = [json.loads(line) for line in (folder / "live.jsonl").read_text().splitlines()]
    return [line for line in lines if kind in (None, line["event"])]


def without_times(lines):
    return [
        {k: v for k, v in line.items() if k not in ("arrived", "latency_ms", "latency", "margin_m")}
        for line in lines
    ]


@pytest.fixture(scope="module")
def whole(home):
    """An undisturbed live run."""
    told = []
    report = LiveRun(
        options(home, home / "whole", vehicle=Vehicle(speed=15 / 3.6, front=0.4)), told.append
    ).run()
    return home / "whole", report, told


def test_feed_keeps_its_rate_and_announces_the_end_only_at_the_end(home, tmp_path, monkeypatch):
    waits = []
    monkeypatch.setattr(
        "flgpr.live.feeding.time", SimpleNamespace(monotonic=lambda: 7.0)
    )  # reading takes no time
    folder = tmp_path / "in"
    assert feed(home / "run.zarr", folder, 4.0, first=2, count=3, lead=1.5, wait=waits.append) == 3
    assert sorted(p.name for p in folder.iterdir()) == [
        "run.json",
        *(scan_name(k) for k in (2, 3, 4)),
    ]
    assert waits[0] == 1.5
    assert waits[1:] == pytest.approx([0.25, 0.5])  # nothing really waited
    feed(home / "run.zarr", folder, FAST)
    assert json.loads((folder / "end.json").read_text()) == {"scans": SCANS}
    with pytest.raises(ValueError, match="rate"):
        feed(home / "run.zarr", folder, 0.0)
    with pytest.raises(ValueError, match="first"):
        feed(home / "run.zarr", folder, 1.0, first=SCANS)
    (folder / "run.json").write_text("{}")
    with pytest.raises(ValueError, match="same run"):
        feed(home / "run.zarr", folder, FAST)


def test_a_feed_rehearses_what_a_radar_gets_wrong(home, tmp_path):
    faults = ["lost:10:3", "late:20:2", "twice:25", "nan:30:2"]
    assert feed(home / "run.zarr", tmp_path / "in", FAST, faults=faults) == SCANS - 3 + 1
    names = {p.name for p in (tmp_path / "in").glob("*.scan")}
    assert names == {scan_name(k) for k in range(SCANS) if k not in (10, 11, 12)} | {
        "scan-000025-again.scan"
    }
    whole = home / "incoming" / scan_name(25)
    assert (tmp_path / "in" / "scan-000025-again.scan").read_bytes() == whole.read_bytes()
    report = LiveRun(options(home, tmp_path / "out", tmp_path / "in")).run()
    told = {name: count for name, count in report.counts.items() if count}
    assert told == {
        "received": SCANS - 2,
        "taken": SCANS - 4 - 3 - 2,
        "warm_up": 4,
        "missing": 3,
        "duplicate": 1,
        "masked": 2,
    }
    assert (
        events(tmp_path / "out", "counts")[0]["missing"] == 3
    )  # a loss is told when it is seen, not at the end
    for text in ("stolen:1", "lost", "lost:x", "lost:1:2:3", "late:-1"):
        with pytest.raises(ValueError, match="fault must be lost, late, twice, nan, jump with"):
            feed(home / "run.zarr", tmp_path / "other", FAST, faults=[text])
    for wrong, words in (
        ({"count": -5}, "count must be a scan or more, got -5"),
        ({"lead": -1.0}, "lead must not be negative"),
        ({"lead": FAST}, "lead must not be negative, and a day at most .* got inf"),
        ({"rate": 1e-308}, "rate must be positive, got 1e-308: a scan a day is the least"),
        ({"tcp": "5601"}, "feed needs one of a folder, .* got 2 of them"),
        (
            {"faults": ["late:5:1000000"]},
            rf"fault must end .* \(late:5 has {SCANS - 5} to the end\), got late:5:1000000",
        ),
        ({"faults": ["lost:5:0"]}, "fault must be of a scan or more, got 'lost:5:0'"),
    ):
        with pytest.raises(ValueError, match=words):
            feed(home / "run.zarr", tmp_path / "other", **{"rate": FAST, **wrong})
    with pytest.raises(
        ValueError, match=rf"a scan that is played \(0 to {SCANS - 1}\), got {SCANS}"
    ):
        feed(home / "run.zarr", tmp_path / "other", FAST, faults=[f"nan:{SCANS}"])
    assert not (tmp_path / "other").exists()


def test_what_is_left_of_an_earlier_play_is_told(home, tmp_path, caplog):
    caplog.set_level("INFO")
    feed(home / "run.zarr", tmp_path / "in", FAST, count=3)
    assert not caplog.text
    feed(home / "run.zarr", tmp_path / "in", FAST, faults=["lost:1:2"])
    assert "in holds 3 scans of an earlier play: what is not played again stays" in caplog.text
    feed(home / "run.zarr", tmp_path / "in", FAST)
    assert f"in holds {SCANS} scans and the end of an earlier play" in caplog.text


def test_a_late_scan_is_played_after_those_that_overtake_it(home, tmp_path):
    waits = []
    feed(
        home / "run.zarr",
        tmp_path / "in",
        1e9,
        first=4,
        count=4,
        wait=waits.append,
        faults=["late:5:2"],
    )
    times = {p.name: p.stat().st_mtime_ns for p in (tmp_path / "in").glob("*.scan")}
    assert sorted(times, key=times.__getitem__) == [scan_name(k) for k in (4, 6, 7, 5)]


def test_a_feed_without_a_listener_is_told_in_words(tmp_path):
    run = tmp_path / "run.zarr"
    save_run(RUN, run)
    with pytest.raises(
        ValueError, match=r"socket must be one that .*, got .*: No such file"
    ) as told:
        feed(run, socket_path=tmp_path / "nobody")
    assert "Errno" not in str(told.value)
