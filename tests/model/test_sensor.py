import numpy as np
import pytest

from flgpr.model import load_sensor, sensor_presets


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
