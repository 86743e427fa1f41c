"""Signal to clutter by formula, against simulated images and against the physics that each factor must obey."""

import json
import math

import numpy as np
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.design import (
    PointSpread,
    Viewing,
    expected_signal_to_clutter,
    ground_model,
    measure_signal_to_clutter,
)
from flgpr.design.array import Design, Question, _set_expected, expected_in_words
from flgpr.model import SPEED_OF_LIGHT, Sensor, load_sensor
from flgpr.model.refraction import ray_divergence, two_way_transmission
from flgpr.simulate.bodies.echoes import incidence
from flgpr.simulate.ground.roughness import surface_backscatter
from flgpr.simulate.ground.soil import one_way_loss
from flgpr.simulate.simulator import array_state

TOLERANCE = 1.0  # dB between formula and images, as the documentation states
BAND = (0.75e9, 1.35e9)


@pytest.fixture(scope="module")
def sensor():
    """sri-array with the tones of one sub-band, half as dense, and the ground around 12 m ahead."""
    data = load_sensor("sri-array").model_dump()
    data["tones"] = {"start": BAND[0], "step": 5e6, "count": 121}
    data["footprint"] = (-4.0, 4.0, 9.0, 15.0)
    return Sensor.model_validate(data)


def smooth(**parts):
    """Moist soil with little loss under a surface of a single scale."""
    return ground_model(**({"permittivity": 6.0, "loss_tangent": 0.02, "unevenness": 0.0} | parts))


@pytest.mark.slow("makes images of simulated ground")
@pytest.mark.parametrize("site", ["arid-sand", "temperate", "prepared-earth"])
def test_formula_and_images_agree(sensor, site):
    bodies = ["metal-at", "plastic-at", "m19", "pmn"]
    depths = [0.0, 0.1]
    ground = ground_model(site)
    expected = expected_signal_to_clutter(sensor, ground, bodies, depths)
    measured = measure_signal_to_clutter(sensor, ground, bodies, depths)
    key = ["body", "depth", "subband", "polarization"]
    assert expected[key].equals(measured[key])
    off = measured["signal_to_clutter_db"] - expected["signal_to_clutter_db"]
    assert off.abs().max() < TOLERANCE
    margin = measured["high_db"] - measured["signal_to_clutter_db"]
    assert (off.abs() < margin).mean() > 0.8, "most of the intervals hold the formula's figure"
    assert margin.between(0.1, 1.8).all()


@pytest.mark.slow("makes images of simulated ground")
def test_the_upper_band_agrees_where_beams_are_narrow():
    data = load_sensor("sri-array").model_dump()
    data["tones"] = {"start": 2.25e9, "step": 5e6, "count": 121}
    data["footprint"] = (-4.0, 4.0, 9.0, 15.0)
    upper = Sensor.model_validate(data)
    ground = ground_model("arid-sand")
    expected = expected_signal_to_clutter(upper, ground, ["metal-at"], [0.05])
    measured = measure_signal_to_clutter(upper, ground, ["metal-at"], [0.05])
    off = measured["signal_to_clutter_db"] - expected["signal_to_clutter_db"]
    assert off.abs().max() < TOLERANCE


def test_clutter_goes_with_the_square_of_the_roughness(sensor):
    levels = []
    for rms_height in (0.0015, 0.005):
        ground = smooth(rms_height=rms_height)
        levels.append(
            [
                expected_signal_to_clutter(sensor, ground, ["plastic-at"], [0.05])[
                    "signal_to_clutter_db"
                ],
                measure_signal_to_clutter(sensor, ground, ["plastic-at"], [0.05], seeds=2)[
                    "signal_to_clutter_db"
                ],
            ]
        )
    by_formula, on_images = np.subtract(levels[0], levels[1])
    ten_decibels = 20 * math.log10(5 / 1.5)
    np.testing.assert_allclose(by_formula, ten_decibels, atol=1e-6)
    np.testing.assert_allclose(on_images, ten_decibels, atol=0.3)


def test_uneven_ground_keeps_clutter_that_a_smoother_surface_has_not(sensor):
    fall = []
    for unevenness in (0.0, 1024e-6):
        levels = [
            expected_signal_to_clutter(
                sensor, smooth(rms_height=s, unevenness=unevenness), ["metal-at"], [0.05]
            )
            for s in (0.001, 0.004)
        ]
        fall.append(levels[0]["signal_to_clutter_db"][0] - levels[1]["signal_to_clutter_db"][0])
    assert fall[0] == pytest.approx(12.04, abs=0.01)
    assert fall[1] < 8


def test_depth_costs_the_soils_attenuation(sensor):
    ground = ground_model("temperate", loss_tangent=0.1)
    narrow = {"narrow": (1.045e9, 1.055e9)}
    table = expected_signal_to_clutter(
        sensor, ground, ["m19"], [0.05, 0.15], Viewing(polarizations=["HH"], subbands=narrow)
    )
    centre = sum(BAND) / 2
    permittivity = complex(ground.soil.media(np.array([centre]))[0][0])
    sine = incidence(
        0.0, 12.0, 0.0, array_state(sensor, np.array([0, 0, sensor.height, 0, 0, 0.0]))
    )
    along = math.sqrt(1 - sine**2 / permittivity.real)  # cosine in the soil
    loss = 2 * one_way_loss(centre, permittivity) * 0.1 / along
    # The table of a box leaves out the waves between it and the surface, so that nothing but the
    # loss changes.
    assert -np.diff(table["signal_to_clutter_db"])[0] == pytest.approx(loss, rel=0.01)
    assert -np.diff(table["attenuation_db"])[0] == pytest.approx(loss, rel=0.01)
    without = expected_signal_to_clutter(sensor, smooth(loss_tangent=0.0), ["m19"], [0.15])
    assert without["attenuation_db"].abs().max() < 1e-3


def test_the_factors_are_those_of_the_formulas(sensor):
    ground = smooth(rms_height=0.003)
    near_middle = {"narrow": (1.045e9, 1.055e9)}
    table = expected_signal_to_clutter(
        sensor, ground, ["metal-at"], [0.05], viewing=Viewing(subbands=near_middle)
    )
    sine = incidence(
        0.0, 12.0, 0.0, array_state(sensor, np.array([0, 0, sensor.height, 0, 0, 0.0]))
    )
    permittivity = 6 - 0.12j
    surface = ground.surface
    backscatter = surface_backscatter(
        1.05e9, sine, permittivity, 0.003, surface.correlation_length, surface.slope
    )
    wanted = {
        "transmission_db": 20 * np.log10(np.abs(two_way_transmission(sine, permittivity))),
        "divergence_db": np.full(2, 20 * np.log10(np.abs(ray_divergence(sine, permittivity)))),
        "sigma0_db": 10 * np.log10(backscatter),
    }
    for name, values in wanted.items():
        np.testing.assert_allclose(table[name], values, atol=0.03, err_msg=name)
    parts = table[["body_dbsm", "transmission_db", "divergence_db", "attenuation_db"]].sum(axis=1)
    total = parts - table["sigma0_db"] - 10 * np.log10(table["cell_m2"])
    np.testing.assert_allclose(table["signal_to_clutter_db"], total)


def test_the_cell_of_a_line_of_receivers_is_that_of_its_bandwidth_and_length():
    receivers = tuple((x, 0.0, 0.0) for x in np.linspace(-1, 1, 41))
    tones = {"start": 900e6, "step": 5e6, "count": 61}
    line = Sensor(
        name="line", source="test", polarization=("HH",), height=4.0, tx=((0.0, 0.0, 0.0),), rx=receivers, tones=tones,
        footprint=(-12.0, 12.0, 6.0, 18.0),
    )  # fmt: skip
    slant = math.hypot(12, 4)
    sine = 12 / math.hypot(12, 4)
    # A boxcar of B Hz is as wide as one range cell c/(2B·sinθ), a uniform aperture L on one leg as
    # λR/L.
    down = SPEED_OF_LIGHT / (2 * 61 * 5e6 * sine)
    across = SPEED_OF_LIGHT / 1.05e9 * slant / (2.0 * 41 / 40)
    area = PointSpread(line, window="boxcar").cell_area([0.0, 12.0, 0.0])
    assert area == pytest.approx(down * across, rel=0.05)


def test_a_wider_band_and_a_nearer_place_have_a_smaller_cell(sensor):
    ground = smooth()
    halves = expected_signal_to_clutter(
        sensor, ground, ["pmn"], [0.0], viewing=Viewing(subbands={"half": (0.9e9, 1.2e9)})
    )
    whole = expected_signal_to_clutter(sensor, ground, ["pmn"], [0.0])
    nearer = expected_signal_to_clutter(
        sensor, ground, ["pmn"], [0.0], viewing=Viewing(distance=10.0)
    )
    assert halves["cell_m2"][0] == pytest.approx(2 * whole["cell_m2"][0], rel=0.1)
    assert nearer["cell_m2"][0] < whole["cell_m2"][0]


def test_a_higher_array_sees_brighter_ground(sensor):
    ground = smooth()
    level = [
        expected_signal_to_clutter(sensor, ground, ["pmn"], [0.0], viewing=Viewing(height=height))[
            "sigma0_db"
        ][0]
        for height in (3.0, 6.0)
    ]
    assert level[1] > level[0] + 3


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"bodies": ["tm62"]}, "body must be .*'tm62'"),
        ({"bodies": "pmn"}, "bodies must be a sequence of at least one name, got 'pmn'"),
        ({"depths": [-0.01]}, "depth must lie between 0 and 1 m, got -0.01"),
        ({"depths": []}, "depths must be at least one, got none"),
        (
            {"distance": 50.0},
            "distance must lie in the footprint of sri-array, 9 to 15 m, got 50.0",
        ),
        ({"height": 0.0}, "height must be greater than 0, got 0.0"),
        ({"window": "square"}, "window must be one of .*'square'"),
        ({"subbands": {}}, "subbands must name at least one band"),
        (
            {"subbands": {"F9": (5e9, 6e9)}},
            "sub-band F9 must hold at least two tones, got 5e\\+09 to 6e\\+09 Hz",
        ),
        ({"polarizations": ["HV"]}, "polarizations must be among .*HH, VV.*got HV"),
        ({"ground": smooth(rms_height=0.0)}, "rms_height or unevenness must be greater than 0"),
    ],
)
def test_faults(sensor, asked, words):
    case = {"sensor": sensor, "ground": smooth(), "bodies": ["pmn"], "depths": [0.05]}
    case |= {name: value for name, value in asked.items() if name in case}
    case["viewing"] = Viewing(**{name: value for name, value in asked.items() if name not in case})
    for function in (expected_signal_to_clutter, measure_signal_to_clutter):
        with pytest.raises(ValueError, match=words):
            function(**case)


def test_faults_of_measuring(sensor):
    with pytest.raises(ValueError, match="seeds must be at least 2, to give an interval, got 1"):
        measure_signal_to_clutter(sensor, smooth(), ["pmn"], seeds=1)
    with pytest.raises(ValueError, match="looks must be at least 1, got 0"):
        measure_signal_to_clutter(sensor, smooth(), ["pmn"], looks=0)


def test_bands_beyond_the_tables_are_refused():
    with pytest.raises(
        ValueError,
        match=r"its middle at or below 3\.225 GHz, where the signature tables end, got 9\.4",
    ):
        expected_signal_to_clutter(load_sensor("dual-band-x"), smooth(), ["pmn"])


def made_up_design(name):
    y = np.array([10.0, 12.0, 14.0])
    return Design(load_sensor(name), {}, np.zeros(1), y, np.zeros(1), np.zeros(1))


def test_a_design_says_in_words_what_to_expect():
    design = made_up_design("sri-array")
    ground = ground_model("prepared-earth")
    _set_expected(design, ground, Question(band=BAND, depth=0.1))
    wanted = expected_signal_to_clutter(
        load_sensor("sri-array"),
        ground,
        ["metal-at"],
        [0.1],
        Viewing(subbands={"all": BAND}, window="hann"),
    )
    level = round(wanted["signal_to_clutter_db"][0])
    told = expected_in_words(design)
    assert "12 m ahead, 10 cm deep in prepared-earth with a surface of 2 mm rms" in told
    assert f"a metal mine {level} dB stronger in HH and " in told
    assert "and a plastic mine " in told


def test_a_design_says_why_nothing_is_expected():
    design = made_up_design("dual-band-x")
    _set_expected(design, ground_model("arid-sand"), Question())
    assert design.expected.empty
    assert "dual-band-x: no signal to clutter by formula" in expected_in_words(design)
    assert "3.225 GHz" in expected_in_words(design)


def call(*arguments):
    return CliRunner().invoke(app, ["design", "sri-array", *arguments])


ONE_CASE = (
    "--signal-to-clutter",
    "--body",
    "pmn",
    "--depth",
    "0.05",
    "--site",
    "prepared-sand",
    "--rms",
    "0.003",
)


def test_the_command_prints_the_functions_figures():
    result = call(*ONE_CASE, "--band", "0.75e9", "1.35e9", "--json")
    rows = json.loads(result.stdout)["signal_to_clutter"]
    ground = ground_model("prepared-sand", rms_height=0.003)
    wanted = expected_signal_to_clutter(
        load_sensor("sri-array"),
        ground,
        ["pmn"],
        [0.05],
        Viewing(subbands={"band": BAND}, window="hann"),
    )
    assert [row["polarization"] for row in rows] == ["HH", "VV"]
    for row, level in zip(rows, wanted["signal_to_clutter_db"], strict=True):
        assert row["signal_to_clutter_db"] == pytest.approx(level, abs=1e-5)
        assert row["ground"] == "prepared-sand"
    printed = call(*ONE_CASE, "--band", "0.75e9", "1.35e9")
    assert printed.exit_code == 0
    line = next(line for line in printed.stdout.splitlines() if "pmn" in line)
    for level in wanted["signal_to_clutter_db"]:
        assert f"{level:.1f}" in line


@pytest.mark.slow("makes images of simulated ground")
def test_the_command_measures_where_it_is_asked_to():
    result = call(*ONE_CASE, "--band", "0.75e9", "1.35e9", "--json", "--measure", "2")
    for row in json.loads(result.stdout)["signal_to_clutter"]:
        assert row["low_db"] < row["measured_db"] < row["high_db"]
        assert abs(row["measured_db"] - row["signal_to_clutter_db"]) < 2


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--body", "pmn"], "--body goes with --signal-to-clutter"),
        (["--json"], "--json goes with --signal-to-clutter"),
        (
            ["--depth", "0.1", "--depth", "0.2"],
            "--depth must be given once without --signal-to-clutter",
        ),
        (["--signal-to-clutter", "--depth", "3"], "depth must lie between 0 and 1 m, got 3.0"),
        (
            ["--signal-to-clutter", "--permittivity", "4"],
            "--loss-tangent must be given with permittivity",
        ),
    ],
)
def test_faults_of_the_command(arguments, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = call(*arguments)
    assert result.exit_code == 2
    assert words in result.stderr
    assert not list(tmp_path.iterdir())
