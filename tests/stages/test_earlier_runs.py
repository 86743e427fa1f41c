"""The stage `earlier` subtracts what earlier drives over the road predict: what was laid since stands out."""

import json
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import flgpr
from driven_twice import FREQUENCY, OLD, drive
from flgpr.clutter import standing_field
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.instead import contrast_lane
from flgpr.method.method import detect, engine_of
from flgpr.recipe.make import with_earlier
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import save_run
from small_lane import LANE, LANE_TOML, TARGETS, small_recipe


def recipe():
    text = small_recipe().replace("[features]\nvariants = true", "[features]\n")
    # The ground of these drives ends with the lane.
    return with_earlier(text) + "margin = 0.5\n"


def strongest_near(detection, target):
    """Return the rank of the first alarm within 0.4 m of a target."""
    alarms = detection.alarms
    near = np.hypot(alarms["x"] - target[0], alarms["y"] - target[1]) < 0.4
    return int(np.flatnonzero(near)[0]) + 1 if near.any() else len(alarms) + 1


@pytest.fixture(scope="module")
def drives():
    return drive(1, OLD), drive(2, TARGETS)


def test_what_was_laid_since_outranks_what_was_there_before(drives):
    before, today = drives
    found = detect(today, parse_recipe(recipe()), LANE, others={"before": before})
    new = [strongest_near(found, target) for target in TARGETS[1:]]
    assert min(new) == 1
    assert max(new) <= 3
    assert strongest_near(found, OLD[0]) > 4
    alone = detect(today, parse_recipe(small_recipe()), LANE)
    assert strongest_near(alone, OLD[0]) < strongest_near(found, OLD[0])
    assert found.notes["earlier_suppression_db"] > 4
    assert found.notes["scans_without_earlier"] == 0


def decibels_at(view, target):
    """Return the strongest pixel within 0.3 m of a target, dB over the median."""
    channel = view[0, 0]
    x, y = target
    near = channel.sel(x=slice(x - 0.3, x + 0.3), y=slice(y - 0.3, y + 0.3))
    return 20 * np.log10(near.max().item() / np.nanmedian(channel))


def test_both_days_show_what_is_old_and_their_difference_does_not(drives):
    before, today = drives
    found = detect(today, parse_recipe(recipe()), LANE, others={"before": before})
    both = [decibels_at(view, OLD[0]) for view in (found.before, found.earlier)]
    assert min(both) > 10
    assert decibels_at(found.view, OLD[0]) < min(both) - 5
    assert all(decibels_at(found.view, target) > 8 for target in TARGETS[1:])
    assert detect(today, parse_recipe(small_recipe()), LANE).earlier is None


def test_what_stands_still_is_told_better_without_the_ground(drives):
    """In the median of thirteen scans a thirteenth of the ground is left."""
    coupling = np.random.default_rng(3).standard_normal((3, 8, 1)) + 1j
    before, today = (one.assign(signal=one["signal"] + coupling) for one in drives)
    lane = ImagedRun(today, parse_recipe(recipe()), LANE, others={"before": before})
    engine_of(lane).run()

    def error(field):
        return np.linalg.norm(field[lane.setup.imaged] - coupling[lane.setup.imaged])

    today_before, today_after, then = (
        lane.results[f"earlier.{name}"] for name in ("standing", "refined", "then.before")
    )
    assert error(today_after["field"]) < 0.92 * error(today_before["field"])
    assert error(then["field"]) < 0.92 * error(standing_field(before["signal"].values))


def test_every_thread_has_the_days_of_the_scan_that_it_cleaned(drives):
    before, today = drives
    lane = ImagedRun(today, parse_recipe(recipe()), LANE, others={"before": before})
    engine_of(lane).run()
    both_have_cleaned = threading.Barrier(2)

    def shows_its_own(index):
        image = lane.imager.image(index)
        lane.earlier.of_image(index, image)
        both_have_cleaned.wait(60)
        return np.array_equal(lane.earlier.days["today"].ravel(), image.values.ravel())

    with ThreadPoolExecutor(2) as pool:
        assert list(pool.map(shows_its_own, (3, 7))) == [True, True]


def test_ranking_by_contrast_instead_subtracts_earlier_drives_too(drives):
    before, today = drives
    lane = ImagedRun(today, parse_recipe(recipe()), LANE, others={"before": before})
    instead, text = contrast_lane(lane)
    assert instead.earlier is not None
    assert with_earlier(text) == text
    alone, text = contrast_lane(ImagedRun(today, parse_recipe(small_recipe()), LANE))
    assert alone.earlier is None
    assert with_earlier(text) != text


def test_tracks_that_are_off_are_moved_onto_each_other(drives):
    before, _ = drives
    worst = []
    for seed in (2, 3, 5):
        today = drive(seed, TARGETS, offset=0.15)
        found = detect(today, parse_recipe(recipe()), LANE, others={"before": before})
        worst.append(max(strongest_near(found, target + [0.15, 0]) for target in TARGETS[1:]))
        assert found.notes["earlier_offset"] == pytest.approx(0.15, abs=0.06)
    assert np.median(worst) <= 3


def test_detect_takes_earlier_runs_by_one_option_and_says_how_they_fit(drives, tmp_path):
    before, today = drives
    for name, run in (("before", before), ("today", today)):
        save_run(run, tmp_path / f"{name}.zarr")
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    (tmp_path / "own.toml").write_text(small_recipe())
    result = flgpr.detect(
        tmp_path / "today.zarr",
        recipe=tmp_path / "own.toml",
        lane=tmp_path / "lane.toml",
        before=tmp_path / "before.zarr",
        output=tmp_path / "result",
    )
    run = result.manifest["run"]
    assert run["others"]["before"]["path"].endswith("before.zarr")
    said = run["stands_out"]["notes"][1]
    assert "what an earlier drive predicts is subtracted, so what lay there then does not" in said
    index = json.loads((tmp_path / "result" / "view" / "index.json").read_text())
    assert {one["detection"]: one["stage"] for one in index["layers"]} == {
        "before": "today",
        "earlier": "earlier drive",
        "main": "what has changed",
    }
    assert "at the earlier drive, right of it today" in (
        tmp_path / "result" / "report.html"
    ).read_text(encoding="utf-8")
    assert flgpr.replay(tmp_path / "result")["identical"]


def test_scans_that_no_earlier_one_lies_near_are_counted(drives):
    before, today = drives
    first_half = before.isel(scan=slice(4))
    found = detect(today, parse_recipe(recipe()), LANE, others={"before": first_half})
    assert found.notes["scans_without_earlier"] > 2
    unseen = np.isnan(found.earlier[0, 0]).mean("x").values
    assert unseen[0] == 0
    assert unseen[-1] == 1
    assert not np.isnan(found.before).any()


@pytest.mark.parametrize(
    ("others", "message"),
    [
        ({}, "`before` must give an earlier run of the road"),
        ({"x": None}, "`before` must give an earlier run of the road"),
        ({"before": "HV alone"}, "run before must have the polarizations .* got none of HH, VV"),
        ({"before": "other tones"}, "run before must have the tones of the run, 74 .* got 80 from"),
    ],
)
def test_what_is_no_earlier_run_is_refused(drives, others, message):
    before, today = drives
    runs = {
        None: before,
        "HV alone": before.sel(polarization=["HV"]),
        "other tones": drive(1, OLD, frequency=FREQUENCY[0] + 1.4e7 * np.arange(80)),
    }
    with pytest.raises(ValueError, match=message):
        detect(today, parse_recipe(recipe()), LANE, others={n: runs[r] for n, r in others.items()})


def test_before_is_for_a_single_run(drives, tmp_path):
    with pytest.raises(ValueError, match="before must be given for a single run, got 2 runs"):
        flgpr.detect([tmp_path / "a", tmp_path / "b"], before=tmp_path / "c", output=tmp_path / "r")


@pytest.mark.parametrize("name", ["wang2007", "fuse2018", "demo", "fused"])
def test_the_stage_is_the_last_of_any_recipe_and_stands_once(name):
    text = with_earlier(recipe_text(name))
    assert [one.stage for one in parse_recipe(text).clutter][-1] == "earlier"
    assert with_earlier(text) == text


def test_a_recipe_made_for_a_run_takes_the_stage_beside_its_own():
    text = 'name = "a"\nclutter = [{stage = "early"}]\n'
    assert with_earlier(text) == 'name = "a"\nclutter = [{stage = "early"}, {stage = "earlier"}]\n'


def test_heights_over_the_sea_make_no_endless_ground(drives):
    before, today = drives
    high = before.copy(deep=True)
    high["pose"].values[:, 2] += 300
    wide = parse_recipe(recipe().replace("margin = 0.5\n", ""))
    with pytest.raises(
        ValueError, match=r"margin of the stage earlier must leave at most .* got 302 m"
    ):
        ImagedRun(today, wide, LANE, others={"before": high})
