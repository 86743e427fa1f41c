import math

import numpy as np
import pytest

from flgpr.model import load_sensor
from flgpr.simulate import make_decks
from simulate.small_decks import SENSOR, flat, lines_of


def test_there_is_a_run_per_scan_transmitter_and_polarization_and_air_once():
    decks = make_decks(flat(), SENSOR, 1)
    names = {run["file"] for run in decks.manifest["runs"]}
    assert names == {f"scan{s:03d}-tx{t:02d}-{p}" for s in (0, 1) for t in (0, 1) for p in "HV"}
    assert all(f"{name}.in" in decks.files for name in names)
    assert len({run["free"] for run in decks.manifest["runs"]}) <= 8
    assert all(
        "#include_file" not in text for name, text in decks.files.items() if name.startswith("air")
    )
    assert all(
        "#include_file: scene.txt" in text
        for name, text in decks.files.items()
        if name.startswith("scan")
    )


def test_cells_resolve_the_highest_tone_in_the_soil():
    decks = make_decks(
        flat(soil={"model": "fixed", "permittivity": 4.0}), SENSOR, 1, cells_per_wavelength=10
    )
    highest = SENSOR.tones.axis()[-1]
    cell = decks.manifest["grid"]["cell"]
    assert 0.9 * 299792458 / highest / 2 / 10 < cell <= 299792458 / highest / 2 / 10
    size = [float(v) for v in lines_of(decks, "domain", "scan000-tx00-H.in")[0]]
    np.testing.assert_allclose(size, np.array(decks.manifest["grid"]["shape"]) * cell)
    with pytest.raises(ValueError, match=r"at most 1e\+03 cells"):
        make_decks(flat(), SENSOR, 1, max_cells=1e3)
    with pytest.raises(ValueError, match="cells_per_wavelength"):
        make_decks(flat(), SENSOR, 1, cells_per_wavelength=2)


def test_the_pulse_ends_where_cells_get_too_few():
    narrow = SENSOR.model_copy(
        update={"tones": SENSOR.tones.model_copy(update={"start": 1450e6, "count": 3})}
    )
    for sensor, cells in ((narrow, 10.0), (SENSOR, 5.0)):
        told = make_decks(
            flat(soil={"model": "fixed", "permittivity": 4.0}), sensor, 1, cells
        ).manifest
        centre = told["waveform"]["frequency"]
        cell = told["grid"]["cell"]
        # exp((1 - x²)/2)·x is 0.01 at x = 3.76: there three cells must fit a wavelength in the
        # soil.
        assert 299792458 / 2 / (3.76 * centre) / cell >= 3.0
    assert make_decks(flat(), SENSOR, 1).manifest["waveform"]["frequency"] == 1e9


def test_what_cannot_be_written_is_said():
    parts = {
        "objects": [
            {"kind": "bush", "x": 0.0, "y": 0.4, "radius": 0.1},
            {"kind": "fiducial", "x": 0.1, "y": 0.4},
            {"kind": "rock", "x": 0.1, "y": 0.5, "radius": 0.04},
            {"kind": "post", "x": -0.1, "y": 0.5, "radius": 0.03, "height": 0.2},
            {"kind": "post", "x": 9.0, "y": 0.5, "radius": 0.03, "height": 0.2},
        ],
        "patches": [{"x": 0.0, "y": 0.5, "radius": 0.2}],
    }
    horn = SENSOR.model_copy(update={"antenna": load_sensor("sri-array").antenna})
    decks = make_decks(flat(**parts), horn, 1)
    told = " ".join(decks.omissions)
    for word in (
        "1 of kind bush",
        "1 of kind fiducial",
        "1 wet patches",
        "1 objects that stand outside",
        "horns",
    ):
        assert word in told
    assert decks.manifest["omissions"] == decks.omissions
    assert len(lines_of(decks, "sphere")) == 1
    assert len(lines_of(decks, "cylinder")) == 1


def test_a_turned_and_tilted_dipole_keeps_its_moment():
    turned = SENSOR.model_copy(update={"tilt": 0.4})
    decks = make_decks(flat(track={"positions": (0.0,), "wander": 0.2}), turned, 2)
    from flgpr.model import attitude_matrix, heading_matrix

    pose = decks.manifest["pose"][0]
    turn = heading_matrix(pose[3]) @ attitude_matrix(*pose[4:])
    assert abs(pose[3]) > 0.005
    wanted = {"H": turn[:, 0], "V": turn @ [0.0, math.sin(0.4), math.cos(0.4)]}
    for run in decks.manifest["runs"]:
        total = [sum(w for c, w in run["source"] if c == axis) for axis in "xyz"]
        np.testing.assert_allclose(total, wanted[run["transmit"]], atol=1e-8)
