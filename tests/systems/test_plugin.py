"""A stage of another distribution, installed: named in a recipe, trained, with workers, after a stop."""

import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pandas as pd
import pytest
from scipy.spatial import cKDTree

import flgpr
from flgpr.live.detector import LiveSettings
from flgpr.live.feeding import feed
from flgpr.live.options import LiveOptions
from flgpr.live.session import LiveRun
from flgpr.recipe.schema import parse_recipe
from flgpr.store import read_table
from systems.lanes import small_recipe

pytestmark = pytest.mark.slow("runs a plug-in's stage with workers, after a stop and live")

PLUGIN = Path(__file__).parents[1] / "plugin"
STAGE = '\n[[columns]]\nstage = "sharpness"\nradius = 0.5\n'
DETECTOR = '\n[detector]\nestimator = "logistic"\nfeatures = ["sharp_*", "C_HH_F1"]\n[detector.options]\nC = 0.1\n'


def make_wheel(folder: Path) -> Path:
    """Make what a build backend would make of the sample package; none need be installed."""
    about = tomllib.loads((PLUGIN / "pyproject.toml").read_text())["project"]
    stem = f"{about['name'].replace('-', '_')}-{about['version']}"
    points = "\n".join(
        f"{name} = {place}" for name, place in about["entry-points"]["flgpr.stages"].items()
    )
    files = {
        "flgpr_sharpness.py": (PLUGIN / "flgpr_sharpness.py").read_text(),
        f"{stem}.dist-info/METADATA": f"Metadata-Version: 2.1\nName: {about['name']}\nVersion: {about['version']}\n",
        f"{stem}.dist-info/WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{stem}.dist-info/entry_points.txt": f"[flgpr.stages]\n{points}\n",
    }
    files[f"{stem}.dist-info/RECORD"] = (
        "".join(f"{name},,\n" for name in files) + f"{stem}.dist-info/RECORD,,\n"
    )
    wheel = folder / f"{stem}-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as target:
        for name, text in files.items():
            target.writestr(name, text)
    return wheel


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    target = tmp_path_factory.mktemp("site")
    options = [
        "--quiet",
        "--no-deps",
        "--no-index",
        "--disable-pip-version-check",
        "--target",
        target,
    ]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, make_wheel(target)], check=True
    )
    return target


@pytest.fixture
def installed(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))


def test_it_is_small():
    assert len((PLUGIN / "flgpr_sharpness.py").read_text().splitlines()) <= 40


def test_its_stage_runs_with_workers_after_a_stop_and_live(lanes, installed, tmp_path):
    recipe = tmp_path / "sharp.toml"
    recipe.write_text(small_recipe("wang2007") + STAGE + DETECTOR)
    lane = lanes / "lane.toml"
    model = flgpr.train(
        [lanes / "train.zarr"], [lanes / "train.csv"], recipe, tmp_path / "model", lanes=[lane]
    )
    assert model.detector.features == ("sharp_HH", "sharp_VV", "sharp_HV", "sharp_VH", "C_HH_F1")
    where = (lanes / "test.zarr", recipe)
    options = {"model": tmp_path / "model", "report": False}
    flgpr.detect(*where, tmp_path / "plain", lane, **options)
    features = pd.read_csv(tmp_path / "plain" / "features.csv")
    assert features["sharp_HH"].corr(features["C_HH_F1"]) > 0.5  # both tell what stands out
    flgpr.detect(*where, tmp_path / "two", lane, workers=2, **options)

    def stop(report):
        if (report["stage"], report["block"]) == ("features", 1):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        flgpr.detect(*where, tmp_path / "stopped", lane, note=stop, **options)
    flgpr.detect(*where, tmp_path / "stopped", lane, **options)
    feed(lanes / "test.zarr", tmp_path / "incoming", float("inf"))
    live = {
        "model": tmp_path / "model",
        "incoming": tmp_path / "incoming",
        "lane": lane,
        "settings": LiveSettings(looks=2),
    }
    LiveRun(LiveOptions(recipe, tmp_path / "live", **live)).run()
    best, mine = (
        read_table(tmp_path / name / "alarms.csv", "alarms") for name in ("plain", "live")
    )
    best = best[best["y"] > best["y"].median()].head(5)  # the background has settled
    assert (cKDTree(mine[["x", "y"]]).query(best[["x", "y"]])[0] < 0.5).all()
    for name in ("alarms.csv", "features.csv", "run_view.npz"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "plain" / name).read_bytes()
        assert (tmp_path / "stopped" / name).read_bytes() == (
            tmp_path / "plain" / name
        ).read_bytes()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "",
            "",
            r"columns.0: stage must be one of .*matched, network, .*got 'sharpness'",
        ),
        ("radius = 0.5", "radius = -1", r"radius: .* got -1"),
        ("radius = 0.5", "size = 1", r"size: no such entry; there are radius"),
        (
            "[[columns]]",
            "[screen]",
            r"screen: stage 'sharpness' of flgpr_sharpness:Sharpness must be .* of the kind screen",
        ),
    ],
    ids=["not installed", "value", "entry", "kind"],
)
def test_what_is_wrong_with_its_table_is_told(request, old, new, message):
    if new:
        request.getfixturevalue("installed")
    with pytest.raises(ValueError, match=message):
        parse_recipe(small_recipe("wang2007") + STAGE.replace(old, new))
