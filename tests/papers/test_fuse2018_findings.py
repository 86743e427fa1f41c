"""Judging statements of the paper, frame by frame."""

import numpy as np
import pandas as pd
import pytest

from flgpr_papers.fuse2018.findings import STATEMENTS, clutter_findings, follow
from flgpr_papers.fuse2018.lanes import (
    fuse_recipe,
)
from flgpr_papers.kit.intervals import clustered

pytestmark = pytest.mark.slow("studies of papers")

RECIPE = fuse_recipe(True)


RECIPE = RECIPE.model_copy(
    update={
        "image": RECIPE.image.model_copy(update={"frames": 2, "spacing": 0.2}),
        "study": RECIPE.study.model_copy(update={"every": 2, "loose_every": 2}),
        "lanes": RECIPE.lanes.model_copy(update={"length": 16.0}),
    }
)


def test_what_stays_from_frame_to_frame_is_followed_and_what_does_not_is_dropped():
    rng = np.random.default_rng(4)
    still = pd.DataFrame(
        {"frame": np.repeat(range(4), 2), "x": [0.0, 1.2] * 4, "y": [5.0] * 8, "magnitude": 3.0}
    )
    still[["x", "y"]] += rng.normal(0, 0.05, (8, 2))
    still.loc[0, "magnitude"] = 9.0  # one bright frame does not make a track bright
    stray = pd.DataFrame({"frame": np.repeat(range(4), 10), "magnitude": 5.0})
    stray = stray.assign(x=np.arange(40) * 1.5, y=20.0)
    tracks = follow(pd.concat([stray, still]), 0.5, 2)
    assert len(tracks) == 2
    assert sorted(tracks["frames"]) == [4, 4]
    np.testing.assert_allclose(np.sort(tracks["x"]), [0.0, 1.2], atol=0.1)
    assert (tracks["confidence"] == 3.0).all()
    assert follow(stray, 0.5, 2).empty
    assert len(follow(stray, 0.5, 1)) == 40


def test_intervals_and_verdicts():
    rng = np.random.default_rng(0)
    held = 0
    for seed in range(100):
        centre = np.repeat(rng.normal(0, 1, 30), 4)
        mean, low, high = clustered(
            centre + rng.normal(0, 0.1, 120), np.repeat(np.arange(30), 4), 300, seed
        )
        assert low <= mean <= high
        held += low <= 0 <= high
    assert 86 <= held <= 99
    assert np.isnan(clustered([], [], 10)).all()
    words = {"looks": 9, "mines": 3, "halo": ""}
    kept = [
        STATEMENTS.number("kept", (-0.2, *ends), **words)
        for ends in ((-0.5, 0.5), (-3, -2), (-2, 0))
    ]
    assert [one.verdict for one in kept] == [
        "agrees",
        "disagrees",
        "cannot say",
    ]


def made_up_boxes(powers):
    """Clutter boxes of many objects whose power falls so much, dB, by stage, with a little spread."""
    rng = np.random.default_rng(7)
    count = 40
    boxes = pd.DataFrame(
        {"cluster": [f"O{k}" for k in range(count)], "frame": np.arange(count), "lane": "A"}
    )
    for stage, fall in powers.items():
        boxes[stage] = 10 ** ((-fall + rng.normal(0, 0.3, count)) / 10)
    return boxes.assign(**{"#0": 1.0})


@pytest.mark.parametrize(
    ("third", "verdict"),
    [(12.0, "agrees"), (25.0, "disagrees"), (20.0, "disagrees")],
)
def test_the_best_combination_is_better_than_each_of_the_others(third, verdict):
    """#6 over #5 does not suffice: here #3 is worse, better, or alike."""
    falls = {f"#{k}": 3.0 * k for k in range(1, 6)} | {"#3": third, "#6": 20.0}
    falls |= {f"iteration {k}": 2.0 * k for k in range(8)}
    found = {one.claim: one for one in clutter_findings(made_up_boxes(falls), RECIPE)}
    best = found["#6 is the best combination"]
    assert best.verdict == verdict
    assert len(best.parts) == 6
    assert all(f"#{k} less #6" in best.ours for k in range(6))
