"""The verdict is a sentence whose every part follows from counts."""

import pytest

from flgpr_trials.verdict import holm
from judged import judged


def test_two_vendors_that_are_not_told_apart():
    assert judged({"ACME": 24, "Globex": 21}).in_words() == (
        "At the registered 0.05 per m²: ACME 24 of 31, Globex 21 of 31, not told apart (p = 0.25); "
        "neither shows Pd >= 0.9 with 95 % confidence."
    )


@pytest.mark.parametrize(
    ("found", "count", "words"),
    [
        ({"A": 31}, 31, "A 31 of 31; it shows Pd >= 0.9"),
        ({"A": 30}, 31, "A 30 of 31; it does not show Pd >= 0.9"),
        ({"A": 31, "B": 10}, 31, "told apart (p = 9.5e-07); A alone shows Pd"),
        ({"A": 31, "B": 31}, 31, "not told apart (p = 1); both show Pd"),
        ({"A": 20, "B": 20}, 20, "none could, for that takes 29 mines without a miss."),
        (
            {"A": 31, "B": 31, "C": 15},
            31,
            "told apart (Holm, 3 pairs): A from C (p = 9.2e-05), B from C (p = 9.2e-05); "
            "A and B show Pd",
        ),
        (
            {"A": 9, "B": 8, "C": 7},
            31,
            "no two told apart (least p = 1, Holm, 3 pairs); none shows",
        ),
    ],
)
def test_every_part_of_the_sentence(found, count, words):
    assert words in judged(found, count).in_words()


def test_the_bound_is_that_of_the_plan():
    points = judged({"A": 29, "B": 28}, 29).points
    # Clopper and Pearson: 0.05^(1/29) with all found
    assert points["at_least"].iloc[0] == pytest.approx(0.05 ** (1 / 29))
    assert points["shows"].tolist() == [True, False]


def test_holm_takes_the_largest_so_far():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.5, 0.9]) == [1.0, 1.0]


def test_a_truth_without_mines_has_no_verdict():
    with pytest.raises(ValueError, match="at least one target"):
        judged({"A": 0}, 0)
