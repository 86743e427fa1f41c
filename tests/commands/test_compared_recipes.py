"""A recipe that is compared with a result's own detects under its own name."""

import pandas as pd

from flgpr.commands.runs import DEMO_COMPARISONS, detect_compared
from flgpr.method.method import detect
from flgpr.progress import silent
from flgpr.recipe.schema import parse_recipe, recipe_names, recipe_text
from flgpr.store import open_run, sample_lane


def test_recipes_of_the_demonstration_are_packaged():
    assert {f"demo-{name}" for name in DEMO_COMPARISONS} <= set(recipe_names())


def test_a_detection_has_name_text_and_the_alarms_of_its_recipe():
    run = open_run(sample_lane() / "run.zarr")
    text = recipe_text("demo-mean-self-signature")
    recipe = parse_recipe(text)
    lane = recipe.lane.lane()
    labels = []

    def track(items, label, total):
        labels.append(label)
        assert total >= 0
        return items

    compared = detect_compared(run, "mean", text, lane, track)
    assert compared.name == "mean"
    assert compared.recipe_text == text
    expected = detect(run, recipe, lane, silent)
    pd.testing.assert_frame_equal(compared.alarms, expected.alarms)
    assert labels
    assert all(label.startswith("mean: ") for label in labels)
