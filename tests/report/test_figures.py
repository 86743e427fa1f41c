"""Figures of a report: their panels, labels and what they leave out."""

import numpy as np
import pandas as pd
import xarray as xr

from flgpr.report.figures import (
    channel_figure,
    complete_roc_figure,
    run_view_figure,
)
from flgpr.report.images import image_figure
from flgpr.results.result import read_result
from flgpr.results.score import score_detections
from small_results import small_result

TRUTH = pd.DataFrame(
    {"target_id": ["t"], "kind": ["metal"], "depth": [0.05], "x": [0.1], "y": [3.0]}
)


def volume(z):
    shape = (2, len(z), 5, 4)
    values = np.random.default_rng(0).random(shape).astype(np.complex64)
    coords = {
        "polarization": ["HH", "VV"],
        "z": np.array(z, float),
        "y": np.arange(5) * 0.5,
        "x": np.arange(4) * 0.5,
    }
    return xr.DataArray(values, dims=tuple(coords), coords=coords, attrs={"title": "a line"})


def test_run_view_and_channels_are_drawn_with_alarms_and_lane(tmp_path):
    result = read_result(small_result(tmp_path / "result"))
    figure = run_view_figure(result, ["main"], TRUTH)
    axes = figure.axes[0]
    assert axes.get_title() == "recipe as it stands"
    assert [text.get_text() for text in axes.texts] == ["1", "2", "3"]  # ranks
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["alarm, with rank", "lane", "metal mine", "halo"]
    assert channel_figure(result).axes[0].get_title() == "HH  F1 (0.75 to 1.35 GHz)"


def test_the_roc_goes_on_beyond_its_last_alarm(tmp_path):
    result = read_result(small_result(tmp_path / "result"))
    scored = score_detections(result, TRUTH)
    axes = complete_roc_figure(scored).axes[0]
    curve = scored[0].curve
    drawn = axes.lines[0].get_xydata()
    assert len(drawn) == len(curve) + 1
    assert drawn[-1, 1] == curve["pd"].iloc[-1]
    assert drawn[-1, 0] > curve["far"].iloc[-1]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert labels == ["all targets", "chance"]


def test_a_plane_has_one_panel_and_a_volume_three():
    peaks = pd.DataFrame({"x": [0.5], "y": [1.0], "z": [0.0]})
    pose = np.zeros((3, 6))
    plane = image_figure(volume([0.0]), peaks, pose)
    solid = image_figure(volume([-0.2, -0.1, 0.0]), peaks, pose)
    panels = [len([a for a in figure.axes if a.images]) for figure in (plane, solid)]
    assert panels == [2, 6]  # by polarization
    assert plane.get_suptitle() == "a line, z = 0 m"
    assert solid.get_suptitle() == "a line"


def test_places_of_a_raster_do_not_hide_the_picture():
    places = np.zeros((1600, 6))
    places[:, :2] = np.stack(
        np.meshgrid(np.linspace(0, 1.5, 40), np.linspace(0, 2, 40)), -1
    ).reshape(-1, 2)
    peaks = pd.DataFrame({"x": [], "y": [], "z": [], "level": []})
    dots = image_figure(volume([0.0]), peaks, places).axes[0].lines[0]
    assert 100 < len(dots.get_xdata()) <= 300
    way = places[:40]
    dots = image_figure(volume([0.0]), peaks, way).axes[0].lines[0]
    assert len(dots.get_xdata()) == 40
