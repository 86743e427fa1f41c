"""The axes of a focused image where nothing, something or all is given."""

import numpy as np
import pytest

from flgpr.imaging.view_axes import View, chosen_scans, view_axes
from flgpr.model import SPEED_OF_LIGHT, make_run

TONES = 1e9 + 20e6 * np.arange(20)


def drive(height=2.0, scans=8, **attributes):
    """A run of one pair along +y."""
    pose = np.zeros((scans, 6))
    pose[:, 1] = 0.5 * np.arange(scans)
    pose[:, 2] = height
    signal = np.ones((scans, 1, 1, TONES.size), np.complex64)
    ends = np.array([[-0.1, 0.0, 0.0]]), np.array([[0.1, 0.0, 0.0]])
    return make_run(signal, TONES, ["HH"], *ends, pose, attrs=attributes), pose


def axes_of(view, height=2.0, pixels=10_000, **attributes):
    run, pose = drive(height, **attributes)
    return view_axes(run, view, pose, pixels)


def test_antennas_above_the_ground_see_the_ground_ahead():
    axes, spacing = axes_of(View(), pixels=1_000_000)
    assert axes["z"].tolist() == [0.0]
    # 1 to 5 heights ahead of all poses, 1.2 heights to each side.
    assert axes["x"][0] == pytest.approx(-2.4, abs=0.2)
    assert axes["y"][0] == pytest.approx(2.0, abs=0.2)
    assert axes["y"][-1] == pytest.approx(3.5 + 10.0, abs=0.2)
    quarter_wave = SPEED_OF_LIGHT / (2 * (TONES[0] + TONES[-1]))
    assert spacing == pytest.approx(quarter_wave, rel=0.05)


def test_a_large_image_has_about_the_pixels_asked_for():
    axes, spacing = axes_of(View(x=(-20.0, 20.0), y=(0.0, 50.0)), pixels=5_000)
    assert axes["x"].size * axes["y"].size == pytest.approx(5_000, rel=0.1)
    assert np.diff(axes["x"]) == pytest.approx(spacing)


def test_a_coupled_line_sees_the_section_below_it_to_the_end_of_the_record():
    axes, _ = axes_of(
        View(permittivity=4.0),
        0.0,
        sounding="ground-coupled",
        time_window_s=40e-9,
        first_sample_s=0.0,
    )
    assert axes["x"].tolist() == [0.0]
    assert (axes["y"][0], axes["y"][-1]) == pytest.approx((0.0, 3.5), abs=0.05)
    assert axes["z"][0] == pytest.approx(-SPEED_OF_LIGHT / 2 * 40e-9 / 2)
    assert axes["z"][-1] == pytest.approx(0.0, abs=0.05)


def test_without_a_record_the_section_ends_where_echoes_repeat():
    axes, _ = axes_of(View(permittivity=1.0), 0.0, sounding="ground-coupled")
    assert axes["z"][0] == pytest.approx(-SPEED_OF_LIGHT / 20e6 / 2)


def test_given_limits_and_spacing_stand():
    axes, spacing = axes_of(View(x=(-1.0, 1.0), y=2.0, z=(-0.5, 0.0), spacing=0.25))
    assert spacing == 0.25
    np.testing.assert_allclose(axes["x"], np.linspace(-1, 1, 9))
    np.testing.assert_allclose(axes["z"], [-0.5, -0.25, 0.0])
    assert axes["y"].tolist() == [2.0]


def test_a_plane_without_a_height_lies_on_the_ground():
    axes, _ = axes_of(View(x=(-1.0, 1.0), y=(3.0, 5.0)))
    assert axes["z"].tolist() == [0.0]


def test_scans_that_lost_sweeps_are_not_chosen():
    run, _ = drive()
    run["valid"].values[3] = False
    assert chosen_scans(run, None).tolist() == [0, 1, 2, 4, 5, 6, 7]
    assert chosen_scans(run, (2, 4)).tolist() == [2, 4]
    with pytest.raises(ValueError, match="one without missing sweeps, got none from 3 to 3"):
        chosen_scans(run, (3, 3))
    with pytest.raises(ValueError, match="0 <= first <= last < 8"):
        chosen_scans(run, (3, 8))


@pytest.mark.parametrize(
    ("view", "message"),
    [
        (View(y=(0.0, 1.0)), "x must be given beside the others"),
        (View(x=0.0, y=(0.0, 1.0), z=0.0), "must have two limits to make a picture, got y"),
        (View(x=(0.0, 1.0), y=(2.0, 1.0)), "y must have limits that increase, got 2, 1"),
        (View(x=(0.0, 1.0), y=(0.0, 1.0), spacing=-0.1), "spacing must be positive, got -0.1"),
        (View(x=(0.0, 1.0), y=(0.0, 1.0), spacing=5.0), r"2 pixels or more .* got x 1 x y 1"),
    ],
)
def test_what_makes_no_picture_is_refused(view, message):
    with pytest.raises(ValueError, match=message):
        axes_of(view)
