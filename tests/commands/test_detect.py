"""`flgpr.detect` in memory and on paths, and what a notebook shows of it."""

import gc
import inspect

import pytest

import flgpr
from flgpr.store import open_run, sample_lane

RUN = sample_lane() / "run.zarr"


def test_a_run_in_memory_and_its_store_give_the_same_alarms_and_leave_nothing():
    stored = flgpr.detect(RUN, "demo", report=False)
    in_memory = flgpr.detect(open_run(RUN).load(), "demo", lane=stored.lane, report=False)
    assert in_memory.detections[0].alarms.equals(stored.detections[0].alarms)
    assert "alarms in" in in_memory._repr_html_()
    assert "data:image/png;base64," in in_memory._repr_html_()
    assert repr(in_memory).startswith("result of demo: ")
    assert in_memory.alarms is in_memory.detections[0].alarms
    folder = in_memory.folder
    assert folder.is_dir()
    del in_memory
    gc.collect()
    assert not folder.exists()


@pytest.mark.slow("detects")
def test_a_list_of_one_run_is_a_survey_and_a_result_has_verbs(tmp_path):
    survey = flgpr.detect([RUN], "demo", tmp_path / "survey", report=False)
    assert len(survey) == 1
    result = survey[0]
    axes = result.plot()
    assert len(axes.lines[0].get_xdata()) == len(result.alarms)
    assert result.plot(axes) is axes
    scored = result.score(RUN.parent / "truth.csv", output=tmp_path / "score")
    assert scored.folder == tmp_path / "score"
    shown = result.view()
    assert shown.url.startswith("http://127.0.0.1:")
    shown.close()


def test_several_runs_need_a_place_and_stores(tmp_path):
    with pytest.raises(ValueError, match="output must be given for a list of runs"):
        flgpr.detect([RUN, RUN], "demo")
    with pytest.raises(ValueError, match="must be stored, got one in memory"):
        flgpr.detect([RUN, open_run(RUN)], "demo", tmp_path / "out")
    with pytest.raises(ValueError, match="at least one run, got none"):
        flgpr.detect([], "demo", tmp_path / "out")
    with pytest.raises(ValueError, match="lane must be given once per run, got 2 for 1 run"):
        flgpr.detect(RUN, "demo", tmp_path / "out", ["a.toml", "b.toml"])
    assert not list(tmp_path.iterdir())


def test_the_package_shows_the_signature_of_its_verb():
    parameters = inspect.signature(flgpr.detect).parameters
    assert list(parameters)[:4] == ["runs", "recipe", "output", "lane"]
    assert repr(parameters["recipe"].annotation) == "str | Path | None"
    assert "Packaged recipe or TOML file" in flgpr.detect.__doc__
    documentation = flgpr.detect.__doc__
    assert documentation.startswith("Raise alarms on runs")
    assert "flgpr.detect(runs, recipe=None" in documentation
    assert "workers, scheduler, lanes_at_once, max_memory, section : Work" in documentation
