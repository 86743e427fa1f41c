"""Solids of a scene in gprMax's input: targets as discs, the rough surface and layers as boxes."""

import math

import numpy as np
import pytest

from flgpr.simulate import make_decks
from flgpr.simulate.ground.roughness import HeightField
from flgpr.simulate.scene.draw import stream
from simulate.small_decks import SENSOR, flat, lines_of


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
