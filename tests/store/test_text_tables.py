"""Text tables of numbers: separators, decimal commas, complex numbers, headers and blocks."""

import numpy as np
import pytest

from flgpr.store.text_tables import read_text_table


@pytest.fixture
def read(tmp_path):
    def read_text(text, notes=None):
        path = tmp_path / "a.txt"
        path.write_text(text)
        return read_text_table(path, notes)

    return read_text


@pytest.mark.parametrize(
    "text", ["1.5 2\n3 4\n", "1.5,2\n3,4\n", "1,5;2\n3;4\n", "1.5\t2\n# three\n3\t4\n"]
)
def test_a_table_is_read_whatever_separates_its_columns(read, text):
    arrays = read(text)
    assert list(arrays) == ["table"]
    np.testing.assert_array_equal(arrays["table"], [[1.5, 2], [3, 4]])


def test_complex_numbers_and_missing_ones(read):
    table = read("1+2i, nan\n-0.5j, 1e-3\n")["table"]
    np.testing.assert_array_equal(table[:, 0], [1 + 2j, -0.5j])
    assert np.isnan(table[0, 1])
    assert table[1, 1] == 1e-3


def test_a_header_names_the_columns_and_text_is_left_out(read):
    notes = []
    arrays = read("f;name;s\n1;a;1,5\n2;7;2,5\n", notes)
    assert list(arrays) == ["f", "s"]
    np.testing.assert_array_equal(arrays["s"], [1.5, 2.5])
    assert notes == [
        "commas in numbers, such as 1,5, are read as decimal commas",
        "column 'name' is not read: 1 of its 2 cells are no numbers",
    ]


def test_blocks_have_names(read):
    notes = []
    arrays = read("left over\nBEGIN CH1\n1,2\nEND\nBEGIN CH1\n3,4\nEND\n", notes)
    assert {name: array.tolist() for name, array in arrays.items()} == {
        "CH1/table": [[1, 2]],
        "CH1 2/table": [[3, 4]],
    }
    assert notes == ["1 lines outside BEGIN and END are not read"]


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("", "there is no line with values"),
        ("a,b\n", "there is a header and no line with values"),
        ("a,a\n1,2\n", "the header must name different columns, got a, a"),
        ("1,2\n3\n", "line 2 must have 2 cells like the first, got 1"),
        ("1,2\n3,x\n", "line 2 must hold numbers, got 'x'"),
        ("a,b\nx,y\n", "no column holds numbers"),
        ("1,5 2,5\n", "line 1 has blanks between numbers with commas"),
        (
            "1,5;2\n1.5;2\n",
            "line 1 must not have decimal commas beside the decimal points of line 2",
        ),
        ("1\x002\n", "it holds zero bytes"),
    ],
)
def test_what_could_be_read_otherwise_is_refused(read, text, rule):
    with pytest.raises(ValueError, match=rule):
        read(text)


def test_comments_in_quotes_are_comments(read):
    text = '"! a program"\n"! 3 January"\n"!"\n"Frequency","S21:Re","S21:Im"\n1e9,1,2\n2e9,3,4\n'
    np.testing.assert_array_equal(read(text)["S21:Im"], [2, 4])
    np.testing.assert_array_equal(read('"# of scans","x"\n1,2\n')["# of scans"], [1])
