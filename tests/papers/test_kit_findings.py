"""The rules of the verdicts: what samples of known truth are said to be, and how often that is wrong."""

import math

import numpy as np
import pytest

from flgpr.report import kit
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    NO_VERDICT,
    OPEN,
    SHARE,
    SHARE_DIFFERENCE,
    UNDECIDED,
    VERDICTS,
    Finding,
    alike,
    by_chance,
    clustered,
    difference_of_shares,
    in_words,
    larger,
    less_figure,
    measured,
    parts_larger,
    read_findings,
    share_error,
    spread,
    together,
    without_paper,
    write_findings,
)

pytestmark = pytest.mark.slow("studies of papers")


def test_no_verdict_without_an_interval():
    for verdict in (AGREES, DISAGREES):
        with pytest.raises(ValueError, match="interval of 'more' must be known"):
            Finding("more", "yes", "no", verdict)
        with pytest.raises(ValueError, match="must be known"):
            Finding("more", "yes", "no", verdict, interval=(0.1, math.nan, math.nan))
    Finding("more", "yes", "no", UNDECIDED)


def test_a_single_miss_is_no_disagreement_with_all_found():
    gap = difference_of_shares((47, 48), (48, 48))
    assert alike(*gap[1:]) == AGREES
    assert alike(*difference_of_shares((33, 48), (48, 48))[1:]) == DISAGREES
    assert alike(*difference_of_shares((8, 10), (10, 10))[1:]) == UNDECIDED


def test_two_samples_of_one_share_rarely_disagree():
    rng = np.random.default_rng(0)
    for share, n, m in ((0.7, 47, 47), (0.95, 48, 20), (0.45, 16, 16)):
        pairs = zip(rng.binomial(n, share, 2000), rng.binomial(m, share, 2000), strict=True)
        wrong = np.mean(
            [alike(*difference_of_shares((a, n), (b, m))[1:]) == DISAGREES for a, b in pairs]
        )
        assert wrong < 0.065


def test_the_error_of_a_figure_widens_the_interval_of_the_difference():
    exact = less_figure((0.8, 0.7, 0.9), 0.93, 0.0)
    rough = less_figure((0.8, 0.7, 0.9), 0.93, 0.045)
    assert exact == pytest.approx((-0.13, -0.23, -0.03))
    assert rough[1] < exact[1]
    assert rough[2] > 0 > exact[2]  # the paper's own error takes the disagreement away
    assert share_error(1.0, 48) == pytest.approx(share_error(1 - 0.5 / 48, 48))


@pytest.mark.slow("repeats a draw until its statistics stand")
def test_parts_that_hold_together_disagree_no_more_often_than_one():
    rng = np.random.default_rng(1)
    wrong = 0
    for _ in range(1000):
        parts = {}
        for name in "abc":
            sample = rng.normal(0.0, 1.0, 40)
            parts[name] = spread(
                sample.mean(),
                [sample[rng.integers(0, 40, 40)].mean() for _ in range(50)],
                together(3),
            )
        wrong += parts_larger("all above", "", parts).verdict == DISAGREES
    assert wrong / 1000 < 0.05


def test_looks_at_one_mine_are_one():
    rng = np.random.default_rng(2)
    level = rng.normal(0, 1, 30)
    looks = np.repeat(level, 10) + rng.normal(0, 0.1, 300)
    _, low, high = clustered(looks, np.repeat(np.arange(30), 10), 2000)
    _, narrow_low, narrow_high = clustered(looks, np.arange(300), 2000)
    assert high - low > 2.5 * (narrow_high - narrow_low)
    assert larger(low, high) != larger(5.0, 6.0)


def test_what_chance_gives_is_said_of_the_statements_that_are_judged():
    made = [Finding(f"s{i}", "", "", AGREES, interval=(1.0, 0.5, 1.5)) for i in range(29)]
    assert by_chance([*made, Finding("q", "", "", OPEN)]) == (29, pytest.approx(1.45), 4)
    assert by_chance([]) == (0, 0.0, 0)


def test_no_share_lies_beyond_nought_and_one():
    draws = [0.9, 1.0, 0.7, 1.0, 0.6]
    assert spread(0.95, draws)[2] > 1
    assert spread(0.95, draws, bounds=SHARE)[2] == 1
    assert less_figure((0.95, 0.5, 1.0), 0.02, 0.2, SHARE_DIFFERENCE)[2] == 1
    pd = measured("Pd", "0.9 (Fig. 7)", "at 0.01 per m²", spread(0.05, draws), bounds=SHARE)
    assert pd.interval[1] == 0
    assert pd.ours.startswith("0.05 (0.00 to ")
    one_sample = measured("Pd", "", "", (0.2, -math.inf, math.inf), bounds=SHARE)
    assert one_sample.ours == "0.2 (one sample, no interval)"
    with pytest.raises(ValueError, match="interval of 'Pd' must lie in 0 to 1"):
        Finding("Pd", "", "", OPEN, interval=(0.5, -0.1, 0.9), bounds=SHARE)
    gap = parts_larger("all above", "", {"a": (0.5, -1.4, 2.0)}, bounds=SHARE_DIFFERENCE)
    assert gap.interval == (0.5, -1.0, 1.0)


def test_a_verdict_is_the_one_that_the_stated_margin_gives():
    wide = (1.0, -5.0, 7.0)  # dB
    with pytest.raises(ValueError, match="must be 'cannot say' by its rule"):
        Finding(
            "26.5 dB", "26.5 dB", "", AGREES, interval=wide, asks=("alike", 6.0, 0.0), unit="dB"
        )
    alike_within = Finding(
        "26.5 dB", "26.5 dB", "", AGREES, interval=wide, asks=("alike", 7.0, 0.0), unit="dB"
    )
    assert alike_within.criterion == "within 7 dB of the paper's"
    assert (
        Finding("more", "", "", AGREES, interval=wide, asks=("larger", -6.0, 0.0)).criterion
        == "above -6"
    )
    assert measured("a", "b", "c", (0.1, 0.06, 0.2), (-0.05, 0.05)).criterion == "-0.05 to 0.05"
    assert Finding("?", "", "", OPEN).criterion == ""


def test_a_quick_run_has_numbers_and_no_verdicts(tmp_path):
    found = [
        Finding("more", "yes", "1.0 (0.5 to 1.5)", AGREES, interval=(1.0, 0.5, 1.5)),
        Finding("asked by us", "not tried", "2", OPEN),
    ]
    write_findings(tmp_path, found, quick=True)
    quick = read_findings(tmp_path)
    assert [one.verdict for one in quick] == [NO_VERDICT, OPEN]
    assert quick[0].interval == found[0].interval
    macro = '{% import "study.html" as study with context %}{% call study.findings(found, (1, 0.05, 1)) %}{% endcall %}'
    environment = kit._environment("flgpr_papers")
    for is_quick in (True, False):
        text = environment.from_string(macro).render(
            found=found,
            quick=is_quick,
            verdicts=VERDICTS,
            no_verdict=NO_VERDICT,
            open_question=OPEN,
        )
        assert (f"<b>{NO_VERDICT}</b>" in text, "<b>agrees</b>" in text) == (is_quick, not is_quick)
        assert "<b>open</b>" in text
        assert ("1 agrees" in text, "by chance" in text) == (not is_quick, not is_quick)


def test_claims_that_do_not_say_what_the_paper_has_are_listed():
    assert without_paper([Finding("a", "0.9", "", OPEN), Finding("b", " ", "", OPEN)]) == ["b"]


@pytest.mark.parametrize(
    ("interval", "text"),
    [
        (
            (0.0140002, 0.0140001, 0.0140003),
            "0.0140 (0.0140 to 0.0140)",
        ),  # no more than four decimals
        ((26.51234, 26.5, 26.52), "26.5 (26.5 to 26.5)"),  # no more than three digits
        ((23456.7, 23456.6, 23456.8), "23457 (23457 to 23457)"),
        ((-1e-9, -0.1, 0.1), "0.00 (-0.10 to 0.10)"),
        ((0.0, 0.0, 0.0), "0.000 (0.000 to 0.000)"),
        ((12.0, 3.0, 21.0), "12 (3 to 21)"),
    ],
)
def test_pages_have_no_more_digits_than_mean_something(interval, text):
    assert in_words(*interval) == text
