"""Experiments on why statements do not hold: what a trial says, what is measured, and the command."""

import csv
import math
from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Grid, Lane
from flgpr_papers.flsar2004 import examples, machines
from flgpr_papers.flsar2004.findings import Measure
from flgpr_papers.flsar2004.lanes import load_settings
from flgpr_papers.kit.findings import measured, write_findings
from reasons import __main__ as script
from reasons import cosgrove2004, flsar2004, fuse2018, wang2007
from reasons.trials import COLUMNS, Trial, declared_trials, road_trials, trials_csv

pytestmark = pytest.mark.slow("studies of papers")


@pytest.fixture
def rng():
    return np.random.default_rng(23)


def noise(rng, *shape):
    return rng.normal(size=shape) + 1j * rng.normal(size=shape)


@pytest.mark.parametrize(
    ("interval", "outcome"),
    [
        ((0.5, 0.4, 0.6), "holds"),
        ((0.5, 0.2, 0.6), "cannot say"),
        ((0.1, 0.0, 0.2), "refuted"),
        ((0.5, -math.inf, math.inf), "cannot say"),
        ((math.nan, math.nan, math.nan), "cannot say"),
    ],
)
def test_a_prediction_is_held_against_the_interval(interval, outcome):
    trial = Trial("a claim", "because", "a change", "a number", interval, "6 seeds", (0.3, 1.0))
    assert trial.outcome == outcome
    assert trial.prediction == "0.3 to 1"


def test_a_number_without_a_prediction_says_nothing_of_an_explanation():
    trial = Trial("a claim", "", "nothing", "a number", (0.21, 0.18, 0.24), "6 seeds")
    assert trial.outcome == trial.prediction == ""
    assert trial.ours == "0.210 (0.180 to 0.240)"
    with pytest.raises(ValueError, match="predicted must be given with an explanation"):
        replace(trial, explanation="because")
    with pytest.raises(ValueError, match="predicted must be given with an explanation"):
        replace(trial, predicted=(0.0, 1.0))


def test_one_sided_predictions_are_told_in_words():
    trial = Trial("c", "e", "x", "q", (1.0, 0.5, 1.5), "s", (0.0, math.inf), unit="dB")
    assert (trial.prediction, trial.outcome) == ("above 0 dB", "holds")
    assert replace(trial, predicted=(-math.inf, 0.0)).prediction == "below 0 dB"
    rows = list(csv.reader(trials_csv([trial]).splitlines()))
    assert rows == [list(COLUMNS), list(trial.row)]


def test_the_road_is_the_cause_of_what_agrees_without_it():
    rule = (0.5, 1.0)
    found = [
        measured("carries over", "p", "Pd", (0.1, 0.05, 0.2), rule),
        measured("sparse", "p", "share", (0.1, 0.05, 0.2), rule),
        measured("like", "p", "Pd", (0.9, 0.8, 0.95), rule),
        measured("not asked", "p", "Pd", (0.1, 0.05, 0.2), rule),
    ]
    prepared = [
        measured("carries over", "p", "Pd", (0.7, 0.6, 0.8), rule),
        measured("sparse", "p", "share", (0.2, 0.1, 0.3), rule),
        measured("like", "p", "Pd", (0.1, 0.05, 0.2), rule),
    ]
    trials = road_trials(found, prepared)
    assert [(one.statement, one.outcome) for one in trials] == [
        ("carries over", "holds"),
        ("sparse", "refuted"),
    ]
    assert trials[0].ours == "0.70 (0.60 to 0.80)"


def test_correlation_over_looks_forgives_what_is_the_same_in_all_looks(rng):
    hh = noise(rng, 400, 28)
    by_pixel = noise(rng, 28)
    same = np.concatenate([hh, hh * by_pixel], axis=1)
    assert cosgrove2004.correlation_over_looks(same) == pytest.approx(1.0)
    apart = np.concatenate([hh, noise(rng, 400, 28)], axis=1)
    assert cosgrove2004.correlation_over_looks(apart) < 0.12


def test_cuts_at_one_level_are_gaussian_again(rng):
    group = rng.integers(0, 5, 20_000)
    white = noise(rng, 20_000, 3) * np.array([0.2, 0.5, 1.0, 2.0, 5.0])[group, None]
    assert cosgrove2004.fourth_moment_ratio(white) > 4
    level = cosgrove2004._at_equal_level(white, group)
    assert cosgrove2004.fourth_moment_ratio(level) == pytest.approx(2.0, abs=0.1)


def test_eigenvalues_speak_for_the_place_of_the_cuts():
    record = {
        "ratios": [1, 0.25, 0.1, 0.05, 0.008, 0.005],
        "surveyed_ratios": [1, 0.05, 0, 0, 0, 0],
    }
    found = {name: [record, record] for name in cosgrove2004.CHANGES}
    for name in found:
        for k, one in enumerate(found[name]):
            found[name][k] = one | {
                "ratios": [r * (1 + 0.01 * k) for r in one["ratios"]],
                "surveyed_ratios": [r * (1 + 0.01 * k) for r in one["surveyed_ratios"]],
            }
    trials = declared_trials("cosgrove2004", "eigenvalue", found)
    said = {(one.statement, one.changed): one.outcome for one in trials if one.explanation}
    second = "Eigenvalue 2 is 0.089 of the first (dry sand)"
    assert (
        said[second, "training cuts placed by survey and refraction, not at the brightest place"]
        == "holds"
    )
    assert said[second, "mines level, straight ahead, undug, under a smooth surface"] == "refuted"


def test_a_bright_few_make_the_mean_template(rng):
    shape = np.zeros((2, 24, 2, 1, 9, 9))
    shape[..., 4, 2:4] = 1.0
    other = np.zeros((9, 9))
    other[4, 5:7] = 1.0
    chips = shape[0] + 0.05 * rng.random((24, 2, 1, 9, 9))
    chips[:3] = 40 * other
    raw = flsar2004.cosine_interval(chips, True, False, 30)
    each = flsar2004.cosine_interval(chips, False, False, 30)
    both_raw = flsar2004.cosine_interval(chips, True, True, 30)
    assert raw[0] < 0.5 < 0.9 < each[0]
    assert both_raw[0] > 0.9


@pytest.fixture(scope="module")
def bright_site():
    """A strip with faint mines, a bright one of the subset, and bright clutter between the two."""
    rng = np.random.default_rng(7)
    settings = load_settings(quick=True)
    grid = Grid(-2.0, 0.0, 51, 1501, 0.08, 0.03)
    x, y = np.meshgrid(grid.x, grid.y)
    image = rng.rayleigh(1.6, grid.shape)
    mines = pd.DataFrame({"x": 0.0, "y": np.arange(2.0, 44.0, 4.0), "kind": "metal", "depth": 0.05})
    mines["strength"] = np.where(np.arange(len(mines)) == 3, 60.0, 5.0)
    for one in mines.itertuples():
        image += one.strength * np.exp(-(((x - one.x) / 0.1) ** 2) - ((y - one.y) / 0.04) ** 2)
    for middle in (4.0, 12.0, 24.0):  # clutter
        image += 25 * np.exp(-(((x - 0.8) / 0.1) ** 2) - ((y - middle) / 0.04) ** 2)
    mines["target"] = [f"T{k}" for k in range(len(mines))]
    mines["direction"] = "out"
    mines["subset"] = np.arange(len(mines)) < 5
    stack = np.broadcast_to(image.astype(np.float32), (2, 1, *grid.shape))
    lane = Lane(-1.5, 1.5, 0.0, 45.0)
    return settings, examples.Site(
        "arid", stack.astype(np.complex64), stack, grid, mines, (lane,), {}
    )


def test_the_brightest_mine_sets_the_limit_of_the_deviation(bright_site):
    settings, site = bright_site
    names = flsar2004.subset_by_strength(settings, site)
    assert names[0] == "T3"
    everything, clusters = flsar2004.removed_share(settings, site, names)
    without, _ = flsar2004.removed_share(settings, site, names[1:])
    assert clusters > 20
    assert everything[0] == 0.0
    assert without[0] * clusters > 5  # the three in two polarizations


def test_other_subsets_have_as_many_mines(bright_site, monkeypatch):
    settings, site = bright_site
    drawn = []

    def share(settings, site, targets, relative=False):
        drawn.append(targets)
        return (0.1, 0.0, 0.2), 10

    monkeypatch.setattr(flsar2004, "removed_share", share)
    assert flsar2004.other_subsets(settings, site) == [0.1] * flsar2004.SUBSETS
    assert {len(one) for one in drawn} == {5}
    assert len({tuple(one) for one in drawn}) > 1


def test_twins_of_a_lane_differ_in_what_is_changed_alone():
    plain = wang2007.clutter_scene("nothing")
    bare = wang2007.clutter_scene(wang2007._TARGETS)
    assert bare.draws == ()
    assert bare.model_copy(update={"draws": plain.draws}) == plain
    even = wang2007.clutter_scene(wang2007._EVEN_SURFACE)
    assert even.surface.texture_shape is None
    assert not any(part.on for part in (even.stones, even.lenses, even.holes, even.heterogeneity))
    assert even.clutter.posts == even.clutter.bushes == even.clutter.rocks == 0


def test_clutter_is_told_with_its_intervals():
    rows = [
        {"HH F1": 9.0, "HH F2": 8.4 + 0.1 * k, "HH F3": 9.5, "HH F4": 10.0, "VV F1": 7.0 + 0.1 * k}
        for k in range(5)
    ]
    record = {"view": rows, "scans": [{**row, "HH F2": row["HH F2"] + 1.0} for row in rows]}
    trials = wang2007.clutter_trials({name: [record] for name in wang2007.CLUTTER_CHANGES})
    plain = trials[0]
    assert plain.interval[0] == pytest.approx(-0.4)
    assert plain.sample == "5 stretches of 1 lanes"
    said = {one.explanation: one.outcome for one in trials if one.explanation}
    assert said["sidelobes of targets stand out more in F1"] == "refuted"
    [in_vv] = [
        outcome for why, outcome in said.items() if why.startswith("clutter stands out less in VV")
    ]
    assert in_vv == "holds"
    assert [one.outcome for one in trials if one.quantity.startswith("99 % quantile over median, HH F2")
            and "scan" in one.quantity] == ["holds"]  # fmt: skip


def test_the_road_is_fitted_too_and_a_mine_keeps_its_peak(tmp_path, monkeypatch):
    changes = np.array([-0.5, -0.7, -0.3, -0.6])
    monkeypatch.setattr(fuse2018, "stored_calibration", lambda *_: None)
    monkeypatch.setattr(fuse2018, "lane_result", lambda *_: None)
    monkeypatch.setattr(fuse2018, "own_changes", lambda *_: (changes, np.arange(4)))
    [trial] = fuse2018.trials(tmp_path, quick=True)
    assert trial.interval[0] == pytest.approx(-0.525)
    assert trial.outcome == "holds"


def test_the_script_writes_the_table_of_a_paper(tmp_path, monkeypatch, capsys):
    asked = []

    def trials(folder, quick, world, track):
        asked.append((folder, quick, world))
        return [Trial("carries over", "", "nothing", "Pd", (0.5, 0.4, 0.6), "9 mines")]

    monkeypatch.setattr(flsar2004, "trials", trials)
    home = tmp_path / "flsar2004"
    for folder, value in ((home, 0.7), (home / "as-found", 0.1)):
        folder.mkdir(parents=True)
        found = measured("carries over", "p", "Pd", (value, value - 0.05, value + 0.05), (0.5, 1.0))
        write_findings(folder, [found], False)
    options = [str(tmp_path), "--paper", "flsar2004", "--quick"]
    script.main(options)
    script.main([*options, "--world", "as-found"])
    assert capsys.readouterr().out.endswith(f"table: {tmp_path / 'reasons-as-found.csv'}\n")
    assert asked == [(home, True, "own"), (home / "as-found", True, "as-found")]
    prepared = list(csv.reader((tmp_path / "reasons.csv").read_text("utf-8").splitlines()))
    assert [row[0] for row in prepared] == ["statement", "carries over"]
    rough = list(csv.reader((tmp_path / "reasons-as-found.csv").read_text("utf-8").splitlines()))
    assert [row[6] for row in rough] == ["outcome", "", "holds"]
    assert (home / "reasons.csv").is_file()
    assert (home / "as-found" / "reasons.csv").is_file()
    with pytest.raises(SystemExit) as refused:
        script.main([str(tmp_path), "--paper", "none"])
    assert refused.value.code == 2
    assert "choose from 'cosgrove2004', 'flsar2004'" in capsys.readouterr().err


@pytest.fixture(scope="module")
def mines():
    """Mines of two features, and one that has more of both than any of them."""
    rng = np.random.default_rng(3)
    X = rng.normal(0.6, 0.1, (30, 2))
    return np.vstack([X, [[0.9, 0.95]]]), np.r_[np.ones(30, bool), False]


def test_a_mine_that_is_better_than_those_of_training_is_no_novelty_with_capped_features(mines):
    X, y = mines
    options = load_settings(quick=True).classify
    own = flsar2004.one_class(options)
    typical = X[y].mean(axis=0, keepdims=True)
    for machine, holds in ((own, False), (flsar2004._capped(own), True)):
        scorer, share = machine(X, y)
        assert (scorer(X[~y])[0] >= scorer(typical)[0] - 1e-9) is np.bool_(holds)
        assert 0 < share <= 1


def test_a_novelty_detector_of_the_study_s_width_is_the_study_s(mines):
    X, y = mines
    options = load_settings(quick=True).classify
    width = machines.median_width(X[y])
    scorer, share = flsar2004.one_class(options, gamma=width)(X, y)
    known, known_share = flsar2004.one_class(options)(X, y)
    assert np.allclose(scorer(X), known(X))
    assert share == known_share
    other, _ = flsar2004.one_class(options, gamma=30 * width)(X, y)
    assert not np.allclose(other(X), known(X), rtol=0.05)


def test_each_novelty_detector_is_held_against_the_binary_machine(mines, monkeypatch):
    rng = np.random.default_rng(5)
    settings = load_settings(quick=True)
    table = pd.DataFrame(
        {
            "kind": ["metal"] * 8 + ["clutter"] * 40,
            "target": [f"M{k // 2}" for k in range(8)] + [""] * 40,
        }
    )
    X = np.vstack([rng.normal(1.0, 0.2, (8, 3)), rng.normal(0.0, 0.2, (40, 3))])
    made = machines.Examples(table, X)
    monkeypatch.setattr(flsar2004, "_buried", lambda *_, **__: made)
    monkeypatch.setattr(flsar2004, "WIDTHS", (3.0,))
    material = MagicMock(settings=settings, sites=[MagicMock(), MagicMock()])
    material.measure.return_value = Measure(400.0, draws=50)
    trials = flsar2004.novelty_trials(material)
    assert [one.changed for one in trials[:4]] == [
        "nothing",
        "complex templates",
        "features above the mean of the training mines count as the mean",
        "kernel of γ = 3 over the number of features",
    ]
    assert len(trials) == 2 * 4 + 3
    # Mines far from all clutter are found by both.
    assert {one.outcome for one in trials if one.explanation} == {"holds"}
    assert {one.sample for one in trials} == {"4 mines"}
