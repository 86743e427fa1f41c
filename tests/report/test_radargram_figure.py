"""The figure of a radargram: its axes and the range of its grey scale."""

import numpy as np
import pytest

from flgpr.report.images import radargram_figure

DELAY = np.arange(50) * 1e-9
NUMBER = np.arange(20)


def figure_of(distance=None, depth=None, values=None):
    if values is None:
        values = np.random.default_rng(0).normal(size=(20, 50))
    return radargram_figure(values, DELAY, NUMBER, distance, depth, "line", "mV", ["dewow"])


def test_even_distances_are_the_axis_and_uneven_ones_stand_above():
    even = figure_of(distance=NUMBER * 0.1)
    assert even.axes[0].get_xlabel() == "distance along the line (m)"
    assert even.axes[0].images[0].get_extent()[:2] == pytest.approx([-0.05, 1.95])
    uneven = figure_of(distance=NUMBER**2 * 0.1)
    assert uneven.axes[0].get_xlabel() == "trace"
    (above,) = uneven.axes[0].child_axes
    assert above.get_xlabel() == "distance along the line (m), uneven"


def test_depth_stands_on_the_right():
    (axis,) = figure_of(depth=DELAY * 1e9 * 0.05).axes[0].child_axes
    assert axis.get_ylabel() == "depth (m)"


def test_a_silent_line_has_a_scale_too():
    values = np.zeros((20, 50))
    values[3, 4] = np.nan
    image = figure_of(values=values).axes[0].images[0]
    assert image.get_clim() == (-1.0, 1.0)


def test_the_title_names_the_steps():
    assert figure_of().axes[0].get_title() == "line\ndewow"
