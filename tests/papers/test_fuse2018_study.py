"""The reproduction of Fuse et al. 2018 on a made-up lane of points: thresholds, masks, variants, scores, page."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from flgpr.clutter import equal_cost, standing_field, subtract_standing
from flgpr.imaging import ImagingOperator
from flgpr.model import make_run, vehicle_to_lane
from flgpr.progress import silent
from flgpr.scoring.curve import held_pd_mean
from flgpr.simulate import draw_world
from flgpr_papers.fuse2018 import process
from flgpr_papers.fuse2018 import study as fuse2018
from flgpr_papers.fuse2018.findings import (
    all_findings,
    frame_match,
    frame_spread,
    lane_match,
    mine_changes,
    own_changes,
    power_db,
    scored,
    strongest_boxes,
)
from flgpr_papers.fuse2018.lanes import (
    Frames,
    band_sensor,
    fuse_recipe,
    lane_scene,
    local,
    masks_stage,
    trained,
)
from flgpr_papers.fuse2018.process import calibrate, example_arrays, process_lane
from flgpr_papers.fuse2018.suppression import VARIANTS, clean, stage_forms, suppressed_alone
from flgpr_papers.kit.findings import NO_VERDICT, OPEN, VERDICTS

pytestmark = pytest.mark.slow("studies of papers")

TX = np.repeat(np.column_stack([np.linspace(-1, 1, 4), np.zeros(4), np.zeros(4)]), 4, axis=0)
RX = np.tile(np.column_stack([np.linspace(-1.1, 1.1, 4), np.zeros(4), np.full(4, -0.2)]), (4, 1))
TONES = {"l": 0.75e9 + 12e6 * np.arange(204), "x": 8.4e9 + 12e6 * np.arange(160)}
MINES = np.column_stack([np.resize([0.5, -1.5, 2.0], 12), 0.5 + 1.5 * np.arange(12)])
BUSHES = np.array([[-6.0, 4.0], [5.5, 7.0], [-5.0, 11.0], [6.5, 14.0]])
RECIPE = fuse_recipe(True)
RECIPE = RECIPE.model_copy(
    update={
        "image": RECIPE.image.model_copy(update={"frames": 2, "spacing": 0.2}),
        "study": RECIPE.study.model_copy(update={"every": 2, "loose_every": 2}),
        "lanes": RECIPE.lanes.model_copy(update={"length": 16.0}),
    }
)


def make_runs(seed, count):
    """Runs of both bands, what is on the lane, and what the mines add to VV: mines that show in VV alone,
    bushes that show everywhere, in noise."""
    rng = np.random.default_rng(seed)
    # Off the pixels, and not alike on the three lanes.
    mines = MINES + rng.uniform(-0.1, 0.1, MINES.shape)
    bushes = BUSHES + rng.uniform(-0.3, 0.3, BUSHES.shape)
    points = np.zeros((len(mines) + 12 * len(bushes), 3))
    points[: len(mines), :2] = mines
    points[len(mines) :, :2] = np.repeat(bushes, 12, axis=0) + rng.normal(
        0, 0.25, (12 * len(bushes), 2)
    )
    mine = np.arange(len(points)) < len(mines)
    phase = np.exp(2j * np.pi * rng.random(len(points)))
    level = {"l": [(1.0, 5.0), (0.03, 2.0)], "x": [(0.02, 3.0)]}
    pose = np.zeros((count, 6))
    pose[:, 1] = 2.0 * np.arange(count) - 5
    runs = {}
    alone = None
    for band, tones in TONES.items():
        own = pose + np.array([0, 0, 3.0 if band == "l" else 3.4, 0, 0, 0])
        strength = np.stack([np.where(mine, a, b) * phase for a, b in level[band]])[:, None]
        made = [
            ImagingOperator(
                tones, vehicle_to_lane(TX, p), vehicle_to_lane(RX, p), points, tolerance=1e-2
            ).forward(strength)
            for p in own
        ]
        if band == "l":
            views = [vehicle_to_lane(side, p) for p in own for side in (TX, RX)]
            makes = [
                ImagingOperator(tones, *views[k : k + 2], points[mine])
                for k in range(0, len(views), 2)
            ]
            alone = np.array(
                [make.forward((level["l"][0][0] * phase[mine])[None, None]) for make in makes]
            )
        noise = rng.normal(size=(*np.shape(made), 2)).view(complex)[..., 0]
        labels = ["VV", "VH"] if band == "l" else ["VV"]
        runs[band] = make_run(
            (np.array(made) + 0.3 * noise).astype(np.complex64), tones, labels, TX, RX, own
        )
    ids = {"target_id": [f"T{i}" for i in range(len(mines))], "kind": "metal", "depth": 0.05}
    truth = pd.DataFrame({"x": mines[:, 0], "y": mines[:, 1], **ids})
    objects = pd.DataFrame({"object_id": [f"O{i}" for i in range(len(bushes))], "kind": "bush"})
    objects = objects.assign(x=bushes[:, 0], y=bushes[:, 1])
    return runs, truth, objects, alone


def make_frames(name, seed, count=6, bands=("l", "x")):
    runs, *rest = make_runs(seed, count)
    return Frames(name, masks_stage({band: runs[band] for band in bands}, RECIPE), *rest)


@pytest.fixture(scope="module")
def calibration():
    return calibrate(make_frames("calibration", 1), RECIPE, silent)


@pytest.fixture(scope="module")
def lanes(calibration, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuse2018")
    results = {}
    for name, seed in (("A", 2), ("B", 3)):
        frames = make_frames(name, seed)
        shown = {}

        def keep(cleaned, frames=frames, shown=shown):
            shown.update(example_arrays(cleaned, frames, RECIPE))

        records = process_lane(frames, calibration, RECIPE, silent, every=2, example=keep)
        process.write_records(folder / f"{name}.json", frames, records)
        results[name] = (
            process.read_records(folder / f"{name}.json", frames),
            frames,
            shown,
        )
    return results


def both(lanes):
    return [lanes[name][0] for name in ("A", "B")]


def test_bands_share_world_and_poses():
    seed = RECIPE.lanes.seeds["A"]
    worlds = [draw_world(lane_scene(RECIPE, "A", band), seed) for band in ("l", "x")]
    assert worlds[0].truth()[["x", "y", "depth"]].equals(worlds[1].truth()[["x", "y", "depth"]])
    assert worlds[0].objects_table().equals(worlds[1].objects_table())
    l_band, x_band = (band_sensor(RECIPE, band) for band in ("l", "x"))
    assert l_band.pairs()[0].shape == (64, 3)
    assert x_band.pairs()[0].shape == (128, 3)
    assert l_band.polarization == ("HH", "HV", "VH", "VV")
    assert l_band.errors.position == x_band.errors.position == RECIPE.radar.position


def test_runs_whose_poses_differ_are_refused():
    runs = make_runs(2, 3)[0]
    assert masks_stage({"l": runs["l"]}, RECIPE).aperture(2).second is None
    one = masks_stage(runs, RECIPE)
    read = one.before(2, 3)
    signal = runs["l"]["signal"].values
    np.testing.assert_array_equal(read, subtract_standing(signal, standing_field(signal)))
    moved = runs["x"]["pose"].copy(deep=True)
    moved[1, 0] += 0.01
    with pytest.raises(ValueError, match=r"share their poses: run and x are up to 0\.01 m"):
        masks_stage(runs | {"x": runs["x"].assign(pose=moved)}, RECIPE)
    with pytest.raises(ValueError, match="3 scans, x has 2"):
        masks_stage(runs | {"x": runs["x"].isel(scan=slice(2))}, RECIPE)
    with pytest.raises(ValueError, match="VV and VH or HV"):
        masks_stage({"l": runs["l"].isel(polarization=slice(1))}, RECIPE)


def test_the_self_signature_goes_whatever_its_gain():
    rng = np.random.default_rng(5)
    still = rng.normal(size=(2, 16, 60)) + 1j * rng.normal(size=(2, 16, 60))
    moving = 0.01 * (rng.normal(size=(41, 2, 16, 60)) + 1j * rng.normal(size=(41, 2, 16, 60)))
    gain = 1 + 0.07 * rng.normal(size=41)
    signal = (gain[:, None, None, None] * still + moving).astype(np.complex64)
    rest = subtract_standing(signal, standing_field(signal))
    assert np.linalg.norm(rest) < 1.1 * np.linalg.norm(moving)


def test_an_aperture_is_the_coherent_sum_of_its_frames():
    stage = make_frames("A", 2, 3).stage
    one = stage.aperture(2)
    assert len(one.data) == 2
    np.testing.assert_allclose(
        one.stack_on(stage.points).adjoint(one.data)[0, 0], one.vv, atol=1e-3
    )
    assert np.unique(stage.region).tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose((*stage.grid.extent(), stage.grid.dy), (-10.1, 10.1, 4.9, 15.1, 0.2))


@pytest.mark.slow("runs a quick form of the whole study")
def test_masks_hold_the_bushes_and_leave_the_mines(lanes):
    for result, _, shown in lanes.values():
        first = result.mines[result.mines["variant"] == "original"]
        assert not first["masked"].any()
        mask = shown["fundamental"] | shown["extended"]
        assert len(shown["boxes"])
        for x, y in shown["boxes"]:
            assert mask[
                (np.abs(shown["x_axis"] - x) < 0.5) & (np.abs(shown["y_axis"] - y)[:, None] < 0.5)
            ].any()


@pytest.mark.slow("runs a quick form of the whole study")
def test_every_variant_lowers_the_boxes_and_the_papers_keeps_the_mines(lanes):
    boxes = strongest_boxes(both(lanes))
    for name in VARIANTS:
        if name == "original":
            continue
        assert power_db(boxes, name).mean() < -10, name
    # With 16 pairs, regions and reflectivities of a frame's own take part of the mines too.
    assert abs(np.median(mine_changes(both(lanes), "shared")[0])) < 1.0
    for name in ("iteration", "whole response", "calibrated roadside", "L band alone"):
        assert -3.0 < np.median(mine_changes(both(lanes), name)[0]) < 1.0, name
    np.testing.assert_allclose(power_db(boxes, "#6"), power_db(boxes, "as printed"), atol=0.05)
    assert (power_db(boxes, "least squares") < power_db(boxes, "shared")).mean() > 0.5


@pytest.mark.slow("runs a quick form of the whole study")
def test_the_loss_of_a_mine_is_that_of_its_own_data(lanes, calibration):
    result, frames, _ = lanes["A"]
    assert {"iteration", "least squares", "least squares spared"} == set(result.own["variant"])
    plain, spared = (
        np.abs(own_changes(both(lanes), name)[0]).mean()
        for name in ("least squares", "least squares spared")
    )
    assert spared < plain / 2
    change, mine = own_changes(both(lanes), "iteration")
    assert len(change) == len(mine) > 8
    clear = result.own[(result.own["variant"] == "iteration") & ~result.own["masked"]]
    assert (clear["change_db"] < 0.5).all()
    assert (
        clear["change_db"].median() > -3.0
    )  # nothing lies over them, but the frame's own fit takes a part
    one = clean(stage_forms(frames, calibration), 1, ("original", "iteration"))
    data = one.data["original"]
    made = [
        suppressed_alone(one, part) for part in (frames.mines[:2], data - frames.mines[:2], data)
    ]
    np.testing.assert_allclose(
        made[0] + made[1], made[2], atol=2e-4 * np.abs(made[2]).max()
    )  # linear ...
    whole = one.aperture.stack_on(one.stage.points)
    mine = np.abs(whole.adjoint(made[2])[0, 0])
    said = np.abs(one.images["iteration"])
    np.testing.assert_allclose(
        mine, said, atol=2e-3 * said.max()
    )  # ... and what the iteration did to all of it


@pytest.mark.slow("runs a quick form of the whole study")
def test_one_frame_lies_within_the_spread_of_the_others():
    rng = np.random.default_rng(0)
    wrong = 0
    for _ in range(400):
        value = rng.normal(24, 3, 41)
        boxes = pd.DataFrame({"lane": "A", "frame": np.repeat(np.arange(20), 2)})
        spread = frame_spread(boxes.iloc[:38], value[:38])
        wrong += abs(value[:38].mean() - value[38:40].mean()) > spread
    assert 0.02 < wrong / 400 < 0.1
    assert frame_spread(boxes.iloc[:2], value[:2]) == 0


def test_truth_does_not_reach_masks_suppression_or_alarms(calibration):
    frames = make_frames("A", 2, 4)
    blind = replace(frames, truth=frames.truth.iloc[:0], objects=frames.objects.iloc[:0])
    with_truth, without = (
        process_lane(one, calibration, RECIPE, silent, ("original", "iteration"), 2)
        for one in (frames, blind)
    )
    assert with_truth.tables["alarms"] == without.tables["alarms"]
    assert not without.tables["mines"]
    assert not without.tables["boxes"]


def test_a_single_band_run_is_masked_by_vv_and_vh(calibration):
    frames = make_frames("A", 2, 3, bands=("l",))
    only = {name: value for name, value in calibration.learnt.items() if name != "second"}
    cleaned = clean(
        stage_forms(frames, replace(calibration, learnt=only)), 2, ("original", "iteration")
    )
    assert cleaned.aperture.second is None
    assert np.array_equal(cleaned.masks["pixel"], cleaned.masks["L"])
    assert cleaned.masks["pixel"].any()
    with pytest.raises(ValueError, match="trained with a second band"):
        stage_forms(frames, calibration)


def test_equal_cost_counts_pixels(calibration):
    cleaned = clean(stage_forms(make_frames("A", 2, 3), calibration), 2, ("original",))
    region = cleaned.stage.region
    mask = np.zeros(region.shape, bool)
    mask[0, :10] = True
    area = int((region == 0).sum())
    assert equal_cost(7, mask, region) == 7 * (20 + area) // 20
    assert equal_cost(7, np.zeros_like(mask), region) == 1


@pytest.mark.slow("runs a quick form of the whole study")
def test_scores_count_every_frame_or_every_place(lanes):
    lane, frames, _ = lanes["A"]
    looks = frame_match(lane, "original", RECIPE)
    used = np.flatnonzero(np.isfinite(lane.poses[:, 0]))
    wanted = sum(
        5 <= y <= 10 and abs(x) <= 7 for k in used for x, y in local(frames.truth, lane.poses[k])
    )
    assert looks.truth["inside"].sum() == wanted
    assert set(looks.truth["mine"]) <= set(frames.truth["target_id"])
    matched, curve, options = scored(lane, "original", RECIPE, "frames")
    assert curve.attrs["area"] == len(used) * 70.0
    assert curve["n_targets"].iloc[0] == wanted
    assert options["cluster"] == "mine"
    assert matched.halo == 0.5
    place = lane_match(lane, "original", RECIPE)
    assert len(place.truth) == len(frames.truth)
    better = [
        held_pd_mean(scored(lane, name, RECIPE, "frames")[1]) for name in ("iteration", "original")
    ]
    assert better[0] >= better[1]


@pytest.mark.slow("runs a quick form of the whole study")
def test_what_is_on_disk_is_not_made_again(lanes, calibration, tmp_path, monkeypatch):
    monkeypatch.setattr(process, "simulate_lane", lambda *_: None)
    monkeypatch.setattr(process, "calibrate", lambda *_: calibration)
    first = process.stored_calibration(tmp_path, RECIPE, True, silent)
    monkeypatch.setattr(process, "calibrate", lambda *_: pytest.fail("made again"))
    again = process.stored_calibration(tmp_path, RECIPE, True, silent)
    np.testing.assert_array_equal(first.learnt["vh"], again.learnt["vh"])
    np.testing.assert_array_equal(first.background, calibration.background)
    keys = {process.result_key(RECIPE, quick) for quick in (False, True)}
    keys |= {
        process.result_key(fuse_recipe(), False),
        process.result_key(RECIPE, True, calibration),
    }
    assert len(keys) == 4
    lane, frames, _ = lanes["A"]
    assert lane.frames == 3
    assert lane.maps["original"].shape[1] == 101
    assert len(frames) == 6


def test_loosened_poses_are_wrong_alike_in_both_bands():
    frames = make_frames("A", 2, 60)
    runs, wrong = (one.stage.setup for one in (frames, fuse2018.loosened(frames, RECIPE)))
    shift = wrong.run["pose"].values - runs.run["pose"].values
    np.testing.assert_allclose(
        wrong.others["x"]["pose"].values - runs.others["x"]["pose"].values, shift, atol=1e-12
    )
    total = np.hypot(shift[:, :3].std(), RECIPE.radar.position)
    assert total == pytest.approx(RECIPE.study.loose_position, rel=0.15)
    assert not shift[:, 3:].any()


@pytest.mark.slow("runs a quick form of the whole study")
def test_the_page_tells_all(lanes, calibration, tmp_path, monkeypatch):
    results = both(lanes)
    loose = results[0]
    found = all_findings(results, loose, RECIPE)
    assert {one.verdict for one in found} <= {*VERDICTS, OPEN}
    assert all(one.interval is not None for one in found)
    assert sum("ROC better with suppression" in one.claim for one in found) == 4
    made_up = {
        "fuse_recipe": RECIPE,
        "stored_calibration": calibration,
        "read_arrays": lanes["A"][2],
    }
    for name, value in made_up.items():
        monkeypatch.setattr(fuse2018, name, lambda *_, value=value, **__: value)
    monkeypatch.setattr(fuse2018, "lane_result", lambda _, __, name, *___, **____: lanes[name][0])
    html = fuse2018.STUDY.reproduce(tmp_path, quick=True).read_text("utf-8")
    assert "<code>prepared-sand</code>" in html
    assert "on roads as found" not in html
    assert html.count("data:image/png;base64,") == 12
    assert all(f"Fig. {number}. " in html for number in range(1, 10))
    assert all(one.paper.strip() for one in found)
    assert "Quick run" in html
    assert html.count(f"<b>{NO_VERDICT}</b>") + html.count(f"<b>{OPEN}</b>") == len(found)
    assert (tmp_path / "figure-9.png").is_file()


def test_the_chain_cleans_as_the_study_does(calibration):
    """What detection is run on is what the study calls by the method's name."""
    frames = make_frames("A", 2, 3)
    forms = stage_forms(frames, calibration)
    cleaned = clean(forms, 2, ("original", *forms))
    for name, form in forms.items():
        stage = trained(frames.stage, calibration.learnt, **form.settings.model_dump())
        kept = stage.passes()[-1].start(None)
        kept.add(2)
        np.testing.assert_array_equal(kept.state(False)["data"][0], cleaned.data[name])
    data = list(cleaned.data.values())
    assert not any(np.array_equal(one, other) for one, other in itertools.combinations(data, 2))


def test_the_extended_masks_threshold_is_that_of_the_frame(calibration):
    frames = make_frames("A", 2, 3)
    forms = stage_forms(frames, calibration)
    one = forms["iteration"].aperture(2)
    own, learnt = (forms[name].limits_for(one) for name in ("iteration", "calibrated roadside"))
    beside = (np.abs(forms["iteration"].across) >= 4) & (np.abs(forms["iteration"].across) <= 10)
    for number in range(4):
        pixels = beside & (forms["iteration"].region == number)
        assert own.low_vh[number] == pytest.approx(np.abs(one.vh[pixels]).mean(), rel=1e-5)
    np.testing.assert_array_equal(learnt.low_vh, calibration.learnt["low_vh"])
    assert own.vv is not None
    np.testing.assert_array_equal(own.vv, learnt.vv)


def test_a_course_that_fell_back_is_told(calibration):
    frames = make_frames("A", 2, 3)
    stage = trained(frames.stage, calibration.learnt)
    stage.setup = replace(
        stage.setup, results={"masks-000000": {"fallen": np.array([True, False, True])}}
    )
    assert stage.notes() == {"suppressions_fallen_back": 2}
    stage.setup = replace(stage.setup, results={"masks-000000": {"fallen": np.array([False])}})
    assert stage.notes() == {}
