"""A score from Python: of objects in memory, and as a notebook shows it."""

import gc

import pandas as pd
import pytest

import flgpr
from flgpr.store import open_run, read_table, sample_lane

LANE = sample_lane()


@pytest.mark.slow("draws all figures of a score, twice")
def test_a_result_and_a_truth_in_memory_are_scored_as_their_files(tmp_path):
    run = open_run(LANE / "run.zarr").load()
    truth = read_table(LANE / "truth.csv", "truth")
    scored = flgpr.score(flgpr.detect(run, "demo", report=False), truth=truth)
    gc.collect()
    assert (scored.folder / "roc.json").is_file()  # the result lives as long as its score
    of_files = flgpr.score(scored.folder, truth=LANE / "truth.csv", output=tmp_path / "score")
    pd.testing.assert_frame_equal(scored.outcomes(), of_files.outcomes())

    shown = scored._repr_html_()
    assert shown.count("data:image/png;base64,") == 1
    assert "<td>metal</td>" in shown
    assert scored.scores[0].in_words().split(",")[0] in shown


@pytest.mark.slow("draws all figures of a score")
def test_names_of_files_are_escaped(tmp_path):
    (tmp_path / "lane.toml").write_text("x_min = -2\nx_max = 2\ny_min = 0\ny_max = 60\n")
    (tmp_path / "alarms.csv").write_text("x,y,confidence\n0.1,10.2,3\n-1,50,2\n1,30,1\n")
    truth = pd.DataFrame(
        {
            "target_id": ["<i>a</i>", "b"],
            "x": [0.0, 1.0],
            "y": [10.0, 30.0],
            "kind": ["metal", "<script>"],
            "depth": [0.0, 0.05],
        }
    )
    output = tmp_path / "score"
    scored = flgpr.score(
        tmp_path / "alarms.csv", truth=truth, lane=tmp_path / "lane.toml", output=output
    )
    shown = scored._repr_html_()
    assert "&lt;script&gt;" in shown
    assert "&lt;i&gt;a&lt;/i&gt;" in shown
    assert "<script>" not in shown
    assert shown.count("data:image/png;base64,") == 1  # the ROC curve, for there is no run-view


def test_a_truth_in_memory_breaks_the_rules_of_a_file(tmp_path):
    run = open_run(LANE / "run.zarr")
    result = flgpr.detect(run, "demo", report=False)
    with pytest.raises(ValueError, match="y"):
        flgpr.score(result, truth=pd.DataFrame({"target_id": ["a"], "x": [0.0]}))
