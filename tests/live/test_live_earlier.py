"""Live detection of what has changed since earlier drives: its images are those of the stored run."""

import json

import numpy as np
import pytest

from driven_twice import FREQUENCY, drive
from flgpr.commands.detect import detect
from flgpr.jobs.job import make_job
from flgpr.live.detector import LiveDetector, LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.intake import Intake
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.live.state import restore_snapshot, take_snapshot
from flgpr.method.imaged_run import ImagedRun
from flgpr.recipe.make import with_earlier
from flgpr.recipe.schema import parse_recipe
from flgpr.stages.earlier import STANDING
from flgpr.store import Scan, describe_for_live, save_run
from live_lane import LANE, STEP, TARGETS, small_recipe

ROAD = {"scans": 36, "step": STEP, "count": 400, "ground": (0.5, 22)}
OLD, NEW = TARGETS[1:2], TARGETS[2:4]
LAID = np.vstack([OLD, NEW])
RECIPE = parse_recipe(with_earlier(small_recipe()))


@pytest.fixture(scope="module")
def before():
    return drive(1, OLD, **ROAD)


@pytest.fixture(scope="module")
def today():
    return drive(2, LAID, **ROAD)


@pytest.fixture(scope="module")
def scans(today):
    time, pose, signal = (today[name].values for name in ("time", "pose", "signal"))
    return [Scan(k, float(time[k]), pose[k], signal[k]) for k in range(len(pose))]


def start(today, before, **settings):
    return LiveDetector(
        describe_for_live(today), RECIPE, LANE, None, LiveSettings(**settings), {"before": before}
    )


def test_images_are_those_of_the_stored_run_where_it_knows_no_more(today, before, scans):
    """What stands still is given: only the stored run knows that of the scans to come."""
    stored = ImagedRun(today, RECIPE, LANE, others={"before": before})
    detector = start(today, before)
    stored.results.update(detector.earlier.stage.setup.results)
    bands = [list(RECIPE.image.subbands).index(name) for name in detector.steps.subbands]
    compared = 0
    for number, scan in enumerate(scans[:16]):
        field = detector.earlier.standing(scan.signal)
        live = detector._image(scan)
        stored.results[STANDING] = {"field": field}
        image = stored.scan_image(number).isel(subband=bands, y=slice(live.shape[-2])).values
        assert np.abs(live - image).max() < 1e-5 * np.abs(image).max()
        compared += 1
        detector.add(scan)
    assert compared == 16


def test_what_stands_still_is_nearly_that_of_the_stored_run_in_the_end(today, before, scans):
    """Coupling ten times as strong as the ground changes the images by a small part."""
    coupling = 10 * np.random.default_rng(3).standard_normal(scans[0].signal.shape[:2])[..., None]
    plain, coupled = start(today, before), start(today, before)
    for scan in scans:
        with_coupling = Scan(scan.number, scan.time, scan.pose, scan.signal + coupling)
        plain.add(scan)
        coupled.add(with_coupling)
    wanted, image = plain._image(scans[-1]), coupled._image(with_coupling)
    assert np.linalg.norm(image - wanted) < 0.3 * np.linalg.norm(wanted)


def suppressed(today, before, scans):
    """Return by how much of each scan's image is subtracted, dB."""
    detector = start(today, before)
    images = detector.earlier.of_image
    decibels = []

    def of_image(image, pose):
        left = images(image, pose)
        part = image[:, detector.earlier._subbands, : left.shape[-2]]
        decibels.append(20 * np.log10(np.linalg.norm(part) / np.linalg.norm(left)))
        return left

    detector.earlier.of_image = of_image
    for scan in scans:
        detector.add(scan)
    return decibels


def with_coupling(run, scale=1.0):
    """Return a run with an echo that stands still on the vehicle, ten times the ground's."""
    rng = np.random.default_rng(3)
    coupling = rng.standard_normal((2, *run["signal"].shape[1:3], 1))
    return run.assign(signal=run["signal"] + 10 * scale * (coupling[0] + 1j * coupling[1]))


def scans_of(run):
    time, pose, signal = (run[name].values for name in ("time", "pose", "signal"))
    return [Scan(k, float(time[k]), pose[k], signal[k]) for k in range(len(pose))]


def test_from_the_first_scan_on_what_stands_still_is_known_by_the_earlier_drive(today, before):
    """Its gain may differ from day to day."""
    plain = suppressed(today, before, scans_of(today)[:4])
    known = suppressed(
        with_coupling(today, 0.8), with_coupling(before), scans_of(with_coupling(today, 0.8))[:4]
    )
    assert min(plain) > 3
    assert min(known) > min(plain) - 1.5


def test_what_stood_still_on_another_vehicle_is_soon_left_out(today, before):
    """It is that of the day that counts, once some scans came."""
    scans = scans_of(with_coupling(today))[:16]
    wanted = suppressed(with_coupling(today), with_coupling(before), scans)
    other = before.copy(deep=True)
    coupling = (with_coupling(before)["signal"] - before["signal"]).values
    other["signal"].values[:] += coupling[:, :, ::-1]
    found = suppressed(with_coupling(today), other, scans)
    assert np.mean(found[8:]) > np.mean(wanted[8:]) - 1


def test_without_the_same_array_the_first_scans_only_teach(today, before):
    detector = start(today, before.isel(pair=slice(0, 7)))
    for number, scan in enumerate(scans_of(today)[:4]):
        assert detector.earlier.is_ready == (number >= 3)
        detector.add(scan)


def test_a_snapshot_goes_on_bit_by_bit_with_earlier_drives(today, before, scans):
    first, second = start(today, before), start(today, before)
    intake = Intake(describe_for_live(today))
    for scan in scans[:12]:
        first.add(scan)
    assert restore_snapshot(take_snapshot(first, intake, set(), "m"), second, intake, "m") == set()
    for scan in scans[12:20]:
        one, other = first.add(scan), second.add(scan)
        assert one.alarms == other.alarms
        np.testing.assert_array_equal(one.view, other.view)
    assert first.earlier.sentences() == second.earlier.sentences() != []


@pytest.fixture(scope="module")
def home(tmp_path_factory, today, before):
    folder = tmp_path_factory.mktemp("days")
    save_run(before, folder / "before.zarr")
    save_run(before.isel(scan=slice(18)), folder / "half.zarr")
    save_run(today, folder / "today.zarr")
    (folder / "recipe.toml").write_text(small_recipe())
    feed(folder / "today.zarr", folder / "incoming", float("inf"))
    return folder


def live(home, name, **more):
    """Return the report of a live run and its events."""
    options = {"recipe": home / "recipe.toml", "incoming": home / "incoming", **more}
    report = LiveRun(LiveOptions(output=home / name, **options)).run()
    lines = [json.loads(line) for line in (home / name / "live.jsonl").read_text().splitlines()]
    return report, lines


def test_what_was_laid_since_is_raised_live_and_the_events_say_what_alarms_are(home):
    report, lines = live(home, "whole", before=[home / "before.zarr"])
    alarms = {}
    for line in lines:
        if line["event"] == "alarm":
            alarms[line["alarm_id"]] = line
    ranked = sorted(alarms.values(), key=lambda one: -one["confidence"])
    away = [np.hypot(one["x"] - LAID[:, 0], one["y"] - LAID[:, 1]) for one in ranked]
    ranks = [next(k for k, far in enumerate(away) if far[target] < 0.4) for target in (1, 2)]
    assert max(ranks) <= 2
    assert all(far[0] > 0.4 for far in away[:4])
    started = next(line for line in lines if line["event"] == "start")
    assert started["notes"] == [
        "what an earlier drive predicts is subtracted, so what lay there then does not stand out"
    ]
    assert report.counts["without_earlier"] == 0
    told = [line["words"] for line in lines if line.get("name") == "before"]
    assert len(told) == 1
    assert "dB of the images)" in told[0]


def test_what_is_wrong_with_an_earlier_drive_is_told(home, before):
    broken = before.copy(deep=True)
    broken["signal"].values[:, :, 2] = 0
    save_run(broken, home / "broken.zarr")
    _, lines = live(home, "broken", before=[home / "broken.zarr"])
    told = [line["words"] for line in lines if line.get("name") == "before"]
    assert told[0].startswith("run before: pair 2 ")
    assert told[0].endswith("; 1 pair left out")


def test_a_road_that_no_earlier_drive_covers_is_told_with_its_scans(home):
    report, lines = live(home, "half", before=[home / "half.zarr"])
    told = [line["words"] for line in lines if line.get("name") == "before"]
    alone = report.counts["without_earlier"]
    assert 6 < alone < 18
    assert "no earlier drive lies near from here on" in told[0]
    assert f"{alone} of " in told[-1]
    assert lines[-1]["without_earlier"] == alone


def test_a_recipe_that_is_made_for_the_run_has_the_stage(home):
    live(home, "fitted", recipe=None, before=[home / "before.zarr"])
    made = parse_recipe((home / "fitted" / "recipe.toml").read_text())
    assert [one.stage for one in made.clutter] == ["earlier"]


def test_what_cannot_go_together_is_refused_with_what_to_change(home, today, before):
    (home / "still.toml").write_text(small_recipe() + '\n[[clutter]]\nstage = "standing"\n')
    with pytest.raises(ValueError, match=r"clutter\.standing: .*; give another recipe, or detect"):
        live(home, "no", recipe=home / "still.toml", before=[home / "before.zarr"])
    (home / "staged.toml").write_text(with_earlier(small_recipe()))
    with pytest.raises(ValueError, match="`before` must give an earlier run of the road"):
        live(home, "no", recipe=home / "staged.toml")
    other = drive(1, OLD, frequency=FREQUENCY[0] + 1.4e7 * np.arange(80), scans=5)
    with pytest.raises(ValueError, match="run before must have the tones of the run, 74 from"):
        start(today, other)
    with pytest.raises(ValueError, match="run before must have the polarizations HH, VV, HV"):
        start(today, before.sel(polarization=["HV"]))


def test_an_earlier_drive_that_tells_nothing_is_refused_before_the_first_scan(home, before):
    save_run(before.isel(scan=slice(2)), home / "two.zarr")
    with pytest.raises(ValueError, match=r"two.zarr: an earlier run must have 3 complete scans"):
        LiveRun(
            LiveOptions(
                home / "recipe.toml", home / "two", home / "incoming", before=[home / "two.zarr"]
            )
        )


def test_an_earlier_drive_of_another_place_on_the_earth_is_refused(home, before, today):
    place = {"longitude": 8.5, "latitude": 49.0, "azimuth": 30.0}
    save_run(before.assign_attrs(georeference=place | {"latitude": 49.1}), home / "far.zarr")
    save_run(today.assign_attrs(georeference=place), home / "here.zarr")
    rule = "far.zarr: must be a run of the same lane, within 10 m"
    with pytest.raises(ValueError, match=rule):
        detect(home / "here.zarr", output=home / "found", before=[home / "far.zarr"])
    feed(home / "here.zarr", home / "here", float("inf"))
    with pytest.raises(ValueError, match=rule):
        live(home, "elsewhere", incoming=home / "here", before=[home / "far.zarr"])


def test_a_tone_at_fault_on_one_day_is_left_out_of_both(home, before, today):
    """The images of both days are compared tone by tone, and a stored run without one has fewer."""
    broken = before.copy(deep=True)
    broken["signal"].values[..., 20] *= (
        np.exp(2j * np.pi * np.random.default_rng(1).random(broken["signal"].values[..., 20].shape))
        * 100
    )
    save_run(broken, home / "noisy.zarr")
    recipe = (home / "recipe.toml").read_text()
    for run, other in (("today", "noisy"), ("noisy", "today")):
        beside = {"before": home / f"{other}.zarr"}
        job = make_job(home / f"{run}.zarr", recipe, LANE, home / "result", others=beside)
        assert job.health.left_out.tones == job.left_out_of_others[0].tones == (20,)
    _, lines = live(home, "noisy", before=[home / "noisy.zarr"])
    told = [line["words"] for line in lines if line.get("name") == "before"]
    assert "1 tone left out" in told[0]
    assert "dB of the images)" in told[-1]
