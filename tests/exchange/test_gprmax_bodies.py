"""Packaged bodies in input files of gprMax: layers, zones, boxes."""

import numpy as np
import pytest

from flgpr.model import Sensor
from flgpr.simulate import Scene, make_decks
from flgpr.simulate.bodies.signature import load_body

SENSOR = Sensor(
    name="a dipole",
    source="test",
    polarization=("HH",),
    height=0.6,
    tx=((0.0, 0.0, 0.0),),
    rx=((0.15, 0.0, 0.0),),
    tones={"start": 500e6, "step": 20e6, "count": 31},
    antenna={"kind": "dipole"},
)
PLACE = {"x": 0.0, "y": 0.45, "depth": 0.06}


def decks_of(**target):
    scene = Scene.model_validate(
        {
            "length": 0.9,
            "x_min": -0.3,
            "x_max": 0.3,
            "track": {"positions": (0.0,)},
            "surface": {"rms_height": 0.0},
            "soil": {"model": "fixed", "permittivity": 4.0},
            "targets": [PLACE | target],
        }
    )
    return make_decks(scene, SENSOR, 1)


def solids(decks, command):
    lines = decks.files["scene.txt"].splitlines()
    return [line.split()[1:] for line in lines if line.startswith(f"#{command}:")]


def medium_at(decks, radius, drop):
    """Return the material that is written last at a place of an upright round body."""
    origin = np.array(decks.manifest["grid"]["origin"])
    place = np.array([PLACE["x"] + radius, PLACE["y"], -PLACE["depth"] - drop]) - origin
    found = None
    for words in solids(decks, "cylinder"):
        top, bottom, width = float(words[2]), float(words[5]), float(words[6])
        reach = np.hypot(place[0] - float(words[0]), place[1] - float(words[1]))
        if bottom < place[2] < top and reach < width:
            found = words[7]
    return found


@pytest.mark.parametrize("name", ["tm-62p", "vs-2.2-hollow", "plastic-at", "tm-62m", "metal-at"])
def test_a_round_body_has_its_media_where_its_description_says(name):
    decks = decks_of(kind="plastic", body=name)
    media = {words[4]: float(words[0]) for words in solids(decks, "material")}
    media |= {"free_space": 1.0, "pec": np.nan}
    body = load_body(name)
    for radius in (0.01, 0.05, 0.09, 0.115, 0.15):
        for drop in (0.004, 0.02, 0.05, 0.11):
            medium = medium_at(decks, radius, drop)
            expected = body.permittivity(radius, drop, -1.0).real
            actual = -1.0 if medium is None else media[medium]
            np.testing.assert_equal(actual, float(expected), err_msg=f"{radius} m, {drop} m")


def test_the_fuze_of_a_packaged_mine_is_written():
    decks = decks_of(kind="plastic", body="tm-62p")
    assert medium_at(decks, 0.0, 0.045) == "pec"
    assert medium_at(decks, 0.0, 0.11) == "body1"  # under the fuze


def test_a_leaning_body_leans_with_all_its_layers():
    decks = decks_of(kind="plastic", body="tm-62p", tilt=0.2, azimuth=np.pi / 2)
    for words in solids(decks, "cylinder"):
        ends = np.array(words[:6], float).reshape(2, 3)
        axis = ends[0] - ends[1]
        np.testing.assert_allclose(
            axis / np.linalg.norm(axis), [np.sin(0.2), 0, np.cos(0.2)], atol=1e-6
        )


def test_a_leaning_layer_that_is_thinner_than_a_cell_ends_on_two_nodes():
    decks = decks_of(kind="plastic", body="vs-1.6", tilt=1.0)
    cell = decks.manifest["grid"]["cell"]
    ends = np.array([words[:6] for words in solids(decks, "cylinder")], float).reshape(-1, 2, 3)
    assert ((ends[:, 0] - ends[:, 1])[:, 2] >= cell * (1 - 1e-6)).all()
    assert "the thickness of 1 layers of the vs-1.6" in " ".join(decks.omissions)


def test_a_box_has_its_size_and_heading():
    decks = decks_of(kind="plastic", body="m19", heading=0.5)
    body = load_body("m19")
    origin = np.array(decks.manifest["grid"]["origin"])
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    prisms = solids(decks, "triangle")
    assert {words[10] for words in prisms} == {"body1", "free_space"}
    widest = 0.0
    volume = 0.0
    for words in prisms:
        corners = np.array(words[:9], float).reshape(3, 3) + origin
        local = (corners[:, :2] - [PLACE["x"], PLACE["y"]]) @ turn.T
        widest = max(widest, np.abs(local).max())
        if words[10] == "body1":
            first, second = local[1] - local[0], local[2] - local[0]
            volume += abs(first[0] * second[1] - first[1] * second[0]) / 2 * float(words[9])
        assert corners[0, 2] + float(words[9]) <= -PLACE["depth"] + 1e-6
    assert widest == pytest.approx(body.radius * body.elongation)
    assert volume == pytest.approx((2 * body.radius) ** 2 * body.height, rel=1e-3)


def test_what_is_not_written_as_it_is_is_told():
    assert (
        decks_of(kind="plastic", body="plastic-at").omissions == decks_of(kind="plastic").omissions
    )
    tilted = " ".join(decks_of(kind="plastic", body="m19", tilt=0.1).omissions)
    assert "the tilt of the m19 at (0, 0.45) m: 5.7°" in tilted
    coarse = Sensor.model_validate(
        SENSOR.model_dump() | {"tones": {"start": 300e6, "step": 20e6, "count": 11}}
    )
    scene = Scene.model_validate(
        {
            "length": 0.9,
            "x_min": -0.3,
            "x_max": 0.3,
            "track": {"positions": (0.0,)},
            "soil": {"model": "fixed", "permittivity": 4.0},
            "targets": [PLACE | {"kind": "plastic", "body": "vs-1.6"}],
        }
    )
    told = " ".join(make_decks(scene, coarse, 1).omissions)
    assert "the thickness of 1 layers of the vs-1.6 at (0, 0.45) m: 12 mm" in told


def test_the_pulse_heeds_the_densest_body():
    sensor = Sensor.model_validate(SENSOR.model_dump())
    rock = {"kind": "rock", "x": 0.1, "y": 0.3, "radius": 0.05}
    centres = []
    for objects in ([], [rock]):
        scene = Scene.model_validate(
            {
                "length": 0.9,
                "x_min": -0.3,
                "x_max": 0.3,
                "track": {"positions": (0.0,)},
                "soil": {"model": "fixed", "permittivity": 2.0},
                "objects": objects,
            }
        )
        decks = make_decks(scene, sensor, 1, cells_per_wavelength=5)
        centres.append(decks.manifest["waveform"]["frequency"])
    cell = decks.manifest["grid"]["cell"]
    assert centres[1] < centres[0]
    # At 3.76 times its centre the pulse has 1 % of its peak: three cells a wavelength in the rock.
    assert 299_792_458 / np.sqrt(6.0) / (3.76 * centres[1]) / cell >= 3.0


def test_the_recorded_time_may_be_cut():
    scene = Scene.model_validate(
        {"length": 0.9, "x_min": -0.3, "x_max": 0.3, "track": {"positions": (0.0,)}}
    )
    decks = make_decks(scene, SENSOR, 1, time_window=9e-9)
    assert "#time_window: 9e-09" in decks.files["scan000-tx00-H.in"]
    assert decks.manifest["grid"]["time_window"] == 9e-9
    with pytest.raises(ValueError, match="time_window must be positive, got -1"):
        make_decks(scene, SENSOR, 1, time_window=-1.0)
