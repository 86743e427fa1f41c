"""Sections of a long lane: their rows, their borders, and what a manifest says of them."""

import math

import pandas as pd
import pytest

from flgpr.method.memory import lane_memory
from flgpr.method.sections import (
    Section,
    divide,
    kept_rows,
    lane_threshold,
    margin,
    noted_section,
    plan_sections,
    section_lane,
    section_note,
    threads_within,
)
from flgpr.model import Lane
from flgpr.recipe.schema import load_recipe

LANE = Lane(-1.5, 1.5, 10.0, 60.0)
LONG = Lane(-1.5, 1.5, 0.0, 2000.0)
SIZES = {"scan": 100, "polarization": 3, "pair": 36, "frequency": 1024}


@pytest.fixture(scope="module")
def recipe():
    return load_recipe("wang2007")


@pytest.mark.parametrize(("rows", "longest"), [(1, 1), (10, 4), (10, 10), (101, 25)])
def test_sections_hold_every_row_once_and_are_as_even_as_can_be(rows, longest):
    sections = divide(rows, longest)
    assert [row for section in sections for row in range(section.start, section.stop)] == list(
        range(rows)
    )
    lengths = [section.stop - section.start for section in sections]
    assert max(lengths) <= longest
    assert max(lengths) - min(lengths) <= 1
    assert len(sections) == math.ceil(rows / longest)


def test_a_section_knows_rows_beyond_its_own_but_none_beyond_the_lane(recipe):
    beyond = margin(recipe)
    radius, spacing = recipe.prescreen.radius, recipe.run_view.spacing
    assert beyond == math.ceil(2 * radius / spacing) + 2
    rows = recipe.run_view.grid(LANE).ny
    assert kept_rows(recipe, LANE, Section(200, 300)) == slice(200 - beyond, 300 + beyond)
    assert kept_rows(recipe, LANE, Section(0, rows)) == slice(0, rows)


def test_a_stage_that_reads_farther_widens_the_margin(recipe):
    wider = recipe.model_copy(update={"columns": load_recipe("flsar2004").columns})
    assert margin(wider) >= margin(recipe)
    assert margin(load_recipe("flsar2004")) > margin(recipe)


def test_neighbours_meet_half_a_pixel_before_the_second_and_cover_the_lane(recipe):
    grid = recipe.run_view.grid(LANE)
    first = section_lane(recipe, LANE, Section(0, 200))
    second = section_lane(recipe, LANE, Section(200, grid.ny))
    assert (first.y_min, second.y_max) == (LANE.y_min, LANE.y_max)
    assert first.y_max == second.y_min == pytest.approx(grid.y[200] - grid.dy / 2)
    assert (first.x_min, first.x_max) == (LANE.x_min, LANE.x_max)


@pytest.mark.parametrize("threshold", [0.1, 1 / 3, math.inf, -math.inf])
def test_a_manifest_says_of_a_section_all_that_is_read_again(threshold):
    section = Section(3, 17, threshold)
    assert noted_section(section_note(LANE, section)) == (LANE, section)


def test_the_density_rule_leaves_the_strongest_and_a_screen_stage_decides_itself(recipe):
    screen = recipe.prescreen
    grid = recipe.run_view.grid(LANE)
    allowed = 3
    # A third of an alarm more than three are allowed: the number is rounded down.
    area = (allowed + 1 / 3) * math.pi * screen.radius**2 / screen.density
    maxima = pd.DataFrame(
        {"x": [0.0] * 5, "y": [20.0, 25, 30, 35, 40], "magnitude": [5.0, 1, 4, 2, 3]}
    )
    threshold = lane_threshold(recipe, LANE, maxima, round(area / (grid.dx * grid.dy)))
    assert (maxima["magnitude"] >= threshold).sum() == allowed
    with_screen = load_recipe("flsar2004")
    assert lane_threshold(with_screen, LANE, maxima, 1000) == -math.inf


# The sections that follow from the memory


def test_a_lane_that_fits_stays_in_one_piece_and_a_limit_cuts_it(recipe):
    rows = recipe.run_view.grid(LONG).ny
    needed = math.ceil(lane_memory(SIZES, recipe, LONG).needed())
    assert plan_sections(SIZES, recipe, LONG, needed) == [Section(0, rows)]
    sections = plan_sections(SIZES, recipe, LONG, needed - 1)
    assert len(sections) > 1
    assert (sections[0].start, sections[-1].stop) == (0, rows)
    with pytest.raises(ValueError, match=r"for a lane of 2000 m in one piece, got"):
        plan_sections(SIZES, recipe, LONG, needed - 1, math.inf)


def test_the_longest_section_that_is_wanted_is_kept_to(recipe):
    sections = plan_sections(SIZES, recipe, LONG, 10**12, longest=100.0)
    spacing = recipe.run_view.spacing
    assert max(section.stop - section.start for section in sections) * spacing <= 100.0 + 1e-9
    with pytest.raises(ValueError, match="section must be a positive length in metres, got 0"):
        plan_sections(SIZES, recipe, LONG, 10**12, longest=0.0)


def test_too_little_memory_says_what_would_suffice(recipe):
    with pytest.raises(ValueError, match=r"must be at least [\d.]+ GB for this run, got 0\.1 GB"):
        plan_sections(SIZES, recipe, LONG, 10**8)


def test_threads_share_what_is_left(recipe):
    sections = [Section(0, recipe.run_view.grid(LONG).ny)]
    needed = math.ceil(lane_memory(SIZES, recipe, LONG).needed())
    assert threads_within(SIZES, recipe, LONG, sections, needed) == 1
    counts = [threads_within(SIZES, recipe, LONG, sections, needed + k * 10**9) for k in (1, 2, 4)]
    assert counts == sorted(counts)
    assert counts[-1] > 1
