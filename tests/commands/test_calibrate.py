"""What the calibrations refuse, by the option that breaks its rule."""

import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.commands.calibrate import (
    calibrate_clock,
    calibrate_permittivity,
    calibrate_range_bias,
)
from flgpr.store import save_run


@pytest.fixture
def stored(small_run, tmp_path):
    return save_run(small_run, tmp_path / "run.zarr")


@pytest.fixture
def reflectors(tmp_path):
    path = tmp_path / "reflectors.csv"
    path.write_text("x_m,y_m,z_m\n0,5,0\n")
    return path


@pytest.mark.parametrize("limits", [(5.0, 2.0), (4.0, 4.0), (0.5, 9.0)])
def test_permittivities_increase_from_that_of_air(limits, stored):
    with pytest.raises(
        ValueError, match=f"increase from 1 or more, got {limits[0]:g}, {limits[1]:g}"
    ):
        calibrate_permittivity(stored, limits=limits)


@pytest.mark.parametrize("search", [0.0, -1.0, float("nan")])
def test_a_search_for_a_bias_has_a_width(search, stored, reflectors):
    with pytest.raises(ValueError, match=f"search must be positive, got {search:g}"):
        calibrate_range_bias(stored, reflectors, search=search)


def test_a_clock_needs_a_track(stored):
    with pytest.raises((ValueError, OSError), match=r"run-track\.csv"):
        calibrate_clock(stored, area=(-1.0, 1.0, 4.0, 6.0), offsets=(-1.0, 1.0))


def test_what_is_refused_is_one_line_and_stores_nothing(stored, reflectors, tmp_path):
    words = ["calibrate", "range-bias", str(stored), "--reflectors", str(reflectors)]
    words += ["--search", "0", "-o", str(tmp_path / "new.zarr")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 2
    assert done.output == "error: search must be positive, got 0\n"
    assert not (tmp_path / "new.zarr").exists()
