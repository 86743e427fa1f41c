"""Lanes that the tests of whole systems share."""

from pathlib import Path

import pytest

from systems.lanes import make_lanes


@pytest.fixture(scope="session")
def lanes(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("lanes")
    make_lanes(folder)
    return folder
