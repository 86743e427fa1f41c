"""Memory that a detection takes, estimated before it begins, and the sections that follow from it."""

import math

import pytest

from flgpr.chain.memory import (
    check_scan_memory,
    memory_needed,
    parse_size,
    plan_sections,
    sizes_of,
    threads_within,
)
from flgpr.chain.recipe import load_recipe
from flgpr.chain.sections import Section
from flgpr.model import Lane
from small_lane import small_run

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
    assert memory_needed(more_scans, recipe, LANE) == memory_needed(SIZES, recipe, LANE)
    rows = [memory_needed(SIZES, recipe, LANE, count) for count in (10, 20, 30)]
    assert rows[0] < rows[1] < rows[2]
    assert rows[2] - rows[1] == pytest.approx(rows[1] - rows[0])
    whole = recipe.run_view.grid(LANE).ny
    assert memory_needed(SIZES, recipe, LANE, whole) == memory_needed(SIZES, recipe, LANE)


def test_a_self_signature_by_the_median_holds_all_images(recipe):
    median = recipe.model_copy(
        update={"background": recipe.background.model_copy(update={"self_signature": "median"})}
    )
    grid = recipe.image.grid()
    channels = SIZES["polarization"] * len(recipe.image.subbands)
    images = 8 * SIZES["scan"] * channels * grid.nx * grid.ny
    more = memory_needed(SIZES, median, LANE) - memory_needed(SIZES, recipe, LANE)
    assert more >= images


def test_a_lane_that_fits_stays_in_one_piece_and_a_limit_cuts_it(recipe):
    rows = recipe.run_view.grid(LANE).ny
    needed = math.ceil(memory_needed(SIZES, recipe, LANE))
    assert plan_sections(SIZES, recipe, LANE, needed) == [Section(0, rows)]
    sections = plan_sections(SIZES, recipe, LANE, needed - 1)
    assert len(sections) > 1
    assert (sections[0].start, sections[-1].stop) == (0, rows)
    with pytest.raises(ValueError, match=r"for a lane of 2000 m in one piece, got"):
        plan_sections(SIZES, recipe, LANE, needed - 1, math.inf)


def test_the_longest_section_that_is_wanted_is_kept_to(recipe):
    sections = plan_sections(SIZES, recipe, LANE, 10**12, longest=100.0)
    spacing = recipe.run_view.spacing
    assert max(section.stop - section.start for section in sections) * spacing <= 100.0 + 1e-9
    with pytest.raises(ValueError, match="section must be a positive length in metres, got 0"):
        plan_sections(SIZES, recipe, LANE, 10**12, longest=0.0)


def test_too_little_memory_says_what_would_suffice(recipe):
    with pytest.raises(ValueError, match=r"must be at least [\d.]+ GB for this run, got 0\.1 GB"):
        plan_sections(SIZES, recipe, LANE, 10**8)
    with pytest.raises(ValueError, match=r"scans of \(3, 36, 1024\) samples must take at most"):
        check_scan_memory((3, 36, 1024), recipe, 10**8)
    check_scan_memory((3, 36, 1024), recipe)


def test_threads_share_what_is_left(recipe):
    sections = [Section(0, recipe.run_view.grid(LANE).ny)]
    needed = math.ceil(memory_needed(SIZES, recipe, LANE))
    assert threads_within(SIZES, recipe, LANE, sections, needed) == 1
    counts = [threads_within(SIZES, recipe, LANE, sections, needed + k * 10**9) for k in (1, 2, 4)]
    assert counts == sorted(counts)
    assert counts[-1] > 1
