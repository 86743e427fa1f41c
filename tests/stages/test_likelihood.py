"""The map of likelihoods: what it learns of clutter and of simulated bodies, and what it finds."""

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from pydantic import ValidationError

from flgpr.imaging import ScanImager
from flgpr.model import Grid, Lane, load_sensor
from flgpr.simulate import ALONE, BARE, Scene, Simulator
from flgpr.stages import Setup
from flgpr.stages.likelihood import LikelihoodMap, LikelihoodSettings, contrasts
from flgpr.stages.textured_clutter import ratio
from systems.lanes import SENSOR

GRID = Grid.spanning((-2.0, 2.0), (4.0, 8.0), 0.1)
BANDS = {"B1": (0.6e9, 0.8e9), "B2": (0.8e9, 1.05e9)}
LANE = Lane(-1.5, 1.5, 4.0, 40.0)


def noise(rng, *shape):
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)) / np.sqrt(2)


def image_of(values, pose=(0.0, 0.0, 2.5, 0.0, 0.0, 0.0)):
    return xr.DataArray(
        np.asarray(values, np.complex64), dims=("polarization", "subband", "y", "x"),
        coords={"polarization": ["HH", "VV", "HV", "VH"], "subband": list(BANDS), "y": GRID.y, "x": GRID.x},
        attrs={"pose": list(pose), "scan": 0},
    )  # fmt: skip


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """One scan of the small array over even ground, and the array's file."""
    file = tmp_path_factory.mktemp("sensor") / "sensor.toml"
    file.write_text(SENSOR)
    return Simulator(
        Scene(track={"positions": (0.0,)}, length=20.0), load_sensor(file), 1, errors=False
    ).run(), file


def stage_of(run, learnt=None, **entries):
    data, file = run
    level = {"gains": np.ones((1, 4, 2)), "gain": np.ones((4, 2, GRID.ny, GRID.nx))}
    setup = Setup(
        run=data, others={}, images=GRID, view=GRID, lane=LANE, imaged=[0, 1, 2, 3], summed=1,
        imager=ScanImager(data, GRID, BANDS, "hann"), results={"gain": level},
    )  # fmt: skip
    table = LikelihoodSettings(
        **{"sensor": str(file), "copies": 3, "soils": ((3.0, 0.01),)} | entries
    )
    return LikelihoodMap(table, setup, learnt)


def gathered(stage, truth=None, scans=6, seed=5):
    """What a lane of speckle with no mine gives."""
    rng = np.random.default_rng(seed)
    images = [
        image_of(noise(rng, 4, 2, GRID.ny, GRID.nx), (0.0, 5.0 * k, 2.5, 0.0, 0.0, 0.0))
        for k in range(scans)
    ]
    accumulator = stage.examples(
        pd.DataFrame({"x": [], "y": []}) if truth is None else truth, images.__getitem__
    )
    for k in range(scans):
        accumulator.add(k)
    return accumulator.result()


def test_clutter_is_learnt_of_target_free_ground_and_every_chip_counts_alike(run):
    stage = stage_of(run)
    plain = gathered(stage)
    assert plain["count"].sum() > 1000
    mean = plain["covariance"].sum(axis=0) / plain["count"].sum()
    np.testing.assert_allclose(np.trace(mean).real, len(mean), rtol=1e-3)  # each over its own power
    np.testing.assert_allclose(mean, np.eye(len(mean)), atol=0.15)
    everywhere = pd.DataFrame({"x": np.zeros(40), "y": np.arange(40.0)})
    assert gathered(stage, everywhere)["count"].sum() < 0.4 * plain["count"].sum()
    with pytest.raises(ValueError, match="needs 72 places of target-free ground"):
        LikelihoodMap.fit(stage.settings, [plain | {"count": 0 * plain["count"]}])


def test_signatures_are_those_of_a_body_that_it_never_simulated(run):
    """A body at another place and depth, in another soil: of its power most lies in what was learnt."""
    stage = stage_of(run, copies=8)
    learnt, notes = LikelihoodMap.fit(stage.settings, [gathered(stage, scans=3)])
    assert notes["signatures"] == 32
    assert 0.5 < notes["kept"] <= 1
    scene = Scene.model_validate(
        {
            "soil": {"model": "fixed", "permittivity": 3.3, "loss_tangent": 0.02}, "length": 20.0, "clutter": BARE,
            "targets": [{"kind": "metal", "x": 0.33, "y": 6.27, "depth": 0.07}], "track": {"positions": (0.0,)},
            **ALONE,
        }
    )  # fmt: skip
    imager = ScanImager(Simulator(scene, load_sensor(run[1]), 9).run(), GRID, BANDS, "hann")
    chips = stage._chips(imager.image(0).values)
    row = int(np.abs(GRID.y[stage._rows] - 6.27).argmin())
    column = int(np.abs(GRID.x[stage._columns] - 0.33).argmin())
    metre = int(6.27 - GRID.y_min)
    white = chips[row, column] @ learnt["whitener"][metre].T
    part = (np.abs(learnt["signature"][metre] @ white) ** 2).sum() / (np.abs(white) ** 2).sum()
    assert part > 0.6
    other = noise(np.random.default_rng(2), 200, len(white))
    by_chance = (np.abs(other @ learnt["signature"][metre].T) ** 2).sum(axis=1) / (
        np.abs(other) ** 2
    ).sum(axis=1)
    assert part > by_chance.max()


def test_the_map_is_largest_where_a_signature_lies_in_speckle_and_not_where_something_else_is_as_bright(
    run,
):
    maker = stage_of(run, level=0.0, copies=8)
    examples = gathered(maker, scans=20)
    learnt, _ = LikelihoodMap.fit(maker.settings, [examples])
    stage = stage_of(run, learnt, level=0.0, copies=8)
    rng = np.random.default_rng(3)
    image = image_of(noise(rng, 4, 2, GRID.ny, GRID.nx))
    ahead = examples["ahead"]
    body = examples["bodies"][np.abs(ahead - 2.0).argmin()].reshape(4, 2, 3, 3)
    like = (20, 28)
    unlike = (20, 12)
    for (row, column), what in ((like, body), (unlike, noise(rng, 4, 2, 3, 3))):
        rows, columns = np.ix_(row + 2 * np.arange(-1, 2), column + 2 * np.arange(-1, 2))
        image.values[:, :, rows, columns] += 5 * what / np.sqrt((np.abs(what) ** 2).mean())
    found = stage.map(image)
    assert found.shape == GRID.shape
    assert np.unravel_index(found.argmax(), found.shape) == like
    assert found[like] > found[unlike] + 20
    assert stage.map(image_of(np.zeros(image.shape))).min() > 0
    np.testing.assert_allclose(stage.map(image.copy(data=3 * image.values)), found, rtol=1e-4)


def test_the_contrast_is_the_power_about_a_pixel_over_that_of_the_ring(run):
    table = stage_of(run).settings
    values = noise(np.random.default_rng(4), 4, 2, GRID.ny, GRID.nx)
    found = contrasts(image_of(values), table)
    row, column = 20, 20
    power = np.abs(values[1, 0]) ** 2

    def total(half):
        square = power[row - half : row + half + 1, column - half : column + half + 1]
        return square.sum(), square.size

    (inner, few), (guard, some), (outer, every) = total(1), total(6), total(15)
    want = 10 * np.log10((inner / few) / ((outer - guard) / (every - some)))
    assert found[1, 0, row, column] == pytest.approx(want, abs=1e-4)
    louder = values * np.array([3.0, 0.1, 1.0, 1.0])[:, None, None, None]
    np.testing.assert_allclose(contrasts(image_of(louder), table), found, atol=1e-4)
    assert np.isfinite(
        contrasts(image_of(np.zeros(values.shape)), table)
    ).all()  # a channel that failed


def test_what_it_adds_of_the_contrast_is_a_mean_of_the_channels_asked_for(run):
    learnt, _ = LikelihoodMap.fit(stage_of(run).settings, [gathered(stage_of(run))])
    image = image_of(noise(np.random.default_rng(6), 4, 2, GRID.ny, GRID.nx))
    without, twice = (
        stage_of(run, learnt, level=level, blur=0.0).map(image) for level in (0.0, 2.0)
    )
    want = contrasts(image.isel(polarization=slice(2)), stage_of(run).settings).mean(axis=(0, 1))
    np.testing.assert_allclose(twice - without, 2 * want, atol=1e-3)


def test_its_map_is_smoothed_over_as_many_metres_as_asked_for(run):
    learnt, _ = LikelihoodMap.fit(stage_of(run).settings, [gathered(stage_of(run))])
    image = image_of(noise(np.random.default_rng(7), 4, 2, GRID.ny, GRID.nx))
    sharp, smooth = (stage_of(run, learnt, blur=blur).map(image) for blur in (0.0, 0.2))
    # four standard deviations of two pixels
    row = 20
    column = 20
    reach = 8
    offset = np.arange(-reach, reach + 1)
    weight = np.exp(-(offset[:, None] ** 2 + offset**2) / (2 * 2**2))
    around = sharp[row - reach : row + reach + 1, column - reach : column + reach + 1]
    assert smooth[row, column] == pytest.approx((weight * around).sum() / weight.sum(), rel=1e-4)


def test_an_array_that_is_not_the_runs_is_refused(run):
    data, file = run
    with pytest.raises(
        ValueError,
        match=r"map\.sensor must describe the run's array, got 'sri-array', which has other antennas",
    ):
        gathered(stage_of((data, "sri-array")))
    other = file.with_name("other.toml")
    other.write_text(SENSOR.replace("count = 81", "count = 80"))
    with pytest.raises(ValueError, match="must have the run's tones"):
        gathered(stage_of((data, other)))
    with pytest.raises(ValueError, match="sensor must be a TOML file or one of"):
        gathered(stage_of((data, "nobodys")))


def test_bad_entries_are_named():
    for entries, word in (
        ({"inner": 0.7}, "must rise"), ({"kinds": ()}, "kinds"), ({"soils": ((0.5, 0.0),)}, "soils"),
        ({"rank": 0}, "rank"), ({"step": 0.0}, "step"),
    ):  # fmt: skip
        with pytest.raises(ValidationError, match=word):
            LikelihoodSettings(sensor="sri-array", **entries)
    with pytest.raises(ValidationError, match=r"antennas must name a sensor.*got '' with"):
        LikelihoodSettings(sensor="run")
    with pytest.raises(ValidationError, match=r"antennas must name a sensor.*got 'sri-array'"):
        LikelihoodSettings(sensor="sri-array", antennas="sri-array")


@pytest.fixture(scope="module")
def whole(run):
    """A stage that has learnt, and what it learnt of."""
    examples = gathered(stage_of(run, copies=8), scans=20)
    learnt, _ = LikelihoodMap.fit(stage_of(run, copies=8).settings, [examples])
    return stage_of(run, learnt, copies=8), examples


def test_its_parts_add_up_to_the_map(whole):
    stage, _ = whole
    image = image_of(noise(np.random.default_rng(8), 4, 2, GRID.ny, GRID.nx))
    adds, alone = stage.parts(image)
    assert list(adds) == ["likelihood", "contrast HH", "contrast VV"]
    assert list(alone) == ["B1", "B2", "mine over stone"]
    np.testing.assert_allclose(
        sum(adds.values()) + stage.settings.offset, stage.map(image), atol=1e-3
    )
    before = {name: one for name, one in stage.learnt.items() if not name.startswith("stone")}
    assert list(stage_of((stage.setup.run, stage.settings.sensor), before).parts(image)[1]) == [
        "B1",
        "B2",
    ]


def test_a_sub_band_alone_is_the_ratio_of_densities_of_its_own_values(whole):
    stage, _ = whole
    back = np.linalg.inv(stage.learnt["whitener"][1].astype(complex))
    own = np.arange(72).reshape(4, 2, 9)[:, 1].ravel()
    clutter = (back @ back.conj().T)[np.ix_(own, own)]
    vectors = (back @ stage.learnt["signature"][1].conj().T)[own]
    body = (vectors * stage.learnt["share"][1]) @ vectors.conj().T
    body /= np.trace(np.linalg.solve(clutter, body)).real  # of unit power in whitened clutter
    chip = noise(np.random.default_rng(9), 72)

    def density(covariance):
        x = chip[own]
        quadratic = (x.conj() @ np.linalg.solve(covariance, x)).real
        return -np.linalg.slogdet(covariance)[1] - len(own) * np.log(quadratic)

    want = np.log(
        np.mean(
            [np.exp(density(clutter + g * body) - density(clutter)) for g in stage.settings.ratios]
        )
    )
    places, whitener, directions, share = stage._band(1, 1, 2)
    np.testing.assert_array_equal(places, own)
    found = ratio((chip[places] @ whitener.T)[None], directions, share, stage.settings.ratios)
    assert found[0] == pytest.approx(want, abs=1e-3)


def test_a_stone_is_told_from_a_mine(whole):
    stage, examples = whole
    rng = np.random.default_rng(10)
    odds = {}
    for sort, ahead in (("bodies", "ahead"), ("stones", "stones_ahead")):
        nearest = np.argsort(np.abs(examples[ahead] - 2.0), kind="stable")[:12]
        odds[sort] = []
        for body in examples[sort][nearest].reshape(-1, 4, 2, 3, 3):
            image = image_of(noise(rng, 4, 2, GRID.ny, GRID.nx))
            rows, columns = np.ix_(20 + 2 * np.arange(-1, 2), 20 + 2 * np.arange(-1, 2))
            image.values[:, :, rows, columns] += 5 * body / np.sqrt((np.abs(body) ** 2).mean())
            odds[sort].append(stage.parts(image)[1]["mine over stone"][20, 20])
    assert np.median(odds["bodies"]) > 0 > np.median(odds["stones"])
    assert np.mean(np.array(odds["bodies"])[:, None] > odds["stones"]) > 0.9


def surveyed(stage, mixing, scans=12, seed=11):
    """What a survey gathers of speckle that is mixed between polarizations."""
    rng = np.random.default_rng(seed)
    images = []
    for k in range(scans):
        speckle = np.einsum("pq,qbyx->pbyx", mixing, noise(rng, 4, 2, GRID.ny, GRID.nx))
        images.append(image_of(speckle, (0.0, 2.0 * k, 2.5, 0.0, 0.0, 0.0)))
    accumulator = stage.survey(images.__getitem__)
    for k in range(scans):
        accumulator.add(k)
    return accumulator.result()


MIXING = np.array([[1.0, 0, 0, 0], [0.9, 0.5, 0, 0], [0, 0, 1.0, 0], [0, 0, 0.9, 0.5]])


def test_the_lanes_own_clutter_is_in_the_covariance_by_its_share(whole):
    stage, _ = whole
    own = stage_of((stage.setup.run, stage.settings.sensor), stage.learnt, copies=8, own=0.7)
    assert own.surveys
    assert not stage.surveys
    survey = surveyed(own, MIXING)
    own.setup.results["survey"] = survey
    metre = 1
    ground = own._ground(metre)

    def covariance(whitener):
        back = np.linalg.inv(whitener.astype(complex))
        return back @ back.conj().T

    size = 72
    of_lane = survey["covariance"][metre - 1 : metre + 2].sum(axis=0)
    of_lane *= size / np.trace(of_lane).real
    want = 0.3 * covariance(stage.learnt["whitener"][metre])
    want += 0.7 * (of_lane + stage.settings.load * np.eye(size))
    np.testing.assert_allclose(covariance(ground.whitener), want, atol=1e-3)
    # The signatures are what they were: of those in the first clutter all power is in the new ones.
    back = np.linalg.inv(stage.learnt["whitener"][metre].astype(complex))
    old = ground.whitener @ back @ stage.learnt["signature"][metre].conj().T
    vectors, share = next(iter(ground.signatures.values()))
    within = (np.abs(vectors @ old) ** 2).sum(axis=0) / (np.abs(old) ** 2).sum(axis=0)
    np.testing.assert_allclose(within, 1, atol=1e-3)
    assert share.sum() == pytest.approx(stage.learnt["share"][metre].sum())
    assert (np.diff(share) <= 1e-9).all()


def test_in_its_own_clutter_a_lane_that_no_training_lane_is_like_has_fewer_likely_places(whole):
    stage, _ = whole
    own = stage_of((stage.setup.run, stage.settings.sensor), stage.learnt, copies=8, own=0.9)
    own.setup.results["survey"] = surveyed(own, MIXING)
    speckle = noise(np.random.default_rng(12), 4, 2, GRID.ny, GRID.nx)
    image = image_of(np.einsum("pq,qbyx->pbyx", MIXING, speckle))
    before = stage.parts(image)[0]["likelihood"]
    after = own.parts(image)[0]["likelihood"]
    white = stage.parts(image_of(speckle))[0]["likelihood"]
    # As many places are likely as in ground that training lanes are like.
    assert np.quantile(before, 0.95) > np.quantile(white, 0.95) + 1
    assert np.quantile(after, 0.95) < np.quantile(before, 0.95) - 1
    np.testing.assert_allclose(
        sum(own.parts(image)[0].values()) + own.settings.offset, own.map(image), atol=1e-3
    )


def test_a_survey_leaves_out_what_is_most_like_a_mine_and_what_is_beside_the_lane(whole):
    stage, examples = whole
    own = stage_of((stage.setup.run, stage.settings.sensor), stage.learnt, copies=8, own=0.5)
    rng = np.random.default_rng(13)
    values = noise(rng, 4, 2, GRID.ny, GRID.nx)
    rows, columns = np.ix_(20 + 2 * np.arange(-1, 2), 20 + 2 * np.arange(-1, 2))
    body = examples["bodies"][np.abs(examples["ahead"] - 2.0).argmin()].reshape(4, 2, 3, 3)
    values[:, :, rows, columns] += 20 * body / np.sqrt((np.abs(body) ** 2).mean())
    image = image_of(values, (0.0, 2.0, 2.5, 0.0, 0.0, 0.0))
    survey = own.survey(lambda _: image)
    survey.add(0)
    found = survey.result()
    examples_of_all = own.examples(pd.DataFrame({"x": [], "y": []}), lambda _: image)
    examples_of_all.add(0)
    everything = examples_of_all.state(True)  # of all places in the lane
    seen = everything["count"] > 0
    share = found["count"][seen] / everything["count"][seen]
    assert ((share > 0.85) & (share < 0.92)).all()

    metre = 2
    whitener = own.learnt["whitener"][metre]
    direction = whitener @ body.ravel()
    direction /= np.linalg.norm(direction)

    def power_along(sums):
        covariance = whitener @ (sums["covariance"][metre] / sums["count"][metre])
        return (direction.conj() @ covariance @ whitener.conj().T @ direction).real

    assert power_along(found) < 0.6 * power_along(everything)


def test_with_the_lanes_own_clutter_it_does_not_run_live(whole):
    stage, _ = whole
    assert LikelihoodMap.why_not_live(stage.settings) == ""
    own = stage.settings.model_copy(update={"own": 0.5})
    assert "clutter of the whole lane" in LikelihoodMap.why_not_live(own)
    with pytest.raises(ValidationError, match="own"):
        LikelihoodSettings(sensor="sri-array", own=1.0)
