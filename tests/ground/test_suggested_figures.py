"""The figures that ``flgpr recipe suggest`` tells are those of the proving ground's table."""

from importlib import resources

import pandas as pd
import pytest

from flgpr.recipe.suggest import MADE, evidence

ENTRIES = {MADE: "wang2007", "flsar2004": "flsar2004-rvm"}


@pytest.mark.parametrize("tier", ["prepared", "as-found"])
def test_suggested_figures_are_those_of_the_proving_ground(tier):
    path = resources.files("flgpr_ground") / "scores-proving-ground-2.csv"
    with path.open(encoding="utf-8") as file:
        scores = pd.read_csv(file)
    of_mines = scores[(scores["split"] == "standard") & (scores["group"] == "mines")]
    rows = of_mines[(of_mines["tier"] == tier) & (of_mines["far_allowed"] == 0.02)].set_index(
        "entry"
    )
    for name, found in evidence()["found"].items():
        row = rows.loc[ENTRIES.get(name, name)]
        assert found[tier] == row["n_detected"]
        assert evidence()["tracks"][tier]["of"] == row["n_targets"]
    for name, p_values in evidence()["p"].items():
        assert p_values[tier] == pytest.approx(rows.loc[ENTRIES.get(name, name), "p"], rel=0.15)
