"""Variants of `fused`, evidence/fused_variants.py, on numbers that are known."""

import sys
from pathlib import Path

import numpy as np
import pytest

from flgpr.recipe.schema import load_recipe
from flgpr.stages.textured_clutter import ratio

sys.path.append(str(Path(__file__).parents[2] / "evidence"))
import fused_variants
from fused_maps import combinations, lanes, learnt, looks_at_some, scores, signatures

COLUMNS, ROWS = 15, 100


def noise(rng, *shape):
    return (rng.normal(size=(*shape, 2)) @ [1, 1j] / np.sqrt(2)).astype(np.complex64)


def lane_of(targets=((0.0, 10.0),), kinds=("metal",), looks=2, site="sand", first=8.5, apart=3.0):
    """A lane of speckle of which every place is seen in some looks."""
    rng = np.random.default_rng(3)
    count = COLUMNS * ROWS
    place = np.tile(np.arange(count), looks)
    scan = np.repeat(np.arange(looks), count)
    ahead = first + apart * scan
    return lanes.Lane(
        site, "metal", COLUMNS, ROWS, -1.4, 0.0, place, scan,
        np.column_stack([np.zeros(len(place)), ahead]), noise(rng, len(place), 3, 7, 9),
        np.zeros((len(place), 3, 7)), np.ones((3, 7, 242, 241)), np.array(targets), np.array(kinds),
    )  # fmt: skip


def signatures_of(rng, bodies=4):
    """Bodies whose echoes are the same in all looks, exactly where the chips are."""
    chip = np.repeat(noise(rng, bodies, 1, 3, 7, 9), 10, axis=1)
    place = np.zeros((bodies, 10, 2))
    place[..., 1] = signatures.LOOKS
    return signatures.Signatures(
        chip, place, np.zeros(bodies), np.zeros(bodies, int), np.zeros((bodies, 2))
    )


def test_no_test_lane_is_read(tmp_path):
    of_tier = list(lanes.ground_lanes(tmp_path, tmp_path, "prepared", further=False))
    assert len(of_tier) == 12
    assert {lane.part for lane, _ in of_tier} == {"train", "validate"}


def test_images_are_those_of_fused_with_more_sub_bands():
    recipe = lanes.images_recipe()
    model = load_recipe("fused")
    assert recipe.map is None
    assert recipe.background == model.background
    assert recipe.run_view == model.run_view
    assert list(recipe.image.subbands) == list(lanes.BANDS)
    for name, band in model.image.subbands.items():
        assert recipe.image.subbands[name] == band == lanes.BANDS[name]


def test_a_mine_is_found_at_the_false_alarms_above_it():
    targets = ((0.0, 5.0), (0.0, 10.0), (0.0, 15.0), (0.0, 18.0))
    lane = lane_of(targets, ("metal", "metal", "plastic", "plastic"))
    values = 1e-3 * np.arange(ROWS)[:, None] + 1e-4 * np.arange(COLUMNS)
    values[25, 7] = 5.0  # at the first mine
    values[50, 7] = 4.0
    values[78, 7] = 2.0  # within a metre of the third
    for row in (10, 37, 63):
        values[row, 3] = 3.0
    found = scores.Found.on([lane], [values])
    np.testing.assert_array_equal(found.far[:2], 0)
    assert found.far[2] == pytest.approx(3 / lane.area())
    assert found.far[3] > found.far[2]  # nothing stands out at the fourth
    whole = 0.04 * COLUMNS * (ROWS - 1)
    assert lane.area() == pytest.approx(whole - 4 * np.pi, rel=0.03)
    row = found.row("a name", found)
    assert row.startswith("| a name | 2, 2, 2, 2 | 0, 0, 0, ")
    assert "| 0, 0 (1) |" in row


def test_clutter_is_white_in_its_own_covariance():
    lane = lane_of(looks=9, first=7.5, apart=1.0)
    mixing = np.linalg.cholesky(np.eye(27) + 0.8 * np.ones((27, 27)))
    mixed = lane.chip[:, :, 0].reshape(-1, 27) @ mixing.T
    lane.chip[:, :, 0] = mixed.reshape(-1, 3, 9)
    some = lane.chips([0])
    clutter = learnt.Clutter.of([0], learnt.with_neighbours(*learnt.sums_of(some, lane.metre)))
    white = clutter.white(lane)
    for metre in (1, 4):
        at = white[lane.metre == metre]
        at = at / np.sqrt((np.abs(at) ** 2).mean(axis=1, keepdims=True))
        np.testing.assert_allclose(at.T @ at.conj() / len(at), np.eye(27), atol=0.15)


def test_directions_in_other_clutter_are_those_of_the_same_signatures():
    lane = lane_of(looks=9, first=7.5, apart=1.0)
    rng = np.random.default_rng(4)
    trained = learnt.Trained([lane], {"metal": signatures_of(rng)})
    prior = trained.clutter([0])
    root = np.eye(27) + 0.5 * noise(rng, 27, 27)
    other = learnt.Clutter.of([0], np.array([root @ root.conj().T] * lanes.METRES))
    carried = combinations.carried(trained.directions(prior, ["metal"], 4), prior, other)
    vectors, _ = carried[2]
    # Signatures of unit power in the first clutter lie within the new directions.
    echo = trained.signatures["metal"].chip[:, 2, :, [0]].reshape(4, 27) @ other.whitener[2].T
    within = (np.abs(echo @ vectors.T) ** 2).sum(axis=1) / (np.abs(echo) ** 2).sum(axis=1)
    np.testing.assert_allclose(within, 1, atol=1e-3)


def test_one_look_taken_jointly_has_the_ratio_of_that_look():
    lane = lane_of(looks=1)
    clutter = learnt.Clutter.of(lanes.LOW, np.array([np.eye(81)] * lanes.METRES))
    vectors = np.linalg.qr(noise(np.random.default_rng(5), 81, 24))[0].T
    parts = np.zeros((3, lanes.METRES, 24), complex)
    for number, share in enumerate((0.6, 0.3, 0.1)):
        parts[number, :, number] = np.sqrt(3 * share)
    every = np.array([vectors] * lanes.METRES)
    want = ratio(clutter.white(lane), vectors[:3], np.array([0.6, 0.3, 0.1]), learnt.RATIOS)
    for coherent in (False, True):
        found = combinations._joint(lane, clutter, every, parts, coherent)
        np.testing.assert_allclose(found.ravel(), want, rtol=1e-3, atol=1e-3)


def test_looks_with_the_same_phase_are_told_from_others_by_phases_alone():
    lane = lane_of(looks=2)
    clutter = learnt.Clutter.of(lanes.LOW, np.array([np.eye(81)] * lanes.METRES))
    vectors = np.array([np.eye(24, 81)] * lanes.METRES)
    parts = np.zeros((1, lanes.METRES, 24), complex)
    parts[0, :, 0] = 1
    alike, opposite = 700, 800
    values = lane.chip.reshape(len(lane.chip), -1)
    at_alike = np.flatnonzero(lane.place == alike)
    at_opposite = np.flatnonzero(lane.place == opposite)
    values[at_opposite] = values[at_alike]
    values[at_alike, 0] = (8, 8)
    values[at_opposite, 0] = (8, -8)
    lane.chip = values.reshape(lane.chip.shape)
    with_phases = combinations._joint(lane, clutter, vectors, parts, True).ravel()
    without = combinations._joint(lane, clutter, vectors, parts, False).ravel()
    assert with_phases[alike] > with_phases[opposite] + 5
    assert without[alike] == pytest.approx(without[opposite], abs=1e-3)


def test_bodies_are_put_in_at_their_level_and_nothing_else_changes():
    lane = lane_of()
    rng = np.random.default_rng(6)
    bodies = {name: signatures_of(rng) for name in signatures.BODIES}
    bench = scores.Bench("prepared", [lane, lane_of(site="clay")], bodies)
    ring = looks_at_some.ring_powers(lane)
    # Speckle of unit power: the ring's mean power is one, but for its own spread.
    assert ring.mean() == pytest.approx(1, abs=0.02)
    chosen = looks_at_some.free_places(lane)[:50]
    before = looks_at_some.looks_at_some(lane, ring, chosen)
    after = looks_at_some.looks_at_some(lane, ring, chosen)
    looks_at_some.put_in_bodies(after, lane, bench, rng)
    added = after.chip - before.chip
    for look in (0, 1):
        shapes = [np.abs(chip[0]) for body in bodies.values() for chip in body.chip]
        nearest = min(np.abs(np.abs(added[look]) - shape).max() for shape in shapes)
        assert nearest < 1e-3
    at = np.isin(lane.place, chosen)
    in_order = np.argsort(lane.place[at], kind="stable")
    np.testing.assert_array_equal(before.chip, lane.chip[at][in_order])


def test_an_experiment_that_does_not_exist_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit):
        fused_variants.main([str(tmp_path), str(tmp_path / "out"), "--only", "luck"])
    message = capsys.readouterr().err
    assert "luck" in message
    assert all(name in message for name in fused_variants.EXPERIMENTS)
    assert not (tmp_path / "out").exists()
