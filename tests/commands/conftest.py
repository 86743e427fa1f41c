"""Fixtures of the tests of commands."""

import pytest

from io_geodesy import anchor_text


@pytest.fixture(scope="session")
def anchor(tmp_path_factory):
    """Path of an anchor (TOML) whose points were surveyed by geodesics."""
    path = tmp_path_factory.mktemp("anchor") / "anchor.toml"
    path.write_text(anchor_text())
    return path
