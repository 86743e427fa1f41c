import math

import numpy as np
import pytest

from flgpr.model import Sensor, load_sensor
from flgpr.simulate import Scene, make_decks

SENSOR = Sensor(
    name="two dipoles",
    source="test",
    polarization=("HH", "HV", "VV"),
    height=0.6,
    tx=((0.0, 0.0, 0.0), (0.3, 0.0, 0.0)),
    rx=((0.1, 0.0, 0.0), (-0.15, 0.02, 0.0)),
    tones={"start": 500e6, "step": 20e6, "count": 51},
    antenna={"kind": "dipole"},
)
SMALL = {"length": 0.9, "x_min": -0.3, "x_max": 0.3, "track": {"positions": (0.0, 0.2)}}


def lines_of(decks, command, name="scene.txt"):
    return [
        line.split()[1:]
        for line in decks.files[name].splitlines()
        if line.startswith(f"#{command}:")
    ]


def flat(**parts):
    return Scene.model_validate({**SMALL, "surface": {"rms_height": 0.0}, **parts})


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


def test_targets_stand_where_the_scene_says():
    plastic = {
        "kind": "plastic",
        "x": 0.1,
        "y": 0.5,
        "depth": 0.03,
        "radius": 0.1,
        "height": 0.06,
        "gap": 0.02,
    }
    metal = {
        "kind": "metal",
        "x": -0.1,
        "y": 0.6,
        "depth": 0.04,
        "radius": 0.08,
        "height": 0.05,
        "tilt": 0.3,
    }
    decks = make_decks(flat(targets=[plastic, metal]), SENSOR, 1)
    origin = np.array(decks.manifest["grid"]["origin"])
    body, gap, steel = (np.array(words[:7], float) for words in lines_of(decks, "cylinder"))
    np.testing.assert_allclose(body[:3] + origin, [0.1, 0.5, -0.03], atol=1e-8)
    np.testing.assert_allclose(body[3:6] + origin, [0.1, 0.5, -0.09], atol=1e-8)
    np.testing.assert_allclose(gap[3:6] + origin, [0.1, 0.5, -0.05], atol=1e-8)
    assert lines_of(decks, "cylinder")[0][7] == lines_of(decks, "material")[0][4]
    assert float(lines_of(decks, "material")[0][0]) == 2.9
    assert lines_of(decks, "cylinder")[1][7] == "free_space"
    lean = steel[:3] - steel[3:6]
    np.testing.assert_allclose(lean / 0.05, [0, math.sin(0.3), math.cos(0.3)], atol=1e-6)
    with pytest.raises(ValueError, match="every target must lie on the lane"):
        make_decks(flat(targets=[metal | {"x": 3.0}]), SENSOR, 1)


def test_a_body_of_revolution_is_cut_into_discs():
    cone = {"kind": "thing", "x": 0.0, "y": 0.5, "profile": ((0.0, 0.0), (0.1, 0.1), (0.0, 0.1))}
    decks = make_decks(flat(targets=[cone]), SENSOR, 1)
    discs = np.array([words[:7] for words in lines_of(decks, "cylinder")], float)
    volume = (np.pi * discs[:, 6] ** 2 * (discs[:, 2] - discs[:, 5])).sum()
    assert volume == pytest.approx(np.pi * 0.1**2 * 0.1 / 3, rel=0.02)


def test_no_disc_is_thinner_than_a_cell():
    thin = {
        "kind": "plastic",
        "x": 0.1,
        "y": 0.5,
        "depth": 0.02,
        "radius": 0.1,
        "height": 0.06,
        "gap": 0.004,
    }
    lid = {
        "kind": "lid",
        "x": -0.1,
        "y": 0.5,
        "profile": ((0.0, 0.0), (0.05, 0.0), (0.08, 0.003), (0.08, 0.004), (0.0, 0.004)),
    }
    dome = {
        "kind": "dome",
        "x": 0.0,
        "y": 0.3,
        "profile": ((0.0, 0.0), (0.05, 0.004), (0.1, 0.05), (0.0, 0.05)),
    }
    decks = make_decks(flat(targets=[thin, lid, dome]), SENSOR, 1)
    cell = decks.manifest["grid"]["cell"]
    ends = np.array([words[:6] for words in lines_of(decks, "cylinder")], float).reshape(-1, 2, 3)
    assert (np.linalg.norm(np.diff(ends, axis=1), axis=-1) >= cell * (1 - 1e-6)).all()
    told = " ".join(decks.omissions)
    assert "the air gap of the plastic at (0.1, 0.5) m: 4 mm became a cell" in told
    assert "the height of the lid at (-0.1, 0.5) m: 4 mm became a cell" in told


def test_the_rough_surface_is_the_simulators_own_snapped_to_cells():
    rough = flat(
        surface={"rms_height": 0.02, "correlation_length": 0.1},
        soil={"model": "fixed", "permittivity": 3.0},
    )
    decks = make_decks(rough, SENSOR, 3)
    grid = decks.manifest["grid"]
    told = decks.manifest["surface"]
    heights = np.zeros(grid["shape"][:2])
    for words in lines_of(decks, "box"):
        i0, j0, _, i1, j1, top = (round(float(v) / grid["cell"]) for v in words[:6])
        heights[i0:i1, j0:j1] = np.maximum(heights[i0:i1, j0:j1], top)
    heights = heights * grid["cell"] + grid["origin"][2]
    assert heights.std() == pytest.approx(told["rms_height_on_grid"])
    assert told["rms_height"] == pytest.approx(0.02, rel=0.3)
    from flgpr.simulate.ground.roughness import HeightField
    from flgpr.simulate.scene.draw import stream

    field = HeightField(0.02, 0.1, stream(3, "heights"))
    i = 30
    j = 40
    x, y = (n * grid["cell"] + grid["origin"][a] + grid["cell"] / 2 for a, n in enumerate((i, j)))
    assert heights[i, j] == pytest.approx(float(field(x, y)), abs=0.51 * grid["cell"])


def test_layers_of_soil_lie_under_one_another():
    soil = {"model": "topp", "moisture": 0.2, "layers": ({"thickness": 0.1, "moisture": 0.05},)}
    decks = make_decks(flat(soil=soil), SENSOR, 1)
    upper, lower = lines_of(decks, "box")
    z = decks.manifest["grid"]["origin"][2]
    assert float(upper[5]) + z == pytest.approx(0.0, abs=1e-9)
    assert (
        float(upper[2])
        == float(lower[5])
        == pytest.approx(-0.1 - z, abs=0.51 * decks.manifest["grid"]["cell"])
    )
    assert (upper[6], lower[6]) == ("soil1", "soil2")


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
