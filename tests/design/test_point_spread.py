"""The point spread against the imaging operator, and its widths by formula."""

import math

import numpy as np
import pytest

from flgpr.design.point_spread import PointSpread
from flgpr.imaging import ImagingOperator
from flgpr.kernels.widths import half_power
from flgpr.model import SPEED_OF_LIGHT, Sensor, load_sensor

WIDE = {"start": 600e6, "step": 20e6, "count": 64}
NARROW = {"start": 1000e6, "step": 1e6, "count": 3}


def array(rx, tones, tx=((0.0, 0.0, 0.0),), **parts):
    return Sensor(
        name="test array", source="test", polarization=("HH", "VV"), height=4.0, tx=tx, rx=rx, tones=tones, **parts
    )  # fmt: skip


@pytest.fixture(scope="module")
def small():
    data = load_sensor("sri-array").model_dump()
    data["rx"] = data["rx"][::5]
    data["tones"] = WIDE
    data["footprint"] = (-3.0, 3.0, 6.0, 14.0)
    return Sensor.model_validate(data)


@pytest.mark.parametrize("band", [None, (0.8e9, 1.4e9)])
def test_the_point_spread_is_the_imaging_operators(small, band):
    source = np.array([0.7, 9.0, 0.0])
    pixels = np.stack(
        [*np.meshgrid(np.linspace(-2, 3, 23), np.linspace(7, 12, 31)), np.zeros((31, 23))], axis=-1
    )
    up = np.array([0.0, 0.0, small.height])
    tx, rx = (end + up for end in small.pairs())
    tones = small.tones.axis()
    path = np.linalg.norm(source - tx, axis=1) + np.linalg.norm(source - rx, axis=1)
    data = np.exp(-2j * np.pi * tones * path[:, None] / SPEED_OF_LIGHT)[None]
    bands = None if band is None else (band,)
    made = [
        ImagingOperator(tones, tx, rx, p, bands, window="hann").adjoint(data)
        for p in (pixels, source[None])
    ]
    wanted = np.abs(made[0][0, 0]) / np.abs(made[1]).max()
    np.testing.assert_allclose(PointSpread(small, band)(pixels, source), wanted, atol=0.01)


def test_the_down_range_width_is_the_windows():
    one = array(((0.0, 0.0, 0.0),), WIDE)
    down, cross = PointSpread(one, window="hann").widths([0.0, 10.0, 0.0])
    sine = 10 / math.hypot(10, 4)
    # A Hann window is 1.44 bins wide at half power (Harris 1978, Table I).
    assert down == pytest.approx(1.44 * SPEED_OF_LIGHT / (2 * 63 * 20e6) / sine, rel=0.03)
    assert cross > 2.0  # one pair alone: nothing but the curvature of its ellipse


def test_the_cross_range_width_is_the_apertures():
    line = array(tuple((x, 0.0, 0.0) for x in np.linspace(-1, 1, 41)), NARROW)
    _, cross = PointSpread(line, window="boxcar").widths([0.0, 12.0, 0.0])
    # A uniform aperture of length D on one leg has the half-power width 0.886·λR/D.
    length = 2.0 * 41 / 40
    assert cross == pytest.approx(
        0.886 * SPEED_OF_LIGHT / 1.001e9 * math.hypot(12, 4) / length, rel=0.03
    )


def test_half_power_width_of_a_known_lobe():
    place = np.linspace(-1, 1, 201)
    assert half_power(place, np.exp(-(place**2) / 0.1)) == pytest.approx(
        2 * np.sqrt(0.05 * np.log(2)), abs=1e-3
    )
    assert np.isnan(half_power(place, np.ones_like(place)))
