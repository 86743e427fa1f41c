"""The figure of a scene shows every kind with its count, and depths as lines."""

import numpy as np
import pandas as pd

from flgpr.model import Lane
from flgpr.report.scene_preview import scene_figure

TARGETS = pd.DataFrame(
    {
        "kind": ["metal", "plastic", "metal"],
        "x": [0.0, 0.5, -0.5],
        "y": [2.0, 4.0, 6.0],
        "top": [0.05, 0.1, 0.0],
        "bottom": [0.15, 0.2, 0.1],
    }
)
OBJECTS = pd.DataFrame(
    {"kind": ["rock", "rock", "tank"], "x": [1.0, 1.0, 3.0], "y": [1.0, 30.0, 3.0]}
)


def draw():
    patches = np.array([[0.0, 5.0, 1.0]])
    return scene_figure("lane, seed 1", Lane(-2, 2, 0, 10), TARGETS, OBJECTS, patches, 4.0)


def test_the_legend_counts_every_kind():
    plan, _ = draw().axes
    labels = [text.get_text() for text in plan.get_legend().get_texts()]
    assert labels == ["lane", "metal (2)", "plastic (1)", "rock (1 of 2)", "tank (1)"]
    assert plan.get_ylim() == (-4.0, 4.0)


def test_the_section_has_depths_in_centimetres_downwards():
    _, section = draw().axes
    metal, plastic = section.collections
    np.testing.assert_allclose(metal.get_segments()[0], [[2, 5], [2, 15]])
    np.testing.assert_allclose(plastic.get_segments()[0], [[4, 10], [4, 20]])
    low, high = section.get_ylim()
    assert low > high, "depth grows downwards"
    assert section.get_xlim() == (-2.0, 12.0)
