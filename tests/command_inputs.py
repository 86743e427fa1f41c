"""What every command reads: lanes, runs, recordings, scenes, plans and grounds that cost little."""

import shutil
from pathlib import Path

import numpy as np

import flgpr
import io_gpr
from archives import read_archive
from calibrate.echoes import echo
from calibrate.rough_ground import drive
from flgpr.commands.anchoring import write_anchor
from flgpr.geo.anchor import fit_anchor
from flgpr.live.feeding import feed
from flgpr.model import make_run
from flgpr.model.track import make_track
from flgpr.proving_ground import load_ground, run_benchmark, write_score_tables
from flgpr.store import open_run, sample_lane, save_run, write_table
from flgpr_exchange.commands.imports import import_gpr
from flgpr_exchange.cphd.phase_history import write_cphd
from flgpr_exchange.gprmax.deck_folder import write_gprmax_decks
from flgpr_trials.commands.plan import plan_lane
from flgpr_trials.commands.seal import seal
from flgpr_trials.commands.trial import trial_intake, trial_new
from io_geodesy import LANE, on_the_ellipsoid
from io_gprmax import lane_and_sensor, write_output
from scans_mapping import TIME, line_mapping
from small_lane import LANE_TOML, small_recipe, small_run
from submitted import CARD, write_submission
from systems.lanes import SENSOR
from systems.lanes import small_recipe as cut_recipe

DATA = Path(__file__).parent / "data"
PHRASE = "correct horse battery"
TRUTH = "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.0\nb,metal,-0.4,6.3,0.0\nc,metal,0.3,8.4,0.0\n"


def write_inputs(home):
    """Write all files that the commands of ``every_command`` read."""
    sample = sample_lane()
    run = open_run(sample / "run.zarr").load()
    shutil.copy(DATA / "lane_a.npz", home)
    arrays = read_archive(home / "lane_a.npz")
    np.savez(home / "louder.npz", **{**arrays, "data": 2 * arrays["data"]})
    _make_anchors(home)
    save_run(run, home / "run.zarr")
    save_run(run.assign_attrs(title="tied"), home / "tied.zarr")
    save_run(run.isel(pair=slice(0, 2)), home / "few.zarr")
    write_cphd(
        run.isel(pair=slice(0, 5)),
        home / "a.cphd",
        fit_anchor(LANE, on_the_ellipsoid(LANE), "EPSG:4326", 0.02),
    )
    io_gpr.write_dt1(home / "line.dt1", io_gpr.section(24))
    import_gpr(home / "line.dt1", home / "line.zarr", height=0.5)
    _make_mapped(home)
    _make_decks(home)
    _make_scenes(home)
    _make_lane(home)
    _make_rail(home)
    _make_plan(home)
    _make_trial(home)
    _make_ground(home)


def _make_anchors(home):
    places = on_the_ellipsoid(LANE)
    rows = "".join(
        f"{x},{y},{e:.9f},{n:.9f}\n" for (x, y, _), (e, n) in zip(LANE, places, strict=True)
    )
    (home / "points.csv").write_text("lane_x_m,lane_y_m,longitude_deg,latitude_deg\n" + rows)
    write_anchor(home / "points.csv", "EPSG:4326", 0.02, home / "anchor.toml")
    turned = on_the_ellipsoid(LANE, azimuth=0.3)
    rows = "".join(
        f"{x},{y},{e:.9f},{n:.9f}\n" for (x, y, _), (e, n) in zip(LANE, turned, strict=True)
    )
    (home / "turned.csv").write_text("lane_x_m,lane_y_m,longitude_deg,latitude_deg\n" + rows)
    write_anchor(home / "turned.csv", "EPSG:4326", 0.02, home / "turned.toml")


MAPPED = line_mapping("mapped.npz", TIME)


def _make_mapped(home):
    rng = np.random.default_rng(4)
    np.savez(home / "mapped.npz", s=rng.normal(size=(12, 20)) + 1j, t=np.arange(12.0))
    (home / "mapped.toml").write_text(MAPPED)
    fixes = (
        "time_s,x_m,y_m,z_m,heading_deg,pitch_deg,roll_deg\n-10,0,0,2,0,0,0\n100,0,200,2,0,0,0\n"
    )
    (home / "track.csv").write_text(fixes)


def _make_decks(home):
    decks = write_gprmax_decks(*lane_and_sensor(), 1, home / "decks", cells_per_wavelength=12)
    for name, text in decks.files.items():
        if name.endswith(".in"):
            write_output(home / "decks" / name.replace(".in", ".out"), text)


def _make_scenes(home):
    scene = (
        'name = "yard"\nsite = "gravel"\nlength = {length}\n[surface]\ndensity = 2.0\n[track]\npositions = [{places}]\n'
        '[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 1\n'
    )
    (home / "scene.toml").write_text(scene.format(length=6.0, places="0.0, 0.5, 1.0"))
    (home / "other-scene.toml").write_text(scene.format(length=7.0, places="0.0"))
    (home / "sensor.toml").write_text(
        SENSOR.replace("count = 81", "count = 63").replace("14e6", "18e6")
    )
    body = 'name = "{name}"\n[[layers]]\nthickness = 0.02\nzones = [[0.03, 2.0]]\n'
    (home / "body.toml").write_text(body.format(name="tiny"))
    (home / "other-body.toml").write_text(body.format(name="other"))


def _make_lane(home):
    """Make a lane to detect on, its result, alarm lists, scans of it, and what a score needs."""
    run = small_run(scans=24, step=0.3, tones=49).assign_attrs(title="small")
    save_run(run, home / "lane.zarr")
    text = (
        small_recipe()
        .replace("x = [-2.0, 2.0]", "x = [-1.5, 1.5]")
        .replace("variants = true\n", "")
    )
    (home / "small.toml").write_text(text)
    (home / "other.toml").write_text(text.replace("radius = 0.4", "radius = 0.5"))
    (home / "lane.toml").write_text(LANE_TOML)
    (home / "truth.csv").write_text(TRUTH)
    result = flgpr.detect(
        home / "lane.zarr", home / "small.toml", home / "result", home / "lane.toml"
    )
    alarms = result.detections[0].alarms
    write_table(alarms[["x", "y", "confidence"]], home / "alarms.csv")
    write_table(alarms[["x", "y", "confidence"]].iloc[::2], home / "others.csv")
    feed(home / "lane.zarr", home / "incoming", rate=np.inf)
    save_run(run.assign_attrs(title="another"), home / "other-lane.zarr")
    feed(home / "other-lane.zarr", home / "other-incoming", rate=np.inf)
    seal(home / "truth.csv", home / "lane.toml", home / "sealed", passphrase=PHRASE)


def _make_rail(home):
    """Make a radar that goes sideways, with its track and reflectors, as ``flgpr calibrate`` takes them."""
    frequency = np.linspace(1.0e9, 2.5e9, 30)
    reflectors = np.array([[-0.6, 6.0, 0.0], [0.9, 7.5, 0.0]])
    stamp = np.linspace(0, 14, 300)
    way = -1.5 + 3.0 / (1 + np.exp(-(stamp - 7.5) / 0.8))
    track = make_track(stamp, np.stack([way, np.zeros_like(way), np.full_like(way, 1.5)], axis=1))
    time = np.arange(0, 9, 0.1)
    place = np.stack([np.interp(time + 3.4, stamp, track[name]) for name in "xyz"], axis=1)
    pose = np.zeros((time.size, 6))
    signal = echo(place, place, reflectors, frequency)[:, None, None]
    array = frequency, ["VV"], [[0, 0, 0]], [[0, 0, 0]]
    save_run(make_run(signal, *array, pose, time), home / "rail.zarr")
    pose[:, :3] = place
    save_run(make_run(signal, *array, pose, time), home / "posed.zarr")
    write_table(track, home / "rail-track.csv")
    save_run(drive(), home / "ahead.zarr")
    (home / "reflectors.csv").write_text(
        "x_m,y_m,z_m\n" + "".join(f"{x},{y},{z}\n" for x, y, z in reflectors)
    )


def _make_plan(home):
    (home / "sorts.csv").write_text("kind,depth,count\nmetal,0.05,3\nplastic,0.1,2\n")
    plan_lane(home / "lane.toml", home / "sorts.csv", home / "plan.csv", 3, spacing=0.5, edge=0.1)
    rows = (home / "plan-sheet.csv").read_text().splitlines()
    head = rows[0].split(",")
    cells = [row.split(",") for row in rows[1:]]
    for row in cells:
        row[head.index("emplaced")] = "yes"
    (home / "sheet.csv").write_text("\n".join([rows[0], *(",".join(row) for row in cells)]) + "\n")
    cells[0][head.index("emplaced")] = "no"
    (home / "other-sheet.csv").write_text(
        "\n".join([rows[0], *(",".join(row) for row in cells)]) + "\n"
    )


def _make_trial(home):
    trial = home / "trial"
    trial_new(trial, lane=home / "lane.toml")
    book = trial / "register.jsonl"
    seal(
        home / "truth.csv", home / "lane.toml", trial / "truth.sealed", book=book, passphrase=PHRASE
    )
    trial_intake(trial, "ACME", home / "alarms.csv", "A. Director")


GROUND = """
name = "small"
version = {version}
sensor = "{sensor}"
halo = 1.0
fars = [0.02, 0.1]
far = 0.1
reference = "entry"
[scene.surface]
density = 2.0
[scene.track]
positions = [-6.0, -4.0, -2.0, 0.0]
[sites]
arid = "arid-sand"
[sorts]
metal = {{ kind = "metal" }}
[lanes.known]
part = "train"
length = 8.0
targets = [["metal", -0.15, 2]]
[lanes.test]
part = "test"
length = 8.0
targets = [["metal", -0.15, 2]]
[lanes.bare]
part = "test"
length = 8.0
targets = []
[splits.standard]
title = "all"
folds = [{{ train = ["*-known-*"], test = ["*-test-*", "*-bare-*"] }}]
"""


def _make_ground(home):
    """Make a proving ground of two short lanes, an entry that is not trained, and what it found."""
    (home / "ground-sensor.toml").write_text(SENSOR)
    for name, version in (("ground", 3), ("other-ground", 4)):
        text = GROUND.format(version=version, sensor=home / "ground-sensor.toml")
        (home / f"{name}.toml").write_text(text)
    (home / "entry.toml").write_text(cut_recipe("wang2007"))
    run_benchmark([home / "entry.toml"], home / "ground", ground=home / "ground.toml")
    write_score_tables([home / "ground"], home / "ground")
    shutil.copytree(home / "ground", home / "pair", symlinks=True)
    shutil.copytree(home / "pair" / "entries" / "entry", home / "pair" / "entries" / "second")
    ground = load_ground(False, home / "ground.toml")
    card = CARD.replace("tiny-3", ground.title)
    write_submission(home / "submission", ground, card)
    write_submission(home / "other-submission", ground, card, share=1)
