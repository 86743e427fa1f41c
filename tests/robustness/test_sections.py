"""A lane in sections: the run-view, alarms and features of the lane in one piece, in little memory."""

import json
import math
import os
import re
import shutil
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.commands.replay import replay
from flgpr.jobs import checkpoint
from flgpr.jobs.checkpoint import finish
from flgpr.jobs.driver import detect_lane
from flgpr.jobs.workers import InProcess, RunOptions
from flgpr.method.memory import lane_memory
from flgpr.method.sections import Section, divide, plan_sections, section_lane, threads_within
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe
from flgpr.results.manifest import ResultError
from flgpr.results.result import join_sections, read_result
from flgpr.results.sections import results_at
from flgpr.viewer.session import open_source
from robust import content, digests, small_job
from scored import score_alarms, score_result

SIZES = {"polarization": 3, "pair": 36, "frequency": 1024, "scan": 120_000}


@pytest.fixture(scope="module")
def folder(lane, tmp_path_factory):
    output = tmp_path_factory.mktemp("long") / "result"
    flgpr.detect(*lane.arguments, output, lane.area, report=False, section=2.0)
    return output


def results(folder):
    return [read_result(home) for home in results_at(folder)]


def test_sections_hold_the_run_view_of_the_whole_lane(lane, folder):
    parts = results(folder)
    whole = lane.result.detections[0].view
    assert len(parts) == 4
    views = [part.detections[0].view for part in parts]
    assert max(view.sizes["y"] for view in views) <= 20
    np.testing.assert_array_equal(
        np.concatenate([view.values for view in views], axis=2), whole.values
    )
    np.testing.assert_array_equal(
        np.concatenate([view["y"].values for view in views]), whole["y"].values
    )
    np.testing.assert_array_equal(
        np.concatenate([view["looks"].values for view in views]), whole["looks"].values
    )


def test_sections_are_joined_for_the_report_and_thinned_if_they_are_long(lane, folder):
    whole = lane.result
    joined = join_sections(folder, results_at(folder))
    assert joined.lane == whole.lane
    assert joined.recipe_text == whole.recipe_text
    xr.testing.assert_identical(joined.detections[0].view, whole.detections[0].view)
    few = join_sections(folder, results_at(folder), most=24).detections[0].view
    full = whole.detections[0].view
    assert few.sizes["y"] <= 24 < full.sizes["y"]
    np.testing.assert_array_equal(few.max("y"), full.max("y"))
    np.testing.assert_array_equal(few["looks"].max("y"), full["looks"].max("y"))
    assert (few["y"].diff("y") > 0).all()


def test_sections_hold_the_alarms_and_features_of_the_whole_lane(lane, folder):
    parts = results(folder)
    whole = lane.result.detections[0]
    order = ["y", "x"]
    features = pd.concat(
        [part.detections[0].alarms[order].join(part.detections[0].features) for part in parts]
    )
    expected = whole.alarms[order].join(whole.features)
    assert len(expected) > 10
    pd.testing.assert_frame_equal(
        features.sort_values(order).reset_index(drop=True),
        expected.sort_values(order).reset_index(drop=True),
    )
    together = pd.read_csv(folder / "alarms.csv")
    columns = ["x", "y", "confidence", "magnitude", "scans"]
    pd.testing.assert_frame_equal(
        together[columns], whole.alarms[columns].astype(together[columns].dtypes)
    )
    assert together["alarm_id"].str.fullmatch(r"section-0[1-4]/alarm-\d+").all()


def test_the_parts_of_the_lane_meet_and_hold_their_alarms(lane, folder):
    parts = results(folder)
    assert parts[0].lane.y_min == lane.lane.y_min
    assert parts[-1].lane.y_max == lane.lane.y_max
    for one, other in pairwise(parts):
        assert one.lane.y_max == other.lane.y_min
    for part in parts:
        alarms = part.detections[0].alarms
        assert alarms["y"].between(part.lane.y_min, part.lane.y_max).all()


@pytest.mark.slow("runs sections again in another way")
def test_sections_do_not_depend_on_who_works(lane, folder, tmp_path):
    other = tmp_path / "result"
    flgpr.detect(*lane.arguments, other, lane.area, report=False, section=2.0, workers=2)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]
    for one, two in zip(results_at(folder), results_at(other), strict=True):
        assert content(one) == content(two)
    assert digests(folder)["alarms.csv"] == digests(other)["alarms.csv"]


class _Stop(Exception):
    """The work is stopped."""


@pytest.mark.slow("runs sections again in another way")
def test_sections_go_on_where_they_were_stopped_the_last_step_too(
    lane, folder, tmp_path, monkeypatch
):
    job = small_job(lane, tmp_path / "result")
    done = []

    def note(report):
        done.append((report["lane"], report["stage"], report["block"]))
        if len(done) in (3, 20):
            raise _Stop

    def stop(folder):
        if folder == job.work:
            raise _Stop
        finish(folder)

    with InProcess() as executor:
        for _ in range(2):
            with pytest.raises(_Stop):
                detect_lane(job, executor, RunOptions(note=note), longest=2.0)
            assert not (tmp_path / "result").exists()
        with monkeypatch.context() as patch:
            patch.setattr(checkpoint, "finish", stop)
            with pytest.raises(_Stop):
                detect_lane(job, executor, RunOptions(note=note), longest=2.0)
        assert len(done) == len(set(done)) > 20
        # What is left costs nothing.
        homes = detect_lane(job, executor, RunOptions(note=pytest.fail), longest=2.0)
    assert homes == results_at(tmp_path / "result")
    for one, two in zip(results_at(folder), homes, strict=True):
        assert content(one) == content(two)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result"]


@pytest.mark.slow("runs sections again in another way")
def test_another_division_begins_anew(lane, tmp_path):
    job = small_job(lane, tmp_path / "result")

    def stop(report):
        if report["stage"] == "finish":
            raise _Stop

    with InProcess() as executor:
        with pytest.raises(_Stop):
            detect_lane(job, executor, RunOptions(note=stop), longest=2.0)
        detect_lane(job, executor, longest=4.0)
    told = json.loads((tmp_path / "result" / "sections.json").read_text())
    assert told["sections"] == ["section-01", "section-02"]
    assert {path.name for path in (tmp_path / "result").iterdir()} == {
        "section-01",
        "section-02",
        "alarms.csv",
        "lane.toml",
        "sections.json",
    }


def test_the_viewer_shows_a_section_and_names_them(folder):
    with pytest.raises(
        ValueError, match=r"one of the sections of this lane \(section-01, .*section-04\)"
    ):
        open_source(folder)
    assert open_source(results_at(folder)[1]).folder == (folder / "section-02").resolve()


def test_a_section_is_replayed(folder):
    assert replay(results_at(folder)[1]) == {
        "identical": True,
        "agrees": True,
        "files": [],
        "difference": 0.0,
    }


@pytest.mark.slow("runs sections again in another way")
def test_one_piece_takes_the_place_of_sections(lane, folder, tmp_path):
    shutil.copytree(folder, tmp_path / "result")
    flgpr.detect(*lane.arguments, tmp_path / "result", lane.area, report=False)
    assert results_at(tmp_path / "result") == [tmp_path / "result"]
    assert not [*(tmp_path / "result").glob("section*")]


@pytest.mark.slow("runs sections again in another way")
def test_a_survey_with_sections_leaves_out_what_is_done(lane, tmp_path):
    done = []
    options = {
        "lane": [lane.area, lane.area],
        "report": False,
        "section": 4.0,
        "note": done.append,
    }
    second = tmp_path / "second.zarr"
    shutil.copytree(lane.run, second)
    runs = [lane.run, second]
    first = flgpr.detect(runs, lane.recipe, tmp_path / "out", **options)
    names = [home.name for home in results_at(first.folders[0])]
    assert names == ["section-01", "section-02"]
    assert first[0].lane == lane.lane
    row = json.loads((tmp_path / "out" / "survey.json").read_text())[0]
    assert row["sections"] == 2
    assert row["alarms"] == len(lane.result.detections[0].alarms)
    assert row["area_m2"] == pytest.approx(lane.lane.area)
    done.clear()
    again = flgpr.detect(runs, lane.recipe, tmp_path / "out", **options)
    assert again.folders == first.folders
    assert not done


@pytest.mark.parametrize(
    "name", ["alarms.csv", "lane.toml", "sections.json", "section-02/manifest.json"]
)
def test_an_altered_folder_of_sections_is_refused(folder, name, tmp_path):
    shutil.copytree(folder, tmp_path / "copy")
    data = bytearray((tmp_path / "copy" / name).read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / "copy" / name).write_bytes(data)
    with pytest.raises(ResultError):
        results_at(tmp_path / "copy")
    (tmp_path / "copy" / name).unlink()
    if name != "sections.json":
        with pytest.raises(ResultError, match="missing"):
            results_at(tmp_path / "copy")


@pytest.mark.slow("runs sections again in another way")
def test_the_command_line_takes_and_scores_sections(lane, tmp_path):
    truth = tmp_path / "truth.csv"
    truth.write_text(
        "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.0\nb,metal,-0.4,6.3,0.0\nc,metal,0.3,8.4,0.0\n"
    )
    output = tmp_path / "out"
    shutil.copytree(lane.result.folder, output)  # one piece, whose place the sections take
    words = [
        "detect",
        str(lane.run),
        "--recipe",
        str(lane.recipe),
        "--lane",
        str(lane.area),
        "-o",
        str(output),
    ]
    told = CliRunner().invoke(app, [*words, "--section", "4", "--quiet"])
    assert told.exit_code == 2
    assert "--overwrite makes it again" in told.stderr
    assert content(output) == lane.content
    for again in (["--overwrite", "--quiet"], []):
        told = CliRunner().invoke(app, [*words, "--section", "4", *again])
        assert told.exit_code == 0, told.output
    assert told.stderr.startswith(f"{output} exists already")
    assert len(results_at(output)) == 2
    assert not (output / "manifest.json").exists()
    told = CliRunner().invoke(app, ["score", str(output), "--truth", str(truth), "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["targets"] == 3
    halo = lane.result.recipe.score.halo
    score_alarms(lane.result.folder / "alarms.csv", truth, lane.area, tmp_path / "list", halo=halo)
    score_result(lane.result.folder, truth, output=tmp_path / "whole")
    sections, one, listed = (
        json.loads((home / "roc.json").read_text())
        for home in (output / "score", tmp_path / "whole", tmp_path / "list")
    )
    assert sections["rules"] == one["rules"] == listed["rules"]
    main, whole, other = (each["detections"]["main"] for each in (sections, one, listed))
    assert main.pop("title") == whole.pop("title")
    assert main == whole
    assert {name for name in main if main[name] != other[name]} <= {
        "targets"
    }  # the list knows no soil
    page = (output / "score" / "report.html").read_text()
    assert (output / "score" / re.search(r'href="([^"]*section-02[^"]*)"', page).group(1)).is_file()
    assert page.count("data:image/png") == (tmp_path / "whole" / "report.html").read_text().count(
        "data:image/png"
    )


def test_a_lane_of_any_length_is_planned_within_the_memory():
    recipe = load_recipe("wang2007")
    short = Lane(-1.5, 1.5, 0, 1200)
    long = Lane(-1.5, 1.5, 0, 200_000)
    assert plan_sections(SIZES, recipe, short) == [Section(0, 12001)]
    assert (
        lane_memory(SIZES | {"scan": 10**6}, recipe, short).needed()
        == lane_memory(SIZES, recipe, short).needed()
    )
    sections = plan_sections(SIZES, recipe, long)
    assert sections[0].start == 0
    assert sections[-1].stop == 2_000_001
    assert all(one.stop == other.start for one, other in pairwise(sections))
    most = max(section.stop - section.start for section in sections)
    assert (
        lane_memory(SIZES, recipe, long).needed(most)
        <= 2e9
        < lane_memory(SIZES, recipe, long).needed(2 * most)
    )
    assert threads_within(SIZES, recipe, long, sections) == 2
    one = lane_memory(SIZES, recipe, short).needed()
    several = [
        threads_within(SIZES, recipe, short, [Section(0, 12001)], int(k * one))
        for k in (0.5, 1, 2, 4)
    ]
    assert several == sorted(several)
    assert several[:2] == [1, 1] < several[2:]
    assert len(plan_sections(SIZES, recipe, long, 2 * 10**9, 1000.0)) == 201
    with pytest.raises(ValueError, match=r"for a lane of 200000 m in one piece, got 2 GB"):
        plan_sections(SIZES, recipe, long, longest=math.inf)
    with pytest.raises(ValueError, match=r"at least .* for this run, got 0\.1 GB"):
        plan_sections(SIZES, recipe, short, 10**8)
    with pytest.raises(ValueError, match="section must be a positive length in metres, got -1"):
        plan_sections(SIZES, recipe, short, longest=-1.0)


def test_parts_are_even_and_cover_everything():
    for rows, longest in ((1, 1), (10, 3), (1001, 250), (7, 100)):
        sections = divide(rows, longest)
        sizes = [section.stop - section.start for section in sections]
        assert sum(sizes) == rows
        assert max(sizes) <= longest
        assert max(sizes) - min(sizes) <= 1
        assert len(sizes) == -(-rows // longest)


def test_a_section_that_the_lane_does_not_reach_is_refused():
    recipe = load_recipe("wang2007")
    with pytest.raises(ValueError, match="lane must have"):
        section_lane(recipe, Lane(-1.5, 1.5, 0, 100), Section(2000, 2100))


@pytest.mark.slow("runs sections again in another way")
def test_a_stretch_without_scans_has_no_alarms(lane, tmp_path):
    area = tmp_path / "far.toml"
    area.write_text("x_min = -0.75\nx_max = 0.75\ny_min = 3.0\ny_max = 24.0\n")
    homes = results_at(
        flgpr.detect(*lane.arguments, tmp_path / "result", area, section=11.0).folder
    )
    counts = [len(read_result(home).detections[0].alarms) for home in homes]
    assert counts[0] > 10
    assert counts[-1] == 0
    assert os.path.getsize(homes[-1] / "report.html") > 1000
