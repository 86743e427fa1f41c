"""Detectors side by side: intervals of paired differences, tables, page, and what a sealed truth lets through."""

import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from scipy.special import xlogy
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.model import Lane
from flgpr.scoring import (
    Rules,
    compare,
    match,
    mcnemar_test,
    paired_interval,
    pd_mean_interval,
    roc,
    side_by_side,
)

LANE = Lane(-2.0, 2.0, 0.0, 300.0)
Y = np.arange(5.0, 295.0, 10.0)
TRUTH = pd.DataFrame(
    {
        "target_id": [f"m{k}" for k in range(len(Y))],
        "x": 0.1234567,
        "y": Y + 0.7654321,
        "kind": "metal",
    }
)
TRUTH = TRUTH.assign(kind=np.where(np.arange(len(Y)) % 2, "metal", "plastic"), depth=0.05)


def alarms(seed, pd_true, false):
    rng = np.random.default_rng(seed)
    hit = TRUTH[rng.random(len(TRUTH)) < pd_true]
    near = pd.DataFrame(
        {"x": hit["x"] + 0.1, "y": hit["y"] - 0.2, "confidence": rng.normal(2, 1, len(hit))}
    )
    noise = rng.uniform([-2, 0, -2], [2, 300, 2], (false, 3))
    return pd.concat(
        [near, pd.DataFrame(noise, columns=["x", "y", "confidence"])], ignore_index=True
    )


def inverted(only_a, only_b, n, level):
    """Differences that the score test accepts, each with the nuisance share that makes the counts most likely."""
    z = stats.norm.ppf((1 + level) / 2)
    accepted = []
    for gap in np.linspace(-0.999, 0.999, 1999):
        share = np.linspace(max(0.0, -gap), (1 - gap) / 2, 1001)
        likely = (
            xlogy(only_a, share + gap)
            + xlogy(only_b, share)
            + xlogy(n - only_a - only_b, 1 - 2 * share - gap)
        )
        best = share[np.nanargmax(likely)]
        if abs(only_a - only_b - n * gap) <= z * np.sqrt(n * (2 * best + gap - gap**2)):
            accepted.append(gap)
    return min(accepted), max(accepted)


@pytest.mark.filterwarnings("ignore:invalid value encountered:RuntimeWarning")
@pytest.mark.parametrize(
    "counts", [(9, 2, 40), (2, 9, 40), (0, 0, 20), (5, 0, 5), (0, 12, 12), (3, 3, 10), (1, 0, 12)]
)
@pytest.mark.parametrize("level", [0.8, 0.95])
def test_the_paired_interval_is_the_score_test_inverted(counts, level):
    assert paired_interval(*counts, level) == pytest.approx(inverted(*counts, level), abs=2e-3)


def test_paired_intervals_cover():
    """About as often as they say, for few targets, where the plain one of Wald covers far less."""
    rng = np.random.default_rng(0)
    p_a = 0.25
    p_b = 0.05
    n = 20
    runs = 4000
    counts = rng.multinomial(n, [p_a, p_b, 1 - p_a - p_b], runs)
    ends = {tuple(one): paired_interval(*one, n) for one in np.unique(counts[:, :2], axis=0)}
    covered = np.mean(
        [low <= p_a - p_b <= high for low, high in (ends[tuple(one)] for one in counts[:, :2])]
    )
    assert covered > 0.95 - 0.01 - 4 * np.sqrt(0.95 * 0.05 / runs)


def test_counts_that_cannot_be_are_refused():
    for counts in ((3, 3, 5), (-1, 0, 5), (0, 0, 0)):
        with pytest.raises(ValueError, match="must be counts among n_targets"):
            paired_interval(*counts)


def test_the_tables_are_those_of_single_scores():
    lists = {"a": alarms(1, 0.9, 30), "b": alarms(2, 0.6, 40), "c": alarms(3, 0.3, 10)}
    fars = (0.005, 0.02, 0.1)
    told = side_by_side(
        {name: match(one, TRUTH, LANE) for name, one in lists.items()}, fars, Rules(draws=50)
    )
    found = {}
    for name, one in lists.items():
        curve = roc(one, TRUTH, LANE)
        for far in fars:
            want = curve[curve["far"] <= far].iloc[-1]
            row = told.points.set_index(["detector", "far_allowed"]).loc[(name, far)]
            assert (
                row[["pd", "pd_low", "far_high", "n_false"]].tolist()
                == want[row.index[[3, 4, 2, 8]]].tolist()
            )
            assert 0 <= row["chance"] <= 1
            near = one[one["confidence"] >= want["threshold"]]
            away = np.hypot(
                *(near[["x", "y"]].to_numpy()[:, None] - TRUTH[["x", "y"]].to_numpy()).transpose(
                    2, 0, 1
                )
            )
            found[name, far] = (away <= 1).any(axis=0)
    assert len(told.pairs) == 9
    for row in told.pairs.to_dict("records"):
        first, second = (found[row[who], row["far_allowed"]] for who in ("first", "second"))
        only = int((first & ~second).sum()), int((second & ~first).sum())
        assert (row["only_first"], row["only_second"]) == only
        assert row["difference"] == pytest.approx(first.mean() - second.mean())
        assert row["p"] == mcnemar_test(*only)
        assert row["low"] < row["difference"] < row["high"]
    assert (told.means["low"] <= told.means["difference"]).all()
    assert (
        told.means[["low_a", "low_b"]].to_numpy()
        <= told.means[["pd_mean_a", "pd_mean_b"]].to_numpy()
    ).all()


@pytest.mark.parametrize("rule", [{"block": 60.0}, {"cluster": "pair"}])
def test_all_rules_of_the_bootstrap_reach_the_tables_of_means(rule):
    truth = TRUTH.assign(pair=np.arange(len(TRUTH)) // 2)
    lists = {"a": alarms(1, 0.9, 30), "b": alarms(2, 0.6, 40)}
    matches = {name: match(one, truth, LANE) for name, one in lists.items()}
    told = side_by_side(matches, [0.01], Rules(draws=50, **rule)).means
    assert told["low_a"].item() == pd_mean_interval(matches["a"], draws=50, **rule)[0]
    assert told["low"].item() == compare(matches["a"], matches["b"], draws=50, **rule).low


def test_what_cannot_be_compared_is_refused():
    one = match(alarms(1, 0.9, 5), TRUTH, LANE)
    with pytest.raises(ValueError, match="two or more"):
        side_by_side({"a": one}, [0.01])
    with pytest.raises(ValueError, match="at least one target"):
        side_by_side(dict.fromkeys("ab", match(alarms(1, 0.9, 5), TRUTH[:0], LANE)), [0.01])
    with pytest.raises(ValueError, match="same truth"):
        side_by_side({"a": one, "b": match(alarms(1, 0.9, 5), TRUTH[1:], LANE)}, [0.01])


@pytest.fixture
def files(tmp_path):
    (tmp_path / "lane.toml").write_text("x_min = -2.0\nx_max = 2.0\ny_min = 0.0\ny_max = 300.0\n")
    TRUTH.to_csv(tmp_path / "truth.csv", index=False)
    for name, one in (("vendorA", alarms(1, 0.9, 30)), ("vendorB", alarms(2, 0.6, 40))):
        one.to_csv(tmp_path / f"{name}.csv", index=False)
    return tmp_path


def plain(text):
    """Text without pictures and digests, in which anything may stand."""
    return re.sub(r"base64,[^\"]*|[0-9a-f]{64}", "", text)


def call(*words, text=""):
    return CliRunner().invoke(app, [str(word) for word in words], input=text)


@pytest.mark.slow("runs a whole command more than once")
def test_two_vendors_are_compared_on_the_command_line(files):
    given = ["score", files / "vendorA.csv", files / "vendorB.csv", "--truth", files / "truth.csv"]
    given += ["--lane", files / "lane.toml", "-o", files / "both"]
    told = call(*given)
    assert told.exit_code == 0, told.output
    line = r"vendorA less vendorB: \+0\.\d\d \([+-]0\.\d\d to \+0\.\d\d\); alone found \d+ and \d+, McNemar's p = "
    assert len(re.findall(line, told.stdout)) == 5
    assert (
        len(
            re.findall(
                r"vendor[AB]  Pd 0\.\d\d \(0\.\d\d to [01]\.\d\d\), \d+ of 29, chance 0\.\d\d",
                told.stdout,
            )
        )
        == 10
    )
    content = json.loads((files / "both" / "comparison.json").read_text())
    assert call(*given, "--json").stdout == json.dumps(content) + "\n"
    assert content["format"] == "flgpr-comparison"
    page = (files / "both" / "comparison.html").read_text()
    for word in ("vendorA less vendorB", "McNemar", "chance", "5 tests"):
        assert word in page
    assert not re.search(r'(src|href)=(?!"data:)', page), "the page needs nothing beside it"


def test_results_bring_their_lane_and_lists_must_be_given_one(demo, files):
    folder = demo[0].folder
    truth = files / "t.csv"
    truth.write_text("target_id,x,y,kind,depth\na,0,4,metal,0\nb,0.5,6,plastic,0.1\n")
    shutil.copytree(folder, files / "again")
    told = call("score", folder, files / "again", "--truth", truth, "-o", files / "both")
    assert told.exit_code == 0, told.output
    assert "+0.00 (-0.66 to +0.66); alone found 0 and 0, McNemar's p = 1" in told.stdout
    for one, message in (
        (files / "vendorA.csv", "alarm lists need --lane to be compared"),
        (files / "nothing", "alarm list or result not found"),
        (folder, "alarms must be different lists to be compared"),
    ):
        refused = call("score", folder, one, "--truth", truth, "-o", files / "x")
        assert refused.exit_code == 2
        assert message in refused.stderr
    assert not (files / "x").exists()
