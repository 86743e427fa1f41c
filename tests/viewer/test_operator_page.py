"""What an operator sees: which way is stricter, what symbols and pictures are, and ground that no scan has seen."""

import io
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from PIL import Image
from watching import viridis

from flgpr.detect import FisherDiscriminant, HistogramNormalizer
from flgpr.method.classifier import Classifier
from flgpr.method.detection import Detection
from flgpr.method.stands_out import StandingOut
from flgpr.model import Lane
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.results.result import write_result
from flgpr.results.view_files import shown_stage
from small_results import small_result

pytestmark = pytest.mark.slow("a browser draws every page")

MASKED = [*range(26, 34), 36]


def gappy_result(folder):
    """Write a lane whose track has a gap and some of whose scans are left out: rows that no scan sees are NaN."""
    recipe = parse_recipe(recipe_text("wang2007"))
    near = recipe.image.y[0]
    far = recipe.run_view.y_max
    pose = np.zeros((40, 6))
    pose[:, 1] = np.arange(40) * 2.0 - 10
    pose[:, 2] = 5.0
    pose[20:, 1] += 24
    x = np.round(np.arange(-2.95, 3, 0.1), 9)
    y = np.round(np.arange(-5, 110, 0.1), 9)
    own = np.delete(pose[:, 1], MASKED)
    seen = ((y[:, None] - own >= near) & (y[:, None] - own <= far)).any(axis=1)
    values = np.where(seen[:, None], 10.0, np.nan)[None, None].repeat(x.size, 3).astype(np.float32)
    looks = ("y", "x"), np.ones(values.shape[2:])
    coords = {"polarization": ["HH"], "subband": ["F1"], "y": y, "x": x, "looks": looks}
    view = xr.DataArray(values, dims=("polarization", "subband", "y", "x"), coords=coords)
    alarms = pd.DataFrame({"alarm_id": ["a"], "x": [1.0], "y": [20.0], "confidence": [9.0]})
    run = {"title": "gaps", "pose": pose.tolist(), "masked_scans": MASKED, "scans": 40}
    found = Detection("main", "", alarms, view)
    lane = Lane(-2, 2, 0, 105)
    return write_result(folder, [found], recipe_text("wang2007"), lane, run)


def trained():
    rng = np.random.default_rng(0)
    values = rng.normal(0, 1, (60, 1)) + 6 * (np.arange(60) % 2)[:, None]
    label = np.arange(60) % 2
    normalizer = HistogramNormalizer().fit(values)
    return Classifier(
        ("C_HH_F1",), normalizer, FisherDiscriminant().fit(normalizer.transform(values), label)
    )


def test_the_slider_says_which_way_is_stricter_and_what_it_costs(watch, shown):
    one = watch(shown)
    page = one.page
    slider = one.page.locator("#threshold")
    place = {
        name: page.get_by_text(name, exact=True).bounding_box()["x"]
        for name in ("stricter", "more alarms")
    }
    assert place["stricter"] < slider.bounding_box()["x"] < place["more alarms"]
    assert one.text("#threshold-left") == "5 of 11 alarms left"
    slider.fill("0")
    assert one.text("#threshold-left") == "0 of 11 alarms left"
    slider.fill(slider.get_attribute("max"))
    assert one.text("#threshold-left") == "11 of 11 alarms left"


def test_the_curve_comes_down_to_no_detection_at_no_false_alarm(watch, shown):
    """The demo finds two of three at FAR 0: between Pd 0 and 0.67 the left end has the curve's colour."""
    one = watch(shown)
    one.page.locator("#threshold").fill("0")
    picture = one.page.locator("#roc-plot").screenshot()
    seen = np.asarray(Image.open(io.BytesIO(picture)).convert("RGB")).astype(int)
    ink = np.array([0x0B, 0x62, 0xA4])
    filled = (np.abs(seen[:, 30:70] - ink).max(axis=2) < 12).any(axis=1)
    ends = np.flatnonzero(filled)
    assert filled[ends[0] : ends[-1]].mean() > 0.95  # one line, not dots
    assert ends[-1] - ends[0] > 0.4 * len(seen)


def test_the_legend_tells_halo_border_and_what_is_missed_as_it_is_drawn(watch, shown):
    one = watch(shown)
    page = one.page
    assert "halo, 0.5 m" in one.text("#legend")
    assert "lane" in one.text("#legend").split("\n")
    assert "seen by no scan" not in one.text("#legend")

    def paths(name):
        drawn = page.locator("#legend li").filter(has_text=name).locator("path")
        return drawn.evaluate_all(
            "(all) => all.map((one) => [one.getAttribute('d'), one.getAttribute('stroke')])"
        )

    shape = paths("plastic")
    missed = paths("missed")
    assert [d for d, _ in missed] == [
        d for d, _ in shape
    ]  # the plastic mine is missed: a triangle, not a hexagon
    assert shape[1][1] == "#ffffff"
    assert missed[1][1] == "#ff7a59"
    page.locator("#threshold").fill("0")
    assert page.locator("#legend li").filter(has_text="missed").locator("svg").count() == 2
    page.uncheck("#show-truth")
    assert "halo" not in one.text("#legend")


def test_pictures_are_called_by_what_they_are(watch, shown, serving, tmp_path):
    """The demo suppresses nothing; the small result is of wang2007, which takes the self-signature away."""
    names = "#a-set option"
    assert watch(shown).page.locator(names).all_inner_texts()[:2] == [
        "as imaged",
        "without suppression",
    ]
    small_result(tmp_path / "small")
    with serving([tmp_path / "small"]) as viewer:
        assert watch(viewer).page.locator(names).all_inner_texts() == ["after suppression"]


def test_stages_follow_the_recipe():
    shown = {
        "demo": "without clutter suppression",
        "demo-mean-self-signature": "after clutter suppression",
        "demo-roadside-suppressed": "after clutter suppression",
        "fuse2018": "after clutter suppression",
        "fused": "map by likelihood",
    }
    for name, stage in shown.items():
        assert shown_stage(parse_recipe(recipe_text(name))) == stage


def test_a_result_of_a_trained_detector_opens_where_it_decides(watch, serving, tmp_path):
    """Of confidences 9, 4 and 2.5 those from zero on; with the border moved to 4 as a stand-in, two of three."""
    classifier = trained()
    assert classifier.border == 0
    small_result(tmp_path / "zero", classifier)
    small_result(
        tmp_path / "four",
        type("Moved", (Classifier,), {"border": 4.0})(**vars(replace(classifier))),
    )
    for name, left in (("zero", 3), ("four", 2)):
        with serving([tmp_path / name]) as viewer:
            one = watch(viewer)
            assert one.text("#threshold-left") == f"{left} of 3 alarms left"
            assert "decides for a mine" in one.text("#point")


def test_without_truth_the_page_begins_with_what_stands_out_and_on_which_ground(
    watch, serving, tmp_path
):
    stands_out = StandingOut(1, 2, 9.0, "tail", 0.01).as_json()
    notes = ["this ground is unlike the training", "the eigenvalue is 11.9 (limit 8.23)"]
    small_result(tmp_path / "told", stands_out=stands_out, unlike={"notes": notes})
    with serving([tmp_path / "told"]) as viewer:
        for size in ((390, 844), (820, 1180), (1280, 800)):
            one = watch(viewer, size=size)
            assert one.text("#answer") == "1 place stands out, 2 are weak."
            assert one.text("#unlike") == "This ground is unlike the training."
            assert one.text("#point").startswith("At most one place of this lane's clutter")
            assert one.text("#point").endswith("The eigenvalue is 11.9 (limit 8.23).")
            for name in ("#answer", "#unlike"):
                assert one.page.locator(name).bounding_box()["y"] < 250
            assert one.text("#roc-plot").startswith("Not scored: flgpr score RESULT")
    stands_out = StandingOut(2, 1, 4.0, "tail", 0.02, beside=1).as_json()
    small_result(tmp_path / "other", stands_out=stands_out)
    with serving([tmp_path / "told", tmp_path / "other"]) as viewer:
        both = "2 places stand out, 1 is weak, 1 stands out beside the lane."
        assert watch(viewer).text("#answer") == f"A: 1 place stands out, 2 are weak. B: {both}"


def test_ground_that_no_scan_has_seen_is_hatched_and_says_why(watch, serving, tmp_path):
    gappy_result(tmp_path / "gaps")
    with serving([tmp_path / "gaps"]) as viewer:
        one = watch(viewer)
        page = one.page
        assert "seen by no scan" in one.text("#legend")
        picture = one.pixels()
        box = page.locator("#lane").bounding_box()
        width, height = box["width"] - 98, box["height"] - 42
        scale = 0.985 * width / 115  # the whole lane from -5.05 to 109.95 m is in sight

        def at(y):
            return 46 + width / 2 + (y - 52.45) * scale, 8 + height / 2

        told = {
            -4.5: "before the first one's sight,\nwhich begins 7 m ahead",
            50.0: "gap in the track from scan 19 to 20,\ny 28.00 to 54.00 m",
            85.5: "scans 28 to 32 left out,\nsweeps are missing",
            109.5: "beyond the last one's sight,\nwhich ends 16 m ahead",
        }
        for y, words in told.items():
            px, py = at(y)
            page.mouse.move(box["x"] + px, box["y"] + py)
            assert one.text("#tip").replace("\u2212", "-") == f"seen by no scan: {words}", y
        middle = picture[int(at(0)[1]) - 20 :][:40]
        inks = [np.unique(middle[:, int(at(y)[0])], axis=0) for y in (50.0, 30.0)]
        assert len(inks[0]) > 3  # stripes
        assert np.abs(inks[1] - viridis(5 / 35)).max() < 8  # one value, at the median
        page.mouse.move(box["x"] + at(30.0)[0], box["y"] + at(30.0)[1])
        assert page.locator("#tip").is_hidden()
        page.mouse.click(box["x"] + at(50.0)[0], box["y"] + at(50.0)[1])
        assert "gap in the track" in page.text_content("#said")
        _, data = one.saved("#export-svg")
        assert re.search(rb"data:image/png", data)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_words_under_the_pointer_do_not_move_the_picture(watch, shown, scheme):
    one = watch(shown, scheme=scheme)
    before = one.page.locator("#lane").bounding_box()
    one.page.mouse.move(before["x"] + 300, before["y"] + 200)
    assert one.text("#readout")
    assert one.page.locator("#lane").bounding_box() == before
