"""Figures of curves: what is drawn, and equal bytes for equal figures."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.colors import to_rgb

from flgpr.report.curve_figures import compared_roc_figure
from flgpr.scoring import example_roc
from flgpr.trials import figure_bytes, patch_figure, roc_figure

CURVE = example_roc([4.0, 3.0, 2.0, 1.0], [True, False, True, True], area=50.0)
BAND = pd.DataFrame({"far": [0.0, 0.1], "pd_low": [0.0, 0.5], "pd_high": [0.5, 1.0]})


def test_a_curve_is_a_staircase_to_the_end_of_the_axis():
    (axes,) = roc_figure({"all": CURVE}, far_max=0.05).axes
    (line,) = axes.lines
    assert line.get_drawstyle() == "steps-post"
    assert line.get_xdata()[-1] == 0.05
    assert line.get_ydata()[-1] == CURVE["pd"].iloc[-1]


def test_chance_is_dotted_in_the_colour_of_its_curve():
    (axes,) = roc_figure({"all": CURVE.assign(chance=0.1)}).axes
    curve, chance = axes.lines
    assert chance.get_color() == curve.get_color()
    assert chance.get_label() == "chance"


def test_three_bands_have_a_panel_each():
    names = ["a", "b", "c"]
    curves = dict.fromkeys(names, CURVE)
    assert len(roc_figure(curves, dict.fromkeys(names[:2], BAND)).axes) == 1
    assert len(roc_figure(curves, dict.fromkeys(names, BAND)).axes) == 3


def test_curves_of_two_conventions_are_not_drawn_together():
    other = CURVE.copy()
    other.attrs["convention"] = "box"
    with pytest.raises(ValueError, match=r"share one convention .* got box, examples"):
        roc_figure({"a": CURVE, "b": other})


def test_patches_are_drawn_by_modulus_with_y_upwards():
    first, second = patch_figure([np.full((2, 3), 3 + 4j), np.ones((2, 2))], ["a", "b"]).axes
    assert first.images[0].get_array().max() == 5
    assert first.images[0].origin == "lower"
    assert second.get_title() == "b"
    with pytest.raises(ValueError, match="equally many and some, got 0 and 0"):
        patch_figure([], [])


@pytest.mark.parametrize("kind", ["png", "pdf", "svg"])
def test_equal_figures_give_equal_bytes(kind):
    assert figure_bytes(roc_figure({"all": CURVE}), kind) == figure_bytes(
        roc_figure({"all": CURVE}), kind
    )


def test_compared_curves_are_told_apart_without_colour():
    names = ["a", "b", "c", "d"]
    single = CURVE.iloc[[0, -1]]
    single.attrs = CURVE.attrs
    curves = {"a": CURVE, "b": CURVE, "c": CURVE, "d": single}
    points = pd.concat(
        [CURVE.iloc[[1]].assign(detector=name, far_allowed=CURVE["far"].iloc[1]) for name in names]
    )
    figure = compared_roc_figure(curves, {name: f"V: {name}" for name in names}, points, 0.05)
    (axes,) = figure.axes
    (legend,) = figure.legends
    shown = legend.get_lines()
    styles = {(line.get_marker(), str(line._unscaled_dash_pattern)) for line in shown[:4]}
    assert len(styles) == 4
    greys = [np.dot(to_rgb(line.get_color()), (0.299, 0.587, 0.114)) for line in shown[:3]]
    assert min(abs(np.diff(sorted(greys)))) > 0.05
    assert legend.get_texts()[0].get_text() == "V: a (3)"
    # A bar at the point and at the last alarm of each; a list of one point has that one alone.
    bars = [len(lines.get_segments()) for lines in axes.collections]
    assert bars == [2, 2, 2, 1]
    for lines in axes.collections:
        for (x, low), (_, high) in lines.get_segments():
            assert 0 <= x <= axes.get_xlim()[1]
            assert 0 <= low < high <= 1
