"""Worlds to ask the papers' statements in: their soils, the rules by which regions are judged, and the map."""

import dataclasses
import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import t as student

import flgpr_papers
from flgpr.execution.executors import Here
from flgpr.execution.survey import How
from flgpr.simulate import Scene
from flgpr_papers import worlds as w
from flgpr_papers.kit.findings import AGREES, DISAGREES, UNDECIDED, Finding, judge_again, row_of
from flgpr_papers.kit.worlds import AXES, World, worlds


def larger(*values, asks=("larger", 0.0, 0.0), claim="A beats B"):
    parts = values if len(values) > 1 else ()
    return Finding(claim, "", "", UNDECIDED, interval=(min(values), -9.0, 9.0), asks=asks, parts=parts)


def test_all_declared_worlds_are_there_once():
    every = worlds()
    assert len(every) == math.prod(map(len, AXES.values())) == 72
    assert len({one.name for one in every}) == 72
    assert [one.number for one in every] == list(range(72))
    asked = w.studies()
    beside = [world for _, world in asked if world.number >= 72]
    assert len(asked) == len(set(asked)) == 3 * 72 + 36 + len(beside)
    assert {one.roughness for one in beside} == {0.5}
    assert len(beside) >= 4 * w.FEWEST


@pytest.mark.parametrize("permittivity", AXES["permittivity"])
def test_a_world_is_a_site_of_its_soil_and_roadside(tmp_path, permittivity):
    world = World(1, permittivity, "mironov", 6.0, "posts")
    scenes = {
        loss: Scene(site=dataclasses.replace(world, loss=loss).site(tmp_path), length=30.0) for loss in AXES["loss"]
    }
    soil = {loss: scene.soil.media(np.array([1e9]))[-1][0] for loss, scene in scenes.items()}
    assert soil["mironov"].real == pytest.approx(permittivity, abs=0.01)
    assert soil["low"].real == pytest.approx(permittivity, abs=0.01)
    assert -soil["low"].imag / soil["low"].real == pytest.approx(0.01)
    assert -soil["mironov"].imag / soil["mironov"].real > 0.02
    for scene in scenes.values():
        assert scene.surface.rms_height == pytest.approx(0.006)
        assert scene.clutter.bushes == 0
        assert scene.clutter.posts > 0
        assert scene.stones.density > 0  # all else is the packaged site's


def test_another_interval_is_judged_by_what_the_claim_asks():
    assert judge_again(larger(0.0), 0.2, 0.1, 0.3) == AGREES
    assert judge_again(larger(0.0, asks=("larger", 0.15, 0.0)), 0.2, 0.1, 0.3) == UNDECIDED
    within = Finding("", "", "", UNDECIDED, rule=(0.0, 0.5), interval=(0.1, 0.0, 0.2))
    assert judge_again(within, 0.7, 0.6, 0.8) == DISAGREES
    alike = larger(0.0, asks=("alike", 0.15, 0.0))
    assert judge_again(alike, 0.05, -0.01, 0.1) == AGREES
    assert judge_again(alike, 0.05, 0.01, 0.1) == DISAGREES
    assert judge_again(larger(0.0, asks=("alike", 0.15, 0.1)), 0.05, 0.01, 0.1) == UNDECIDED  # the paper's own error


def test_a_region_is_judged_by_the_mean_over_its_worlds():
    values = np.random.default_rng(1).normal(0.3, 0.1, 12)
    count, (mean, low, high), verdict = w.pooled([larger(one) for one in values], 13)
    half = student.ppf(1 - 0.025 / 13, 11) * values.std(ddof=1) / math.sqrt(12)
    assert (count, verdict) == (12, AGREES)
    assert (mean, low, high) == pytest.approx((values.mean(), values.mean() - half, values.mean() + half))
    two = [larger(one, -one) for one in values]
    assert w.pooled(two, 13)[2] == DISAGREES  # one part of the claim is on the wrong side
    assert w.pooled(two[: w.FEWEST - 1], 13)[2] == UNDECIDED
    assert w.pooled([*two, larger(math.nan, 0.1)], 13)[0] == 12


def test_regions_disagree_by_chance_as_rarely_as_they_should():
    rng, wrong = np.random.default_rng(2), 0
    for _ in range(300):
        regions = [[larger(one) for one in rng.normal(0, 1, 18)] for _ in range(13)]
        wrong += any(w.pooled(region, 13)[2] != UNDECIDED for region in regions)
    assert wrong <= 27  # 5 % of 300 and three standard errors


@pytest.fixture
def made(tmp_path):
    """Records as the studies write them: A beats B where the soil is dry, C nowhere; one world's lanes too small."""
    rng = np.random.default_rng(4)
    for paper, world in w.studies():
        gap = rng.normal(0.5 if world.permittivity < 5 else -0.5, 0.1)
        corner = 3.0 if (world.roughness, world.roadside) == (3.0, "none") else -0.5
        found = [larger(gap), larger(rng.normal(-1, 0.1), claim="C"), larger(rng.normal(0, 1), claim="D")]
        found.append(larger(rng.normal(corner, 0.1), claim="E"))
        pd_of = Finding(
            "Pd of the deflection detector",
            "",
            "",
            "open",
            interval=(1 / world.permittivity + rng.normal(0, 1e-3) - 0.01 * (world.loss == "mironov"), 0.0, 1.0),
        )
        failed = paper == "fuse2018" and world.number == 3
        record = {"failed": "lane too short" * failed, "findings": [] if failed else list(map(row_of, [*found, pd_of]))}
        path = w.path_of(tmp_path, paper, world)
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps({"world": dataclasses.asdict(world), **record, "seconds": 1.0}))
    return tmp_path


def test_the_map_tells_where_a_statement_holds(made):
    page = w.write_map(made).read_text(encoding="utf-8")
    table = pd.read_csv(made / "worlds.csv")
    holds = table.groupby(["paper", "statement"])["holds"].first()
    for paper in flgpr_papers.PAPERS:
        assert holds[paper]["A beats B"] == "somewhere"
        assert holds[paper]["C"] == "nowhere"
        assert holds[paper]["D"] == "undecided"
        assert holds[paper]["E"] == ("in a corner" if paper != w.TWO_SITES else "nowhere")  # four worlds are too few
        assert (made / f"{paper}.png").stat().st_size > 10_000
        assert page.count(f'id="{paper}"') == 1
    assert set(table[table["statement"] == "E"]["corners"].dropna()) == {"roughness 3.0, roadside none"}
    dry = table[(table["paper"] == "wang2007") & (table["statement"] == "A beats B")].set_index("region")
    assert dry.loc["permittivity 3.0", "verdict"] == AGREES
    assert dry.loc["permittivity 9.0", "verdict"] == DISAGREES
    assert (dry.loc["all", "worlds"], dry.loc["loss low", "worlds"]) == (72, 36)
    assert "71 of 72" not in page
    assert table[(table["paper"] == "fuse2018") & (table["region"] == "all")]["worlds"].max() == 71
    soils = holds["cosgrove2004"]
    assert {soils[claim] for claim, *_ in w.SOILS} == {"everywhere"}
    assert set(table[table["region"] == "smooth"]["worlds"]) == {0, 6}  # soils in order are not asked there
    assert not any(name.startswith("loss") for name in table[table["paper"] == w.TWO_SITES]["region"])


def test_what_is_there_is_not_run_again(made, monkeypatch):
    left = w.studies()[:2]
    for paper, world in left:
        w.path_of(made, paper, world).unlink()
    done = []
    monkeypatch.setattr(w, "judge_in_world", lambda *job: done.append(job[:2]))
    w.run_worlds(made, Here())
    assert sorted(done) == sorted((paper, world.number) for paper, world in left)


def test_lanes_too_small_for_a_study_are_told(tmp_path, monkeypatch):
    def too_small(world, folder):
        folder.mkdir(parents=True)
        raise ValueError(f"lane of {world.name} must hold a mine")

    monkeypatch.setattr("flgpr_papers.cosgrove2004.study.findings_in", too_small)
    w.judge_in_world("cosgrove2004", 5, str(tmp_path))
    record = json.loads(w.path_of(tmp_path, "cosgrove2004", worlds()[5]).read_text())
    assert record["failed"] == f"lane of {worlds()[5].name} must hold a mine"
    assert not list((tmp_path / "work").iterdir())
    assert "undecided" in w.write_map(tmp_path).read_text(encoding="utf-8")


def test_a_cluster_does_what_is_left(made, monkeypatch):
    distributed = pytest.importorskip("distributed")
    for paper in flgpr_papers.PAPERS:
        monkeypatch.setattr(f"flgpr_papers.{paper}.study.findings_in", lambda world, _: [larger(world.permittivity)])
    left = [w.path_of(made, *one) for one in w.studies()[:3]]
    for path in left:
        path.unlink()
    with distributed.LocalCluster(
        n_workers=1, processes=False, dashboard_address="127.0.0.1:0", host="tcp://127.0.0.1"
    ) as cluster:
        page = w.map_worlds(made, How(scheduler=cluster.scheduler_address))
    assert page == made / "index.html"
    assert all(json.loads(path.read_text())["findings"] for path in left)
