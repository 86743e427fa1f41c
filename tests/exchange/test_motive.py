"""Takes of OptiTrack Motive."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flgpr.formats.arrays import open_arrays
from flgpr.formats.mapped import import_mapped
from flgpr.formats.tracks import read_track
from flgpr.model.frames import attitude_matrix, heading_matrix
from take import UP, take_text

TIME = np.arange(0, 3, 0.25)
PLACE = np.column_stack([0.1 * TIME, 2.0 * TIME, np.full(TIME.size, 1.5)])  # lane
ANGLES = np.column_stack([0.1 * TIME, np.full(TIME.size, 0.05), np.full(TIME.size, -0.02)])
LANE = [heading_matrix(h) @ attitude_matrix(p, r) for h, p, r in ANGLES]
ROOM = Rotation.from_matrix(
    UP.T @ np.array(LANE) @ UP
)  # the body was made with its axes along the room's


@pytest.fixture
def take(tmp_path):
    path = tmp_path / "take.csv"
    path.write_text(take_text(TIME, 1000 * PLACE @ UP, ROOM.as_quat(), lost=(4, 5)))
    return path


def test_a_take_is_named_arrays(take):
    opened = open_arrays(take)
    assert opened.kind == "take of OptiTrack Motive"
    assert {"time", "Cart/position", "Cart/rotation", "Pole/position"} < set(opened.arrays)
    assert opened.arrays["Cart/position"].unit == "mm"
    assert opened.arrays["Cart/rotation"].shape == (12, 4)
    place = opened.read("Cart/position")
    assert np.isnan(place[4:6]).all()
    np.testing.assert_allclose(place[6], 1000 * PLACE[6] @ UP, atol=1e-5)


def test_a_take_is_a_track_of_its_body(take):
    track = read_track(take, body="Cart", axes=("x", "-z", "y"))
    keep = [k for k in range(12) if k not in (4, 5)]
    np.testing.assert_allclose(track[["x", "y", "z"]], PLACE[keep], atol=1e-6)
    np.testing.assert_allclose(track[["heading", "pitch", "roll"]], ANGLES[keep], atol=1e-5)
    assert track.attrs["notes"] == ["2 of 12 fixes of the track not finite, bridged"]
    for options, words in (
        ({"axes": ("x", "-z", "y")}, "body must be one of Cart, Pole, got None"),
        ({"body": "Cat", "axes": ("x", "-z", "y")}, "body must be one of Cart, Pole, got 'Cat'"),
        ({"body": "Cart"}, "axes must say which"),
        ({"body": "Cart", "axes": ("x", "z", "y")}, "right-handed"),
        (
            {"body": "Cart", "axes": ("x", "-z", "y"), "max_gap": 0.5},
            "max_gap = 0.5 s, got none for 0.75 s",
        ),
    ):
        with pytest.raises(ValueError, match=words) as error:
            read_track(take, **options)
        assert str(take) in str(error.value)


MAPPING = """
title = "cart"
files.take = "take.csv"
polarization = ["HH"]
signal = {variable = "data", dims = ["scan", "frequency"]}
frequency = {span = [1, 2], unit = "GHz"}
antenna_position = {values = [[0, 0, 0]], unit = "m"}
time = {span = [0.5, 2.5], unit = "s"}
[track]
time = {file = "take", variable = "time", unit = "s"}
position = {file = "take", variable = "Cart/position", unit = "mm"}
orientation = {file = "take", variable = "Cart/rotation", body = ["x", "-z", "y"]}
axes = ["x", "-z", "y"]
clock_offset = 0.0
"""


def test_a_take_in_a_mapping(take):
    np.save(take.parent / "data.npy", np.ones((5, 3), complex))
    (take.parent / "m.toml").write_text(MAPPING.replace('"data"', '"array"'))
    arrived = import_mapped(take.parent / "m.toml", take.parent / "data.npy")
    np.testing.assert_allclose(
        arrived.run["pose"].values[:, 1], 2 * np.linspace(0.5, 2.5, 5), atol=1e-6
    )
    np.testing.assert_allclose(
        arrived.run["pose"].values[:, 3], 0.1 * np.linspace(0.5, 2.5, 5), atol=1e-5
    )
    euler = take_text(TIME, 1000 * PLACE @ UP, ROOM.as_euler("YXZ", degrees=True), spin="YXZ")
    take.write_text(euler)
    with pytest.raises(ValueError, match="quaternions instead"):
        read_track(take, body="Cart", axes=("x", "-z", "y"))
    text = MAPPING.replace('"data"', '"array"').replace(
        'rotation", ', 'rotation", euler = "YXZ", unit = "deg", '
    )
    (take.parent / "m.toml").write_text(text)
    again = import_mapped(take.parent / "m.toml", take.parent / "data.npy")
    np.testing.assert_allclose(again.run["pose"].values, arrived.run["pose"].values, atol=1e-5)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("Frame,Time", "Bild,Zeit", "must name its columns"),
        (",Name,", ",Nom,", "lines of Type and Name"),
        ("Rigid Body", "Skeleton", "positions of rigid bodies or markers"),
        ("\n3,0.750000,", "\n3,x,", "could not convert"),
        ("\n3,0.750000,", "\n3,1,2,3,0.750000,", "take of OptiTrack Motive"),
    ],
)
def test_damaged_takes(take, old, new, words):
    text = take.read_text()
    assert old in text
    take.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=words) as error:
        open_arrays(take)
    assert str(take) in str(error.value)


def test_a_take_without_frames(take):
    head, _, _ = take.read_text().partition("\n0,0.0")
    take.write_text(head + "\n")
    with pytest.raises(ValueError, match=r"frames|No columns"):
        open_arrays(take)
