"""JSON text: its limits, its canonical form, and the digest that it carries."""

import math

import pytest

from flgpr.json_text import (
    MOST_NESTING,
    canonical_json,
    check_format,
    count_values,
    json_with_digest,
    parse_json,
    parse_with_digest,
    sha256,
)


def test_equal_values_have_one_canonical_form():
    assert canonical_json({"b": 1, "a": [1.5, None]}) == b'{"a":[1.5,null],"b":1}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        canonical_json({"a": math.nan})


def test_at_least_as_many_values_are_counted_as_there_are():
    assert count_values('{"a": [1, 2], "b": {}}') >= 4
    assert count_values(b"[1]") >= 1


def test_nesting_is_bounded():
    assert parse_json("[" * MOST_NESTING + "]" * MOST_NESTING)
    with pytest.raises(ValueError, match="nested at most 100 deep"):
        parse_json("[" * (MOST_NESTING + 2) + "]" * (MOST_NESTING + 2))


def test_a_digest_is_that_of_the_rest_and_any_change_shows():
    data = json_with_digest({"a": 1, "b": "x"})
    parsed = parse_with_digest(data)
    assert parsed["sha256"] == sha256(canonical_json({"a": 1, "b": "x"}))
    with pytest.raises(ValueError, match="differs from what was written"):
        parse_with_digest(data.replace(b'"x"', b'"y"'))
    with pytest.raises(ValueError, match="differs from what was written"):
        parse_with_digest(data + b"\n")


def test_another_format_or_version_is_refused():
    check_format({"format": "flgpr-x", "version": 1}, "flgpr-x", 1)
    for content in ({}, {"format": "flgpr-x", "version": 2}, {"format": "flgpr-y", "version": 1}):
        with pytest.raises(ValueError, match="format must be flgpr-x version 1"):
            check_format(content, "flgpr-x", 1)
