"""Every packaged recipe on a lane of 30 m with three mines: it trains, or says what to change, and then trains."""

import pandas as pd
import pytest

import flgpr
from few_mines import MINES, counts_of, follow, resized
from flgpr.recipe.schema import parse_recipe, recipe_names

pytestmark = pytest.mark.slow("trains every packaged recipe")


def train(three_mines, name, text, folder):
    recipe = folder / f"{name}.toml"
    recipe.write_text(text)
    truth = [three_mines / "truth.csv"]
    borders = [three_mines / "lane.toml"]
    return flgpr.train([three_mines / "run.zarr"], truth, recipe, folder / "model", lanes=borders)


def trained_as_advised(three_mines, name, text, folder):
    """Train; where three mines are too few, check what is said, and do what is advised."""
    try:
        return text, train(three_mines, name, text, folder)
    except ValueError as error:
        message = str(error)
    assert name == "flsar2004", (
        message
    )  # its thresholds rest on two mines, and hold in all ranges of a polarization
    assert "screen.clusters raised no alarm at the targets left for the detector" in message
    assert 'Set rule = "or" in [screen] (now "and-or")' in message
    counts = counts_of(message)
    assert counts["targets in the truth (3 metal)"] == len(MINES)
    assert counts["taken by screen.clusters"] == counts["taken by features.templates"] == 2
    assert counts["targets left for the detector"] == 1
    assert counts["hits on targets left for the detector"] == counts["hits with all features"] == 0
    advised = follow(text, message)
    assert parse_recipe(advised).screen.settings.rule == "or"
    return advised, train(three_mines, name, advised, folder)


@pytest.mark.parametrize("name", recipe_names())
def test_every_packaged_recipe_trains_on_three_mines_and_detects(three_mines, name, tmp_path):
    text = resized(name, three_mines)
    model = None
    if not name.startswith("demo"):
        text, trained = trained_as_advised(three_mines, name, text, tmp_path)
        model = tmp_path / "model"
        assert set(parse_recipe(text).learning()) <= set(trained.stages)
        assert trained.stages or trained.detector is not None
    recipe = tmp_path / f"{name}.toml"
    recipe.write_text(text)
    flgpr.detect(
        three_mines / "run.zarr",
        recipe,
        tmp_path / "result",
        three_mines / "lane.toml",
        model=model,
        report=False,
    )
    alarms = pd.read_csv(tmp_path / "result" / "alarms.csv")
    assert len(alarms) > 0
    assert alarms["confidence"].notna().all()
