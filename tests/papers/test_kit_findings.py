"""The rules of the verdicts: what samples of known truth are said to be, and how often that is wrong."""

import math
from dataclasses import replace

import numpy as np
import pytest

from flgpr.report import kit
from flgpr_papers.kit.findings import (
    AGREES,
    DISAGREES,
    NO_VERDICT,
    OPEN,
    UNDECIDED,
    VERDICTS,
    Finding,
    Statements,
    by_chance,
    finding_of,
    in_words,
    joint_power,
    judge,
    measured,
    near,
    of_parts,
    over_experiments,
    power,
    read_findings,
    row_of,
    write_findings,
)
from flgpr_papers.kit.intervals import (
    SHARE,
    SHARE_DIFFERENCE,
    clustered,
    effective_looks,
    intracluster,
    paired_shares,
    proportion,
    share_of_looks,
    spread,
    students,
    together,
)

pytestmark = pytest.mark.slow("studies of papers")


def test_no_verdict_without_an_interval():
    for verdict in (AGREES, DISAGREES):
        with pytest.raises(ValueError, match="interval of 'more' must be known"):
            Finding("more", "yes", "no", verdict)
        with pytest.raises(ValueError, match="must be known"):
            Finding("more", "yes", "no", verdict, interval=(0.1, math.nan, math.nan))
    Finding("more", "yes", "no", UNDECIDED)


PAPERS = {
    # figure and number of targets, looks or boxes of every figure that a statement has to be alike
    "cosgrove2004, Pd of the best soil": (0.9, 72),
    "wang2007, all found": (1.0, 47),
    "wang2007, PD_mean of C_HH": (0.93, 47),
    "wang2007, plastic at 0.02": (13 / 20, 20),
    "wang2007, plastic at 0.07": (18 / 20, 20),
    "wang2007, simulants at 0.02": (7 / 16, 16),
    "wang2007, simulants at 0.07": (9 / 16, 16),
    "wang2007, metal on blind lanes": (1.0, 48),
}
MARGIN = 0.15
REPLICATES = 20


def said(ours, figure, count):
    papers = proportion(figure * count, count)
    return judge(proportion(*ours), near(papers, MARGIN, SHARE), figure=papers)


@pytest.mark.parametrize("name", PAPERS)
def test_a_rule_at_the_papers_sample_size_can_say_all_three(name):
    """Our number as the paper's agrees; off by the margin it disagrees; between it cannot be said."""
    figure, count = PAPERS[name]
    least, _ = near(proportion(figure * count, count), MARGIN, SHARE)
    trials = REPLICATES * count

    assert said((figure * trials, trials), figure, count) == AGREES
    assert said((least * trials, trials), figure, count) == UNDECIDED
    assert said(((least - MARGIN) * trials, trials), figure, count) == DISAGREES
    # Lanes of the paper's own size disagree where both samples differ, too.
    small = [said((k, count), figure, count) for k in range(count + 1)]
    assert {UNDECIDED, DISAGREES} <= set(small)


def test_a_single_miss_is_no_disagreement_with_all_found():
    assert said((47, 48), 1.0, 48) == AGREES
    assert said((33, 48), 1.0, 48) == DISAGREES
    assert said((8, 10), 1.0, 10) == UNDECIDED
    assert said((2, 16), 9 / 16, 16) == DISAGREES


@pytest.mark.parametrize(("figure", "spread"), [(26.5, 5.0), (5.03, 7.8)])
def test_a_figure_of_one_frame_can_be_met_and_missed(figure, spread):
    papers = figure, figure - spread, figure + spread
    rule = near(papers, 6.0)
    for centre, verdict in (
        (figure, AGREES),
        (rule[1], UNDECIDED),
        (rule[1] + 2, DISAGREES),
    ):
        assert judge((centre, centre - 1, centre + 1), rule, figure=papers) == verdict


@pytest.mark.parametrize(
    ("rule", "worth", "intervals"),
    [
        ((0.0, math.inf), 0.05, ((0.01, 0.2), (-0.02, 0.2), (-0.03, 0.03))),
        ((-0.05, math.inf), 0.0, ((-0.01, 0.02), (-0.06, 0.1), (-0.2, -0.06))),
        ((-0.1, 0.1), 0.0, ((-0.05, 0.09), (0.05, 0.2), (0.11, 0.2))),
    ],
)
def test_a_rule_agrees_leaves_open_and_disagrees(rule, worth, intervals):
    numbers = [((low + high) / 2, low, high) for low, high in intervals]
    assert [judge(number, rule, worth) for number in numbers] == [
        AGREES,
        UNDECIDED,
        DISAGREES,
    ]


def test_a_share_of_samples_alike_rarely_disagrees_and_one_off_rarely_agrees():
    rng = np.random.default_rng(0)
    for figure, count in PAPERS.values():
        ours = rng.binomial(REPLICATES * count, figure, 500)
        papers = rng.binomial(count, figure, 500)
        verdicts = [
            said((k, REPLICATES * count), m / count, count)
            for k, m in zip(ours, papers, strict=True)
        ]
        assert verdicts.count(DISAGREES) / 500 < 0.06
        assert verdicts.count(AGREES) / 500 > 0.5


def test_power_is_how_often_the_rule_answers():
    rng = np.random.default_rng(1)
    rule, error = (-0.1, 0.1), 0.03
    half = 1.96 * error
    agrees, disagrees = power((0.02, 0.02 - half, 0.02 + half), rule)
    held, off = [
        [judge((x, x - half, x + half), rule) for x in rng.normal(mean, error, 4000)]
        for mean in (0.0, 0.2)
    ]
    assert agrees == pytest.approx(held.count(AGREES) / 4000, abs=0.02)
    assert disagrees == pytest.approx(off.count(DISAGREES) / 4000, abs=0.02)
    # A rule that cannot agree says so.
    assert power((0.0, -0.2, 0.2), rule)[0] == 0
    larger_agrees, larger_disagrees = power((0.3, 0.3 - half, 0.3 + half), (0.0, math.inf), 0.05)
    assert larger_agrees == pytest.approx(0.91, abs=0.01)  # a gain of 0.10
    assert larger_disagrees == pytest.approx(0.38, abs=0.01)  # none
    assert joint_power([(0.9, 0.8), (0.5, 0.7)]) == (0.45, 0.7)


def test_choices_of_a_repeated_experiment_have_to_come_to_one_verdict():
    def found(first, second):
        intervals = {"offset": (first, -1.0, 1.0), "no-bias": (second, -1.0, 1.0)}
        return Statements("flsar2004").by_every("novelty", intervals, kind="metal")

    apart = over_experiments([found(0.30, 0.30), found(0.31, 0.10), found(0.32, -0.10)])
    assert apart.verdict == UNDECIDED
    first, second = apart.ours.split("; ")
    assert first.startswith("offset: 0.31")
    assert first.endswith(" disagrees")
    assert second.startswith("no-bias: 0.1")
    assert second.endswith(" cannot say")
    alike = over_experiments([found(0.30, 0.31), found(0.31, 0.32), found(0.32, 0.30)])
    assert alike.verdict == DISAGREES
    assert "disagrees" not in alike.ours


def test_repeats_of_an_experiment_are_judged_together_and_counted_one_by_one():
    values = [0.02, 0.12, -0.03, 0.09, 0.07, 0.05]
    one = Finding(
        "more", "", "", UNDECIDED, interval=(0.02, -1.0, 1.0), rule=(0.0, math.inf), worth=0.05
    )
    repeated = over_experiments([replace(one, interval=(v, -1.0, 1.0)) for v in values])
    assert repeated.shown == (5, 6)
    assert repeated.interval == students(values)
    assert repeated.verdict == UNDECIDED
    two = [replace(one, parts=(v + 0.2, v - 0.3), names=("A - B", "A - C")) for v in values]
    assert over_experiments(two).verdict == DISAGREES
    assert over_experiments(two).ours.startswith("A - B +0.25 (")
    assert over_experiments(two).shown == (0, 6)
    equal = [replace(one, parts=(0.0, v), names=("A", "B")) for v in values]
    assert over_experiments(equal).ours.startswith("A +0.00 (no interval); B +0.05 (")


def test_a_difference_that_is_exactly_nothing_in_twelve_experiments_is_nothing():
    within = Finding("little", "", "", UNDECIDED, interval=(0.0, -1.0, 1.0), rule=(-0.05, 0.05))
    some = [0.001 * (k % 3 - 1) for k in range(12)]
    found = [replace(within, parts=(0.0, v), names=("A", "B")) for v in some]
    together_ = over_experiments(found)
    assert together_.ours.startswith("A 0 in every one; B +0.0000 (")
    assert together_.verdict == AGREES
    assert together_.power == pytest.approx((1.0, 1.0))
    assert over_experiments(found[1:]).verdict == UNDECIDED
    equal = [replace(within, parts=(0.01, v), names=("A", "B")) for v in some]
    assert over_experiments(equal).verdict == UNDECIDED  # as large in each, but not nothing


def test_looks_of_a_seed_count_by_their_design_effect():
    every = np.ones((12, 72))
    one_missed = every.copy()
    one_missed[0, 0] = 0
    assert share_of_looks(every)[1] == pytest.approx(0.957, abs=0.001)
    assert share_of_looks(0 * every)[2] == pytest.approx(0.043, abs=0.001)
    # A miss more or less changes little: no interval of nothing missed is wider than of one missed.
    gap = np.subtract(share_of_looks(every)[1:], share_of_looks(one_missed)[1:])
    assert np.abs(gap).max() < 0.01
    # Seeds that find all or nothing are a look each.
    halves = np.repeat([[1.0], [0.0]], [6, 6], axis=0) * every
    assert intracluster(halves) == 1
    assert effective_looks(halves) == pytest.approx(12 * (1.96 / 2.201) ** 2, rel=0.001)
    assert paired_shares(every, every)[1:] == pytest.approx((-0.043, 0.043), abs=0.001)
    assert paired_shares(every, 0 * every)[1] > 0.9
    with pytest.raises(ValueError, match="must have at least two clusters, got 1"):
        share_of_looks(every[:1])


@pytest.mark.slow("repeats a draw until its statistics stand")
@pytest.mark.parametrize(("correlation", "least"), [(0.02, 0.95), (0.1, 0.94), (0.3, 0.9)])
def test_shares_of_looks_hold_the_truth(correlation, least):
    """Also close to all, where the spread of the seeds says nothing."""
    rng = np.random.default_rng(3)
    for share in (0.5, 0.9, 0.99, 0.999):
        both = share * (1 / correlation - 1), (1 - share) * (1 / correlation - 1)
        held = 0
        for _ in range(600):
            found = rng.random((12, 36)) < rng.beta(*both, (12, 1))
            _, low, high = share_of_looks(found)
            held += low <= share <= high
        assert held / 600 > least


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
        wrong += of_parts("all above", "", parts, (0.0, math.inf)).verdict == DISAGREES
    assert wrong / 1000 < 0.05


def test_looks_at_one_mine_are_one():
    rng = np.random.default_rng(2)
    level = rng.normal(0, 1, 30)
    looks = np.repeat(level, 10) + rng.normal(0, 0.1, 300)
    value, low, high = clustered(looks, np.repeat(np.arange(30), 10), 2000)
    _, narrow_low, narrow_high = clustered(looks, np.arange(300), 2000)
    assert high - low > 2.5 * (narrow_high - narrow_low)
    assert judge((value, low, high), (0.0, math.inf)) == UNDECIDED


def test_what_chance_gives_is_said_of_the_statements_that_are_judged():
    made = [Finding(f"s{i}", "", "", AGREES, interval=(1.0, 0.5, 1.5)) for i in range(29)]
    assert by_chance([*made, Finding("q", "", "", OPEN)]) == (29, pytest.approx(1.45), 4)
    assert by_chance([]) == (0, 0.0, 0)


def test_no_share_lies_beyond_nought_and_one():
    draws = [0.9, 1.0, 0.7, 1.0, 0.6]
    assert spread(0.95, draws)[2] > 1
    assert spread(0.95, draws, bounds=SHARE)[2] == 1
    pd = measured("Pd", "0.9 (Fig. 7)", "at 0.01 per m²", spread(0.05, draws), bounds=SHARE)
    assert pd.interval[1] == 0
    assert pd.ours.startswith("0.05 (0.00 to ")
    one_sample = measured("Pd", "", "", (0.2, -math.inf, math.inf), bounds=SHARE)
    assert one_sample.ours == "0.2 (one sample, no interval)"
    with pytest.raises(ValueError, match="interval of 'Pd' must lie in 0 to 1"):
        Finding("Pd", "", "", OPEN, interval=(0.5, -0.1, 0.9), bounds=SHARE)
    gap = of_parts(
        "all above", "", {"a": (0.5, -1.4, 2.0)}, (0.0, math.inf), bounds=SHARE_DIFFERENCE
    )
    assert gap.interval == (0.5, -1.0, 1.0)


def test_a_verdict_is_the_one_that_the_stated_rule_gives():
    wide = (27.5, 21.5, 33.5)  # dB
    with pytest.raises(ValueError, match="must be 'cannot say' by its rule"):
        Finding("26.5 dB", "26.5 dB", "", AGREES, interval=wide, rule=(20.5, 32.5), unit="dB")
    alike = Finding("26.5 dB", "26.5 dB", "", AGREES, interval=wide, rule=(19.5, 33.5), unit="dB")
    assert alike.criterion == "19.5 to 33.5 dB"
    more = Finding("more", "", "", AGREES, interval=wide, rule=(-6.0, math.inf), worth=0.5)
    assert more.criterion == "above -6, worth 0.5"
    assert measured("a", "b", "c", (0.1, 0.06, 0.2), (-0.05, 0.05)).criterion == "-0.05 to 0.05"
    assert Finding("?", "", "", OPEN).criterion == ""


def test_a_quick_run_has_numbers_and_no_verdicts(tmp_path):
    found = [
        Finding("more", "yes", "1.0 (0.5 to 1.5)", AGREES, interval=(1.0, 0.5, 1.5)),
        Finding("asked by us", "not tried", "2", OPEN),
        Finding("far", "", "", UNDECIDED, interval=(0.1, 0, 1), rule=(0.0, math.inf), shown=(1, 2)),
    ]
    write_findings(tmp_path, found, quick=True)
    quick = read_findings(tmp_path)
    assert [one.verdict for one in quick] == [NO_VERDICT, OPEN, NO_VERDICT]
    assert quick[0].interval == found[0].interval
    assert quick[2] == replace(found[2], verdict=NO_VERDICT)
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


def test_findings_of_the_earlier_rules_can_be_read():
    row = row_of(Finding("more", "", "", AGREES, interval=(1.0, 0.5, 1.5)))
    assert finding_of(row | {"asks": ["larger", 0.0, 0.0]}).verdict == AGREES
    old = {name: row[name] for name in ("claim", "paper", "ours", "verdict", "interval")}
    assert finding_of(old) == finding_of(row)
