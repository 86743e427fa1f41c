"""Every reader of our own formats on damaged files: only documented errors, in bounded memory.

``FLGPR_CASES`` tells how many cases there are per reader. The readers of other formats have theirs in
``tests/exchange/test_fuzz_exchange.py``.
"""

import json
import resource
import shutil
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_flips import learnt_stage, small_classifier

from damage import CASES, FUZZ, damaged, refusal
from flgpr.commands.scoring import read_lanes
from flgpr.formats.fullwave import import_fullwave
from flgpr.json_text import canonical_json
from flgpr.live.state import read_snapshot, write_snapshot
from flgpr.method.model import MODEL_FILE, load_model, save_model
from flgpr.model import load_sensor, make_run
from flgpr.recipe.schema import load_recipe, recipe_text
from flgpr.results.result import read_result
from flgpr.simulate import load_scene
from flgpr.store import (
    Bundle,
    RunWriter,
    json_with_digest,
    open_run,
    parse_with_digest,
    read_lane,
    read_table,
    sample_lane,
    save_run,
    sha256,
    write_bundle,
)
from flgpr.store.journal import JOURNAL, Journal, WrittenScan
from flgpr.store.run_writer import _digests
from flgpr_trials.ledger import read_register, register
from small_lane import LANE_TOML
from small_results import small_result

MOST_MEMORY = 700_000  # kB


@pytest.fixture(scope="module", autouse=True)
def memory_is_bounded():
    Path("/proc/self/clear_refs").write_text(
        "5"
    )  # forget the peak of tests before, which would hide one of these
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    yield
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_MEMORY


class Folder:
    """A folder one file of which is damaged at a time."""

    def __init__(self, path, read):
        self.path = path
        self.read = read
        self.files = {
            p.relative_to(path).as_posix(): p.read_bytes()
            for p in sorted(path.rglob("*"))
            if p.is_file()
        }

    def attack(self, draw, mend=None):
        """Damage a file, let ``mend`` make the digests fit again, read, and put everything back."""
        name = draw(st.sampled_from(sorted(self.files)))
        data = damaged(self.files[name], draw)
        changed = {name: data}
        if mend is not None:
            changed |= mend(self.files | changed)
        for one, content in changed.items():
            (self.path / one).write_bytes(content)
        said = refusal(self.read, self.path)
        for one in changed:
            (self.path / one).write_bytes(self.files[one])
        return said, data != self.files[name]


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    home = tmp_path_factory.mktemp("good")
    rng = np.random.default_rng(5)
    signal = rng.normal(size=(2, 1, 2, 3)) + 1j * rng.normal(size=(2, 1, 2, 3))
    pose = np.zeros((2, 6))
    run = make_run(signal, [1e9, 1.1e9, 1.2e9], ["HH"], np.zeros((2, 3)), np.ones((2, 3)), pose)
    return {
        "store": Folder(save_run(run, home / "a.zarr"), lambda path: open_run(path, 10**7).load()),
        "result": Folder(small_result(home / "result", small_classifier()), read_result),
        "model": Folder(save_model(small_classifier(), home / "model"), load_model),
        "learnt stage": Folder(learnt_stage(home / "stage"), load_model),
    }


@pytest.mark.parametrize("kind", ["store", "result", "model", "learnt stage"])
@FUZZ
@given(data=st.data())
def test_damage_is_always_noticed(folders, kind, data):
    said, changed = folders[kind].attack(data.draw)
    assert (said is not None) == changed
    assert said is None or str(folders[kind].path) in said


def mend_store(files):
    """Give a damaged store a manifest that vouches for it."""
    try:
        manifest = json.loads(files["commit.json"])
        del manifest["sha256"]
        for key, entry in manifest["files"].items():
            entry.update(sha256=sha256(files[key]), bytes=len(files[key]))
        manifest["sha256"] = sha256(canonical_json(manifest))
        return {"commit.json": json.dumps(manifest, indent=1, sort_keys=True).encode()}
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def mend_sealed(name, digest):
    """Give a damaged folder a sealed description that vouches for it."""

    def mend(files):
        try:
            content = json.loads(files[name])
            content.pop("sha256", None)
            content["files"] = {key: digest(files[key]) for key in content["files"]}
            content["sizes"] = {key: len(files[key]) for key in content["files"]}
            return {name: json_with_digest(content)}
        except (ValueError, KeyError, TypeError, AttributeError):
            return {}

    return mend


def mend_bundle(name):
    """Give a damaged bundle digests that vouch for it."""

    def mend(files):
        try:
            first, _, rest = files[name].partition(b"\n")
            length = int(first.split()[0])
            head = json.loads(rest[:length])
            body = rest[length:]
            for one in head["arrays"]:
                size = np.dtype(one["dtype"]).itemsize * int(np.prod(one["shape"]))
                one["sha256"] = sha256(body[one["at"] : one["at"] + size])
            text = canonical_json(head)
            return {name: f"{len(text)} {sha256(text)}\n".encode() + text + body}
        except (
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            IndexError,
            OverflowError,
            RecursionError,
        ):
            return {}

    return mend


MENDED = {
    "store": mend_store,
    "result": mend_sealed("manifest.json", sha256),
    "model": mend_bundle(MODEL_FILE),
}


@pytest.mark.parametrize("kind", MENDED)
def test_forging_works(folders, kind):
    """Else the next test would be one of digests again."""
    folder = folders[kind]
    forged = MENDED[kind](folder.files)
    assert forged
    for name, content in forged.items():
        (folder.path / name).write_bytes(content)
    assert refusal(folder.read, folder.path) is None
    for name in forged:
        (folder.path / name).write_bytes(folder.files[name])


@pytest.mark.slow("draws many damaged files anew")
@pytest.mark.parametrize("kind", MENDED)
@FUZZ
@given(data=st.data())
def test_forgeries_that_fit_their_digests_are_read_or_refused(folders, kind, data):
    said, _ = folders[kind].attack(data.draw, MENDED[kind])
    assert (
        said is None or str(folders[kind].path) in said or "checksum" in said
    )  # of a chunk, when it is read


ALARMS = b"alarm_id,x,y,confidence\na,0.1,3.5,2.25\nb,-1.0,4.0,1.5\n"
TRUTH = b"target_id,x,y,kind,depth\nm,0.5,10.0,metal,0.05\np,-0.5,20.0,plastic,\n"
OBJECTS = b"object_id,x,y,kind,radius,height\nr,0.5,10.0,rock,0.1,\np,-0.5,20.0,post,,1.2\n"
SCENE = b'name = "yard"\nsite = "gravel"\nlength = 8.0\n[[draws]]\nkind = "metal"\ndepth = 0.05\ncount = 1\n'
LANES = b"lane,x_min,x_max,y_min,y_max\na,-1,1,0,10\nb,-1,1,0,20\n"


def sensor_text():
    from importlib import resources

    return (resources.files("flgpr.model") / "presets" / "sri-van.toml").read_bytes()


TEXTS = {
    "alarms.csv": (lambda: ALARMS, lambda path: read_table(path, "alarms")),
    "truth.csv": (lambda: TRUTH, lambda path: read_table(path, "truth")),
    "objects.csv": (lambda: OBJECTS, lambda path: read_table(path, "objects")),
    "lane.toml": (lambda: LANE_TOML.encode(), read_lane),
    "lanes.csv": (lambda: LANES, read_lanes),
    "scene.toml": (lambda: SCENE, load_scene),
    "sensor.toml": (sensor_text, load_sensor),
    "recipe.toml": (lambda: recipe_text("wang2007").encode(), load_recipe),
    "sealed.json": (
        lambda: json_with_digest({"a": [1, 2.5, None], "b": {"c": "d"}}),
        lambda path: read_with_digest(path),
    ),
}


def read_with_digest(path):
    try:
        return parse_with_digest(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


@pytest.mark.slow("draws many damaged files anew")
@pytest.mark.parametrize("name", TEXTS)
@FUZZ
@given(data=st.data())
def test_damaged_texts(name, data, tmp_path):
    make, read = TEXTS[name]
    path = tmp_path / name
    path.write_bytes(damaged(make(), data.draw))
    said = refusal(read, path)
    assert said is None or str(path) in said


@FUZZ
@given(data=st.data())
def test_a_damaged_register(data, tmp_path):
    whole = tmp_path / "whole.jsonl"
    if not whole.exists():
        for number in range(3):
            register(whole, event=f"event {number}", recipe="r")
    path = tmp_path / "register.jsonl"
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    refusal(read_register, path)


@FUZZ
@given(data=st.data())
def test_a_damaged_work_file(data, tmp_path):
    whole = tmp_path / "whole.arrays"
    path = tmp_path / "damaged.arrays"
    arrays = {
        "a": np.arange(7.0),
        "b": np.array(["HH", "VV"]),
        "c": np.zeros((2, 0, 3), np.complex64),
    }
    if not whole.exists():
        write_bundle(whole, arrays)
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    read = {}
    said = refusal(lambda: read.update(Bundle(path)))
    assert said is None or str(path) in said
    if said is None:
        for name, value in arrays.items():
            np.testing.assert_array_equal(read[name], value)


@FUZZ
@given(data=st.data())
def test_a_damaged_live_snapshot(data, tmp_path):
    whole = tmp_path / "whole.npz"
    path = tmp_path / "damaged.npz"
    if not whole.exists():
        write_snapshot(
            whole, ({"format": "flgpr-live-snapshot", "version": 1}, {"a": np.arange(3.0)})
        )
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    said = refusal(read_snapshot, path)
    assert said is None or str(path) in said


@FUZZ
@given(data=st.data())
def test_a_damaged_archive_of_a_full_wave_lane(data, tmp_path):
    whole = tmp_path / "whole.npz"
    path = tmp_path / "damaged.npz"
    if not whole.exists():
        np.savez(
            whole,
            data=np.ones((2, 1, 2, 1, 3), np.complex64),
            frequency_hz=np.array([1e9, 1.1e9, 1.2e9]),
            polarisation=np.array(["VV"]),
            tx_xyz_m=np.zeros((2, 1, 3)),
            rx_xyz_m=np.ones((2, 2, 3)),
            truth=np.array(json.dumps({"mines": [["metal", 0.1, 2.0, 0.05]], "soil_eps": 4.0})),
        )
    path.write_bytes(damaged(whole.read_bytes(), data.draw))
    said = refusal(import_fullwave, path)
    assert said is None or "\n" not in said


ABOUT = {"frequency": "f", "attrs": {"site": "yard"}}


@FUZZ
@given(data=st.data())
def test_a_damaged_journal(data, tmp_path):
    """What is read of it is a beginning of what was written, or it is another run's."""
    valid = np.ones((1, 2), bool)
    scans = [WrittenScan(f"{k}" * 64, np.arange(6.0) + k, k + 0.5, valid) for k in range(3)]
    if not (tmp_path / "whole").exists():
        journal = Journal(tmp_path / "whole", ABOUT, False)
        for scan in scans:
            journal.append(scan)
        journal.close()
    (tmp_path / "damaged").mkdir(exist_ok=True)
    (tmp_path / "damaged" / JOURNAL).write_bytes(
        damaged((tmp_path / "whole" / JOURNAL).read_bytes(), data.draw)
    )
    with mock.patch("flgpr.append_log.os.fsync"):
        journal = Journal(tmp_path / "damaged", ABOUT, True)
    journal.close()
    for read, written in zip(journal.scans, scans, strict=False):
        assert (read.sha256, read.pose.tolist(), read.time) == (
            written.sha256,
            written.pose.tolist(),
            written.time,
        )


@pytest.mark.slow("draws many damaged files anew")
@settings(FUZZ, max_examples=max(10, CASES // 100))
@given(data=st.data())
def test_a_damaged_journal_costs_scans_and_nothing_else(data, small_run, tmp_path):
    """A stopped import whose journal is damaged ends in the same store."""
    want = tmp_path / "want"
    stopped = tmp_path / "stopped"
    path = tmp_path / "a.zarr"
    if not want.exists():
        save_run(small_run, want)
        fixed = [
            small_run[n].values for n in ("frequency", "polarization", "tx_position", "rx_position")
        ]
        writer = RunWriter(
            stopped, *fixed, small_run.attrs, inputs=_digests(small_run), resume=True
        )
        for scan in range(2):
            one = small_run.isel(scan=scan)
            writer.append(one["signal"].values, one["pose"].values, float(one["time"]))
        writer.__exit__(KeyboardInterrupt, None, None)
    for left in (path, tmp_path / "a.zarr.partial"):  # of a case that failed
        shutil.rmtree(left, ignore_errors=True)
    shutil.copytree(tmp_path / "stopped.partial", tmp_path / "a.zarr.partial")
    journal = (tmp_path / "stopped.partial" / JOURNAL).read_bytes()
    (tmp_path / "a.zarr.partial" / JOURNAL).write_bytes(damaged(journal, data.draw))
    save_run(small_run, path, resume=True)
    assert open_run(path).load().identical(open_run(want).load())
    assert not (tmp_path / "a.zarr.partial").exists()


def test_the_packaged_lane_is_whole():
    assert refusal(lambda: open_run(sample_lane() / "run.zarr").load()) is None
