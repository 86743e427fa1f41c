"""Scores without a result: curves over each other, operating points, and what becomes of each target."""

import json
import re

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.model import Lane
from flgpr.store import lane_text
from flgpr.store.writing import write_table
from flgpr.viewer.session import open_source, open_sources
from scored import compare_alarms, score_alarms
from scored_blind import score_sealed, seal_truth_file
from small_results import small_result

LANE = Lane(-2.0, 2.0, 0.0, 60.0)


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    """Two vendors on six targets, A better at plastic; a score of each, one by another halo, and their comparison."""
    home = tmp_path_factory.mktemp("vendors")
    y = [5.0, 15, 25, 35, 45, 55]
    truth = pd.DataFrame(
        {
            "target_id": [*"abcdef"],
            "x": 0.0,
            "y": y,
            "kind": ["metal", "plastic"] * 3,
            "depth": 0.05,
        }
    )
    write_table(truth, home / "truth.csv")
    (home / "lane.toml").write_text(lane_text(LANE))
    false = [(1.7, 10.0), (-1.7, 20.0), (1.7, 30.0), (-1.7, 40.0)]
    for name, hits in (("one", "abcdf"), ("two", "ace")):
        rows = [(0.0, y["abcdef".index(hit)], 9.0 - n) for n, hit in enumerate(hits)]
        rows += [(px, py, 6.5 - n) for n, (px, py) in enumerate(false)]
        write_table(pd.DataFrame(rows, columns=["x", "y", "confidence"]), home / f"{name}.csv")
        score_alarms(
            home / f"{name}.csv",
            home / "truth.csv",
            home / "lane.toml",
            home / f"score-{name}",
            draws=20,
        )
    score_alarms(
        home / "two.csv", home / "truth.csv", home / "lane.toml", home / "wide", draws=20, halo=1.5
    )
    compare_alarms(
        [home / "one.csv", home / "two.csv"], home / "truth.csv", home / "both", home / "lane.toml"
    )
    return home


def rows_of(page, number):
    return page.locator("#scores table").nth(number).locator("tbody tr").all_inner_texts()


@pytest.mark.slow("a browser draws every page")
def test_a_score_is_shown_with_its_points_and_targets(watch, serving, scores):
    told = json.loads((scores / "score-one" / "roc.json").read_text())["detections"]["main"]
    with serving([scores / "score-one"]) as viewer:
        one = watch(viewer)
        page = one.page
        at = told["operating_point"]
        assert f"{at['n_detected']} of 6" in one.text("#counts")
        assert f"Opened at {at['far_allowed']:g} false alarms per m²" in one.text("#point")
        assert page.locator("#lane").is_hidden()
        points = [row.split("\t") for row in rows_of(page, 0)]
        assert len(points) == 3 * 5  # all, metal, plastic at the usual rates
        kinds = {
            name: [row for row in points if row[0] == name] for name in ("all", "metal", "plastic")
        }
        for name, rows in kinds.items():
            for row, point in zip(
                rows, told["kinds"].get(name, {}).get("points", []), strict=False
            ):
                assert (float(row[1]), row[2]) == (
                    point["far_allowed"],
                    f"{point['n_detected']} of 3",
                )
        assert (
            kinds["all"][0][2]
            == f"{sum(int(kinds[k][0][2][0]) for k in ('metal', 'plastic'))} of 6"
        )
        page.locator("#threshold").fill("2")
        fates = {row.split("\t")[0]: row.split("\t")[2] for row in rows_of(page, 1)}
        assert fates == {**dict.fromkeys("ab", "found"), **dict.fromkeys("cdef", "missed")}
        assert one.text("#threshold-left") == "0 of 4 false alarms left"


@pytest.mark.slow("a browser draws every page")
def test_two_scores_stand_side_by_side(watch, serving, scores):
    with serving([scores / "score-one", scores / "score-two" / "roc.json"]) as viewer:
        one = watch(viewer)
        counts = one.text("#counts")
        assert "A score-one" in counts
        assert "B score-two" in counts
        one.page.locator("#threshold").fill(one.page.get_attribute("#threshold", "max"))
        found = re.search(r"found\s+(\d) of 6\s+(\d) of 6", one.text("#counts")).groups()
        assert found == ("5", "3")
        fates = {row.split("\t")[0]: row.split("\t")[2::2] for row in rows_of(one.page, 1)}
        assert fates["b"] == ["found", "missed"]
        assert fates["e"] == ["missed", "found"]
        assert one.page.locator("#scores [role=alert]").count() == 0
        assert one.page.locator("#roc-plot canvas").count() == 1
        wide = "(all) => all.filter((one) => one.scrollWidth > one.clientWidth + 1).length"
        assert one.page.locator("header, aside, #scores").evaluate_all(wide) == 0


@pytest.mark.slow("a browser draws every page")
def test_on_a_phone_the_picture_stands_above_the_tables(watch, serving, scores):
    with serving([scores / "score-one"]) as viewer:
        page = watch(viewer, size=(390, 844)).page
        roc, tables = (page.locator(name).bounding_box()["y"] for name in ("#roc", "#scores"))
        assert roc < tables


@pytest.mark.slow("a browser draws every page")
def test_scores_by_different_rules_say_so(watch, serving, scores):
    with serving([scores / "score-one", scores / "wide"]) as viewer:
        words = watch(viewer).text("#scores [role=alert]")
        assert words == "A and B do not compare: halo radius 1 and 1.5."


@pytest.mark.slow("a browser draws every page")
def test_a_comparison_shows_its_detectors(watch, serving, scores):
    with serving([scores / "both"]) as viewer:
        one = watch(viewer)
        assert one.page.locator("#b-set option").all_inner_texts() == ["one", "two"]
        assert len(rows_of(one.page, 0)) == 5
        assert one.text("#threshold-out") == "not told"


@pytest.mark.slow("a browser draws every page")
@pytest.mark.parametrize("show", ["curve", "targets"])
def test_a_blind_score_tells_no_more_than_it_may(watch, serving, scores, tmp_path, show):
    pytest.importorskip("cryptography")
    phrase = "seven words that nobody else would guess"
    sealed = seal_truth_file(
        scores / "truth.csv", scores / "lane.toml", tmp_path / "sealed", phrase, show=show
    )
    score_sealed(scores / "one.csv", sealed, phrase, tmp_path / "blind")
    with serving([tmp_path / "blind"]) as viewer:
        one = watch(viewer)
        assert one.page.locator("#scores table").count() == (1 if show == "curve" else 2)
        assert {row.split("\t")[0] for row in rows_of(one.page, 0)} == {"all", "metal", "plastic"}
        if show == "targets":
            found = [row.split("\t")[2] for row in rows_of(one.page, 1)].count("found")
            assert f"{found} of 6" in one.text("#counts")


@pytest.mark.slow("a browser draws every page")
def test_a_result_stands_beside_a_score_by_its_own(watch, serving, scores, demo, tmp_path):
    with serving([demo[0].folder, scores / "score-one"]) as viewer:
        one = watch(viewer)
        assert one.page.locator("#lane").is_hidden()
        assert one.page.locator("#a-set optgroup").count() == 2
        assert "of 3" in one.text("#counts")
        assert "another truth" in one.text("#scores [role=alert]")
    small_result(tmp_path / "unscored")
    with pytest.raises(
        ValueError,
        match=r"unscored: shown together with a score it must be scored, too: `flgpr.score`",
    ):
        open_sources([scores / "score-one", tmp_path / "unscored"])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("roc.json", "{}"),
        ("roc.json", "[1]"),
        ("roc.json", "nonsense"),
        ("comparison.json", '{"format": "flgpr-comparison", "version": 2}'),
        (
            "roc.json",
            '{"format": "flgpr-score", "version": 1, "rules": {}, "notes": {}, "detections": {"a": {"points": []}}}',
        ),
    ],
)
def test_what_is_no_score_is_refused_in_a_line(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match="not a score that can be shown"):
        open_source(tmp_path)
    ran = CliRunner().invoke(app, ["view", str(tmp_path), "--no-browser"])
    assert ran.exit_code == 2
    assert ran.output.count("\n") == 1
