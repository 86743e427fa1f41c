"""What steps of tones keep apart, against the response of the tones and echoes summed one by one."""

import math

import numpy as np
import pytest

from aliases import alias_paths
from flgpr.model import (
    SPEED_OF_LIGHT,
    Sensor,
    check_tones,
    clear_end,
    image_paths,
    load_sensor,
    tightest_paths,
    unambiguous_path,
)
from flgpr.model.ambiguity import longest_path, shortest_path

EVEN = 300e6 + 2.5e6 * np.arange(641)
ANTENNAS = np.array([[-1.0, 0.0, 3.5], [0.0, 0.0, 3.5], [1.5, 0.0, 3.0]])


def response(tones, path):
    """Amplitude of an echo at a path away from its own, one tone after the other."""
    return abs(sum(np.exp(2j * np.pi * f * path / SPEED_OF_LIGHT) for f in tones)) / len(tones)


@pytest.mark.parametrize("step", [2.5e6, 6e6, 8e6])
def test_even_tones_repeat_an_echo_whole_after_c_over_their_step(step):
    tones = 300e6 + step * np.arange(169)
    path = unambiguous_path(tones)
    assert path == pytest.approx(SPEED_OF_LIGHT / step)
    assert response(tones, path) == pytest.approx(1)
    assert max(response(tones, part * path) for part in np.linspace(0.02, 0.98, 97)) < 0.25


@pytest.mark.parametrize("every", [2, 3, 5])
def test_tones_thinned_to_every_nth_repeat_n_times_as_early(every):
    assert unambiguous_path(EVEN[::every]) == pytest.approx(unambiguous_path(EVEN) / every)


def test_missing_tones_and_gaps_are_no_coarser_steps():
    rng = np.random.default_rng(1)
    lost = np.sort(rng.choice(EVEN, 500, replace=False))
    notched = EVEN[(EVEN < 0.9e9) | (EVEN > 0.93e9)]
    for tones in (lost, notched):
        assert unambiguous_path(tones) == pytest.approx(unambiguous_path(EVEN), rel=1e-3)


def test_a_coarser_half_of_the_tones_counts_though_the_greatest_common_spacing_is_finer():
    mixed = np.concatenate([EVEN[:320], EVEN[320::2]])
    path = unambiguous_path(mixed)
    assert path == pytest.approx(SPEED_OF_LIGHT / 5e6, rel=1e-3)
    assert response(mixed, path) > 0.3
    assert response(mixed, SPEED_OF_LIGHT / 2.5e6) == pytest.approx(1)


def test_tones_at_random_places_and_a_single_tone_repeat_nowhere():
    rng = np.random.default_rng(2)
    for count in (30, 641):
        assert unambiguous_path(np.sort(rng.uniform(0.3e9, 1.9e9, count))) == math.inf
    assert unambiguous_path([1e9]) == math.inf


def test_an_alias_lies_whole_repetitions_before_or_behind_its_echo():
    np.testing.assert_allclose(alias_paths(7.0, 37.5, 17.0, 48.0), [44.5])
    np.testing.assert_allclose(alias_paths(7.0, 37.5, 0.0, 90.0), [44.5, 82.0])
    np.testing.assert_allclose(alias_paths(85.0, 60.0, 25.0, 37.0), [25.0])
    assert alias_paths(7.0, 50.0, 17.0, 48.0).size == 0
    assert alias_paths(20.0, 50.0, 17.0, 48.0).size == 0
    assert alias_paths(7.0, math.inf, 0.0, 90.0).size == 0


def test_no_path_by_way_of_the_image_is_outside_its_bounds():
    x = (-2.0, 3.0)
    y = (6.5, 24.5)
    rng = np.random.default_rng(3)
    ground = np.column_stack([rng.uniform(*x, 2000), rng.uniform(*y, 2000), np.zeros(2000)])
    edges = np.array([(a, b, 0.0) for a in x for b in y])
    places = np.concatenate([ground, edges])[:, None]
    paths = sum(np.linalg.norm(places - end, axis=-1) for end in (ANTENNAS, ANTENNAS[::-1]))
    assert paths.max() == pytest.approx(longest_path(ANTENNAS, ANTENNAS[::-1], x, y))
    assert 0.97 * paths.min() <= shortest_path(ANTENNAS, ANTENNAS[::-1], x, y) <= paths.min()


@pytest.mark.parametrize("step", [2.5e6, 5.5e6, 6e6, 6.5e6, 8e6, 12e6, 20e6])
def test_what_is_called_aliased_is_where_an_echo_of_some_path_before_the_image_appears(step):
    """The rule, an inequality, against aliases of all paths from the direct coupling to the image's nearest pixel."""
    x = (-2.0, 3.0)
    y = (6.5, 22.0)
    tones = 300e6 + step * np.arange(int(1.4e9 / step))
    paths = image_paths(tones, ANTENNAS, ANTENNAS + [0.3, 0.0, 0.0], x, y)
    before = np.linspace(paths.direct, paths.nearest, 4000)
    inside = any(
        alias_paths(p, paths.unambiguous, paths.nearest, paths.farthest + paths.cell).size
        for p in before
    )
    assert paths.aliased == inside
    assert paths.direct == pytest.approx(0.3)
    if paths.repeats:
        assert paths.aliased


def test_the_sub_band_with_the_widest_cell_or_step_decides():
    tones = np.concatenate([EVEN[:320], EVEN[320::4]])
    bands = {"low": (0.3e9, 1.0e9), "high": (1.2e9, 1.9e9), "none": (5e9, 6e9)}
    paths = tightest_paths(tones, bands, ANTENNAS, ANTENNAS, (-2.0, 2.0), (6.0, 14.0))
    assert paths.unambiguous == pytest.approx(SPEED_OF_LIGHT / 10e6, rel=1e-3)


def test_an_image_may_end_where_the_error_says_and_not_behind():
    van = load_sensor("sri-van")
    x = (-3.24, 3.24)
    y = (6.75, 23.25)

    def on(step):
        tones = van.tones.model_copy(update={"step": step, "count": round(1.344e9 / step) + 1})
        return van.model_copy(update={"tones": tones})

    check_tones(on(6e6), x, y)
    words = (
        r"tones\.step must be at most 6\.\d+ MHz .* up to 23\.25 m .* "
        r"got 8 MHz: echoes repeat after 37\.47 m .* end"
    )
    with pytest.raises(ValueError, match=words) as error:
        check_tones(on(8e6), x, y)
    end = float(str(error.value).split("end the image ")[1].split()[0])
    check_tones(on(8e6), x, (y[0], end))
    with pytest.raises(ValueError, match=r"tones\.step"):
        check_tones(on(8e6), x, (y[0], end + 0.05))
    widest = float(str(error.value).split("at most ")[1].split()[0])
    check_tones(on(widest * 1e6), x, y)
    with pytest.raises(ValueError, match=r"take finer steps$"):
        check_tones(on(30e6), x, y)


def test_where_no_end_helps_it_is_not_a_number():
    sensor = Sensor.model_validate(load_sensor("full-wave").model_dump() | {"height": 5.0})
    tx, rx = (side + [0.0, 0.0, 5.0] for side in sensor.pairs())
    paths = image_paths(1e9 + 40e6 * np.arange(30), tx, rx, (-1.0, 1.0), (3.0, 6.0))
    assert math.isnan(clear_end(paths, tx, rx, (-1.0, 1.0), (3.0, 6.0)))
