from flgpr.model.printable import printable


def test_text_that_is_printable_stays_as_it_is():
    assert printable("Müller, 3 × 4 m²") == "Müller, 3 × 4 m²"
    assert printable("a\nb\x07") == "a\\nb\\x07"


def test_no_path_ends_a_line_or_hides_text():
    assert printable("a\u202eb\u2028\x7f\udcff") == r"a\u202eb\u2028\x7f\udcff"
