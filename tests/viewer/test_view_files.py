"""What detection writes for the viewer, against slow twins and known scenes."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from flgpr.features import PatchShape
from flgpr.method.detection import Detection
from flgpr.method.evidence import MOST_SCANS, EvidenceSums
from flgpr.method.look_samples import decibels, focused_trace, range_kernel
from flgpr.model import SPEED_OF_LIGHT
from flgpr.results.result import read_result
from flgpr.results.view_files import TILE_ROWS, plain_json, pyramid
from flgpr.store import open_run, sample_lane


def slow_trace(signal, frequency, tx, rx, point, offset):
    """The definition, one term at a time."""
    half = (frequency[-1] - frequency[0]) / 2
    total = 0
    weights = 0
    for p in range(len(tx)):
        path = np.linalg.norm(tx[p] - point) + np.linalg.norm(rx[p] - point)
        for k, f in enumerate(frequency):
            weight = np.cos(np.pi * (f - frequency[0] - half) / half / 2) ** 2
            total += (
                weight
                * signal[p, k]
                * np.exp(2j * np.pi * f * (path + 2 * offset) / SPEED_OF_LIGHT)
            )
            weights += weight
    return abs(total) / weights


def echo(frequency, tx, rx, point):
    path = np.linalg.norm(tx - point, axis=1) + np.linalg.norm(rx - point, axis=1)
    return np.exp(-2j * np.pi * path[:, None] * frequency / SPEED_OF_LIGHT)


@pytest.fixture
def array():
    x = np.linspace(-1, 1, 6)
    tx = np.zeros((6, 3))
    rx = np.stack([x, 0 * x, 0 * x + 1.5], axis=1)
    tx[:, 2] = 1.6
    return 0.5e9 + 1e7 * np.arange(60), tx, rx


def test_trace_is_its_definition(array):
    rng = np.random.default_rng(3)
    frequency, tx, rx = array
    signal = rng.normal(size=(2, 6, 60)) + 1j * rng.normal(size=(2, 6, 60))
    point = np.array([0.4, 5.0, 0.0])
    offsets = np.array([-1.0, 0.0, 0.3])
    points = np.stack([point, [-0.2, 9.0, 0.0]])
    fast = focused_trace(signal, frequency, tx, rx, points, range_kernel(frequency, offsets))
    slow = [
        [[slow_trace(one, frequency, tx, rx, p, offset) for offset in offsets] for one in signal]
        for p in points
    ]
    np.testing.assert_allclose(fast, slow, atol=1e-6)  # a ten-thousandth of the noise


def test_trace_of_a_point_scatterer_peaks_on_it_at_unit_height(array):
    frequency, tx, rx = array
    point = np.array([0.4, 5.0, 0.0])
    signal = echo(frequency, tx, rx, point)[None]
    offsets = np.linspace(-2, 2, 161)
    away = point + 0.5 * point * [1, 1, 0] / np.hypot(*point[:2])
    here, there = focused_trace(
        signal, frequency, tx, rx, np.stack([point, away]), range_kernel(frequency, offsets)
    )[:, 0]
    assert here[80] == pytest.approx(1, abs=1e-6)
    assert here.argmax() == 80
    assert offsets[there.argmax()] == pytest.approx(-0.5, abs=0.06)


def test_patches_and_cuts_hold_the_image(demo):
    index = json.loads((demo[0].folder / "view" / "index.json").read_text())
    entry = index["detections"][0]["evidence"]
    values = np.fromfile(demo[0].folder / "view" / entry["file"], "<f2")
    assert values.size == entry["start"][-1]
    size = entry["patch"]["size"]
    cut = len(entry["cut"])
    trace = len(entry["trace"])
    block = 16 * (size**2 + cut) + 4 * trace
    alarms = demo[0].detections[0].alarms
    pose = np.asarray(demo[0].manifest["run"]["pose"])
    for row, scans in enumerate(entry["scans"]):
        own = values[entry["start"][row] : entry["start"][row + 1]].reshape(len(scans), block)
        place = alarms[["x", "y"]].to_numpy()[row]
        for one, look in zip(own, scans, strict=True):
            assert look["distance"] == pytest.approx(
                np.hypot(*(place - pose[look["scan"], :2])), abs=1e-3
            )
            patches = one[: 16 * size**2].reshape(16, size, size)
            cuts = one[16 * size**2 : 16 * (size**2 + cut)].reshape(16, cut)
            # The middle of the patch and of the cut are both the pixel of the alarm.
            np.testing.assert_array_equal(patches[:, size // 2, size // 2], cuts[:, cut // 2])
        assert [look["distance"] for look in scans] == sorted(look["distance"] for look in scans)


@pytest.fixture
def approach():
    """Eight scans of a vehicle that drives on, in dB like their number, and three alarms, one of them out of sight."""
    x = np.linspace(-2, 2, 41)
    y = np.linspace(2, 14, 121)
    images = []
    for scan in range(8):
        values = np.full((1, 1, y.size, x.size), 10.0 ** (scan / 20), np.complex64)
        coords = {"polarization": ["HH"], "subband": ["all"], "y": y, "x": x}
        attrs = {"scan": scan, "pose": [0, 1.0 * scan, 5, 0, 0, 0]}
        images.append(
            xr.DataArray(
                values, dims=("polarization", "subband", "y", "x"), coords=coords, attrs=attrs
            )
        )
    return (
        images,
        pd.DataFrame({"x": [0.0, 1.0, 50.0], "y": [12.0, 3.5, 12.0]}),
        PatchShape(5, 0.1, (1, 1), (3, 3)),
    )


def gathered(images, *arguments):
    sums = EvidenceSums(*arguments)
    for image in images:
        sums.add(image)
    return sums.result()


def test_only_the_nearest_scans_are_kept(approach):
    found = gathered(*approach, 20.0)
    assert [[look["scan"] for look in scans] for scans in found.scans] == [[7, 6, 5, 4], [1, 0], []]
    assert len(found.scans[0]) == MOST_SCANS
    assert [block.shape for block in found.blocks] == [(4, 25 + 81), (2, 25 + 81), (0, 0)]
    np.testing.assert_allclose(found.blocks[0][0, :25], 7.0, atol=1 / 64)
    assert found.polarimetric["entropy"].isna().all()  # one polarization alone says nothing


def polarized(image):
    """Three polarizations of which the second turns with every scan."""
    turn = np.exp(0.5j * image.attrs["scan"])
    values = np.concatenate([image.values, turn * image.values, 0.1j * image.values]).astype(
        np.complex64
    )
    return xr.DataArray(
        values,
        dims=image.dims,
        coords={**image.coords, "polarization": ["HH", "VV", "HV"]},
        attrs=image.attrs,
    )


def test_with_poses_known_only_what_will_be_kept_is_cut_up(approach):
    images, alarms, patch = approach
    images = [polarized(image) for image in images]
    expected = gathered(images, alarms, patch, 20.0)
    poses = {image.attrs["scan"]: np.asarray(image.attrs["pose"]) for image in images}
    together = EvidenceSums(alarms, patch, 20.0)
    kept = []
    for part in (images[:3], images[3:]):
        sums = EvidenceSums(alarms, patch, 20.0, poses=poses)
        for image in part:
            sums.add(image)
        kept += sums.state()["scan"].tolist()
        together.merge(sums.state())
    found = together.result()
    assert sorted(kept) == [0, 1, 4, 5, 6, 7]
    assert found.scans == expected.scans
    for one, other in zip(found.blocks, expected.blocks, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found.polarimetric["entropy"][0] > 0.1
    pd.testing.assert_frame_equal(found.polarimetric, expected.polarimetric)


def test_decibels_keep_half_precision_and_gaps():
    values = np.array([1.0, 10.0, 0.0, np.nan, 1e-3, 30.0])
    seen = decibels(values).astype(float)
    np.testing.assert_allclose(seen[[0, 1, 2, 4, 5]], [0, 20, -120, -60, 29.54], atol=0.02)
    assert np.isnan(seen[3])


@pytest.mark.parametrize("rows", [1, 511, 512, 513, 1200, 2049])
def test_every_level_keeps_the_brightest(rows):
    rng = np.random.default_rng(rows)
    level = rng.normal(size=(rows, 7)).astype(np.float16)
    level[rng.random(level.shape) < 0.1] = np.nan
    levels = list(pyramid(level))
    assert len(levels[-1]) <= TILE_ROWS
    for number, one in enumerate(levels):
        step = 2**number
        assert len(one) == -(-rows // step)
        for row in (0, len(one) // 2, len(one) - 1):
            group = level[row * step : (row + 1) * step]
            expected = np.where(np.isnan(group).all(axis=0), np.nan, np.fmax.reduce(group, axis=0))
            np.testing.assert_array_equal(one[row], expected)


def test_view_files_are_under_the_manifests_digests(demo):
    files = demo[0].manifest["files"]
    written = {
        path.relative_to(demo[0].folder).as_posix()
        for path in (demo[0].folder / "view").rglob("*.*")
    }
    assert written - {"view/score.json"} == {name for name in files if name.startswith("view/")}
    layer = demo[0].folder / "view" / "layers" / "main.0.0.0.f16"
    whole = layer.read_bytes()
    try:
        layer.write_bytes(whole[:-1] + b"\x00")
        with pytest.raises(ValueError, match=r"main\.0\.0\.0\.f16 differs"):
            read_result(demo[0].folder)
    finally:
        layer.write_bytes(whole)


def test_before_is_brighter_than_after_at_the_roadside(demo):
    """The strip of the roadside-suppressed variant shows the post before and not after."""
    index = json.loads((demo[0].folder / "view" / "index.json").read_text())
    grid = index["grid"]
    row = round((4.0 - grid["y"]) / grid["dy"])
    column = round((-1.2 - grid["x"]) / grid["dx"])
    seen = {}
    for one in index["layers"]:
        if (one["polarization"], one["subband"]) == ("HH", "0.45-1.5"):
            file = demo[0].folder / "view" / one["levels"][0]["file"]
            values = np.fromfile(file, "<f2").reshape(grid["ny"], grid["nx"]).astype(float)
            seen[one["detection"]] = values[row, column] - one["percentiles"]["50"]
    assert seen["before"] > 20
    assert seen["main"] > 20
    assert seen["roadside-suppressed"] < 5


def test_contributions_add_up_to_the_confidence(demo):
    index = json.loads((demo[0].folder / "view" / "index.json").read_text())
    for one in index["detections"]:
        total = np.sum([column for column in one["contributions"].values()], axis=0)
        np.testing.assert_allclose(total, one["alarms"]["confidence"], rtol=1e-5)


def test_every_subset_of_the_score_adds_up(demo):
    content = json.loads((demo[0].folder / "view" / "score.json").read_text())["content"]
    for name, one in content["detections"].items():
        curves = {(curve["kind"], curve["depth"]): curve for curve in one["curves"]}
        whole = curves[None, None]
        for group in (
            [(kind, None) for kind in content["kinds"]],
            [(None, depth) for depth in content["depths"]],
        ):
            parts = [curves[key] for key in group]
            assert sum(part["n_targets"] for part in parts) == whole["n_targets"]
            assert (
                np.sum([part["n_detected"] for part in parts], axis=0).tolist()
                == whole["n_detected"]
            )
        scored = next(score for score in demo[1] if score.name == name)
        np.testing.assert_allclose(one["shared"]["far"], scored.curve["far"], rtol=1e-4)
        np.testing.assert_allclose(whole["pd_high"], scored.curve["pd_high"], rtol=1e-4)
        np.testing.assert_allclose(whole["chance"], scored.curve["chance"], rtol=1e-4)
        assert (
            one["shared"]["threshold"][one["shared"]["point"]["row"]] == scored.point["threshold"]
        )


def test_plain_json_leaves_nothing_that_json_lacks():
    value = {
        "a": np.float32(1.5),
        "b": [np.nan, np.inf, np.int64(3)],
        "c": np.array([True]),
        4: None,
    }
    assert plain_json(value) == {"a": 1.5, "b": [None, None, 3], "c": [True], "4": None}


def test_run_views_of_another_grid_are_refused(demo, tmp_path):
    from flgpr.results.view_files import write_view

    main = demo[0].detections[0]
    other = Detection("other", "other", main.alarms, main.view.isel(y=slice(0, 50)))
    with pytest.raises(ValueError, match="run-views must share one grid, got another in 'other'"):
        write_view(tmp_path, [main, other], demo[0].lane, {}, demo[0].recipe)


def test_the_signal_is_read_once_per_scan_and_not_altered():
    run = open_run(sample_lane() / "run.zarr")
    before = run["signal"].values.copy()
    images = [
        xr.DataArray(
            np.ones((1, 1, 3, 3), np.complex64),
            dims=("polarization", "subband", "y", "x"),
            coords={
                "polarization": ["HH"],
                "subband": ["all"],
                "y": [2.0, 3.0, 4.0],
                "x": [-1.0, 0.0, 1.0],
            },
            attrs={"scan": 0, "pose": run["pose"].values[0].tolist()},
        )
    ]
    alarms = pd.DataFrame({"x": [0.0], "y": [3.0]})
    found = gathered(images, alarms, PatchShape(3, 0.1, (1, 1), (1, 1)), 5.0, run)
    assert found.blocks[0].shape == (1, 9 + 81 + 4 * len(found.trace))
    np.testing.assert_array_equal(run["signal"].values, before)
