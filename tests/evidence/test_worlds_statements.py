"""Statements judged over the worlds of a map."""

import math

import numpy as np
import pytest
from scipy.stats import t as student

import flgpr_papers
from flgpr_papers.kit.findings import AGREES, DISAGREES, UNDECIDED, Finding
from worlds import statements
from worlds.space import worlds
from worlds.statements import judge_again
from worlds.studies import FINDINGS_IN

pytestmark = pytest.mark.slow("studies of papers")


def larger(*values, rule=(0.0, math.inf), claim="A beats B"):
    parts = values if len(values) > 1 else ()
    return Finding(
        claim, "", "", UNDECIDED, interval=(min(values), -9.0, 9.0), rule=rule, parts=parts
    )


def test_another_interval_is_judged_by_what_the_claim_asks():
    assert judge_again(larger(0.0), (0.2, 0.1, 0.3)) == AGREES
    assert judge_again(larger(0.0, rule=(0.15, math.inf)), (0.2, 0.1, 0.3)) == UNDECIDED
    within = Finding("", "", "", UNDECIDED, rule=(0.0, 0.5), interval=(0.1, 0.0, 0.2))
    assert judge_again(within, (0.7, 0.6, 0.8)) == DISAGREES


def test_a_region_is_judged_by_the_mean_over_its_worlds():
    values = np.random.default_rng(1).normal(0.3, 0.1, 12)
    count, (mean, low, high), verdict = statements.pooled([larger(value) for value in values], 13)
    half = student.ppf(1 - 0.025 / 13, 11) * values.std(ddof=1) / math.sqrt(12)
    assert (count, verdict) == (12, AGREES)
    assert (mean, low, high) == pytest.approx(
        (values.mean(), values.mean() - half, values.mean() + half)
    )
    two = [larger(value, -value) for value in values]
    assert statements.pooled(two, 13)[2] == DISAGREES  # one part of the claim is on the wrong side
    assert statements.pooled(two[: statements.FEWEST - 1], 13)[2] == UNDECIDED
    assert statements.pooled([*two, larger(math.nan, 0.1)], 13)[0] == 12


def test_regions_disagree_by_chance_as_rarely_as_they_should():
    rng = np.random.default_rng(2)
    wrong = 0
    for _ in range(300):
        regions = [[larger(value) for value in rng.normal(0, 1, 18)] for _ in range(13)]
        wrong += any(statements.pooled(region, 13)[2] != UNDECIDED for region in regions)
    assert wrong <= 27  # 5 % of 300 and three standard errors


def test_every_paper_is_asked_in_every_world_and_two_sites_once():
    asked = statements.studies()
    assert len(asked) == len(set(asked)) == 3 * 48 + sum(world.loss == "low" for world in worlds())
    assert {world.loss for paper, world in asked if paper == statements.TWO_SITES} == {"low"}
    assert {paper for paper, _ in asked} == set(flgpr_papers.PAPERS) == set(FINDINGS_IN)
