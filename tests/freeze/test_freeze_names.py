"""Public names, with parameters, members and values, and settings of files are what they were."""

from importlib import import_module

import pytest

from flgpr.model import Grid
from freeze import names
from freeze.frozen import read_json

FROZEN = read_json(names.TABLE)


@pytest.mark.parametrize("module", FROZEN)
def test_a_module_offers_what_it_offered_under_the_name_that_users_import(module):
    home = import_module(module)
    for name, frozen in FROZEN[module].items():
        assert names.describe(getattr(home, name)) == frozen, name


@pytest.mark.parametrize("module", FROZEN)
def test_a_module_that_lists_what_it_offers_lists_what_is_frozen(module):
    assert names.offered(module) in ([], sorted(FROZEN[module]))


@pytest.mark.parametrize(
    ("annotation", "written"),
    [
        ("xr.Dataset | None", "Dataset | None"),
        ("Mapping[str, flgpr.model.Grid]", "Mapping[str, Grid]"),
        (Grid, "Grid"),
        (Grid | None, "Grid | None"),
        (list[Grid], "list[Grid]"),
    ],
)
def test_types_are_written_without_their_modules(annotation, written):
    assert names.annotation(annotation) == written


@pytest.mark.parametrize("name", ["Recipe", "Scene", "Sensor"])
def test_files_may_set_what_they_could_set(name):
    assert names.settings()[name] == read_json(names.SETTINGS)[name]


def test_packaged_recipes_say_what_they_said():
    assert names.packaged_recipes() == read_json(names.RECIPES)
