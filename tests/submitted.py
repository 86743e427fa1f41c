"""A small proving ground with tiers, and a submission to it made of its truth."""

import pandas as pd

from flgpr.proving_ground import load_ground
from flgpr.store import write_table
from grounds import TINY

CARD = """
format = "flgpr-submission-1"
ground = "tiny-3"
name = "hand-made"
version = "1.0"
method = "Alarms where the targets lie, and where none do"
authors = ["A. Author", "B. Author"]
date = 2026-11-20
licence = "CC-BY-4.0"
trained_on = "the training lanes of each fold, and nothing else"
test_lanes_seen = false
test_truth_seen = false
[cost]
hardware = "one core of a laptop"
seconds_per_km = 120
training_seconds = 30
[parameters]
threshold = 0.5
window = "hann"
"""


def write_ground(home):
    """Write the description, and return it with its file."""
    path = home / "ground.toml"
    path.write_text(TINY)
    return path, load_ground(False, path)


def prints_of(ground):
    """Return a table of fingerprints of all lanes."""
    rows = [{"lane": name, "sha256": "0" * 64, "HH": 1e-4} for name in ground.lanes]
    return pd.DataFrame(rows)


def write_submission(folder, ground, card=CARD, splits=("standard",), tiers=None, share=2):
    """Write a submission that finds one of ``share`` targets, with a false alarm per lane."""
    folder.mkdir()
    (folder / "submission.toml").write_text(card, encoding="utf-8")
    write_table(prints_of(ground), folder / "fingerprints.csv")
    for split in splits:
        for lane in ground.tested(split):
            if tiers is not None and lane.tier not in tiers:
                continue
            found = lane.truth()[["x", "y"]].iloc[::share].assign(confidence=2.0)
            false = pd.DataFrame({"x": [-1.4], "y": [lane.length - 0.1], "confidence": [1.0]})
            table = pd.concat([found, false], ignore_index=True)
            own_folder = folder / split / lane.name
            own_folder.mkdir(parents=True)
            write_table(table, own_folder / "alarms.csv")
    return folder
