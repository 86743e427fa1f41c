"""Kill commands again and again: nothing breaks, nothing is stuck, and the end is the same to the byte.

Half of the kills come at a random one of the file operations, which is exact and repeatable; half at a random time.
``FLGPR_KILLS`` tells how many kills there are of an import, of a detection, and of all commands that write together; of
a detection in sections half as many. Without it all commands together are killed a few times.
"""

import json
import multiprocessing
import os
import shutil
import signal
import sys
from pathlib import Path

import numpy as np
import pytest

import bag
import flgpr
import io_gpr
from archives import read_archive
from every_command import make_cheap, make_inputs
from flgpr.commands.imports import import_fullwave, import_mapped
from flgpr.jobs import checkpoint
from flgpr.results.manifest import ResultError
from flgpr.results.result import read_result
from flgpr.results.sections import results_at
from flgpr.store import open_run
from flgpr.store.journal import JOURNAL
from flgpr_exchange.commands.imports import import_gpr
from flgpr_trials import sealing
from robust import content, digests
from scans_mapping import TIME, line_mapping

DATA = Path(__file__).parents[1] / "data"
KILLS = int(os.environ.get("FLGPR_KILLS", "4"))
MOST_IN_A_ROW = 4
LATE = (
    "zarr",
    "pyogrio",
    "geopandas",
    "rasterio",
    "flgpr.report.score_page",
    "matplotlib.backends.backend_agg",
)
"""What commands load when they need it: loaded once, for all processes."""
LONGEST = 300.0  # s that a command may take which is not killed
OPERATIONS = {
    "open", "os.rename", "os.remove", "os.rmdir", "os.mkdir", "os.truncate", "os.scandir", "os.listdir", "os.link",
}  # fmt: skip


def counted(home, last, pipe, work, arguments):
    """Do work in this process and send the number of file operations under a folder; die at the last one."""
    count = 0

    def watch(event, about):
        nonlocal count
        if event in OPERATIONS and about and str(home) in str(about[0]):
            count += 1
            if count == last:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(watch)
    work(*arguments)
    pipe.send(count)


class Killer:
    """Runs work in child processes and kills them."""

    def __init__(self, seed, home, work):
        self.rng = np.random.default_rng(seed)
        self.home = home
        self.work = work
        self.context = multiprocessing.get_context("forkserver")
        self.context.set_forkserver_preload(["flgpr.jobs.preload", "every_command", *LATE])
        self.kills = 0
        ours, theirs = self.context.Pipe()
        child = self.start(None, theirs, home / "probe")
        child.join()
        assert child.exitcode == 0  # else nothing would come through the pipe
        self.operations = ours.recv()

    def start(self, last, pipe, output):
        child = self.context.Process(
            target=counted, args=(self.home, last, pipe, self.work, (output,))
        )
        child.start()
        return child

    def attack(self, output):
        """Start once and kill; tell whether it got through before."""
        _, theirs = self.context.Pipe()
        if self.kills % 2:
            child = self.start(int(self.rng.integers(1, self.operations + 1)), theirs, output)
            child.join()
        else:
            child = self.start(None, theirs, output)
            child.join(float(self.rng.uniform(0.0, 1.0)))
            child.kill()
            child.join()
        through = child.exitcode == 0
        assert through or child.exitcode == -signal.SIGKILL
        self.kills += not through
        return through

    def siege(self, output, check, apart=False):
        """Kill up to a few times, checking in between, then let it end, perhaps in a process of its own, too."""
        for _ in range(int(self.rng.integers(1, MOST_IN_A_ROW + 1))):
            through = self.attack(output)
            check()
            if through or self.kills >= KILLS:
                break
        if apart:
            self.finish(output)
        else:
            self.work(output)

    def finish(self, output):
        """Start once more and let it end."""
        _, theirs = self.context.Pipe()
        child = self.start(None, theirs, output)
        child.join(LONGEST)
        stuck = child.exitcode is None
        child.kill()
        assert not stuck, "it did not end"
        assert child.exitcode == 0


def test_kills_of_a_detection(lane, tmp_path):
    def check():
        """What is there is whole or absent."""
        if (tmp_path / "result" / "manifest.json").exists():
            try:
                read_result(tmp_path / "result")
            except ResultError as error:
                pytest.fail(str(error))

    killer = Killer(7, tmp_path, Detection(lane.run, lane.recipe, lane.area))
    want = content(tmp_path / "probe")
    while killer.kills < KILLS:
        killer.siege(tmp_path / "result", check)
        assert content(tmp_path / "result") == want
        assert sorted(path.name for path in tmp_path.iterdir()) == ["probe", "result"]
        shutil.rmtree(tmp_path / "result")


@pytest.mark.slow("is killed, and begins again, several times")
def test_kills_of_a_detection_in_sections(lane, tmp_path):
    def state(folder):
        found = {name: digest for name, digest in digests(folder).items() if "manifest" not in name}
        return {**found, **{home.name: content(home) for home in results_at(folder)}}

    def check():
        """What is there is whole or absent."""
        if (tmp_path / "result").exists():
            state(tmp_path / "result")

    killer = Killer(
        9, tmp_path, Detection(lane.run, lane.recipe, lane.area, section=3.0, every=0.0)
    )
    want = state(tmp_path / "probe")
    assert {"section-01", "section-02", "section-03", "alarms.csv", "sections.json"} <= set(want)
    while killer.kills < KILLS // 2:
        killer.siege(tmp_path / "result", check)
        assert state(tmp_path / "result") == want
        assert sorted(path.name for path in tmp_path.iterdir()) == ["probe", "result"]
        shutil.rmtree(tmp_path / "result")


class Detection:
    """A detection that may have been done already."""

    def __init__(self, *arguments, section=None, every=2.0):
        self.arguments = arguments
        self.section = section
        self.every = every

    def __call__(self, output):
        run, recipe, area = self.arguments
        checkpoint.KEEP_EVERY = self.every
        checkpoint.MERGE_BYTES = 1
        flgpr.detect(run, recipe, output, area, report=False, section=self.section)


class Import:
    """An import that may have been done already, and then takes away what was left."""

    def __init__(self, work, *arguments):
        self.work = work
        self.arguments = arguments

    def __call__(self, output):
        output.mkdir(exist_ok=True)
        self.work(*self.arguments, output / "run.zarr")


def a_fullwave_lane(home):
    arrays = read_archive(DATA / "lane_a.npz")
    scans = np.arange(24) % 3
    moved = {name: arrays[name][scans] + 0.0 for name in ("data", "tx_xyz_m", "rx_xyz_m")}
    for name in ("tx_xyz_m", "rx_xyz_m"):
        moved[name] = arrays[name][:1] + np.arange(24)[:, None, None] * [0.0, 0.1, 0.0]
    moved["data"] = moved["data"][..., :20] * np.exp(1j * np.arange(24))[:, None, None, None, None]
    np.savez(home / "long.npz", **{**arrays, **moved, "frequency_hz": arrays["frequency_hz"][:20]})
    return import_fullwave, home / "long.npz"


def a_mapped_array(home):
    rng = np.random.default_rng(4)
    np.savez(home / "a.npz", s=rng.normal(size=(24, 20)) + 1j, t=np.arange(24.0))
    (home / "m.toml").write_text(MAPPED)
    return import_mapped, home / "m.toml"


def a_recording(home):
    pytest.importorskip("mcap_ros2")
    (home / "drive.mcap").write_bytes(bag.drive(scans=24, poses=150))
    (home / "m.toml").write_text(f'files.data = "drive.mcap"\n{bag.MAPPING}')
    return import_mapped, home / "m.toml"


def a_gpr_line(home):
    return import_gpr, io_gpr.write_dt1(home / "line.dt1", io_gpr.section(24))


MAPPED = line_mapping(
    "a.npz",
    TIME,
    """[pose]
x = 0
y = "t"
z = 1.5
heading = 0
pitch = 0
roll = 0
unit = "m"
angle_unit = "deg"
""",
)


@pytest.mark.slow("is killed, and begins again, several times")
@pytest.mark.parametrize("made", [a_fullwave_lane, a_mapped_array, a_recording, a_gpr_line])
def test_kills_of_an_import(made, tmp_path):
    def check():
        """A store that is there is whole; what was acknowledged of one that is not was not written again."""
        nonlocal known
        if (tmp_path / "out" / "run.zarr").exists():
            open_run(tmp_path / "out" / "run.zarr").load()
        else:
            now = written(tmp_path / "out", together)
            assert {scan: now.get(scan) for scan in known} == known
            known = now

    killer = Killer(8, tmp_path, Import(*made(tmp_path)))
    want = digests(tmp_path / "probe")
    # Scans of less than 4 KiB share files, so that a small import has one file for all 24.
    files = sum("signal/c/" in name for name in want)
    assert files == (24 if made is a_fullwave_lane else 1)
    stored = json.loads((tmp_path / "probe/run.zarr/signal/zarr.json").read_text())
    together = stored["chunk_grid"]["configuration"]["chunk_shape"][0]
    while killer.kills < KILLS:
        known = {}
        killer.siege(tmp_path / "out", check)
        assert digests(tmp_path / "out") == want
        shutil.rmtree(tmp_path / "out")


def written(folder, together):
    """Scans that a journal says are there in full files, and which file each has.

    The last file, which is not full, is written at the end, and again by a writer that goes on.
    """
    partial = folder / "run.zarr.partial"
    if not (partial / JOURNAL).is_file():
        return {}
    whole = (partial / JOURNAL).read_bytes().count(b"\n") - 1
    whole -= whole % together
    return {k: (partial / f"signal/c/{k // together}/0/0/0").stat().st_ino for k in range(whole)}


class Given:
    """A command of the command line, in a process of its own."""

    def __init__(self, command):
        self.command = command

    def __call__(self, output):
        make_cheap(self.command)
        sealing._COST = 2**8  # as in the process that made the inputs
        self.command(output)


@pytest.fixture(scope="module")
def commands(tmp_path_factory):
    return make_inputs(tmp_path_factory.mktemp("inputs"))


FEW = ("import mapped", "export qgis", "plan lane")
"""Commands that ``make test-slow`` kills, each a few times."""


@pytest.mark.slow("is killed, and begins again, several times")
def test_kills_of_every_command(commands, tmp_path):
    every = "FLGPR_KILLS" in os.environ
    order = np.random.default_rng(11).permutation(list(commands) if every else FEW)
    wanted = KILLS if every else 1
    kills = 0
    rounds = 0
    while kills < wanted or rounds < len(order):
        name = str(order[rounds % len(order)])
        home = tmp_path / str(rounds)
        home.mkdir()
        for folder in ("probe", "out"):
            commands[name].start(home / folder)
        killer = Killer(rounds, home, Given(commands[name]))
        want = commands[name].content(home / "probe")
        killer.siege(home / "out", lambda: None, apart=True)
        assert commands[name].content(home / "out") == want, name
        assert sorted(path.name for path in home.iterdir()) == ["out", "probe"], name
        kills += killer.kills
        rounds += 1
        shutil.rmtree(home)
    print(f"{kills} kills of {min(rounds, len(order))} commands")
