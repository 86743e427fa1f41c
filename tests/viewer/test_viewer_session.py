"""The viewer's sources: tiles and evidence of a result, live events, and what is refused."""

import json

import numpy as np
import pytest

from flgpr.store import sample_lane
from flgpr.viewer.session import (
    LiveFile,
    ResultFiles,
    RunFiles,
    ViewError,
    open_source,
    open_sources,
)
from small_results import small_result

RUN = sample_lane() / "run.zarr"


@pytest.fixture
def result(tmp_path):
    return small_result(tmp_path / "result")


def test_tiles_are_the_rows_of_a_level(result):
    files = ResultFiles(result)
    tile = np.frombuffer(files.tile(0, 0, 0), "<f2").reshape(5, 5)
    assert np.isfinite(tile).all()
    for numbers in ((1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0)):
        assert files.tile(*numbers) is None
    assert files.evidence(0, 0) is None
    assert files.title == "result (small)"
    assert files.score_bytes() is None


def test_an_altered_layer_is_not_shown(result):
    files = ResultFiles(result)
    (layer,) = result.glob("view/layers/*.f16")
    layer.write_bytes(bytes(50))
    with pytest.raises(ViewError, match=r"differs|altered|digest"):
        files.tile(0, 0, 0)


def test_a_run_shows_its_track_and_nothing_else():
    files = open_source(RUN)
    assert isinstance(files, RunFiles)
    assert len(files.index["scans"]["x"]) > 1
    assert files.index["layers"] == []
    assert not files.index["run"]["recording"]


def test_the_table_of_alarms_stands_for_its_result(result):
    (source,) = open_sources([result / "alarms.csv"])
    assert isinstance(source, ResultFiles)


def test_what_cannot_be_shown_is_named(tmp_path, result):
    with pytest.raises(FileNotFoundError, match="nothing to view"):
        open_source(tmp_path / "nothing")
    with pytest.raises(ViewError, match="path must be a result folder"):
        open_source(tmp_path)
    (result / "manifest.json").write_text("{}")
    with pytest.raises(ViewError, match="not a result folder"):
        ResultFiles(result)


def test_live_events_are_read_from_where_the_last_answer_ended(tmp_path):
    live = LiveFile(tmp_path)
    assert live.after(0)["age"] is None
    path = tmp_path / "live.jsonl"
    path.write_text('{"event":"note"}\nnonsense\n{"event":"sc')
    first = live.after(0)
    assert (first["events"], first["bad"]) == ([{"event": "note"}], 1)
    with path.open("a") as file:
        file.write('an"}\n')
    assert live.after(first["next"])["events"] == [{"event": "scan"}]
    path.write_text(json.dumps({"event": "start"}) + "\n")
    assert live.after(10_000)["restarted"]
