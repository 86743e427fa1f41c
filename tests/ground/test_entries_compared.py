"""One entry beside others, evidence/entries_compared.py, on numbers that are known."""

import importlib.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.scoring import match

pytestmark = pytest.mark.slow("of a script, whose numbers stand on a page")

SCRIPT = Path(__file__).parents[2] / "evidence" / "entries_compared.py"


@pytest.fixture(scope="module")
def compared():
    spec = importlib.util.spec_from_file_location("entries_compared", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def matched(confidence=(3.0, 2.0, 1.0, 0.0)):
    """Two lanes: on the first a hit, a false alarm and a hit, on the second a false alarm."""
    alarms = pd.DataFrame({
        "x": 0.0, "y": [5.0, 10.0, 15.0, 5.0], "confidence": confidence,
        "lane": ["sand", "sand", "sand", "bare"],
    })  # fmt: skip
    truth = pd.DataFrame({
        "target_id": ["a", "b", "c"], "x": 0.0, "y": [5.0, 15.0, 18.5],
        "kind": ["metal", "metal", "plastic"], "depth": 0.05, "lane": "sand",
    })  # fmt: skip
    lanes = {"sand": Lane(-1.0, 1.0, 0.0, 20.0), "bare": Lane(-1.0, 1.0, 0.0, 10.0)}
    return match(alarms, truth, lanes, 1.0)


def test_targets_are_found_behind_the_false_alarms_of_the_chosen_lanes(compared):
    both = compared.found_in(matched(), ["sand", "bare"])
    one = compared.found_in(matched(), ["sand"])
    assert np.isinf(both.far[2])
    assert np.isinf(one.far[2])
    assert both.far[0] == one.far[0] == 0.0
    assert both.far[1] == both.least
    assert one.far[1] == one.least > both.least
    late = compared.found_in(matched((3.0, 2.0, 1.0, 1.5)), ["sand", "bare"])
    assert late.far[1] == 2 * late.least


def found(compared, far):
    kind = ["metal"] * len(far)
    return compared.Found(pd.DataFrame({"kind": kind}), np.array(far), 0.001)


def test_pairs_are_counted_at_the_rate(compared):
    first = found(compared, [0.0, 0.0, 0.02, np.inf])
    second = found(compared, [0.0, 0.5, 0.5, 0.01])
    cells = compared.paired_cells(first, second, "metal")
    assert cells[0].startswith("3 of 4 (")
    assert cells[1].startswith("2 of 4 (")
    assert cells[2:] == ["+2 -1", "1"]
    assert compared.paired_cells(first, second, "plastic")[2] == "+0 -0"
    assert compared.paired_cells(first, second, "mines", ("plastic",))[0].startswith("0 of 0")
    assert compared.paired_cells(first, second, "mines", ("metal",)) == cells


def test_no_false_alarm_counts_as_one_in_a_ratio(compared):
    first = found(compared, [0.0] * 10)
    second = found(compared, [0.002] * 10)
    assert compared.ratio_cell(first, second, "metal", 0.7) == "0.0010, 0.0020: 0.50 (0.50 to 0.50)"
    never = found(compared, [np.inf] * 10)
    assert compared.ratio_cell(first, never, "metal", 0.7) == "0.0010, never"


def test_a_calibration_error_is_that_of_the_bins(compared):
    p = np.array([0.25, 0.25, 0.25, 0.25, 0.95, 0.95])
    hit = np.array([1, 0, 0, 0, 1, 0], dtype=bool)
    assert compared.calibration_error(p, hit) == pytest.approx(2 * 0.45 / 6)
    assert compared.calibration_error(np.array([1.0]), np.array([True])) == 0.0


def test_the_interval_of_a_calibration_error_holds_it_and_right_probabilities_are_near(compared):
    rng = np.random.default_rng(1)
    p = rng.uniform(0, 1, 4000)
    right = compared.Stated(p, rng.random(4000) < p, np.arange(4000) // 40)
    cells = compared.calibration_cells(right)
    assert cells[0] == "4000"
    error = float(cells[2].split()[0])
    middle, most = (float(value) for value in cells[3].split(", "))
    assert middle / 2 < error <= 1.2 * most
    wrong = compared.Stated(p**2, right.hit, right.stretch)
    error = float(compared.calibration_cells(wrong)[2].split()[0])
    assert error == pytest.approx(1 / 6, abs=0.02)  # the mean of p - p²


def test_alarms_beyond_the_borders_state_nothing(compared):
    stated = compared.stated_in(matched(), ["sand"])
    assert stated.hit.tolist() == [True, False, True]
    np.testing.assert_allclose(stated.p, 1 / (1 + np.exp([-3.0, -2.0, -1.0])))
    assert stated.stretch.tolist() == [0, 1, 1]


def test_the_best_of_the_others_is_chosen_by_its_mines(compared):
    class Three(compared.Compared):
        def __init__(self):
            pass

        def entries(self, _split):
            return ["own", "good", "as good", "bad"]

        def scored(self, _split):
            return ()

        def found(self, entry, _split, _site):
            far = {"own": [0.0] * 4, "bad": [0.5] * 4}.get(entry, [0.0, 0.0, 0.5, 0.5])
            return found(compared, far)

    assert Three().best("standard", "sand", "own") == ["good", "as good"]
