"""Every command that writes, on inputs that cost little, so that tests can call it twice, at once, or kill it."""

import fnmatch
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from typer.testing import CliRunner

from command_inputs import PHRASE, write_inputs
from flgpr.commands import simulation
from flgpr.commands.app import app
from flgpr.model import load_sensor
from flgpr.simulate import load_scene
from flgpr.simulate.bodies.signature import table as nodes
from flgpr.store import open_run, write_whole
from flgpr_ground.signatures import build
from flgpr_papers import overview
from flgpr_papers.kit.cache import read_or_make, store_lane, write_arrays
from flgpr_papers.kit.findings import measured, write_findings
from flgpr_papers.kit.page import draw
from robust import digests


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


class MadeUpStudy:
    """A study that keeps and writes all kinds of files that those of the papers do, by the same functions."""

    page = "study.html"

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
        write_whole(folder / self.page, f"level {level}")
        return folder / self.page


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
    Command(
        "open",
        "open {in}/mapped.npz -o {out}/a.toml",
        "open {in}/mapped.npz {in}/track.csv -o {out}/a.toml",
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
        "compare",
        "compare {in}/alarms.csv {in}/others.csv --truth {in}/truth.csv --lane {in}/lane.toml -o {out}/score",
        "compare {in}/alarms.csv {in}/others.csv --truth {in}/truth.csv --lane {in}/lane.toml --halo 0.5 "
        "-o {out}/score",
    ),
    Command(
        "seal",
        "seal {in}/truth.csv --lane {in}/lane.toml -o {out}/sealed",
        "seal {in}/truth.csv --lane {in}/lane.toml --halo 0.5 -o {out}/sealed",
        typed=f"{PHRASE}\n{PHRASE}\n",
        loose=("sealed",),
    ),
    Command(
        "trial new",
        "trial new {out}/trial",
        "trial new {out}/trial --pd 0.8",
        loose=("trial/register.jsonl",),
    ),
    Command(
        "trial intake",
        "trial intake {out}/trial ACME {in}/alarms.csv",
        beside=("trial",),
    ),
    Command(
        "trial verdict",
        "trial verdict {out}/trial",
        typed=f"{PHRASE}\n",
        beside=("trial",),
        loose=("trial/verdict.*", "trial/*.jsonl"),
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
        "calibrate poses",
        "calibrate poses {in}/ahead.zarr -o {out}/a.zarr",
        "calibrate poses {in}/ahead.zarr --position 0.01 -o {out}/a.zarr",
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
    Command("benchmark template", "benchmark template {out}/mine"),
    Command(
        "benchmark compare",
        "benchmark compare entry {out}/pair --with second",
        beside=("pair",),
        loose=("*costs.csv", "pair/index.html", "*/truth.sealed.json.log.jsonl"),
        drawn=("*/score-*.json",),
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
]


def make_inputs(home):
    """Make what the commands read, and give the commands by name."""
    write_inputs(home)
    return {one.name: _with_inputs(one, home) for one in COMMANDS}


def _with_inputs(command, home):
    command.inputs = home
    return command


def names_of_commands():
    """Name the commands of the command line, groups included."""
    found = []
    for command in app.registered_commands:
        found.append(command.name or command.callback.__name__)
    for group in app.registered_groups:
        found += [f"{group.typer_instance.info.name} {one.name or one.callback.__name__.replace('_', '-')}"
                  for one in group.typer_instance.registered_commands]  # fmt: skip
    return found
