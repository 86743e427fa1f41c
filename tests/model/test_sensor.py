import numpy as np
import pytest

from flgpr.model import Sensor, load_sensor, sensor_presets


def test_sri_array_is_the_paper_s():
    sensor = load_sensor("sri-array")
    tones = sensor.tones.axis()
    assert (tones[0], tones.size, tones[1] - tones[0]) == (442.5e6, 1024, 2.5e6)
    assert tones[-1] == pytest.approx(3e9)
    tx, rx = sensor.pairs()
    assert tx.shape == rx.shape == (36, 3)
    np.testing.assert_allclose(tx[:18, 0], -1.5)
    np.testing.assert_allclose(rx[18:, 0], np.linspace(-2, 2, 18))


@pytest.mark.parametrize("name", sensor_presets())
def test_every_preset_loads(name):
    assert load_sensor(name).tones.count > 1


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('name = "x"', ["source"]),
        ("name = ", ["TOML"]),
    ],
)
def test_a_bad_sensor_file_says_what_is_wrong(tmp_path, text, words):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(ValueError) as error:
        load_sensor(path)
    for word in [*words, "mine.toml"]:
        assert word in str(error.value)


def test_an_unknown_sensor_lists_the_presets():
    with pytest.raises(ValueError, match="sri-array"):
        load_sensor("nothing")


def low(**parts):
    data = load_sensor("full-wave").model_dump() | {"footprint": "auto"}
    return Sensor.model_validate(data | parts)


def test_a_footprint_of_its_own_begins_behind_dipoles_and_below_horns():
    left, right, behind, ahead = low().ground_in_view
    height = 1.5 - 0.03 * 16 / 18  # mean of all antennas
    assert (left, right) == pytest.approx((-1.125 - height, 1.125 + height))
    assert (behind, ahead) == pytest.approx((-height, 5.6 * height))
    horns = {"antenna": {"kind": "horn"}}
    assert low(**horns, tilt=0.0).ground_in_view[2] == pytest.approx(0.0)
    assert low(**horns, tilt=0.3).ground_in_view[2] == pytest.approx(-height * np.tan(0.3))
    assert low(**horns, tilt=1.5).ground_in_view[2] == pytest.approx(-height)


def test_a_footprint_grows_with_the_height_and_is_kept_where_it_is_given():
    once = np.array(low(height=0.8).ground_in_view)
    twice = np.array(low(height=1.6).ground_in_view)
    assert (np.abs(twice) > np.abs(once)).all()
    given = low(footprint=(-1.0, 1.0, 2.0, 3.0))
    assert given.ground_in_view == given.footprint == (-1.0, 1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="footprint must have x_max > x_min"):
        low(footprint=(1.0, -1.0, 2.0, 3.0))
    with pytest.raises(ValueError, match="footprint"):
        low(footprint="wide")


def test_entries_of_the_errors_that_do_nothing_are_told():
    for name in sensor_presets():
        assert load_sensor(name).idle_errors() == []
    idle = low(errors={"burst_probability": 0.3, "antenna_drift": 0.2}).idle_errors()
    assert idle == [
        "errors.antenna_drift = 0.2 does nothing without antenna_gain_db or antenna_phase or antenna_delay",
        "errors.burst_probability = 0.3 does nothing without clutter_to_noise_db",
    ]
    on = {"ringing_db": 0.0, "ringing_frequencies": [1e9], "ringing_q": 9.0}
    assert low(errors=on).idle_errors() == []


def test_a_drift_of_the_signature_is_of_the_direct_wave_as_well():
    drift = {"errors": {"self_signature_drift": 0.1}}
    [idle] = low(**drift, direct_wave=False).idle_errors()
    assert idle.endswith("self_signature_drift = 0.1 does nothing without self_signature_db")
    assert low(**drift, direct_wave=True).idle_errors() == []
