import json
import math
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from flgpr.model import Lane
from flgpr.report import write_score_report
from flgpr.scoring import clopper_pearson, example_roc, pd_mean, roc
from flgpr.trials import figure_bytes, patch_figure, roc_figure

LANE = Lane(-2.0, 2.0, 0.0, 120.0)


def made_lane(seed=0, targets=16):
    """Build a lane whose detector finds metal better than plastic and shallow better than deep."""
    rng = np.random.default_rng(seed)
    truth = pd.DataFrame(
        {
            "target_id": [f"T{k:02d}" for k in range(targets)],
            "x": rng.uniform(-1.5, 1.5, targets),
            "y": np.linspace(4, 116, targets),
            "kind": np.resize(["metal", "plastic"], targets),
            "depth": np.resize([0.0, 0.0, 0.05, 0.05, 0.1, 0.1], targets),
        }
    )
    gain = 3 - 1.5 * (truth["kind"] == "plastic") - 10 * truth["depth"]
    near = truth[["x", "y"]] + rng.normal(0, 0.25, (targets, 2))
    noise = pd.DataFrame(rng.uniform([-3, 0], [3, 120], (90, 2)), columns=["x", "y"])
    alarms = pd.concat([near, noise], ignore_index=True)
    alarms["confidence"] = np.concatenate([rng.normal(gain, 1), rng.normal(0, 1, 90)])
    return alarms, truth


class Tags(HTMLParser):
    """Collects what a page refers to, and checks that tags close."""

    def __init__(self):
        super().__init__()
        self.open = []
        self.links = []
        self.tags = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href")]
        if tag not in ("meta", "img", "br", "link", "hr"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    alarms, truth = made_lane()
    patches = {
        row: np.random.default_rng(row).normal(size=(9, 9)) * (1 + 1j) for row in range(len(alarms))
    }
    names = {name: np.eye(9) for name in truth["target_id"]}
    folder = tmp_path_factory.mktemp("score")
    truth.loc[3, "kind"] = "<b>plastic</b>"
    truth.loc[5, "depth"] = math.nan
    paths = write_score_report(
        folder, alarms, truth, LANE, draws=40, alarm_patches=patches, target_patches=names, survey_error=0.1,
        notes={"recipe": "wang2007 & more"}, title="A <lane>",
    )  # fmt: skip
    return alarms, truth, paths


def test_the_page_is_self_contained_and_well_formed(written):
    text = written[2]["html"].read_text(encoding="utf-8")
    page = Tags()
    page.feed(text)
    assert page.open == []
    assert all(link.startswith("data:image/png;base64,") for link in page.links)
    assert page.tags.count("img") == 7  # the road, four ROC figures, missed targets, false alarms
    assert "script" not in page.tags
    assert "http" not in re.sub(r"base64,[^\"]*", "", text)
    assert "<b>plastic</b>" not in text
    assert "&lt;b&gt;plastic" in text
    assert "A &lt;lane&gt;" in text
    assert "wang2007 &amp; more" in text
    assert "nan" not in re.sub(r"base64,[^\"]*", "", text).lower().split()


def test_the_page_prints_convention_counts_and_operating_points(written):
    alarms, truth, paths = written
    text = paths["html"].read_text(encoding="utf-8")
    curve = roc(alarms, truth, LANE)
    assert "Wang et al. 2007, rules 1-6" in text
    assert f"{pd_mean(curve):.3f}" in text
    assert "halo radius 1 m" in text
    assert "not known" in text
    assert "survey" in text.lower()
    row = curve[curve["far"] <= 0.05].iloc[-1]
    low, high = clopper_pearson(row["n_detected"], row["n_targets"])
    assert f"{low:.3f} to {high:.3f}" in text
    assert f"{row['n_detected']:.0f} of {row['n_targets']:.0f}" in text


def test_the_page_opens_with_the_operating_point_and_tells_chance(written):
    text = written[2]["html"].read_text(encoding="utf-8")
    main = json.loads(written[2]["json"].read_text(encoding="utf-8"))["detections"]["main"]
    point = main["operating_point"]
    last = main["points"][-1]
    lead = re.search(r"<p class=lead>(.*?)</p>", text, re.S).group(1)
    assert f"{point['n_detected']} of 16 targets were found, with {point['n_false']} false" in lead
    exact = re.search(r"<p class=exact>(.*?)</p>", text, re.S).group(1)
    assert f"{point['n_detected']} of 16 targets found at 0.05 false alarms per m²" in exact
    assert f"chance {point['chance']:.2f}" in exact
    assert f"chance {main['pd_mean']['chance']:.3f}" in exact
    assert f"Pd {last['pd']:.2f} and chance {last['chance']:.2f}" in text
    assert text.index("Found at which false alarm rate") < text.index(
        "What became of each target at 0.05"
    )
    fates = re.findall(r"<td>(found|missed)</td><td class=n>(\S+)</td>", text)
    assert [fate == "found" for fate, _ in fates] == [row["found"] for row in main["targets"]]
    late = next(row for row in main["targets"] if row["detected"] and not row["found"])
    assert ("missed", f"{late['far']:.3g}") in fates


class Folds(HTMLParser):
    """Counts tables and pictures outside of closed parts."""

    def __init__(self):
        super().__init__()
        self.closed = 0
        self.shown = []
        self.nesting = []

    def handle_starttag(self, tag, attrs):
        if tag == "details":
            self.nesting.append("open" not in dict(attrs))
        elif tag in ("table", "img") and not any(self.nesting):
            self.shown.append(tag)

    def handle_endtag(self, tag):
        if tag == "details":
            self.nesting.pop()


def test_a_page_begins_with_the_road_and_folds_what_is_exact(written):
    text = written[2]["html"].read_text(encoding="utf-8")
    page = Folds()
    page.feed(text)
    assert page.shown == ["img"]
    assert text.index("<img") < text.index("<details")
    assert "details::details-content" in text  # printed pages show what is folded


def test_the_json_holds_the_curve(written):
    alarms, truth, paths = written
    told = json.loads(
        paths["json"].read_text(encoding="utf-8"), parse_constant=lambda name: pytest.fail(name)
    )
    curve = roc(alarms, truth, LANE)
    main = told["detections"]["main"]
    assert [row["pd"] for row in main["points"]] == curve["pd"].tolist()
    assert main["points"][0]["threshold"] is None
    assert told["rules"]["convention"] == "lane"
    assert (
        main["pd_mean"]["low"]
        <= main["pd_mean"]["value"]
        == pd_mean(curve)
        <= main["pd_mean"]["high"]
    )
    assert told["rules"]["survey_error"]["share"] == 0.1
    assert told["notes"] == {"recipe": "wang2007 & more"}
    assert [row["target_id"] for row in main["targets"]] == truth["target_id"].tolist()


def test_figures_are_png_and_pdf(written):
    paths = written[2]
    for name in ("roc", "kind", "depth"):
        assert paths[f"{name}_png"].read_bytes()[:4] == b"\x89PNG"
        assert paths[f"{name}_pdf"].read_bytes()[:4] == b"%PDF"


@pytest.mark.slow("draws all figures of a score")
def test_a_report_is_the_same_each_time(written, tmp_path):
    alarms, truth, paths = written
    again = write_score_report(tmp_path, alarms, truth, LANE, draws=40)
    assert again["roc_png"].read_bytes() == paths["roc_png"].read_bytes()
    assert again["roc_pdf"].read_bytes() == paths["roc_pdf"].read_bytes()


@pytest.mark.slow("draws all figures of a score")
def test_lanes_without_targets_or_alarms_are_reported_too(tmp_path):
    alarms, truth = made_lane()
    blank = write_score_report(tmp_path / "blank", alarms, truth.iloc[:0], LANE, draws=10)
    told = json.loads(blank["json"].read_text(), parse_constant=lambda name: pytest.fail(name))
    assert told["detections"]["main"]["n_targets"] == 0
    assert told["detections"]["main"]["pd_mean"] is None
    page = blank["html"].read_text(encoding="utf-8")
    assert "No target stands here" in page
    assert "nan" not in re.sub(r"base64,[^\"]*", "", page)
    assert page.count("<img") == 1  # the road with its alarms
    silent = write_score_report(tmp_path / "silent", alarms.iloc[:0], truth, LANE, draws=10)
    assert "Missed targets at 0.05 false alarms per m²: 16" in silent["html"].read_text(
        encoding="utf-8"
    )
    bad = tmp_path / "bad"
    with pytest.raises(ValueError, match="truth must have the columns"):
        write_score_report(bad, alarms, truth.drop(columns="kind"), LANE)
    assert not bad.exists()


def test_figures_refuse_what_cannot_be_drawn_together():
    alarms, truth = made_lane()
    with pytest.raises(ValueError, match="share one convention"):
        roc_figure(
            {"a": roc(alarms, truth, LANE), "b": example_roc([1.0, 0.5], [True, False], 1.0)}
        )
    with pytest.raises(ValueError, match="equally many"):
        patch_figure([], [])
    with pytest.raises(ValueError, match="two dimensions"):
        patch_figure([np.ones(3)], ["a"])
    assert figure_bytes(roc_figure({"a": roc(alarms, truth, LANE)}), "svg")[:5] == b"<?xml"
