"""Words by which arrays are known."""

import pytest

from flgpr.formats.draft_arrays import COMPONENTS, RECEIVER, TRANSMITTER, component_of


def test_a_word_of_a_name_is_a_whole_word():
    assert component_of("pos.Lat_deg")[0] == "latitude"
    assert component_of("platform") is None


def test_the_plainest_word_is_known():
    assert component_of("y_m") == ("y", 0)
    component, rank = component_of("dist")
    assert component == "y"
    assert rank > 0


def test_a_word_is_of_one_component():
    words = [word for words in COMPONENTS.values() for word in words]
    assert len(set(words)) == len(words)


@pytest.mark.parametrize("name", ["translation", "rechtswert", "direction"])
def test_words_that_begin_as_an_antenna_are_none(name):
    assert not TRANSMITTER.search(name)
    assert not RECEIVER.search(name)
