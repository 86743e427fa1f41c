"""A missing library names the extra that installs it."""

import math

import pytest

from flgpr.store import MissingExtraError
from flgpr.store.extras import optional


def test_an_installed_module_is_returned():
    assert optional("math", "gis") is math


def test_a_missing_module_names_its_package_and_extra():
    with pytest.raises(MissingExtraError, match=r"no_such_library is needed .* 'flgpr\[gis\]'"):
        optional("no_such_library.part", "gis")
