"""What explains alarms: the looks of the nearest scans, gathered in any division."""

import numpy as np
import pandas as pd
import pytest

from divided import SCANS, with_results
from flgpr.method import evidence as evidence_module
from flgpr.method.evidence import (
    MOST_SCANS,
    Evidence,
    EvidenceSums,
    confidence_contributions,
    in_order,
)


def sums(lane, **options):
    contrast = lane.recipe.contrast
    y_max = lane.recipe.run_view.y_max
    alarms = lane.alarms().iloc[:5]
    return EvidenceSums(alarms, contrast.patch(), y_max, lane.setup.run, **options)


def gathered(lane, scans, **options):
    evidence = sums(lane, **options)
    for index in scans:
        evidence.add(lane.coherent(index))
    return evidence


@pytest.fixture(scope="module")
def lane():
    return with_results()


@pytest.fixture(scope="module")
def one_block(lane):
    return gathered(lane, range(SCANS)).result()


def test_looks_are_those_of_the_nearest_scans(lane, one_block):
    assert len(one_block.scans) == 5
    for looks in one_block.scans:
        assert 1 <= len(looks) <= MOST_SCANS
        distances = [look["distance"] for look in looks]
        assert distances == sorted(distances)
    alarm = lane.alarms().iloc[0]
    nearest = one_block.scans[0][0]
    x, y = lane.setup.run["pose"].values[nearest["scan"], :2]
    assert nearest["distance"] == pytest.approx(np.hypot(alarm.x - x, alarm.y - y), abs=2e-3)


def test_of_more_looks_the_nearest_are_left(lane, one_block, monkeypatch):
    monkeypatch.setattr(evidence_module, "MOST_SCANS", 2)
    fewer = gathered(lane, range(SCANS)).result()
    assert max(len(looks) for looks in one_block.scans) > 2
    assert fewer.scans == [looks[:2] for looks in one_block.scans]


@pytest.mark.parametrize("cut", [1, 6, 12])
def test_the_division_of_the_scans_changes_no_look(cut, lane, one_block):
    total = sums(lane)
    for scans in (range(cut), range(cut, SCANS)):
        total.merge(gathered(lane, scans).state())
    divided = total.result()
    assert divided.scans == one_block.scans
    for first, second in zip(divided.blocks, one_block.blocks, strict=True):
        np.testing.assert_array_equal(first, second)
    pd.testing.assert_frame_equal(divided.polarimetric, one_block.polarimetric)


def test_known_poses_sample_the_nearest_scans_alone_and_find_the_same(lane, one_block):
    poses = {scan: lane.setup.pose(scan) for scan in range(SCANS)}
    assert gathered(lane, range(SCANS), poses=poses).result().scans == one_block.scans


def evidence_of(causes, adds):
    count = len(causes)
    return Evidence(
        ["HH"], ["F1"], None, np.zeros(0), np.zeros(0),
        [[{"scan": number}] for number in range(count)],
        [np.full((1, 2), number, np.float16) for number in range(count)],
        pd.DataFrame({"entropy": np.arange(count, dtype=float)}), adds, [], causes,
    )  # fmt: skip


def test_evidence_follows_the_ranking_and_what_was_not_gathered_is_empty():
    evidence = evidence_of([np.zeros((1, 3))] * 2, [])
    ranked = in_order(evidence, np.array([1, 5, 0]))
    assert ranked.scans == [[{"scan": 1}], [], [{"scan": 0}]]
    assert [block.size for block in ranked.blocks] == [2, 0, 2]
    np.testing.assert_array_equal(ranked.polarimetric["entropy"], [1.0, np.nan, 0.0])


def test_contributions_add_up_to_the_confidence():
    """Two looks of weight 1/4 and 3/4, at which two parts of the map have values."""
    looks = np.array([[0, 1.0, 0.25, 4.0, 8.0], [1, 2.0, 0.75, 0.0, 4.0]])
    evidence = evidence_of([looks, np.zeros((0, 5))], ["first", "second"])
    shares = confidence_contributions(evidence, 2.0, [20.0, 1.0])
    assert shares.iloc[0].to_dict() == {"first": 2.0, "second": 10.0, "constant": 8.0}
    assert shares.iloc[1].isna().all()
