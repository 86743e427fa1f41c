"""Agreement of analysts: against another implementation, and by simulation."""

import numpy as np
import pytest
from sklearn.metrics import cohen_kappa_score

from flgpr.scoring import agreement

NAMES = ["mine", "unsure", "clutter"]


def drawn(rng, shares, count):
    pairs = rng.choice(9, count, p=np.ravel(shares))
    return [NAMES[one] for one in pairs // 3], [NAMES[one] for one in pairs % 3]


def kappa_of(shares):
    expected = float(shares.sum(axis=0) @ shares.sum(axis=1))
    return (np.trace(shares) - expected) / (1 - expected)


JOINT = {
    "often alike": np.array([[0.4, 0.05, 0.02], [0.03, 0.1, 0.03], [0.02, 0.05, 0.3]]),
    "by chance": np.outer([0.3, 0.2, 0.5], [0.5, 0.2, 0.3]),
    "mines are rare": np.array([[0.05, 0.02, 0.01], [0.01, 0.02, 0.02], [0.01, 0.01, 0.85]]),
    "always alike": np.diag([0.3, 0.1, 0.6]),
}


@pytest.mark.parametrize("shares", JOINT.values(), ids=JOINT)
def test_kappa_is_that_of_scikit_learn_and_its_interval_covers(shares):
    rng = np.random.default_rng(4)
    covered = 0
    rounds = 400
    for number in range(rounds):
        first, second = drawn(rng, shares, 60)
        told = agreement(first, second, NAMES)
        if number < 20:
            assert told.kappa == pytest.approx(cohen_kappa_score(first, second))
            assert told.agreed == sum(a == b for a, b in zip(first, second, strict=True))
            assert told.table.loc["mine", "clutter"] == list(zip(first, second, strict=True)).count(
                ("mine", "clutter")
            )
        covered += told.kappa_low <= kappa_of(shares) <= told.kappa_high
    assert covered >= 0.95 * rounds - 3 * np.sqrt(rounds * 0.95 * 0.05)


def test_perfect_agreement_of_few_is_not_certain():
    told = agreement([*"mmc"], [*"mmc"], ["m", "c"])
    assert told.kappa == told.kappa_high == 1
    assert told.kappa_low < 0.4


def test_one_verdict_throughout_leaves_kappa_undefined():
    told = agreement(["mine"] * 5, ["mine"] * 5, NAMES)
    assert np.isnan([told.kappa, told.kappa_low, told.kappa_high]).all()
    assert told.share == 1


@pytest.mark.parametrize(
    ("first", "second", "words"),
    [(["mine"], [], "got 1 and 0"), ([], [], "at least one"), (["mine"], ["bush"], "got bush")],
)
def test_what_cannot_be_compared_is_refused(first, second, words):
    with pytest.raises(ValueError, match=words):
        agreement(first, second, NAMES)
