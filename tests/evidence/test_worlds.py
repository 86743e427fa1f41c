"""The map of worlds in parts: what it writes, and that stopped runs resume."""

import json
import math
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit
from scipy.stats import t as student

from flgpr.jobs.workers import InProcess
from flgpr.scoring import clopper_pearson
from flgpr_papers.kit.mines import mix_counts
from worlds import __main__ as script
from worlds import ablation, detection, geometry
from worlds.lanes import lane_table, read_targets
from worlds.space import AXES

ROOT = Path(__file__).parents[2]

pytestmark = pytest.mark.slow("studies of papers")


def write_lane(job, folder, rng):
    """Write a record as a lane does: targets that are found the better, the more they stand above the clutter."""
    rough = job.site["surface"]["rms_height"] * 1000
    bodies = []
    for kind, mix, level in (
        ("metal", "metal", 14),
        ("plastic", job.mines, 2),
        ("simulant", "simulant", -2),
    ):
        for body, count in mix_counts(mix, job.count).items():
            bodies += [(kind, body, level)] * count
    targets = []
    ratios = []
    far = []
    luck = rng.normal(0, 1.5)  # what the mines of a lane share
    for number, (kind, body, level) in enumerate(bodies):
        ratio = level - 20 * math.log10(rough / 2) + rng.normal(0, 2)
        place = {"x": 0.0, "y": 4.0 * number, "depth": 0.075}
        targets.append({"target_id": f"T{number:03d}", "kind": kind, "body": body, **place})
        ratios.append(ratio)
        far.append(float(0.3 * expit(-(ratio + luck - 3) / 2)) if ratio > -10 else None)
    grounds = job.ground or (None,)
    found = [
        {"ground": ground, "far": far, "chance": [0.06, 0.2], "alarms": 99} for ground in grounds
    ]
    path = job.path(folder)
    path.parent.mkdir(parents=True, exist_ok=True)
    record = {
        "about": job.about,
        "seconds": 1.0,
        "targets": targets,
        "ratio_db": ratios,
        "found": found,
    }
    path.write_text(json.dumps(record))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """All parts of the full form, with records made up."""
    folder = tmp_path_factory.mktemp("map")
    rng = np.random.default_rng(4)
    for part in (detection, ablation, geometry):
        for job in part.jobs():
            write_lane(job, folder, rng)
    script.main([str(folder)])
    return folder


@pytest.mark.slow("runs a quick form of the whole study")
def test_the_script_makes_all_tables_and_figures_of_the_docs(made):
    for path in (ROOT / "docs" / "evidence" / "worlds").iterdir():
        if path.name.startswith("statements"):  # judged once, by rules that are others now
            continue
        own = made / path.name
        assert own.stat().st_size > (2_000 if path.suffix == ".png" else 50), path.name
        if path.suffix == ".csv":
            assert list(pd.read_csv(own).columns) == list(pd.read_csv(path).columns)
    short = pd.read_csv(made / "ablation-short.csv").set_index(["road", "change"])
    assert short.loc[("smooth", "roughness"), "plastic, signal to clutter, dB"].endswith(" *")


@pytest.mark.slow("runs a quick form of the whole study")
def test_effects_tell_what_the_axes_do(made):
    folder = made
    effects = pd.read_csv(folder / "detection-effects.csv")
    plastic = effects[effects["response"] == "plastic 0.07"]
    rough = plastic[plastic["axis"] == "roughness"].set_index("level")
    assert rough.loc[["1.0", "2.0", "4.0"], "value"].is_monotonic_decreasing
    assert rough.loc["8.0", "difference_high"] < -0.2
    assert rough["p"].iloc[0] < 1e-6
    assert rough["dispersion"].iloc[0] > 1.2  # mines of a world share their luck
    assert plastic.loc[plastic["axis"] == "loss", "p"].iloc[0] > 1e-3
    level = effects[
        (effects["response"] == "plastic ratio_db") & (effects["axis"] == "roughness")
    ].set_index("level")
    assert level.loc["4.0", "difference"] == pytest.approx(-20 * math.log10(4), abs=0.5)
    assert (
        level.loc["4.0", "difference_low"]
        < -20 * math.log10(4)
        < level.loc["4.0", "difference_high"]
    )
    cells = plastic[plastic["axis"] == "roughness x permittivity"]
    assert len(cells) == 16
    assert set(cells["worlds"]) == {4}
    assert not (effects[effects["response"] == "metal 0.02"]["axis"] == "mines").any()


@pytest.mark.slow("runs a quick form of the whole study")
def test_costs_find_the_part_that_matters(made):
    folder = made
    costs = pd.read_csv(folder / "ablation-costs.csv")
    level = costs[costs["response"] == "plastic ratio_db"]
    added = level[level["road"] == "smooth"].set_index("change")
    taken = level[level["road"] == "natural"].set_index("change")
    assert added.index[added["clear"]].tolist() == ["roughness"]  # the records know of nothing else
    assert added.loc["roughness", "difference"] == pytest.approx(-20 * math.log10(2.5), abs=1.5)
    assert taken.loc["roughness", "low"] > 0
    assert set(costs["replicates"]) == {4}


@pytest.mark.slow("runs a quick form of the whole study")
def test_geometries_are_averaged_over_lanes(made):
    folder = made
    means = pd.read_csv(folder / "geometry-means.csv")
    assert len(means) == 3 * 5 * 9
    assert set(means["lanes"]) == {4}
    lanes = pd.read_csv(folder / "geometry.csv")
    here = lanes[(lanes["height"] == 2.0) & (lanes["farthest"] == 10.0)]
    row = means[
        (means["height"] == 2.0)
        & (means["farthest"] == 10.0)
        & (means["response"] == "plastic 0.07")
    ].iloc[0]
    values = here["plastic_0.07"] / here["plastic_targets"]
    half = student.ppf(0.975, 3) * values.std(ddof=1) / 2
    exact = clopper_pearson(here["plastic_0.07"].sum(), here["plastic_targets"].sum())[1]
    high = min(max(values.mean() + half, exact), 1.0)
    assert (row["value"], row["high"]) == pytest.approx((values.mean(), high), abs=2e-5)
    shares = means[~means["response"].str.endswith("ratio_db")]
    assert shares["low"].ge(0).all()
    assert shares["high"].le(1).all()


@pytest.mark.slow("runs a quick form of the whole study")
def test_figures_come_from_the_tables_alone(made, tmp_path):
    folder = made
    for path in folder.glob("ablation*.csv"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    script.main([str(tmp_path), "--part", "figures"])
    assert sorted(path.name for path in tmp_path.glob("*.png")) == ["ablation.png"]
    assert (tmp_path / "ablation.png").read_bytes() == (folder / "ablation.png").read_bytes()


@pytest.mark.slow("runs a quick form of the whole study")
def test_what_is_there_is_not_run_again(made, monkeypatch):
    monkeypatch.setattr("worlds.lanes.run_job", lambda *_: pytest.fail("a lane is run again"))
    script.run_part(made, "detection", InProcess())


def test_a_stopped_part_shows_what_is_there(tmp_path):
    rng = np.random.default_rng(1)
    for job in ablation.jobs()[:25]:  # a replicate and a quarter
        write_lane(job, tmp_path, rng)
    targets = read_targets(tmp_path, ablation.jobs())
    lanes = lane_table(targets, ["road", "change", "replicate"])
    costs = ablation.costs(lanes)
    assert set(costs["replicates"]) == {1}
    assert not costs["clear"].any()
    for job in detection.jobs()[:20]:
        write_lane(job, tmp_path, rng)
    few = lane_table(read_targets(tmp_path, detection.jobs()), list(AXES))
    assert detection.effects(few).empty


def test_what_cannot_be_run_is_refused(tmp_path, capsys):
    with pytest.raises(SystemExit) as ended:
        script.main([str(tmp_path / "x"), "--part", "depth"])
    assert ended.value.code == 2
    assert "choose from 'detection', 'ablation', 'geometry', 'figures'" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
