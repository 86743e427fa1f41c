"""Every command that writes, on inputs that cost little, so that tests can call it twice, at once, or kill it."""

import fnmatch
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from typer.testing import CliRunner

import flgpr
import io_gpr
from archives import read_archive
from calibrate.echoes import echo
from flgpr.chain.progress import silent
from flgpr.commands import simulation
from flgpr.commands.anchoring import anchor_from_points, write_anchor
from flgpr.commands.app import app
from flgpr.commands.imports import import_gpr
from flgpr.commands.plan import plan_lane
from flgpr.commands.sealed_scoring import seal_truth_file
from flgpr.formats.cphd import write_cphd
from flgpr.geo.anchor import fit_anchor
from flgpr.live.feeding import feed
from flgpr.model import load_sensor, make_run
from flgpr.model.track import make_track
from flgpr.proving_ground import load_ground, run_benchmark, write_score_tables
from flgpr.simulate import load_scene
from flgpr.simulate.bodies.signature import build
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.store import open_run, sample_lane, save_run, write_table, write_whole
from flgpr_papers import overview, reasons
from flgpr_papers.kit.cache import read_or_make, store_lane, write_arrays
from flgpr_papers.kit.findings import measured, write_findings
from flgpr_papers.kit.page import draw
from flgpr_papers.kit.reasons import Trial
from flgpr_papers.worlds import statements
from io_geodesy import LANE, on_the_ellipsoid
from io_gprmax import lane_and_sensor, write_output
from robust import digests
from scans_mapping import TIME, line_mapping
from small_lane import LANE_TOML, small_recipe, small_run
from submitted import CARD, write_submission
from systems.lanes import SENSOR
from systems.lanes import small_recipe as cut_recipe

DATA = Path(__file__).parent / "data"
PHRASE = "correct horse battery"
TRUTH = "target_id,kind,x,y,depth\na,metal,0.2,4.5,0.0\nb,metal,-0.4,6.3,0.0\nc,metal,0.3,8.4,0.0\n"


@dataclass
class Command:
    """A command: ``{in}`` stands for the folder of inputs, ``{out}`` for that of outputs."""

    name: str
    words: str
    #: the same command on another input, which must be refused; none where there is no other, or it may be added
    other: str = ""
    typed: str = ""
    #: names in the folder of inputs that it works on in place, and which are copied to the folder of outputs
    beside: tuple[str, ...] = ()
    #: files that hold times or random numbers: they must be there, with whatever bytes
    loose: tuple[str, ...] = ()
    #: names with a random number or a digest of one: as many must be there
    drawn: tuple[str, ...] = ()
    #: what entries share while they run: a stop may come after a pass and before it is shared, and
    #: whoever needs it then computes it
    cache: tuple[str, ...] = ()
    inputs: Path = field(default_factory=Path)

    def start(self, output):
        """Make the folder of outputs as it is before the command is first given."""
        output.mkdir()
        for name in self.beside:
            source = self.inputs / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, output / name)

    def run(self, output, words=None):
        """Give the command in this process."""
        text = (words or self.words).replace("{in}", str(self.inputs)).replace("{out}", str(output))
        return CliRunner().invoke(app, text.split(), input=self.typed)

    def __call__(self, output):
        done = self.run(output)
        assert done.exit_code == 0, (self.name, done.exit_code, done.output, done.exception)

    def content(self, output):
        """Digests of all files, but for those with times or random numbers: they are named."""
        found = digests(output)
        cached = {name for pattern in self.cache for name in fnmatch.filter(found, pattern)}
        found = {name: one for name, one in found.items() if name not in cached}
        content = dict(found)
        for pattern in self.loose:
            content |= dict.fromkeys(fnmatch.filter(found, pattern), "there")
        for pattern in self.drawn:
            names = fnmatch.filter(found, pattern)
            content = {name: one for name, one in content.items() if name not in names}
            content[pattern] = f"{len(names)} there"
        return content


def make_cheap(command, change=setattr):
    """Let a command that works for long do with numbers that cost nothing: what counts here is how they are written."""
    if command.name == "simulate signature":
        _make_signatures_cheap(change)
    if command.name.startswith("reproduce"):
        _make_studies_cheap(command.inputs, change)


def _make_studies_cheap(inputs, change):
    """Let a study with a lane, a record, an array, a figure and a page stand for those of the papers."""
    study = MadeUpStudy(inputs)
    change(overview, "study_of", lambda _: study)
    for module in (statements, reasons):
        change(module, "import_module", lambda _: study)


class MadeUpStudy:
    """A study that keeps and writes all kinds of files that those of the papers do, by the same functions."""

    PAGE = "study.html"

    def __init__(self, inputs):
        self.scene = load_scene(inputs / "scene.toml")
        self.sensor = load_sensor(inputs / "sensor.toml")

    def reproduce(self, folder, quick, track, world):
        folder.mkdir(parents=True, exist_ok=True)
        store, _, _ = store_lane(folder / "lanes", self.scene, 3, self.sensor, track)
        level = read_or_make(folder / "parts" / "level.json", lambda: _rms(store))
        arrays = folder / "parts" / "level.arrays"
        if not arrays.is_file():
            write_arrays(arrays, {"level": np.array([level])})
        found = [measured("A above B", "", "level", (level, level - 0.1, level + 0.1))]
        write_findings(folder, found, quick, world=world)
        figure = Figure(figsize=(1, 1))
        figure.subplots().plot([level])
        write_whole(folder / "level.png", draw(figure, quick, dpi=20))
        page = folder / self.PAGE
        write_whole(page, f"level {level}")
        return page

    def findings_in(self, _world, work):
        store_lane(work, self.scene, 3, self.sensor, silent)
        return [measured("A above B", "", "level", (0.2, 0.1, 0.3), verdict="agrees")]

    def trials(self, home, _quick, _world, track):
        store, _, _ = store_lane(home / "lanes", self.scene, 3, self.sensor, track)
        level = read_or_make(home / "reasons" / "level.json", lambda: _rms(store))
        return [Trial("A above B", "", "nothing", "level", (level, 0.0, 2 * level), "one lane")]


def _rms(store):
    return float(np.sqrt(np.mean(np.abs(open_run(store)["signal"].values) ** 2)))


def _make_signatures_cheap(change):
    """Let tables of signatures have six nodes."""
    for name, count in (("PERMITTIVITY", 2), ("LOSS", 2), ("FREQUENCY", 3)):
        change(nodes, name, getattr(nodes, name)[:count])
    change(simulation, "PERMITTIVITY", nodes.PERMITTIVITY)
    change(simulation, "FREQUENCY", nodes.FREQUENCY)
    change(build, "solve_piece", _made_up)


def _made_up(body, soil, frequency):
    rng = np.random.default_rng([soil, frequency, len(body.name)])
    shape = (nodes.DEPTH.size, 1, nodes.SINE.size, nodes.SEPARATION.size, 4)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


COMMANDS = [
    Command(
        "import fullwave",
        "import fullwave {in}/lane_a.npz -o {out}/a.zarr",
        "import fullwave {in}/louder.npz -o {out}/a.zarr",
    ),
    Command(
        "import gprmax",
        "import gprmax {in}/decks -o {out}/a.zarr",
        "import gprmax {in}/decks -o {out}/a.zarr --keep-direct",
    ),
    Command(
        "import mapped",
        "import mapped {in}/mapped.toml --track {in}/track.csv -o {out}/a.zarr",
        "import mapped {in}/mapped.toml --track {in}/track.csv --clock-offset 1 -o {out}/a.zarr",
    ),
    Command(
        "import cphd",
        "import cphd {in}/a.cphd -o {out}/a.zarr",
        "import cphd {in}/a.cphd --anchor {in}/anchor.toml -o {out}/a.zarr",
    ),
    Command(
        "import gpr",
        "import gpr {in}/line.dt1 -o {out}/a.zarr",
        "import gpr {in}/line.dt1 -o {out}/a.zarr --height 0.1",
    ),
    Command(
        "import gpr survey",
        "import gpr {in}/line.dt1 {in}/line.dt1 -o {out}/a.zarr --line-spacing 0.5",
        "import gpr {in}/line.dt1 {in}/line.dt1 -o {out}/a.zarr --line-spacing 0.6",
    ),
    Command(
        "import table",
        "import table {in}/truth.csv --kind truth -o {out}/a.csv",
        "import table {in}/reflectors.csv --kind alarms --columns confidence=z_m -o {out}/a.csv",
    ),
    Command(
        "simulate",
        "simulate {in}/scene.toml --sensor {in}/sensor.toml -o {out}/a.zarr --truth {out}/key.csv --seed 3",
        "simulate {in}/scene.toml --sensor {in}/sensor.toml -o {out}/a.zarr --truth {out}/key.csv --seed 4",
    ),
    Command(
        "simulate preview",
        "simulate {in}/scene.toml --preview {out}/a.png",
    ),
    Command(
        "simulate gprmax",
        "simulate {in}/scene.toml --sensor {in}/sensor.toml --engine gprmax -o {out}/decks --cells 4",
        "simulate {in}/scene.toml --sensor {in}/sensor.toml --engine gprmax -o {out}/decks --cells 5",
    ),
    Command(
        "simulate signature",
        "simulate signature {in}/body.toml -o {out}/a.npz",
        "simulate signature {in}/other-body.toml -o {out}/a.npz",
    ),
    Command(
        "prepare",
        "prepare {in}/run.zarr --background -o {out}/a.zarr",
        "prepare {in}/run.zarr --background --agc 5 -o {out}/a.zarr",
    ),
    Command(
        "image",
        "image {in}/tied.zarr --spacing 0.2 --anchor {in}/anchor.toml -o {out}/a.png -o {out}/a.npz -o {out}/a.zarr "
        "-o {out}/a.tif",
        "image {in}/tied.zarr --spacing 0.3 --anchor {in}/anchor.toml -o {out}/a.npz",
    ),
    Command(
        "image recording",
        "image {in}/line.dt1 --gain -o {out}/a.png -o {out}/a.npz",
        "image {in}/line.dt1 --dewow -o {out}/a.npz",
    ),
    Command(
        "image depth",
        "image {in}/line.zarr --permittivity 9 --x -0.2 0.2 --depth 0.2 --depth 0.4 -o {out}/a.png -o {out}/a.npz",
        "image {in}/line.zarr --permittivity 9 --x -0.2 0.2 --depth 0.3 -o {out}/a.npz",
    ),
    Command(
        "design",
        "design {in}/sensor.toml -o {out}/a.html",
        "design {in}/sensor.toml --depth 0.1 -o {out}/a.html",
    ),
    Command("info", "info {in}/run.zarr --plot {out}/a.png"),
    Command(
        "info files",
        "info {in}/mapped.npz {in}/track.csv --mapping {out}/a.toml",
        "info {in}/mapped.npz {in}/reflectors.csv --mapping {out}/a.toml",
    ),
    Command(
        "recipe for",
        "recipe for {in}/run.zarr -o {out}/a.toml",
        "recipe for {in}/line.zarr -o {out}/a.toml",
    ),
    Command(
        "anchor",
        "anchor {in}/points.csv --crs EPSG:4326 --accuracy 0.02 --write {out}/a.toml --lane {in}/lane.toml "
        "--outline {out}/a.geojson --run {in}/run.zarr -o {out}/a.zarr",
        "anchor {in}/points.csv --crs EPSG:4326 --accuracy 0.03 --write {out}/a.toml --lane {in}/lane.toml",
    ),
    *(
        Command(
            f"export {to}",
            f"export {{in}}/result -o {{out}}/a.{to} --to {to} --anchor {{in}}/anchor.toml",
            f"export {{in}}/result -o {{out}}/a.{to} --to {to} --anchor {{in}}/turned.toml",
        )
        for to in ("geojson", "gpkg", "kml", "gpx", "geotiff")
    ),
    Command(
        "export csv",
        "export {in}/truth.csv -o {out}/a.csv --to csv --anchor {in}/anchor.toml",
        "export {in}/truth.csv -o {out}/a.csv --to csv --anchor {in}/turned.toml",
    ),
    Command(
        "export qgis",
        "export {in}/result -o {out}/a.zip --to qgis --anchor {in}/anchor.toml",
        "export {in}/result -o {out}/a.zip --to qgis --anchor {in}/turned.toml",
    ),
    Command(
        "export cphd",
        "export {in}/few.zarr -o {out}/a.cphd --to cphd --anchor {in}/anchor.toml",
        "export {in}/few.zarr -o {out}/a.cphd --to cphd --anchor {in}/turned.toml",
    ),
    Command(
        "export sigmf",
        "export {in}/few.zarr -o {out}/a --to sigmf --anchor {in}/anchor.toml",
        "export {in}/few.zarr -o {out}/a --to sigmf --anchor {in}/turned.toml",
    ),
    Command(
        "detect",
        "detect {in}/lane.zarr --recipe {in}/small.toml --lane {in}/lane.toml -o {out}/result",
        "detect {in}/lane.zarr --recipe {in}/other.toml --lane {in}/lane.toml -o {out}/result",
    ),
    Command(
        "detect in sections",
        "detect {in}/lane.zarr --recipe {in}/small.toml --lane {in}/lane.toml --section 4 -o {out}/result",
        "detect {in}/lane.zarr --recipe {in}/small.toml --lane {in}/lane.toml --section 3 -o {out}/result",
    ),
    Command(
        "detect a survey",
        "detect {in}/lane.zarr {in}/other-lane.zarr --recipe {in}/small.toml --lane {in}/lane.toml "
        "--lane {in}/lane.toml -o {out}/survey",
        "detect {in}/lane.zarr {in}/other-lane.zarr --recipe {in}/other.toml --lane {in}/lane.toml "
        "--lane {in}/lane.toml -o {out}/survey",
    ),
    Command(
        "train",
        "train {in}/lane.zarr --truth {in}/truth.csv --recipe {in}/small.toml --lane {in}/lane.toml --feature C_HH_F1 "
        "--feature M_VV_F1 -o {out}/model",
        "train {in}/lane.zarr --truth {in}/truth.csv --recipe {in}/small.toml --lane {in}/lane.toml --feature C_HH_F1 "
        "-o {out}/model",
    ),
    Command(
        "score in a result",
        "score {out}/result --truth {in}/truth.csv",
        "score {out}/result --truth {in}/truth.csv --far 0.02",
        beside=("result",),
    ),
    Command(
        "score a list",
        "score {in}/alarms.csv --truth {in}/truth.csv --lane {in}/lane.toml -o {out}/score",
        "score {in}/alarms.csv --truth {in}/truth.csv --lane {in}/lane.toml --halo 0.5 -o {out}/score",
    ),
    Command(
        "score side by side",
        "score {in}/alarms.csv {in}/others.csv --truth {in}/truth.csv --lane {in}/lane.toml -o {out}/score",
        "score {in}/alarms.csv {in}/others.csv --truth {in}/truth.csv --lane {in}/lane.toml --halo 0.5 -o {out}/score",
    ),
    Command(
        "score --seal",
        "score {in}/truth.csv --seal --lane {in}/lane.toml -o {out}/sealed",
        "score {in}/truth.csv --seal --lane {in}/lane.toml --halo 0.5 -o {out}/sealed",
        typed=f"{PHRASE}\n{PHRASE}\n",
        loose=("sealed",),
    ),
    Command(
        "score --sealed",
        "score {in}/alarms.csv --sealed {out}/sealed -o {out}/score",
        "score {in}/others.csv --sealed {out}/sealed -o {out}/score",
        typed=f"{PHRASE}\n",
        beside=("sealed",),
        loose=("sealed.log.jsonl", "score/*"),
    ),
    Command("demo", "demo -o {out}/result"),
    Command(
        "plan lane",
        "plan lane {in}/lane.toml {in}/sorts.csv -o {out}/a.csv --seed 3 --spacing 0.5 --edge 0.1 --anchor "
        "{in}/anchor.toml",
        "plan lane {in}/lane.toml {in}/sorts.csv -o {out}/a.csv --seed 4 --spacing 0.5 --edge 0.1",
        loose=("*.register.jsonl",),
    ),
    Command(
        "plan lane of a seed that is drawn",
        "plan lane {in}/lane.toml {in}/sorts.csv -o {out}/a.csv --spacing 0.5 --edge 0.1",
        "plan lane {in}/lane.toml {in}/sorts.csv -o {out}/a.csv --spacing 0.6 --edge 0.1",
        loose=("*",),
    ),
    Command(
        "plan register",
        "plan register {in}/small.toml --book {out}/plan.csv.register.jsonl",
        beside=("plan.csv.register.jsonl",),
        loose=("*.register.jsonl",),
    ),
    Command(
        "plan survey",
        "plan survey {out}/plan.csv {in}/sheet.csv -o {out}/truth.csv",
        "plan survey {out}/plan.csv {in}/other-sheet.csv -o {out}/truth.csv",
        beside=("plan.csv", "plan.csv.register.jsonl"),
        loose=("*.register.jsonl",),
    ),
    Command(
        "calibrate clock",
        "calibrate clock {in}/rail.zarr --area -1.5 1.8 5.5 8.5 --spacing 0.15 --offsets 3.2 3.6 --step 0.1 "
        "-o {out}/a.zarr",
        "calibrate clock {in}/rail.zarr --area -1.5 1.8 5.5 8.0 --spacing 0.15 --offsets 3.2 3.6 --step 0.07 "
        "-o {out}/a.zarr",
    ),
    Command(
        "calibrate range-bias",
        "calibrate range-bias {in}/posed.zarr --reflectors {in}/reflectors.csv -o {out}/a.zarr",
        "calibrate range-bias {in}/posed.zarr --reflectors {in}/reflectors.csv --keep-standing -o {out}/a.zarr",
    ),
    Command(
        "calibrate joint",
        "calibrate joint {in}/rail.zarr --reflectors {in}/reflectors.csv --offsets 3.2 3.6 --step 0.1 --biases -0.5 1 "
        "-o {out}/a.zarr",
        "calibrate joint {in}/rail.zarr --reflectors {in}/reflectors.csv --offsets 3.2 3.6 --step 0.1 --biases -0.6 1 "
        "-o {out}/a.zarr",
    ),
    Command(
        "live",
        "live {in}/incoming --recipe {in}/small.toml --snapshot 3 -o {out}/live",
        "live {in}/other-incoming --recipe {in}/small.toml --snapshot 3 -o {out}/live",
        loose=("live/live.jsonl", "live/live.json"),
    ),
    Command(
        "feed",
        "feed {in}/lane.zarr {out}/in --rate 0 --lead 0",
        "feed {in}/run.zarr {out}/in --rate 0 --lead 0",
    ),
    Command(
        "benchmark run",
        "benchmark run {in}/entry.toml --ground {in}/ground.toml -o {out}/ground",
        "benchmark run {in}/entry.toml --ground {in}/other-ground.toml -o {out}/ground",
        loose=(
            "*costs.csv",
            "*costs.json",
            "ground/index.html",
            "*/truth.sealed.json*",
        ),
        drawn=("*/score-*.json",),
        cache=("ground/kept/*",),
    ),
    Command(
        "benchmark table",
        "benchmark table {out}/ground",
        beside=("ground",),
        loose=("*costs.csv", "ground/index.html", "*/truth.sealed.json.log.jsonl"),
        drawn=("*/score-*.json",),
    ),
    Command(
        "benchmark oracle",
        "benchmark oracle {out}/ground --recipe {in}/entry.toml",
        beside=("ground",),
        loose=("*costs.csv", "*costs.json", "ground/index.html", "*/truth.sealed.json.log.jsonl"),
        drawn=("*/score-*.json",),
    ),
    Command(
        "benchmark make",
        "benchmark make --ground {in}/ground.toml -o {out}/ground",
        "benchmark make --ground {in}/other-ground.toml -o {out}/ground",
        loose=("*/truth.sealed.json",),
    ),
    Command(
        "benchmark croissant",
        "benchmark croissant {in}/ground -o {out}/croissant.json",
        "benchmark croissant --ground {in}/other-ground.toml -o {out}/croissant.json",
    ),
    Command(
        "benchmark enter",
        "benchmark enter {in}/submission --ground {in}/ground.toml -o {out}/ground",
        "benchmark enter {in}/other-submission --ground {in}/ground.toml -o {out}/ground",
        loose=("*/truth.sealed.json*",),
        drawn=("*/score-*.json",),
    ),
    Command(
        "benchmark leaderboard",
        "benchmark leaderboard {out}/ground -o {out}/page.html",
        beside=("ground",),
    ),
    Command(
        "reproduce",
        "reproduce all -o {out}/papers --quick",
        "reproduce all -o {out}/papers",
    ),
    Command(
        "reproduce worlds",
        "reproduce worlds --part statements -o {out}/map --quick",
        "reproduce worlds --part statements -o {out}/map",
        loose=("map/statements/*.json",),
    ),
    Command("reproduce reasons", "reproduce reasons -o {out}/papers --quick"),
]


def make_inputs(home):
    """Make what the commands read, and give them."""
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
    _make_ground(home)
    return {one.name: _with_inputs(one, home) for one in COMMANDS}


def _with_inputs(command, home):
    command.inputs = home
    return command


def _make_anchors(home):
    places = on_the_ellipsoid(LANE)
    rows = "".join(
        f"{x},{y},{e:.9f},{n:.9f}\n" for (x, y, _), (e, n) in zip(LANE, places, strict=True)
    )
    (home / "points.csv").write_text("lane_x_m,lane_y_m,longitude_deg,latitude_deg\n" + rows)
    write_anchor(anchor_from_points(home / "points.csv", "EPSG:4326", 0.02), home / "anchor.toml")
    turned = on_the_ellipsoid(LANE, azimuth=0.3)
    rows = "".join(
        f"{x},{y},{e:.9f},{n:.9f}\n" for (x, y, _), (e, n) in zip(LANE, turned, strict=True)
    )
    (home / "turned.csv").write_text("lane_x_m,lane_y_m,longitude_deg,latitude_deg\n" + rows)
    write_anchor(anchor_from_points(home / "turned.csv", "EPSG:4326", 0.02), home / "turned.toml")


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
    decks = simulation.write_gprmax_decks(
        *lane_and_sensor(), 1, home / "decks", cells_per_wavelength=12
    )
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
    seal_truth_file(home / "truth.csv", home / "lane.toml", home / "sealed", PHRASE)


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
    ground = load_ground(False, home / "ground.toml")
    card = CARD.replace("tiny-3", ground.title)
    write_submission(home / "submission", ground, card)
    write_submission(home / "other-submission", ground, card, share=1)


def names_of_commands():
    """Name the commands of the command line, groups included."""
    found = []
    for command in app.registered_commands:
        found.append(command.name or command.callback.__name__)
    for group in app.registered_groups:
        found += [f"{group.typer_instance.info.name} {one.name or one.callback.__name__.replace('_', '-')}"
                  for one in group.typer_instance.registered_commands]  # fmt: skip
    return found
