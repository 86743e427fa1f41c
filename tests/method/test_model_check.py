"""What the check of a model says, and the file that it is kept in."""

import pytest

from flgpr.method.model_check import CHECK_FILE, Check, check_sentences, write_check


def check(found, by_contrast, only_recipe, only_contrast, p):
    return Check(4, 24, 0.1, found, by_contrast, only_recipe, only_contrast, p)


@pytest.mark.parametrize(
    ("result", "advice"),
    [
        (check(20, 14, 7, 1, 0.07), None),
        (check(14, 14, 2, 2, 1.0), None),
        (check(12, 15, 1, 4, 0.38), "the contrast finds more, but chance gives such a difference"),
        (check(6, 18, 0, 12, 0.0005), "the contrast finds more than chance explains: do not use this model"),
    ],
    ids=["better", "level", "below by chance", "below"],
)  # fmt: skip
def test_it_says_what_was_found_and_advises_where_it_is_below(result, advice, tmp_path):
    assert check_sentences(tmp_path) == []
    write_check(tmp_path, result)
    first, *rest = check_sentences(tmp_path)
    assert first.startswith(
        f"on 4 simulated lanes of your array this recipe finds {result.found} of 24 mines, "
        f"the contrast {result.by_contrast} of 24, at 0.1 false alarms per m²"
    )
    assert len(rest) == (advice is not None)
    if advice:
        assert rest[0].startswith(advice)


def test_the_reason_why_there_was_none_is_kept(tmp_path):
    write_check(tmp_path, "run.frequency must lie on an even raster\x1b")
    assert check_sentences(tmp_path) == [
        "not checked on simulated lanes: run.frequency must lie on an even raster\\x1b"
    ]


@pytest.mark.parametrize("text", ["", "[1]", '{"mines": 3}', '"text"', '{"p": 1, "else": 2}'])
def test_a_file_of_something_else_is_refused(text, tmp_path):
    (tmp_path / CHECK_FILE).write_text(text)
    with pytest.raises(ValueError, match=r"check\.json must be what `flgpr.train` wrote"):
        check_sentences(tmp_path)


def test_a_file_that_makes_words_of_numbers_is_refused(tmp_path):
    write_check(tmp_path, check(20, 14, 7, 1, 0.07))
    file = tmp_path / CHECK_FILE
    file.write_text(file.read_text().replace("20", '"20\\u001b[2J"'))
    with pytest.raises(ValueError, match=r"must be what `flgpr.train` wrote"):
        check_sentences(tmp_path)
