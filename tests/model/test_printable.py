from flgpr.model.printable import in_one_line, printable, shortened


def test_text_that_is_printable_stays_as_it_is():
    assert printable("Müller, 3 × 4 m²") == "Müller, 3 × 4 m²"
    assert printable("a\nb\x07") == "a\\nb\\x07"


def test_no_path_ends_a_line_or_hides_text():
    assert printable("a\u202eb\u2028\x7f\udcff") == r"a\u202eb\u2028\x7f\udcff"


def test_an_error_of_several_lines_becomes_one_and_an_empty_one_has_its_name():
    assert in_one_line(ValueError("bad\n  file: 7")) == "bad file: 7"
    assert in_one_line(ValueError("bad\nfile"), 3) == "bad"
    assert in_one_line(KeyError()) == "KeyError"


def test_a_text_is_shown_up_to_a_length():
    assert shortened("abc", 3) == "abc"
    assert shortened("abcd", 3) == "abc..."
