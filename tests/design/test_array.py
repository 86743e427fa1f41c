import math

import numpy as np
import pytest

from flgpr.design import Viewing, expected_signal_to_clutter, ground_model
from flgpr.design.array import Question, study
from flgpr.design.point_spread import PointSpread
from flgpr.model import SPEED_OF_LIGHT, Sensor, load_sensor


def array(rx, tones, tx=((0.0, 0.0, 0.0),), **parts):
    return Sensor(
        name="test array", source="test", polarization=("HH", "VV"), height=4.0, tx=tx, rx=rx, tones=tones, **parts
    )  # fmt: skip


WIDE = {"start": 600e6, "step": 20e6, "count": 64}
NARROW = {"start": 1000e6, "step": 1e6, "count": 3}


@pytest.fixture(scope="module")
def small():
    data = load_sensor("sri-array").model_dump()
    data["rx"] = data["rx"][::5]
    data["tones"] = WIDE
    data["footprint"] = (-3.0, 3.0, 6.0, 14.0)
    return Sensor.model_validate(data)


@pytest.fixture(scope="module")
def found(small):
    return study(small)


def test_a_sparse_array_has_its_grating_lobe_where_the_spacing_puts_it():
    sparse = array(
        tuple((x, 0.0, 0.0) for x in np.arange(-3, 3.1, 0.6)),
        NARROW,
        footprint=(-7.0, 7.0, 8.0, 16.0),
    )
    source = np.array([0.0, 12.0, 0.0])
    slant = math.hypot(12, 4)
    x = np.linspace(2.0, 8.0, 400)
    # On the circle of the same distance the paths of neighbours differ by spacing times the sine of
    # the direction.
    ring = np.stack([x, np.sqrt(slant**2 - 16 - x**2), np.zeros_like(x)], axis=-1)
    amplitude = PointSpread(sparse, window="boxcar")(ring, source)
    wanted = slant * SPEED_OF_LIGHT / 1.001e9 / 0.6
    assert x[amplitude.argmax()] == pytest.approx(wanted, abs=0.3)
    assert amplitude.max() > 0.7


@pytest.mark.slow("studies an array on simulated ground")
def test_what_a_study_finds(small, found):
    assert found.down.shape == (13, 9)
    assert np.isfinite(found.down).all()
    assert (np.diff(found.cross[:, 4]) > 0).all()  # cross-range resolution falls with distance
    assert (
        np.diff(found.down[:, 4]) < 0
    ).all()  # down-range it rises as the ground is seen more from the side
    assert found.facts["unambiguous_range"] == pytest.approx(SPEED_OF_LIGHT / 40e6)
    assert all(lobe["level"] < -3 for lobe in found.lobes)
    for y, x, power in found.responses.values():
        assert power.shape == (y.size, x.size)
        assert power.max() <= 0.05
    assert set(found.ratio) == {(kind, p) for kind in ("metal", "plastic") for p in ("HH", "VV")}
    metal = found.ratio["metal", "HH"]
    plastic = found.ratio["plastic", "HH"]
    assert np.isfinite(metal).all()
    assert np.median(metal - plastic) > 5


@pytest.mark.slow("studies an array on simulated ground")
def test_the_simulated_map_is_what_the_formula_expects(found):
    middle = found.ratio_y.size // 2
    viewing = Viewing(distance=float(found.ratio_y[middle]), window="hann")
    wanted = expected_signal_to_clutter(
        found.sensor, ground_model("arid-sand"), ["metal-at"], [0.05], viewing
    )
    for level, polarization in zip(
        wanted["signal_to_clutter_db"], wanted["polarization"], strict=True
    ):
        assert found.ratio["metal", polarization][middle, 2] == pytest.approx(level, abs=1.5)
    assert list(found.expected["body"].unique()) == ["metal-at", "plastic-at"]
    assert found.distance == found.y[found.y.size // 2]


@pytest.mark.slow("studies an array on simulated ground")
def test_deeper_mines_are_weaker_against_the_same_clutter(small, found):
    deeper = study(small, Question(site="temperate", depth=0.15))
    # The soil takes about 5 dB more; waves between the body and the surface make it a little more
    # or less.
    assert np.median(deeper.ratio["metal", "HH"]) < np.median(found.ratio["metal", "HH"]) - 3


def test_faults_are_told(small):
    with pytest.raises(ValueError, match="band must hold at least two tones"):
        study(small, Question(band=(5e9, 6e9)))
    for depth in (-1.0, 50.0, float("nan")):
        with pytest.raises(ValueError, match=f"depth must lie between 0 and 1 m, got {depth}"):
            study(small, Question(depth=depth))
    with pytest.raises(ValueError, match="window must be one of"):
        PointSpread(small, window="square")
