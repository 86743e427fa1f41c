"""Mistakes that people make, and what they are told: none passes in silence, each says what is wrong and what to do.

A row is what somebody did, the words of a command or a call from Python, and what the message must hold.
"""

import re
import shutil
import warnings
import zipfile

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import flgpr
from flgpr.commands.app import app
from flgpr.model import make_run
from flgpr.model.track import make_track, poses_at
from flgpr.scoring import example_roc, pd_mean
from flgpr.store import sample_lane, save_run
from small_lane import LANE_TOML, TARGETS, small_recipe, small_run
from small_results import small_result

TRUTH = pd.DataFrame(
    {
        "target_id": list("abc"),
        "kind": "metal",
        "x": TARGETS[:, 0],
        "y": TARGETS[:, 1],
        "depth": 0.05,
    }
)
FEET = 1 / 0.3048
POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
RUN = small_run()
SMALL = "--recipe {in}/small.toml --lane {in}/lane.toml"
CAUSAL = "demo-mean-self-signature"
SCORE = "--truth {in}/truth.csv --lane {in}/lane.toml -o {out}/score"


def made(**changes):
    """Make the small run with other values."""
    names = ("signal", "frequency", "polarization", "tx_position", "rx_position", "pose")
    return make_run(**{name: RUN[name].values for name in names} | changes)


def posed(change):
    """Make the small run with poses that a function changed in a copy."""
    pose = RUN["pose"].values.copy()
    change(pose)
    return made(pose=pose)


def turned(pose):
    pose[:, 3] = 90.0


def in_feet(pose):
    pose[:, :3] *= FEET


def on_the_globe(pose):
    pose[:, 0] = 13.4 + pose[:, 0] / 70e3
    pose[:, 1] = 52.5 + pose[:, 1] / 111e3


def lost(pose):
    pose[3] = np.nan


def at_other_times(place):
    track = make_track(1.7e9 + np.arange(10.0), np.arange(30.0).reshape(10, 3))
    poses_at(track, np.arange(13.0))


def tables():
    """Return the tables that people give, by the names of their files."""
    hits = TRUTH[["x", "y"]]
    rng = np.random.default_rng(0)
    false = pd.DataFrame({"x": rng.uniform(-0.7, 0.7, 30), "y": rng.uniform(9.5, 9.9, 30)})
    alarms = pd.concat([hits, false], ignore_index=True)
    alarms["confidence"] = np.linspace(9.0, 1.0, len(alarms))
    again = TRUTH.iloc[:1].assign(target_id="again", x=TRUTH["x"] + 0.02)
    return {
        "truth": TRUTH,
        "alarms": alarms,
        "low-is-mine": alarms.assign(confidence=-alarms["confidence"]),
        "nan": alarms.assign(confidence=alarms["confidence"].where(alarms.index != 4)),
        "unranked": alarms[["x", "y"]],
        "swapped": TRUTH.assign(x=TRUTH["y"], y=TRUTH["x"]),
        "other-lane": TRUTH.assign(y=TRUTH["y"] + 100),
        "utm": TRUTH.assign(x=TRUTH["x"] + 390e3, y=TRUTH["y"] + 5820e3),
        "feet": TRUTH.assign(x=TRUTH["x"] * FEET, y=5 + TRUTH["y"] * FEET).assign(y=lambda t: t["y"] - 5),
        "cm": TRUTH.assign(x=TRUTH["x"] * 100, y=TRUTH["y"] * 100),
        "depth-cm": TRUTH.assign(depth=5.0),
        "same-id": pd.concat([TRUTH, TRUTH.iloc[:1]]),
        "again": pd.concat([TRUTH, again]),
        "no-alarms": alarms.iloc[:0],
    }  # fmt: skip


def write_files(home):
    """Write files that are not what they are given for."""
    (home / "small.toml").write_text(small_recipe())
    (home / "lane.toml").write_text(LANE_TOML)
    (home / "far.toml").write_text("x_min = -2\nx_max = 2\ny_min = 100\ny_max = 110\n")
    (home / "reversed.toml").write_text("x_min = 2\nx_max = -2\ny_min = 0\ny_max = 10\n")
    (home / "commas.csv").write_text("x,y,confidence\n0,2,4,5,9,0\n")
    (home / "empty.csv").write_text("")
    (home / "pointer.npz").write_text(POINTER)
    (home / "shot.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(99))
    with zipfile.ZipFile(home / "alarms.xlsx", "w") as book:
        book.writestr("[Content_Types].xml", "<x/>")
    shutil.copy(home / "alarms.xlsx", home / "run.zip")
    (home / "incoming").mkdir()
    points = [(0, 0, 13.4, 52.5), (0, 50, 13.4, 52.50045), (3, 25, 13.40004, 52.500225)]
    rows = [f"{x},{y},{latitude},{longitude}" for x, y, longitude, latitude in points]
    header = "lane_x_m,lane_y_m,longitude_deg,latitude_deg"
    (home / "points.csv").write_text("\n".join([header, *rows]) + "\n")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    home = tmp_path_factory.mktemp("mistakes")
    for name, table in tables().items():
        table.to_csv(home / f"{name}.csv", index=False)
    write_files(home)
    save_run(RUN, home / "run.zarr")
    save_run(RUN, home / "drive" / "run.zarr")
    small_result(home / "result")
    shutil.copytree(sample_lane() / "run.zarr", home / "sample.zarr")
    return home


MISTAKES = {
    "a reaction time of a vehicle without a speed": (
        "live {in}/incoming --recipe {causal} --reaction 1 -o {out}/a",
        "reaction goes with a speed, here or in the recipe, got 1 alone",
    ),
    "a page that is not asked for must not open a browser": (
        "live {in}/incoming --recipe {causal} --no-browser -o {out}/a",
        "--no-browser goes with --view, got it alone",
    ),
    "an end before the beginning": (
        "live {in}/incoming --recipe {causal} --idle -3 -o {out}/a",
        "idle must be 0 s or more, got -3",
    ),
    # The radar engineer
    "tones in MHz": (
        lambda _: made(frequency=RUN["frequency"].values / 1e6),
        "frequency must be in hertz.*is it in MHz",
    ),
    "tones from high to low": (
        lambda _: made(frequency=RUN["frequency"].values[::-1]),
        "frequency must increase strictly",
    ),
    "heading in degrees": (lambda _: posed(turned), "heading within ±2π.*are they in degrees"),
    "polarizations named V-V": (
        lambda _: made(polarization=["H-H", "V-V", "HV"]),
        "must be among HH, HV, VH, VV, got 'H-H'",
    ),
    "scans out of order": (lambda _: made(time=np.arange(13.0)[::-1]), "time must not decrease"),
    "a scan without a pose": (lambda _: posed(lost), "missing pose for 1 of 13 scans.*interpolate"),
    "positions in another time base": (
        at_other_times,
        "must lie within the track.*is the clock offset right",
    ),
    "antennas in rows of x alone": (
        lambda _: made(tx_position=np.zeros(8)),
        r"tx_position must have the shape \(pair, 3\)",
    ),
    "longitude and latitude swapped": (
        "anchor {in}/points.csv --crs EPSG:4326 --accuracy 0.1 --write {out}/a.toml",
        "must fit one another.*or x and y",
    ),
    # The student
    "truth given to detect": (
        "detect {in}/truth.csv -o {out}/a",
        "must be a run store.*a table: alarms and truth",
    ),
    "truth given as the recipe": (
        "detect {in}/run.zarr --recipe {in}/truth.csv -o {out}/a",
        "truth.csv: not valid TOML",
    ),
    "a recipe misspelt": ("detect {in}/run.zarr --recipe fuzed -o {out}/a", "did you mean fused"),
    "a recipe of another array": (
        "detect {in}/run.zarr --recipe wang2007 -o {out}/a",
        "does not fit the run.*`flgpr recipe for RUN` writes one",
    ),
    "a recipe that learns, without a model": (
        "detect {in}/sample.zarr --recipe fused -o {out}/a",
        "needs a model: make one with `flgpr train`",
    ),
    "a run given as the model": (
        f"detect {{in}}/run.zarr {SMALL} --model {{in}}/run.zarr -o {{out}}/a",
        "not a whole model.*a run: ",
    ),
    "a result given as a run": (
        "detect {in}/result -o {out}/a",
        "no run store.*a result: `flgpr view` shows it",
    ),
    "a run given as a result": (
        "score {in}/run.zarr --truth {in}/truth.csv",
        "a run: `flgpr detect` makes a result of it",
    ),
    "the folder around a run": (
        "detect {in}/drive -o {out}/a",
        "a folder that holds run.zarr: name it",
    ),
    "a zipped run": ("detect {in}/run.zip -o {out}/a", "a ZIP archive or an Excel file: unpack it"),
    "a pointer of Git LFS": ("detect {in}/pointer.npz -o {out}/a", "not fetched: git lfs pull"),
    "a screenshot for data": ("detect {in}/shot.png -o {out}/a", "a picture: give the data"),
    "a table in memory for a run": (
        lambda _: flgpr.detect(TRUTH, "demo"),
        "run stores or datasets, got a DataFrame",
    ),
    "a run in memory for a result": (
        lambda _: flgpr.score(RUN, TRUTH),
        "alarms must be a result.*got a Dataset",
    ),
    "the run as the output": (
        f"detect {{in}}/run.zarr {SMALL} -o {{in}}/run.zarr",
        "must be a new folder or an older result",
    ),
    "more workers than cores can serve": (
        f"detect {{in}}/run.zarr {SMALL} --workers 5000 -o {{out}}/a",
        "workers must be at most 8 for each of the",
    ),
    "a rate below zero": (
        f"detect {{in}}/run.zarr {SMALL} --far -1 -o {{out}}/a",
        "far must be above 0 and at most 10 per m²",
    ),
    "a lane outside of the run": (
        "detect {in}/sample.zarr --recipe demo --lane {in}/far.toml -o {out}/a",
        "lane must lie where scans see it",
    ),
    # The director
    "alarms without confidences": (
        f"score {{in}}/unranked.csv {SCORE}",
        "must have the columns confidence.*--unranked takes",
    ),
    "a decimal comma in a table of commas": (
        f"score {{in}}/commas.csv {SCORE}",
        "line 2 .*decimal commas need semicolons",
    ),
    "an Excel file for CSV": (
        f"score {{in}}/alarms.xlsx {SCORE}",
        "table as text.*save the sheet as CSV",
    ),
    "a screenshot for alarms": (f"score {{in}}/shot.png {SCORE}", "table as text.*a picture"),
    "an empty file": (f"score {{in}}/empty.csv {SCORE}", "must have a header, got an empty file"),
    "a row without a confidence": (
        f"score {{in}}/nan.csv {SCORE}",
        "number in every row, got 1 of 33.*in row 5",
    ),
    "truth and alarms swapped": (
        "score {in}/truth.csv --truth {in}/alarms.csv {lane}",
        "must have the columns confidence",
    ),
    "truth with its axes swapped": (
        "score {in}/alarms.csv --truth {in}/swapped.csv {lane}",
        "reach if it is with x and y swapped",
    ),
    "truth of another lane": (
        "score {in}/alarms.csv --truth {in}/other-lane.csv {lane}",
        "are they of another lane",
    ),
    "truth in UTM": (
        "score {in}/alarms.csv --truth {in}/utm.csv {lane}",
        "in another frame .*need an --anchor",
    ),
    "truth in feet": (
        "score {in}/alarms.csv --truth {in}/feet.csv {lane}",
        "in reach if they are in ft",
    ),
    "truth in centimetres": (
        "score {in}/alarms.csv --truth {in}/cm.csv {lane}",
        "in reach if they are in cm",
    ),
    "two rows of one name": (
        "score {in}/alarms.csv --truth {in}/same-id.csv {lane}",
        "target_id must be unique, got 'a'",
    ),
    "a halo in centimetres": (
        f"score {{in}}/alarms.csv {SCORE} --halo 50",
        "radius 50 m .*is the halo in metres",
    ),
    "a halo below zero": (
        f"score {{in}}/alarms.csv {SCORE} --halo -1",
        "halo must be a positive radius in metres, got -1",
    ),
    "a lane whose borders are swapped": (
        "score {in}/alarms.csv --truth {in}/truth.csv --lane {in}/reversed.toml -o {out}/a",
        "must have x_max > x_min",
    ),
    "a list without its lane": (
        "score {in}/alarms.csv --truth {in}/truth.csv -o {out}/a",
        "an alarm list needs --lane",
    ),
    "a score without truth": ("score {in}/alarms.csv {lane}", "--truth is needed, or --sealed"),
    "a score of a list that is not there": (
        f"score {{in}}/none.csv {SCORE}",
        "alarm list or result not found",
    ),
    # The driver
    "a recipe that needs the whole run": (
        "live {in}/incoming --recipe demo -o {out}/a",
        "cannot run live: .*only the whole run shows",
    ),
    "a threshold no confidence has": (
        "live {in}/incoming --recipe {causal} --threshold 1e9 -o {out}/a",
        "must lie between -1e.06 and 1e.06",
    ),
    "the page of a folder that is not there": (
        "view {in}/none --no-browser",
        "nothing to view at ",
    ),
    "the page of a table": (
        "view {in}/truth.csv --no-browser",
        "must be a result folder, a run.*a table",
    ),
}
"""Refused: nothing is written."""

NOTHING_CAME = {
    "scans that never come": (
        "live {in}/incoming --recipe {causal} --idle 0.1 -o {out}/a",
        "no scan came from .*incoming: ",
    ),
    "a folder of scans that is not there": (
        "live {in}/none --recipe {causal} --idle 0.1 -o {out}/a",
        "no scan came from .*, which does not exist",
    ),
    "a run given to live": (
        "live {in}/run.zarr --recipe {causal} --idle 0.1 -o {out}/a",
        "`flgpr feed` plays a run into a folder",
    ),
}
"""Refused once it is clear that nothing comes: a script must not take it for a drive."""

DOUBTS = {
    "confidences that are low for mines": (
        f"score {{in}}/low-is-mine.csv {SCORE}",
        "is the order reversed",
    ),
    "a rate beyond the list": (
        f"score {{in}}/alarms.csv {SCORE} --far 500",
        "beyond the .* of the whole list",
    ),
    "a mean of Pd beyond the list": (
        lambda _: pd_mean(example_roc([3.0, 2.0, 1.0], [1, 0, 0], 50.0, n_targets=2), 0.5),
        "curve ends at 0.04 false alarms per m².*to far_max of 0.5 its last Pd, 0.5, is taken",
    ),
    "depths in centimetres": (
        "score {in}/alarms.csv --truth {in}/depth-cm.csv {lane}",
        "are these centimetres",
    ),
    "two rows of one target": (
        "score {in}/alarms.csv --truth {in}/again.csv {lane}",
        "two rows of one target",
    ),
    "conjugated data": (
        f"detect {{in}}/conjugated.zarr {SMALL} -o {{out}}/a",
        "the data are conjugated",
    ),
    "positions in feet": (f"detect {{in}}/feet.zarr {SMALL} -o {{out}}/a", "antennas 6.56 m high"),
    "positions in longitude and latitude": (
        f"detect {{in}}/globe.zarr {SMALL} -o {{out}}/a",
        "no scan sees the lane; look at its borders",
    ),
    "a model of another array": (
        f"detect {{in}}/wide.zarr {SMALL} --model {{in}}/model -o {{out}}/a",
        r"trained with another array \(.* GHz, 2 m wide, 2 m high\) .* this run's \(.* 4 m wide",
    ),
    "real data": ("check {in}/real.zarr", "Doubtful: signal is real.*import I and Q"),
    "real data in Python": (
        lambda _: made(signal=RUN["signal"].values.real),
        "signal is real.*mirrored path",
    ),
    "scans in another order than their poses": (
        "check {in}/mixed-scans.zarr",
        "are the scans in the order of their poses",
    ),
    "scans and poses in another order": (
        "check {in}/mixed.zarr",
        "the course turns round at .*are scans and poses in the order",
    ),
    "HH and VV exchanged, which nothing shows": (
        "check {in}/run.zarr",
        "not observable .*HH and VV exchanged",
    ),
    "a model tried on the run it was trained on": (
        f"detect {{in}}/run.zarr {SMALL} --model {{in}}/model -o {{out}}/a",
        "trained on this very run",
    ),
}
"""Done, and said, because it may be meant."""


def said(action, place, output):
    """Do what somebody did; return whether it was refused, and all that was said."""
    if callable(action):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            try:
                action(place)
            except ValueError as error:
                return True, str(error)
        return False, " ".join(str(one.message) for one in told)
    words = (
        action.replace("{causal}", CAUSAL)
        .replace("{lane}", "--lane {in}/lane.toml -o {out}/a")
        .replace("{in}", str(place))
        .replace("{out}", str(output))
        .split()
    )
    done = CliRunner().invoke(app, words, input="")
    assert done.exit_code in (0, 2), (done.output, done.exception)
    return done.exit_code == 2, " ".join(done.output.split())


@pytest.mark.filterwarnings("always:image.y should")  # of recipes that fit no array of these
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_refused_and_the_message_says_what_to_do(mistake, place, tmp_path):
    action, pattern = MISTAKES[mistake]
    refused, told = said(action, place, tmp_path)
    assert refused, told
    assert re.search(pattern, told), told
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow("waits for scans")
@pytest.mark.parametrize("mistake", NOTHING_CAME)
def test_a_drive_without_scans_is_refused_at_its_end(mistake, doubted, tmp_path):
    action, pattern = NOTHING_CAME[mistake]
    refused, told = said(action, doubted, tmp_path)
    assert refused, told
    assert re.search(pattern, told), told
    assert (tmp_path / "a" / "live.jsonl").read_bytes() == b""


@pytest.fixture(scope="module")
def doubted(place):
    save_run(made(signal=RUN["signal"].values.conj()), place / "conjugated.zarr")
    save_run(posed(in_feet), place / "feet.zarr")
    save_run(posed(on_the_globe), place / "globe.zarr")
    mixed = np.random.default_rng(0).permutation(RUN.sizes["scan"])
    signal = RUN["signal"].values
    save_run(made(signal=signal[mixed]), place / "mixed-scans.zarr")
    save_run(made(signal=signal[mixed], pose=RUN["pose"].values[mixed]), place / "mixed.zarr")
    save_run(
        made(tx_position=2 * RUN["tx_position"].values, rx_position=2 * RUN["rx_position"].values),
        place / "wide.zarr",
    )
    with pytest.warns(UserWarning, match="signal is real"):
        save_run(made(signal=signal.real), place / "real.zarr")
    flgpr.train([place / "run.zarr"], [place / "truth.csv"], place / "small.toml", place / "model",
                lanes=[place / "lane.toml"])  # fmt: skip
    return place


@pytest.mark.slow("detects, scores and trains")
@pytest.mark.filterwarnings("always:image.y should")
@pytest.mark.parametrize("doubt", DOUBTS)
def test_what_may_be_a_mistake_is_said(doubt, doubted, tmp_path):
    action, pattern = DOUBTS[doubt]
    refused, told = said(action, doubted, tmp_path)
    assert not refused, told
    assert re.search(pattern, told), told


@pytest.mark.slow("trains")
def test_the_model_of_another_recipe_is_refused(doubted, tmp_path):
    words = "detect {in}/sample.zarr --recipe demo --model {in}/model -o {out}/a"
    refused, told = said(words, doubted, tmp_path)
    assert refused
    assert "missing: C_HH_F1, M_VV_F1, P_alpha_F1; is it the model of another recipe?" in told
    assert not (tmp_path / "a").exists()
