"""Public names, with parameters, members and values, and settings of files are what they were."""

import pytest

from freeze import names
from freeze.frozen import read_json


@pytest.fixture(scope="module")
def table():
    return names.name_table()


@pytest.mark.parametrize("module", names.public_modules())
def test_a_package_offers_what_it_offered(module, table):
    frozen = read_json(names.TABLE)[module]
    assert sorted(table[module]) == sorted(frozen)
    for name, described in table[module].items():
        assert described == frozen[name], name


def test_these_are_the_packages(table):
    assert sorted(table) == sorted(read_json(names.TABLE))


@pytest.mark.parametrize("name", ["Recipe", "Scene", "Sensor"])
def test_files_may_set_what_they_could_set(name):
    assert names.settings()[name] == read_json(names.SETTINGS)[name]


def test_packaged_recipes_say_what_they_said():
    assert names.packaged_recipes() == read_json(names.RECIPES)
