"""TOML is parsed within limits, whatever its text does to hide what it holds."""

import pytest

from flgpr.toml_text import MOST_TOML, InlineTable, parse_toml, toml_lines


def test_text_and_bytes_are_parsed_alike():
    assert parse_toml('a = "1.2" # = 3\n[b.c]\nd = [1, 2]\n') == {
        "a": "1.2",
        "b": {"c": {"d": [1, 2]}},
    }
    assert parse_toml(b"a = 1") == {"a": 1}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("#" * (MOST_TOML + 1), "must have at most 16777216 characters, got 16777217"),
        (".".join("a" * 101) + " = 1", "its keys must have at most 100 parts, got more"),
        ("a = " + "[" * 5000 + "]" * 5000, "nested too deeply"),
        ("a = ", "Invalid value"),
    ],
)
def test_what_takes_too_much_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        parse_toml(text)


def test_dots_in_texts_are_no_parts_of_a_key():
    dots = "." * 200
    assert parse_toml(f'a = "{dots}"') == {"a": dots}


def test_tables_are_written_with_comments_and_read_back():
    tables = {
        "title": 'a "b"',
        "place": {
            "point": InlineTable({"x": 0.5, "no bare key": ["?"]}),
            "rows": [[1.0, 2.0], [3.0, 4.0]],
            "inner": {"name": "c"},
        },
    }
    lines = toml_lines(tables, {"title": "why", "place": "where", "place.rows": "m"})
    assert lines[0] == 'title = "a \\"b\\""  # why'
    assert lines[2] == "[place]  # where"
    assert lines[3] == 'point = {x = 0.5, "no bare key" = ["?"]}'
    assert "\n".join(lines[4:5]) == "rows = [\n    [1.0, 2.0],\n    [3.0, 4.0],\n]  # m"
    assert parse_toml("\n".join(lines)) == tables
