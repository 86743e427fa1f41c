"""Figures and tables of reports: long lanes stay readable and cheap."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.method.detection import Detection
from flgpr.model import Grid, Lane
from flgpr.recipe.schema import load_recipe
from flgpr.report import geometry_figure, report_html
from flgpr.report.figures import run_view_figure
from flgpr.results.result import Result
from flgpr.results.score import score_detections
from flgpr.screen import view_array

RUN = {
    "title": "road",
    "source": "",
    "scans": 1000,
    "masked_scans": [],
    "missing_sweeps": 0,
    "pairs": 1,
    "polarizations": ["HH"],
    "tones": 2,
    "frequency_hz": [1e9, 2e9],
    "tx_m": [[0.0, 0.0, 2.0]],
    "rx_m": [[1.0, 0.0, 2.0]],
    "pose": [[0.0, float(y), 2.0, 0.0, 0.0, 0.0] for y in range(1000)],
}


def result_of(length, alarms, folder):
    grid = Grid.spanning((-3.0, 3.0), (0.0, length), 0.1)
    values = np.full((1, 1, grid.ny, grid.nx), 0.1, np.float32)
    values[0, 0, grid.ny // 3, 7] = 5.0
    view = view_array(
        values, np.ones((grid.ny, grid.nx), int), grid, {"polarization": ["HH"], "subband": ["F1"]}
    )
    y = np.linspace(1.0, length - 1.0, alarms)
    table = pd.DataFrame(
        {"alarm_id": [f"a{k}" for k in range(alarms)], "x": 0.0, "y": y, "confidence": -y}
    )
    manifest = {"run": RUN, "flgpr": "0", "python": "3", "libraries": {}, "recipe_sha256": "0"}
    (folder / "recipe.toml").write_text("")
    found = Detection("main", "", table, view)
    return Result(
        Path(folder), manifest, load_recipe("wang2007"), Lane(-1.5, 1.5, 0.0, length), [found]
    )


@pytest.mark.parametrize(("length", "scale"), [(20.0, False), (700.0, True)])
def test_a_long_lane_is_stretched_and_keeps_its_brightest_spot(length, scale, tmp_path):
    figure = run_view_figure(result_of(length, 3, tmp_path), ["main"])
    figure.draw_without_rendering()
    axes = figure.axes[0]
    assert axes.get_window_extent().height > 0.79 * figure.bbox.height, "no empty bands"
    mesh = axes.collections[0]
    levels = mesh.get_array()
    assert ("not to scale" in figure.get_suptitle()) == scale
    assert (axes.get_aspect() == "auto") == scale
    assert levels.shape[0] <= 2400
    row, column = np.unravel_index(np.argmax(levels), levels.shape)
    assert column == 7
    y = mesh.get_coordinates()[row : row + 2, 0, 1].mean()
    assert y == pytest.approx(length / 3, abs=0.31)
    assert figure.get_size_inches()[1] < 30


@pytest.mark.slow("writes many pictures")
def test_only_the_first_ranks_are_written_and_listed(tmp_path):
    result = result_of(700.0, 620, tmp_path)
    assert len(run_view_figure(result, ["main"]).axes[0].texts) == 100
    page = report_html(result)
    assert "The first 500 of 620; alarms.csv has them all." in page
    assert page.count("<tr>") >= 500
    few = report_html(result_of(20.0, 5, tmp_path))
    assert "alarms.csv has them all" not in few
    assert "Not scored: no truth was given." in few
    assert "<td>a4</td>" in few
    assert few.count("data:image/png;base64,") == 4
    assert "No alarms." in report_html(result_of(20.0, 0, tmp_path))


def test_names_from_files_are_shown_and_not_run(tmp_path):
    result = result_of(20.0, 1, tmp_path)
    result.manifest["run"] = RUN | {"title": "<script>alert(1)</script>", "source": '"><img src=x>'}
    page = report_html(result)
    assert "&lt;script&gt;alert(1)" in page
    assert "<script" not in page
    assert "<img src=x" not in page


def test_a_score_is_not_titled_by_what_was_said_before_the_truth_was_known(tmp_path):
    result = result_of(20.0, 3, tmp_path)
    truth = pd.DataFrame(
        {"target_id": ["t"], "kind": ["metal"], "depth": [0.05], "x": [0.1], "y": [3.0]}
    )
    assert "<h1>road: 3 alarms</h1>" in report_html(result)
    assert "<h1>road</h1>" in report_html(result, score_detections(result, truth))


def test_stops_of_a_long_run_are_thinned_out():
    figure = geometry_figure(RUN, Lane(-1.5, 1.5, 0.0, 1000.0), None, 0.4)
    figure.draw_without_rendering()
    plan = figure.axes[0]
    assert 200 <= len(plan.lines) <= 400


def test_rays_from_the_side_go_ahead():
    _, side = geometry_figure(RUN, Lane(-1.5, 1.5, 0.0, 1000.0), None, 0.4).axes
    rays = [line.get_xdata() for line in side.lines if line.get_color() == "0.6"]
    assert rays
    assert all(end >= start for start, end in rays)
