"""What the passes over one lane share."""

import numpy as np
import pandas as pd
import pytest

from alone import needs
from divided import setup, with_results
from flgpr.engine import (
    bundle_groups,
    group_of,
)
from flgpr.method.imaged_run import array_table, table_arrays
from flgpr.method.sections import Section
from small_lane import small_recipe

RIVAL = needs("flgpr_ground")


def test_tables_go_through_arrays_unchanged():
    table = pd.DataFrame({"x": [1.5, np.nan], "scans": [3, 4]})
    both = bundle_groups({"a": table_arrays(table), "ab": {"x": np.zeros(3)}}) | {"x": np.ones(2)}
    assert array_table(group_of(both, "a")).equals(table)


def test_the_background_reaches_as_far_as_the_filters_read():
    lane = setup()
    (median, _), (mean, _), _ = lane.recipe.smoothing
    wanted = lane.near.ny + median // 2 + mean // 2
    assert lane.background_rows == min(wanted, lane.imager.grid.ny)
    assert setup(whole_background=True).background_rows == lane.imager.grid.ny


def test_blocks_reach_the_rows_that_their_scans_see():
    lane = setup()
    assert lane.rows_of(None) == slice(0, lane.grid.ny)
    first, last = lane.rows_of(range(0, 1)), lane.rows_of(range(12, 13))
    assert first.start == 0
    assert last.stop == lane.grid.ny
    assert first.stop < last.stop
    both = lane.rows_of(range(0, 13))
    assert (both.start, both.stop) == (0, lane.grid.ny)


def test_only_blocks_that_reach_a_section_are_numbered():
    blocks = [range(0, 4), range(4, 9), range(9, 13)]
    rows = setup().grid.ny
    assert setup().block_numbers(blocks) == [0, 1, 2]
    near = setup(section=Section(0, 2))
    assert near.block_numbers(blocks)[0] == 0
    assert 2 not in near.block_numbers(blocks)
    far = setup(section=Section(rows - 2, rows))
    assert 0 not in far.block_numbers(blocks)


def test_a_recipe_whose_confidence_is_no_column_is_refused():
    with pytest.raises(ValueError, match=r"confidence must be .*, got 'entropy'"):
        setup('confidence = "entropy"\n' + small_recipe())


@RIVAL
def test_a_recipe_with_more_columns_than_a_table_holds_is_refused_before_it_runs():
    """It ran, and its result could not be read."""
    stage = '\n[[columns]]\nstage = "hog"\nsize = {size}\ncell = {cell}\n'
    with pytest.raises(ValueError, match=r"columns of the recipe .* must be at most 3979, got \d+"):
        setup(small_recipe() + stage.format(size=[8.0, 8.0], cell=0.1))
    assert len(setup(small_recipe() + stage.format(size=[2.4, 2.4], cell=0.8)).columns) == 1


def test_a_view_has_the_labels_of_the_recipe():
    lane = with_results()
    view = lane.view()
    assert list(view["polarization"].values) == lane.polarizations
    assert list(view["subband"].values) == list(lane.recipe.image.subbands)
    assert view.sizes["y"] == lane.grid.ny
