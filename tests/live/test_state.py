"""Snapshots: the same bits go on, little is stored, and damage is refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.live.detector import LiveDetector
from flgpr.live.intake import Intake
from flgpr.live.state import (
    SnapshotError,
    read_snapshot,
    restore_snapshot,
    take_snapshot,
    write_snapshot,
)
from flgpr.method.classifier import make_training_set
from flgpr.method.estimators import train_estimator
from flgpr.method.method import detect
from flgpr.recipe.schema import parse_recipe
from flgpr.store import Scan, canonical_json, describe_for_live
from live_lane import LANE, SCANS, TARGETS, make_lane_run, small_recipe

PLUGIN = Path(__file__).parents[1] / "plugin"
STAGE = '\n[[columns]]\nstage = "sharpness"\nradius = 0.3\n'
DETECTOR = '\n[detector]\nestimator = "logistic"\nfeatures = ["sharp_HH", "C_HH_F1"]\n'


@pytest.fixture(scope="module")
def run():
    return make_lane_run()


@pytest.fixture(scope="module")
def recipe():
    return parse_recipe(small_recipe())


@pytest.fixture(scope="module")
def scans(run):
    time, pose, signal = (run[name].values for name in ("time", "pose", "signal"))
    return [Scan(k, float(time[k]), pose[k], signal[k]) for k in range(SCANS)]


def start(run, recipe, **options):
    return LiveDetector(describe_for_live(run), recipe, options.pop("lane", LANE), **options)


def play(detector, scans):
    updates = [detector.add(scan) for scan in scans]
    detector.finish()
    return updates


@pytest.fixture(scope="module")
def played(run, recipe, scans):
    detector = start(run, recipe)
    return detector, play(detector, scans)


@pytest.fixture(scope="module")
def sharp(run, tmp_path_factory):
    """A recipe with the sample plug-in's stage and an estimator of scikit-learn, and what batch finds with it."""
    about = tmp_path_factory.mktemp("site") / "flgpr_sharpness-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: flgpr-sharpness\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[flgpr.stages]\nsharpness = flgpr_sharpness:Sharpness\n"
    )
    with pytest.MonkeyPatch.context() as patch:
        for folder in (PLUGIN, about.parent):
            patch.syspath_prepend(str(folder))
        recipe = parse_recipe(small_recipe() + STAGE + DETECTOR)
    found = detect(run, recipe, LANE)
    truth = pd.DataFrame(TARGETS, columns=["x", "y"]).assign(
        kind="metal", depth=0.05, target_id=list("abcde")
    )
    truth = truth.assign(radius=0.15, height=0.1, lane="one")
    examples = make_training_set([("one", found.alarms, found.features, truth, LANE)], 0.5)
    return recipe, train_estimator(examples, recipe.detector, recipe.detector.features)


@pytest.fixture(scope="module")
def sharp_played(run, scans, sharp):
    detector = start(run, sharp[0], model=sharp[1])
    return detector, play(detector, scans)


@pytest.mark.slow("plays a lane with every kind of detector twice")
@pytest.mark.parametrize("how", ["contrast", "estimator"])
def test_a_snapshot_goes_on_bit_by_bit(run, recipe, scans, request, tmp_path, how):
    recipe, model = (recipe, None) if how == "contrast" else request.getfixturevalue("sharp")
    whole, expected = request.getfixturevalue("played" if how == "contrast" else "sharp_played")
    first = start(run, recipe, model=model)
    intake = Intake(describe_for_live(run))
    for scan in scans[:23]:
        first.add(scan)
    write_snapshot(tmp_path / "s.npz", take_snapshot(first, intake, {"scan-000022.scan"}, "mark"))
    second = start(run, recipe, model=model)
    assert restore_snapshot(read_snapshot(tmp_path / "s.npz"), second, intake, "mark") == {
        "scan-000022.scan"
    }
    for scan, update in zip(scans[23:], expected[23:], strict=True):
        mine = second.add(scan)
        assert mine.alarms == update.alarms
        np.testing.assert_array_equal(mine.view, update.view)
    second.finish()
    pd.testing.assert_frame_equal(second.table(), whole.table())


def test_passed_alarms_are_a_few_bytes_each(run, played, monkeypatch):
    """After hours on the road a snapshot is still written at once: their words do not grow with them."""
    detector = played[0]
    intake = Intake(describe_for_live(run))
    words, arrays = take_snapshot(detector, intake, set(), "")
    known = len(detector.table())
    size = sum(array.nbytes for array in arrays.values())
    monkeypatch.setattr(detector.alarms, "passed", detector.alarms.passed * 1000)
    more, grown = take_snapshot(detector, intake, set(), "")
    assert len(canonical_json(more)) == len(canonical_json(words))
    assert sum(array.nbytes for array in grown.values()) == size + 999 * known * 48
    table = detector.table()
    assert len(table) == 1000 * known > 10_000
    assert table["alarm_id"].nunique() == known


def test_a_snapshot_of_something_else_or_damaged_is_refused(run, recipe, scans, tmp_path):
    detector = start(run, recipe)
    intake = Intake(describe_for_live(run))
    for scan in scans[:6]:
        detector.add(scan)
    path = tmp_path / "s.npz"
    assert read_snapshot(path) is None
    write_snapshot(path, take_snapshot(detector, intake, set(), "mark"))
    with pytest.raises(SnapshotError, match="another run"):
        restore_snapshot(read_snapshot(path), start(run, recipe), intake, "other")
    data = path.read_bytes()
    for at in np.linspace(0, len(data) - 1, 60).astype(int):
        path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        with pytest.raises(SnapshotError, match="`fresh`"):
            read_snapshot(path)
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(SnapshotError, match="`fresh`"):
        read_snapshot(path)
