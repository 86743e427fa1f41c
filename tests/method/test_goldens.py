"""What the chains find on lanes that no simulator makes, frozen: the sample lane and a lane of point scatterers.

``PYTHONPATH=tests python tests/method/test_goldens.py`` writes the tables anew; a change of them is a change of the
results, and must be meant.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.commands.runs import DEMO_COMPARISONS
from flgpr.live.detector import LiveDetector
from flgpr.method.classifier import make_training_set, train
from flgpr.method.method import detect
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.store import Scan, describe_for_live, open_run, sample_lane
from live_lane import LANE as LIVE_LANE
from live_lane import make_lane_run
from live_lane import small_recipe as live_recipe
from small_lane import LANE, TARGETS, small_recipe, small_run

FOLDER = Path(__file__).parent.parent / "data" / "goldens"
DIGITS = 6
DEMO = ("demo", *(f"demo-{name}" for name in DEMO_COMPARISONS))


def levels(view):
    """Mean, spread and largest of every channel of a run-view."""
    rows = [
        {
            "channel": f"{p}-{s}",
            "mean": one.mean().item(),
            "spread": one.std().item(),
            "largest": one.max().item(),
        }
        for p in view["polarization"].values
        for s in view["subband"].values
        for one in [view.sel(polarization=p, subband=s)]
    ]
    return pd.DataFrame(rows)


def demo():
    """Alarms of the recipe demo and of those beside it, and its run-view."""
    run = open_run(sample_lane() / "run.zarr")
    found = {name: detect(run, load_recipe(name)) for name in DEMO}
    alarms = pd.concat(
        [one.alarms.assign(recipe=name) for name, one in found.items()], ignore_index=True
    )
    return {"demo-alarms": alarms, "demo-view": levels(found["demo"].view)}


def features():
    """Alarms and features of a small lane, and what a classifier that was trained on them says."""
    run = small_run()
    recipe = parse_recipe(small_recipe())
    found = detect(run, recipe, LANE)
    truth = pd.DataFrame(
        {
            "target_id": ["a", "b", "c"],
            "x": TARGETS[:, 0],
            "y": TARGETS[:, 1],
            "kind": "metal",
            "depth": 0.05,
        }
    ).assign(radius=0.15, height=0.1, lane="one")
    model = train(
        make_training_set([("one", found.alarms, found.features, truth, LANE)], 0.5),
        ("C_HH_F1", "C_VV_F1"),
    )
    judged = detect(run, recipe, LANE, model=model).alarms
    tables = {
        "alarms": found.alarms,
        "features": found.features,
        "view": levels(found.view),
        "judged": judged,
    }
    return {f"small-{name}": table for name, table in tables.items()}


def live():
    """Final alarms of a lane that came scan by scan."""
    run = make_lane_run()
    detector = LiveDetector(describe_for_live(run), parse_recipe(live_recipe()), LIVE_LANE)
    time, pose, signal = (run[name].values for name in ("time", "pose", "signal"))
    for k in range(run.sizes["scan"]):
        detector.add(Scan(k, float(time[k]), pose[k], signal[k]))
    detector.finish()
    return {"live-alarms": detector.table()}


@pytest.mark.parametrize("chain", [demo, features, live], ids=lambda chain: chain.__name__)
def test_a_chain_finds_what_it_found(chain):
    for name, table in chain().items():
        want = pd.read_csv(FOLDER / f"{name}.csv")
        assert list(table.columns) == list(want.columns), name
        assert len(table) == len(want), name
        for column in want.columns:
            got = table[column].to_numpy()
            frozen = want[column].to_numpy()
            if np.issubdtype(frozen.dtype, np.number):
                scale = np.nanmax(np.abs(frozen), initial=0)
                np.testing.assert_allclose(
                    got.astype(float),
                    frozen,
                    rtol=1e-3,
                    atol=1e-3 * scale,
                    err_msg=f"{name}.{column}",
                )
            else:
                np.testing.assert_array_equal(
                    got.astype(str), frozen.astype(str), err_msg=f"{name}.{column}"
                )


if __name__ == "__main__":
    for chain in (demo, features, live):
        for name, table in chain().items():
            table.to_csv(FOLDER / f"{name}.csv", index=False, float_format=f"%.{DIGITS}g")
