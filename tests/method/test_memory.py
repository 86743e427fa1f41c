"""Memory that a detection takes, estimated before it begins."""

import numpy as np
import pytest

from alone import needs
from flgpr.method.memory import (
    check_scan_memory,
    lane_memory,
    parse_size,
    sizes_of,
    thread_memory,
)
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe, parse_recipe, recipe_text
from small_lane import small_run

RIVAL = needs("flgpr_ground")

SIZES = {"scan": 100, "polarization": 3, "pair": 36, "frequency": 1024}
LANE = Lane(-1.5, 1.5, 0.0, 2000.0)


@pytest.fixture(scope="module")
def recipe():
    return load_recipe("wang2007")


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2 * 10**9), ("2GiB", 2 * 2**30), ("500 mb", 5 * 10**8), ("1.5kB", 1500), ("7", 7)],
)
def test_sizes_are_read_with_their_units(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "GB", "-2GB", "0MB", "2 GBit", "two"])
def test_what_is_no_size_is_refused(text):
    with pytest.raises(ValueError, match="max-memory must be a size such as 2GB or 500MB"):
        parse_size(text)


def test_sizes_of_a_run_are_the_lengths_of_its_dimensions():
    run = small_run(scans=3)
    assert sizes_of(run)["scan"] == 3
    assert sizes_of(run)["polarization"] == run.sizes["polarization"]


def test_memory_grows_with_rows_and_not_with_scans(recipe):
    more_scans = SIZES | {"scan": 10_000}
    assert (
        lane_memory(more_scans, recipe, LANE).needed() == lane_memory(SIZES, recipe, LANE).needed()
    )
    rows = [lane_memory(SIZES, recipe, LANE).needed(count) for count in (10, 20, 30)]
    assert rows[0] < rows[1] < rows[2]
    assert rows[2] - rows[1] == pytest.approx(rows[1] - rows[0])
    whole = recipe.run_view.grid(LANE).ny
    assert (
        lane_memory(SIZES, recipe, LANE).needed(whole) == lane_memory(SIZES, recipe, LANE).needed()
    )


def test_one_estimate_holds_for_any_rows(recipe):
    memory = lane_memory(SIZES, recipe, LANE)
    for rows in (None, 0, 1, 500):
        assert memory.needed(rows) == lane_memory(SIZES, recipe, LANE).needed(rows)
    assert memory.thread == thread_memory(SIZES, recipe)
    assert memory.view == recipe.run_view.grid(LANE)


def test_a_self_signature_by_the_median_holds_all_images(recipe):
    median = recipe.model_copy(
        update={"background": recipe.background.model_copy(update={"self_signature": "median"})}
    )
    grid = recipe.image.grid()
    channels = SIZES["polarization"] * len(recipe.image.subbands)
    images = 8 * SIZES["scan"] * channels * grid.nx * grid.ny
    more = lane_memory(SIZES, median, LANE).needed() - lane_memory(SIZES, recipe, LANE).needed()
    assert more >= images


@RIVAL
def test_thousands_of_columns_count(recipe):
    """Fisher vectors of a long lane take more than all else."""
    stage = '\n[[columns]]\nstage = "fisher-vectors"\n'
    many = parse_recipe(recipe_text("wang2007") + stage)
    columns = 4 * 2 * 30 * 16
    screen = recipe.prescreen
    view = recipe.run_view.grid(LANE)
    alarms = screen.density * view.nx * view.ny * view.dx * view.dy / (np.pi * screen.radius**2)
    more = lane_memory(SIZES, many, LANE).needed() - lane_memory(SIZES, recipe, LANE).needed()
    assert more > columns * alarms * 8
    few = parse_recipe(recipe_text("wang2007") + stage + "parts = 1\ngaussians = 15\n")
    less = lane_memory(SIZES, few, LANE).needed() - lane_memory(SIZES, recipe, LANE).needed()
    assert less == pytest.approx(more / 8)


def test_scans_that_take_too_much_memory_are_refused(recipe):
    with pytest.raises(ValueError, match=r"scans of \(3, 36, 1024\) samples must take at most"):
        check_scan_memory((3, 36, 1024), recipe, 10**8)
    check_scan_memory((3, 36, 1024), recipe)
