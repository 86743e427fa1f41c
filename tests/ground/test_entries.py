"""Entries of a proving ground: packaged recipes that fit its array, and those found by name, file or folder."""

import warnings

import numpy as np
import pytest

from flgpr.proving_ground import find_entry, load_ground, packaged_entries
from flgpr.recipe.fit import check_fit
from flgpr.recipe.make import fit_recipe
from flgpr.recipe.schema import parse_recipe, recipe_text
from flgpr.store import open_run

FIRST = {quick: load_ground(quick, "proving-ground-1") for quick in (False, True)}
SECOND = {quick: load_ground(quick) for quick in (False, True)}
FULLWAVE = load_ground(source="full-wave-1")


@pytest.mark.parametrize(
    "ground", [*FIRST.values(), *SECOND.values(), FULLWAVE], ids=lambda one: one.title
)
def test_every_packaged_entry_is_a_recipe_that_fits_the_array(ground):
    frequency = next(iter(ground.lanes.values())).sensor.tones.axis()
    entries = packaged_entries(ground)
    assert ground.table.reference in entries
    assert len(entries) > 10
    assert set(entries) <= set(packaged_entries(FIRST[False]))
    for name, entry in entries.items():
        recipe = parse_recipe(entry.text, name)
        edges = np.array(list(recipe.image.subbands.values()))
        assert edges.min() >= frequency[0], name
        assert edges.max() <= frequency[-1] + 1, name


def test_fused_enters_the_full_wave_track_fitted_to_its_array():
    run = open_run(FULLWAVE.lanes["arid-lane-1"].stored[0])
    entry = find_entry("fused", FULLWAVE)
    recipe = parse_recipe(entry.text, "fused")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_fit(run, recipe)
    assert (recipe.map.settings.sensor, recipe.map.settings.antennas) == ("run", "full-wave")
    assert recipe.image.y[0] == 1.8  # as it ran, 1.2 antenna heights ahead
    described = FULLWAVE.text.replace("version = 1", "version = 99")
    own = parse_recipe(fit_recipe(run, like="fused"))
    fitted = parse_recipe(find_entry("fused", load_ground(source=described)).text)
    assert fitted == own.model_copy(update={"description": fitted.description})
    assert fitted.image.y[0] == 1.2
    others = {"fuse2018-wang2007", "cosgrove2004", "flsar2004-rvm", "low-rank"}
    assert not others & set(packaged_entries(FULLWAVE))
    assert packaged_entries(FIRST[False])["fused"].text.strip() == recipe_text("fused").strip()


def test_entries_are_found_by_name_recipe_or_folder(tmp_path):
    ground = FIRST[False]
    assert find_entry("wang2007", ground).title.startswith("C_HH")
    own = tmp_path / "mine.toml"
    own.write_text(packaged_entries(ground)["wang2007"].text)
    assert find_entry(own, ground).name == "mine"
    with pytest.raises(ValueError, match="must hold alarm lists"):
        find_entry(tmp_path / "..", ground)
    with pytest.raises(ValueError, match=r"package.Mine; a class .* is named MODULE:CLASS"):
        find_entry("package.Mine", ground)
