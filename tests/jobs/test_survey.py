"""Names of many lanes, and what is refused before any is begun."""

import pytest

import flgpr
from flgpr.jobs.survey import detect_survey, lane_names


def test_lanes_are_named_after_their_runs():
    assert lane_names(["a/first.zarr", "b/second.zarr"]) == ["first", "second"]
    with pytest.raises(ValueError, match="must have different names, got several first"):
        lane_names(["a/first.zarr", "b/first.zarr", "c.zarr"])


def test_several_lanes_at_once_need_others_who_work(tmp_path):
    with pytest.raises(ValueError, match="lanes_at_once needs workers or a scheduler"):
        detect_survey([], tmp_path / "survey", at_once=2)
    assert not (tmp_path / "survey").exists()


def test_borders_are_one_file_per_run(tmp_path):
    with pytest.raises(ValueError, match="lane must be given once per run, got 1 for 2 runs"):
        flgpr.detect(["a.zarr", "b.zarr"], output=tmp_path / "survey", lane=["a.toml"])
    assert not (tmp_path / "survey").exists()
