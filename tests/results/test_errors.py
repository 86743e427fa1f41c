"""The error of a result folder that cannot be used."""

import pytest

from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result
from small_results import small_result


def test_it_is_a_value_error_that_names_the_folder(tmp_path):
    assert issubclass(ResultError, ValueError)
    with pytest.raises(ResultError, match="empty"):
        read_result(tmp_path / "empty")


def test_an_altered_file_raises_it(tmp_path):
    folder = small_result(tmp_path / "result")
    recipe = folder / "recipe.toml"
    recipe.write_text(recipe.read_text() + "# altered\n")
    with pytest.raises(ResultError, match=r"recipe\.toml"):
        read_result(folder).recipe
