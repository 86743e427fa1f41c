"""CFAR, RX, matched filters and the subspace of low rank against their formulas, and ranking by a stage's column."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from sklearn.covariance import ledoit_wolf

import flgpr
from flgpr.clutter import standing_field, subtract_standing
from flgpr.live.detector import LiveDetector
from flgpr.method.detection import rank_alarms
from flgpr.method.imaged_run import ImagedRun
from flgpr.method.method import detect, engine_of
from flgpr.method.model import load_model
from flgpr.method.sections import Section, lane_threshold
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe, parse_recipe
from flgpr.stages import TrainingView
from flgpr.store import describe_for_live, save_run
from flgpr_ground.stages.anomaly import Cfar, CfarSettings, Matched, MatchedSettings, Rx, RxSettings
from flgpr_ground.stages.low_rank import LowRank, LowRankSettings, low_rank_part
from small_lane import LANE, LANE_TOML, TARGETS, small_recipe, small_run

X = np.round(np.arange(-2, 2.05, 0.1), 9)
Y = np.round(np.arange(0, 10.05, 0.1), 9)
ONE = [[0.0, 5.0]]  # a place: pixel 50, 20
TRUTH = pd.DataFrame(
    {"x": TARGETS[:, 0], "y": TARGETS[:, 1], "kind": ["metal", "plastic", "metal"]}
)


def as_view(values, polarization=("HH", "VV"), subband=("F1", "F2")):
    coords = {"polarization": list(polarization), "subband": list(subband), "y": Y, "x": X}
    return xr.DataArray(np.asarray(values, np.float32), dims=tuple(coords), coords=coords)


def speckle(seed=1):
    return np.random.default_rng(seed).rayleigh(1.0, (2, 2, Y.size, X.size))


def cfar(view, places=ONE, **settings):
    return Cfar(CfarSettings(**settings), None).of_view(view, np.array(places, float))["cfar"]


def rx(view, places=ONE, **settings):
    return Rx(RxSettings(**settings), None).of_view(view, np.array(places, float))["rx"]


# The ring of guard 0.2 m and outer 0.4 m: 9 x 9 pixels less 5 x 5.
SMALL = {"reach": 0.2, "guard": (0.2, 0.2), "outer": (0.4, 0.4)}


def ring_of(values, row=50, column=20):
    ring = np.ones((9, 9), bool)
    ring[2:7, 2:7] = False
    return values[..., row - 4 : row + 5, column - 4 : column + 5][..., ring]


def test_cfar_is_the_peak_over_the_ring():
    values = speckle()
    values[0, 0, 51, 21] = 9.0
    ring = ring_of(values[0, 0])
    assert ring.size == 56
    view = as_view(values)
    np.testing.assert_allclose(cfar(view, **SMALL), 20 * np.log10(9.0 / ring.mean()), rtol=1e-5)
    np.testing.assert_allclose(
        cfar(view, kind="ordered", **SMALL),
        20 * np.log10(9.0 / np.sort(ring)[int(0.75 * 56) - 1]),
        rtol=1e-5,
    )
    np.testing.assert_allclose(
        cfar(view, polarization="VV", subband="F2", **SMALL),
        20 * np.log10(max(values[1, 1, 50 + j, 20 + i] for j in (-2, -1, 0, 1, 2) for i in (-2, -1, 0, 1, 2)
                          if i * i + j * j <= 4) / ring_of(values[1, 1]).mean()),
        rtol=1e-5,
    )  # fmt: skip
    with pytest.raises(ValueError, match="polarization must be one of HH, VV, got 'XX'"):
        cfar(view, polarization="XX")


def test_an_ordered_level_is_not_lifted_by_a_neighbour():
    values = speckle()
    values[0, 0, 50, 20] = 9.0
    before = {kind: cfar(as_view(values), kind=kind, **SMALL)[0] for kind in ("average", "ordered")}
    values[0, 0, 46:48, 22:25] = 40.0
    after = {kind: cfar(as_view(values), kind=kind, **SMALL)[0] for kind in ("average", "ordered")}
    assert before["average"] - after["average"] > 8.0
    assert before["ordered"] - after["ordered"] < 2.5


def test_unseen_pixels_are_left_out_and_too_few_give_nan():
    values = speckle()
    values[0, 0, :49] = np.nan
    ring = ring_of(values[0, 0])
    peak = values[0, 0, 50, 20] = 9.0
    want = 20 * np.log10(peak / ring[np.isfinite(ring)].mean())
    np.testing.assert_allclose(cfar(as_view(values), **SMALL), want, rtol=1e-5)
    assert np.isnan(cfar(as_view(values), least=57, **SMALL)).all()
    assert np.isnan(rx(as_view(values), least=57, **SMALL)).all()
    assert np.isnan(cfar(as_view(values), places=[[0.0, 2.0]], **SMALL)).all()
    assert cfar(as_view(values), places=np.zeros((0, 2))).shape == (0,)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"reach": 0.6}, "reach must be at most guard .* got 0.6"),
        ({"outer": (0.5, 0.5)}, "outer must be at least guard .* and larger in x or y"),
        ({"outer": (2.0, 0.1)}, r"outer must be .* got \(2.0, 0.1\)"),
        ({"least": 1}, "least"),
    ],
)
def test_rings_that_are_none_are_refused(settings, told):
    with pytest.raises(ValueError, match=told):
        CfarSettings(**settings)


def test_rx_is_the_mahalanobis_distance_and_its_sign_tells_bright_from_dark():
    values = speckle()
    values[..., 50, 20] = [[9.0, 4.0], [7.0, 3.0]]
    ring = (
        20
        * np.log10(
            ring_of(values.reshape(4, *values.shape[-2:]).astype(np.float32)).astype(float)
        ).T
    )
    off = 20 * np.log10([9.0, 4.0, 7.0, 3.0]) - ring.mean(axis=0)
    want = off @ np.linalg.solve(ledoit_wolf(ring)[0], off)
    np.testing.assert_allclose(rx(as_view(values), **SMALL), want, rtol=1e-4)
    np.testing.assert_allclose(rx(as_view(5 * values), **SMALL), want, rtol=1e-4)
    values[..., 48:53, 18:23] = 0.05
    assert rx(as_view(values), **SMALL) < 0


def test_rx_of_correlated_gaussian_logs_is_about_chi_squared():
    rng = np.random.default_rng(5)
    mix = np.eye(4) + 0.5 * np.tri(4)
    logs = np.einsum("ij,jyx->iyx", mix, rng.normal(size=(4, Y.size, X.size))).reshape(
        2, 2, Y.size, X.size
    )
    x, y = np.meshgrid(X[13:-13:2], Y[13:-13:2])
    own = {
        "reach": 0.01,
        "guard": (0.1, 0.1),
        "outer": (1.2, 1.2),
    }  # the alarm's own pixel, no maximum
    found = np.abs(rx(as_view(10 ** (logs / 20)), np.column_stack([x.ravel(), y.ravel()]), **own))
    error = 5 * np.sqrt(
        8 / found.size
    )  # the mean of chi-squared with 4 degrees of freedom is 4, its variance 8
    assert (
        abs(found.mean() - 4) < error + 0.15
    )  # 616 cells and shrinkage tell the covariance to some per cent
    assert abs((found > 9.488).mean() - 0.05) < 5 * np.sqrt(0.05 * 0.95 / found.size) + 0.01


def test_channels_that_are_copies_count_once():
    values = speckle()
    copied = np.concatenate([values, values[:1]])
    once = rx(as_view(values))
    twice = rx(as_view(copied, ("HH", "VV", "HV")))
    assert np.isfinite(twice).all()
    np.testing.assert_allclose(twice, once, rtol=0.2)  # they are shrunk differently


SIGNATURE = np.array([[8.0, 2.0], [6.0, 0.0]])  # dB over the clutter


def training(seed=2):
    values = speckle(seed)
    places = pd.DataFrame({"x": [0.0, -0.9, 0.8, 0.5], "y": [2.0, 4.0, 6.0, 8.0],
                           "kind": ["metal", "plastic", "metal", "simulant"]})  # fmt: skip
    for x, y in places[["x", "y"]].to_numpy():
        values[..., np.argmin(abs(Y - y)), np.argmin(abs(X - x))] = 2.0 * 10 ** (SIGNATURE / 20)
    return TrainingView(as_view(values), places, Lane(-1.5, 1.5, 0.0, 10.0))


def test_matched_filters_are_their_closed_forms():
    lane = training()
    settings = MatchedSettings(reach=0.05)
    learnt, notes = Matched.fit(settings, [lane])
    assert notes["mines_for_signature"] == 3
    logs = 20 * np.log10(lane.view.values.reshape(4, Y.size, X.size).astype(float))
    x, y = np.meshgrid(X, Y)
    away = (abs(x) <= 1.5) & np.all(
        [np.hypot(x - a, y - b) > 1 for a, b in lane.truth[["x", "y"]].to_numpy()], axis=0
    )
    clutter = logs[:, away].T
    mean = clutter.mean(axis=0)
    covariance = ledoit_wolf(clutter)[0]
    s = (20 * np.log10(2.0) + SIGNATURE).ravel() - mean
    np.testing.assert_allclose(learnt["signature"], s, rtol=1e-5)
    np.testing.assert_allclose(learnt["covariance"], covariance, rtol=1e-6)
    found = Matched(settings, None, learnt).of_view(
        lane.view, np.array([[-0.5, 3.0], [0.0, 2.0], [9.0, 9.0]])
    )
    inverse = np.linalg.inv(covariance)
    for row, (j, i) in enumerate(((30, 15), (20, 20))):
        one = logs[:, j, i] - mean
        np.testing.assert_allclose(
            found["amf"][row], s @ inverse @ one / np.sqrt(s @ inverse @ s), rtol=1e-5
        )
        cosine = s @ inverse @ one / np.sqrt((s @ inverse @ s) * (one @ inverse @ one))
        np.testing.assert_allclose(found["ace"][row], cosine, rtol=1e-5)
    np.testing.assert_allclose(found["ace"][1], 1, rtol=1e-5)  # a mine of the signature itself
    assert np.isnan(found["amf"][2])
    assert np.isnan(found["ace"][2])


def test_ace_does_not_depend_on_strength_but_amf_does():
    lane = training()
    settings = MatchedSettings(reach=0.05)
    learnt = Matched.fit(settings, [lane])[0]
    stage = Matched(settings, None, learnt)
    point = np.array([[-0.5, 3.0]])
    weak = lane.view.copy(
        data=np.broadcast_to(
            10 ** ((learnt["mean"] + np.array([3.0, 1.0, 2.0, -1.0])).reshape(2, 2, 1, 1) / 20),
            lane.view.shape,
        )
    )
    strong = lane.view.copy(
        data=np.broadcast_to(
            10 ** ((learnt["mean"] + 4 * np.array([3.0, 1.0, 2.0, -1.0])).reshape(2, 2, 1, 1) / 20),
            lane.view.shape,
        )
    )
    one = stage.of_view(weak, point)
    other = stage.of_view(strong, point)
    np.testing.assert_allclose(other["ace"], one["ace"], rtol=1e-6)
    np.testing.assert_allclose(other["amf"], 4 * one["amf"], rtol=1e-6)  # fmt: skip


def test_the_signature_is_that_of_the_kinds_and_all_that_made_it_is_spent():
    lane = training()
    assert Matched.fit(MatchedSettings(kinds=("metal",)), [lane])[1]["mines_for_signature"] == 2
    assert [
        list(one.index) for one in Matched.targets_used_for_training(MatchedSettings(), [lane])
    ] == [[0, 1, 2]]
    with pytest.raises(ValueError, match="needs targets of the kinds wood that are seen, got none"):
        Matched.fit(MatchedSettings(kinds=("wood",)), [lane])
    with pytest.raises(ValueError, match="needs clutter pixels farther than 30 m from all targets"):
        Matched.fit(MatchedSettings(clear=30.0), [lane])


def drifting(scans=40, pairs=2, tones=96):
    """What stands still, of two parts whose gains drift on their own in every pair, and a point that is passed."""
    rng = np.random.default_rng(7)
    f = np.linspace(0.8e9, 1.8e9, tones)
    delay = np.array([5e-9, 12e-9])[:, None]
    parts = np.exp(-2j * np.pi * f * delay) * (1 + 0.3 * rng.normal(size=(2, tones)))
    drift = 1 + 0.15 * np.cumsum(
        rng.normal(size=(scans, 1, pairs, 2)) + 1j * rng.normal(size=(scans, 1, pairs, 2)), 0
    )
    still = np.einsum("sqkr,rf->sqkf", drift, 10 * parts)
    away = np.hypot(8.0 - 0.15 * np.arange(scans), 2.0)[:, None, None, None]
    echo = np.broadcast_to(0.5 * np.exp(-4j * np.pi * f * away / 299792458.0), still.shape)
    return still, echo


def low_rank(signal, *parts, **settings):
    """What the stage leaves of the signal that it learnt from, or of parts of it."""
    stage = LowRank(
        LowRankSettings(**settings), SimpleNamespace(results={}, imager=range(len(signal)))
    )
    stage.before = lambda index, count: signal[index : index + 1]
    (work,) = stage.passes()
    gathered = work.start(None)
    for index in range(len(signal)):
        gathered.add(index)
    stage.setup.results[work.name] = gathered.result()
    left = [np.stack([stage.clean(0, one) for one in part]) for part in parts or (signal,)]
    return left if parts else left[0]


def energy(one):
    return float((np.abs(one) ** 2).sum())


def test_low_rank_takes_out_what_drifts_and_keeps_what_moves():
    still, echo = drifting()
    signal = (still + echo).astype(np.complex64)
    standing, moving = low_rank(signal, still, echo)
    assert energy(moving) > 0.9 * energy(echo)
    plain = energy(subtract_standing(signal, standing_field(signal)) - echo)
    assert energy(standing) < min(0.2 * energy(echo), 1e-2 * plain)
    assert energy(still) > 1e3 * energy(echo)
    cleaned = low_rank(signal, most=16)
    assert np.vdot(cleaned, echo).real / energy(echo) > 0.9
    assert energy(low_rank(still.astype(np.complex64))) < 1e-8 * energy(still)


def test_one_dimension_is_enough_for_one_part_and_no_signal_has_none():
    still, echo = drifting(pairs=1)
    one = still[:1] * (1 + 0.3 * np.sin(np.arange(40)))[:, None, None, None]
    cleaned = low_rank((one + echo).astype(np.complex64), rank=1)
    assert np.vdot(cleaned, echo).real / energy(echo) > 0.9
    np.testing.assert_array_equal(low_rank(np.zeros((5, 1, 1, 8), np.complex64)), 0)
    with pytest.raises(ValueError, match=r"low-rank.rank must be less than .* 2 and 96, got 2"):
        low_rank(still[:2].astype(np.complex64))


def test_principal_component_pursuit_parts_the_low_rank_from_the_sparse():
    rng = np.random.default_rng(4)
    low = (rng.normal(size=(60, 2)) + 1j * rng.normal(size=(60, 2))) @ rng.normal(size=(2, 80))
    sparse = np.where(rng.random(low.shape) < 0.05, 10 * rng.normal(size=low.shape), 0)
    np.testing.assert_allclose(low_rank_part(low + sparse), low, atol=1e-2)


@pytest.fixture(scope="module")
def run():
    return small_run()


PLAIN = small_recipe(3).replace("variants = true", "variants = false")


def recipe(confidence, *stages):
    return parse_recipe(
        f'confidence = "{confidence}"\n' + PLAIN + "".join(f"\n[[{one}\n" for one in stages)
    )


CFAR = 'columns]]\nstage = "cfar"\npolarization = "HH"\nsubband = "F1"\nouter = [1.0, 1.0]'
MATCHED = 'columns]]\nstage = "matched"\nreach = 0.4'
TRACKED = 'columns]]\nstage = "tracking"\nlevel = 1.5'


def test_a_column_of_the_run_view_ranks_without_a_model(run):
    found = detect(run, recipe("cfar", CFAR, TRACKED), LANE)
    np.testing.assert_array_equal(found.alarms["confidence"], found.features["cfar"])
    assert (np.diff(found.alarms["confidence"]) <= 0).all()
    assert len(found.alarms) > 3
    assert list(found.contributions) == ["cfar"]
    assert found.notes["confidence"] == "cfar"
    top = found.alarms[["x", "y"]].to_numpy()[:3]
    assert (np.hypot(*(top[:, None] - TARGETS).T).min(axis=1) < 0.3).sum() >= 2


def test_sections_rank_alike(run):
    one = recipe("rx", 'columns]]\nstage = "rx"\nguard = [0.4, 0.4]\nouter = [0.8, 2.5]')
    whole = ImagedRun(run, one, LANE, explains=False)
    engine_of(whole).run()
    alarms = rank_alarms(whole).alarms
    known = whole.results["alarms"]
    rows = whole.grid.ny
    maxima = pd.DataFrame({name: known[f"maximum|{name}"] for name in ("x", "y", "magnitude")})
    threshold = lane_threshold(one, LANE, maxima, int(known["seen"]))
    parts = []
    for section in (Section(0, rows // 2, threshold), Section(rows // 2, rows, threshold)):
        part = ImagedRun(run, one, LANE, section=section, explains=False)
        engine_of(part).run()
        parts.append(rank_alarms(part).alarms)
    table = pd.concat(parts).sort_values(["y", "x"])
    want = alarms.sort_values(["y", "x"])
    np.testing.assert_allclose(
        table[["x", "y", "confidence"]], want[["x", "y", "confidence"]], rtol=1e-4
    )


def test_a_learnt_column_ranks_and_no_detector_is_trained_for_it(run, tmp_path):
    save_run(run, tmp_path / "run.zarr")
    TRUTH.assign(target_id=["a", "b", "c"], depth=0.0).to_csv(tmp_path / "truth.csv", index=False)
    (tmp_path / "lane.toml").write_text(LANE_TOML)
    (tmp_path / "amf.toml").write_text('confidence = "amf"\n' + PLAIN + f"\n[[{MATCHED}\n")
    one = load_recipe(tmp_path / "amf.toml")
    with pytest.raises(ValueError, match=r"learns .*features\.matched"):
        detect(run, one, LANE)
    files = [[tmp_path / name] for name in ("run.zarr", "truth.csv", "lane.toml")]
    model = flgpr.train(*files[:2], tmp_path / "amf.toml", tmp_path / "model", lanes=files[2])
    assert model.detector is None
    assert model.notes["features.matched"]["mines_for_signature"] == 3
    found = detect(run, one, LANE, model=load_model(tmp_path / "model"))
    np.testing.assert_array_equal(found.alarms["confidence"], found.features["amf"])
    assert found.features["ace"].abs().max() <= 1


def test_a_column_of_scans_ranks_live(run):
    detector = LiveDetector(describe_for_live(run), recipe("tracked", TRACKED), LANE)
    assert detector.steps.single == "tracked"
    assert list(detector.steps.stages) == ["features.tracking"]


def test_a_confidence_that_nothing_makes_is_refused(run):
    with pytest.raises(
        ValueError,
        match=r"confidence must be contrast or magnitude without \[\[columns\]\], got 'cfra'",
    ):
        recipe("cfra")
    told = r"confidence must be one of contrast, magnitude, tracked, cfar, got 'cfra'"
    with pytest.raises(ValueError, match=told):
        ImagedRun(run, recipe("cfra", TRACKED, CFAR), LANE)
    with pytest.raises(
        ValueError, match=r"confidence must be one of contrast, magnitude, tracked, got 'cfra'"
    ):
        LiveDetector(describe_for_live(run), recipe("cfra", TRACKED), LANE)
    with pytest.raises(
        ValueError, match="subband must be one of F1, F2, got 'F9'"
    ):  # before anything is imaged
        ImagedRun(run, recipe("cfar", CFAR.replace("F1", "F9")), LANE)


def test_a_recipe_with_the_clutter_stage_runs_end_to_end(run):
    found = detect(run, recipe("contrast", 'clutter]]\nstage = "low-rank"\nrank = 1'), LANE)
    top = found.alarms[["x", "y"]].to_numpy()[:5]
    assert (np.hypot(*(top[:, None] - TARGETS).T).min(axis=1) < 0.3).any()
