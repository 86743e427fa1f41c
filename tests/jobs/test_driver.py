"""One lane from run to result: pass by pass, in one piece, in sections, resumed and left as it is."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.engine import block_name
from flgpr.jobs.checkpoint import begin
from flgpr.jobs.driver import (
    PassRunner,
    PassToRun,
    check_job,
    detect_lane,
    passes_of_lane,
)
from flgpr.jobs.job import LaneJob, make_job
from flgpr.jobs.pieces import do_block, do_finish, do_merge
from flgpr.jobs.workers import InProcess, RunOptions
from flgpr.method.imaged_run import ImagedRun
from flgpr.progress import silent
from flgpr.results.result import read_result
from flgpr.store import save_run
from small_lane import LANE, small_recipe, small_run


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    path = tmp_path_factory.mktemp("driver") / "run.zarr"
    save_run(small_run(scans=4), path)
    return path


def job_of(run, output):
    return make_job(run, small_recipe(), LANE, output, report=False)


def test_a_result_is_written_and_no_work_folder_stays(run, tmp_path):
    job = job_of(run, tmp_path / "result")
    reports = []
    with InProcess() as executor:
        assert detect_lane(job, executor, RunOptions(note=reports.append)) == [tmp_path / "result"]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]
    assert len(read_result(tmp_path / "result").detections) == 1
    assert reports


def test_a_label_stands_before_all_that_progress_is_shown_of(run, tmp_path):
    titles = []

    def track(items, title, total):
        titles.append(title)
        return items

    with InProcess() as executor:
        detect_lane(
            job_of(run, tmp_path / "result"), executor, RunOptions(track=track), label="north: "
        )
    assert titles[-1] == "north: writing the result"
    assert all(title.startswith("north: ") for title in titles)
    assert len(titles) > 2


def test_a_whole_result_is_left_as_it_is_unless_it_is_to_be_overwritten(run, tmp_path, caplog):
    job = job_of(run, tmp_path / "result")
    reports = []
    with InProcess() as executor:
        detect_lane(job, executor)
        with caplog.at_level("INFO", "flgpr.outputs"):
            again = detect_lane(job, executor, RunOptions(note=reports.append), overwrite=False)
        assert again == [tmp_path / "result"]
        assert reports == []
        assert "result exists already" in caplog.text
        detect_lane(job, executor, RunOptions(note=reports.append))
        assert reports


def test_what_does_not_fit_is_refused_before_anything_is_written(run, tmp_path):
    small = replace(job_of(run, tmp_path / "result"), max_memory=1000)
    with InProcess() as executor, pytest.raises(ValueError, match="memory"):
        detect_lane(small, executor)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "own.txt").write_text("own")
    with InProcess() as executor, pytest.raises(FileExistsError, match="notes"):
        detect_lane(job_of(run, tmp_path / "notes"), executor)
    assert (tmp_path / "notes" / "own.txt").read_text() == "own"


def test_a_job_is_refused_early_by_what_is_known_before_it_is_begun(run, tmp_path):
    job = job_of(run, tmp_path / "result")
    check_job(job)
    with pytest.raises(ValueError, match="must fit into max_memory"):
        check_job(replace(job, max_memory=1000))
    with pytest.raises(ValueError, match="max-memory must be at least"):
        check_job(replace(job, max_memory=1_000_000))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "own.txt").write_text("own")
    with pytest.raises(FileExistsError, match="result"):
        check_job(job)


def test_recipes_share_passes_through_a_cache_and_find_what_they_find_alone(run, tmp_path):
    cache = RunOptions(pass_cache=tmp_path / "cache")
    other_recipe = small_recipe().replace("density = 0.75", "density = 0.5")
    first = make_job(run, small_recipe(), LANE, tmp_path / "first", False, options=cache)
    second = make_job(run, other_recipe, LANE, tmp_path / "second", False, options=cache)
    alone = make_job(run, other_recipe, LANE, tmp_path / "alone", False)
    reports = []
    with InProcess() as executor:
        detect_lane(first, executor)
        detect_lane(second, executor, RunOptions(note=reports.append))
        detect_lane(alone, executor)
    passes_with_blocks = {report["stage"] for report in reports if report["block"] >= 0}
    assert passes_with_blocks == {"features"}  # other alarms, on the same background and run-view
    assert second.recipe != first.recipe
    for name in ("alarms.csv", "features.csv"):
        assert (tmp_path / "second" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_passes_without_explanations_leave_their_results_in_the_lane(run, tmp_path):
    job = job_of(run, tmp_path / "result")
    with InProcess() as executor, passes_of_lane(job, executor) as lane:
        assert isinstance(lane, ImagedRun)
        assert not lane.explains
        assert {"signature", "gain", "view", "alarms", "features"} <= set(lane.results)
    assert not (tmp_path / "result").exists()


# Passes handed out block by block, by an executor that only takes note of it

COST = {"seconds": 1.0, "processor_seconds": 2.0, "peak_bytes": 10}


class Noting:
    """Does no work, and leaves what the work would leave."""

    def __init__(self, work):
        self.work = work
        self.asked = []

    def run(self, work, arguments, threads=1):
        for piece in arguments:
            self.asked.append((work, *piece[1:]))
            if work is do_block:
                self.work[block_name(*piece[1:])] = {}
            if work is do_merge:
                self.work[piece[1]] = {}
            yield COST | {"piece": piece[1:]}


@pytest.fixture
def bare_job(tmp_path):
    return LaneJob(
        run="run.zarr", recipe="", lane=(0.0, 1.0, 0.0, 1.0), model=None,
        output=str(tmp_path / "result"), report=True, store_sha256="a", model_sha256="",
        code=(), cpu="",
    )  # fmt: skip


@pytest.fixture
def work(bare_job):
    with begin(bare_job.work, bare_job.identity) as opened:
        yield opened


SIGNATURE = PassToRun("signature", "title of signature", True, [0, 1, 2])
ALARMS = PassToRun("alarms", "title of alarms", False, [])


def runner_of(executor, notes, labels, label=""):
    def track(items, label, total):
        labels.append((label, total))
        return silent(items, label, total)

    return PassRunner(executor, RunOptions(track=track, note=notes.append), 1, label)


def test_blocks_are_done_and_merged_pass_by_pass_and_all_is_reported(bare_job, work):
    executor, notes, labels = Noting(work), [], []
    runner = runner_of(executor, notes, labels, "lane: ")
    runner.run(bare_job, work, [SIGNATURE, ALARMS])
    assert executor.asked == [
        (do_block, "signature", 0),
        (do_block, "signature", 1),
        (do_block, "signature", 2),
        (do_merge, "signature", (0, 1, 2)),
        (do_merge, "alarms", ()),
    ]
    assert labels == [("lane: title of signature", 3)]  # nothing is shown of a pass without blocks
    assert len(notes) == 5


def test_what_the_work_folder_has_is_not_done_again(bare_job, work):
    work["signature-000001"] = {}
    executor, notes, labels = Noting(work), [], []
    runner = runner_of(executor, notes, labels)
    work["alarms"] = {}
    runner.run(bare_job, work, [SIGNATURE, ALARMS])
    blocks = [piece[2] for piece in executor.asked if piece[0] is do_block]
    assert blocks == [0, 2]
    assert labels == [("title of signature", 2)]
    executor.asked.clear()
    runner.run(bare_job, work, [SIGNATURE, ALARMS])
    assert executor.asked == []


def test_early_merged_blocks_are_not_done_again(bare_job, work):
    work["signature-so-far"] = {"next": np.array(2)}
    executor = Noting(work)
    runner_of(executor, [], []).run(bare_job, work, [SIGNATURE])
    assert executor.asked[0] == (do_block, "signature", 2)
    assert executor.asked[1] == (do_merge, "signature", (0, 1, 2))


def test_the_result_is_written_under_a_label_of_its_own(bare_job, work):
    executor, notes, labels = Noting(work), [], []
    runner_of(executor, notes, labels, "section-01: ").finish(bare_job)
    assert executor.asked == [(do_finish,)]
    assert labels == [("section-01: writing the result", 1)]
    assert len(notes) == 1


# A lane in sections has the alarms of the lane in one piece


@pytest.fixture(scope="module")
def in_sections(tmp_path_factory):
    """The small lane, detected in one piece and in sections of 4 m at most."""
    home = tmp_path_factory.mktemp("sections")
    save_run(small_run(), home / "run.zarr")
    with InProcess() as executor:
        for name, longest in (("whole", None), ("cut", 4.0)):
            job = make_job(home / "run.zarr", small_recipe(), LANE, home / name, report=False)
            folders = detect_lane(job, executor, longest=longest)
    assert folders == [home / "cut" / "section-01", home / "cut" / "section-02"]
    return home


def test_the_table_of_all_alarms_is_that_of_one_piece(in_sections):
    whole = read_result(in_sections / "whole").detections[0].alarms
    table = pd.read_csv(in_sections / "cut" / "alarms.csv")
    assert len(table) == len(whole)
    assert table["confidence"].is_monotonic_decreasing
    for name in ("x", "y", "confidence"):
        pd.testing.assert_series_equal(
            table[name].sort_values(ignore_index=True),
            whole[name].sort_values(ignore_index=True),
            check_dtype=False,
            rtol=1e-4,
        )


def test_alarms_name_their_sections(in_sections):
    table = pd.read_csv(in_sections / "cut" / "alarms.csv")
    for section in ("section-01", "section-02"):
        own = read_result(in_sections / "cut" / section).detections[0].alarms
        wanted = {f"{section}/{name}" for name in own["alarm_id"]}
        assert wanted == {name for name in table["alarm_id"] if name.startswith(section)}


def test_the_folder_lists_its_sections_and_nothing_else_stays(in_sections):
    names = {path.name for path in (in_sections / "cut").iterdir()}
    assert names == {"section-01", "section-02", "alarms.csv", "lane.toml", "sections.json"}
    listed = json.dumps(json.loads((in_sections / "cut" / "sections.json").read_text()))
    assert "section-01" in listed
    assert "section-02" in listed
    assert {path.name for path in in_sections.iterdir()} == {"run.zarr", "whole", "cut"}
