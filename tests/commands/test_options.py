"""Options that several commands have: sizes, sequences, and runs that are taken together."""

from pathlib import Path

import pytest

from flgpr.commands.options import one_or_more, runs_by_name, size_in_bytes


def test_one_value_is_a_list_of_one():
    assert one_or_more(None) == []
    assert one_or_more("a.zarr") == ["a.zarr"]
    assert one_or_more(Path("a.zarr")) == [Path("a.zarr")]
    assert one_or_more(("a", "b")) == ["a", "b"]


def test_sizes_are_bytes():
    assert size_in_bytes("2GB") == 2_000_000_000
    assert size_in_bytes(17) == 17


def test_runs_of_a_name_belong_to_the_runs_in_turn():
    by_run = runs_by_name(["low=a.zarr", "high=b.zarr", "low=c.zarr", "high=d.zarr"], 2)
    assert by_run == [
        {"low": Path("a.zarr"), "high": Path("b.zarr")},
        {"low": Path("c.zarr"), "high": Path("d.zarr")},
    ]


def test_mappings_are_of_one_run_or_one_for_each():
    assert runs_by_name((), 2) == [{}, {}]
    assert runs_by_name({"low": "a"}, 1) == [{"low": "a"}]
    assert runs_by_name([{"low": "a"}, {"low": "b"}], 2) == [{"low": "a"}, {"low": "b"}]


@pytest.mark.parametrize("text", ["a.zarr", "=a.zarr", "low="])
def test_a_text_without_name_and_run_is_refused(text):
    with pytest.raises(ValueError, match=f"with must be NAME=RUN, got '{text}'"):
        runs_by_name([text], 1)


def test_a_name_that_is_not_there_for_each_run_is_refused():
    with pytest.raises(ValueError, match="with must give low once per run, got 1 for 2 runs"):
        runs_by_name(["low=a.zarr"], 2)
