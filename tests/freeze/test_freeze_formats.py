"""Files of today's formats open, hold what they held and are resumed; new ones are made alike."""

import json
import shutil

import pandas as pd
import pytest

import flgpr as package
from flgpr.store import open_run
from freeze.formats import (
    FILES,
    PHRASE,
    TABLE,
    begin_writing,
    file_table,
    live,
    make_formats,
    values,
)
from freeze.frozen import check_table, read_json
from freeze.recipes import events, flgpr
from robust import digests


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Files as the program writes them now."""
    folder = tmp_path_factory.mktemp("formats")
    make_formats(folder)
    return folder


@pytest.fixture
def files(tmp_path):
    """A copy of the committed files, to go on with."""
    shutil.copytree(FILES, tmp_path / "formats")
    return tmp_path / "formats"


def test_committed_files_open_and_hold_what_they_held():
    assert values(FILES) == read_json(TABLE)["values"]


def test_files_have_the_names_keys_types_and_shapes_that_they_had(made):
    frozen = read_json(TABLE)["files"]
    described = json.loads(json.dumps(file_table(made)))
    assert sorted(described) == sorted(frozen)
    for name, one in described.items():
        assert one == frozen[name], name


@pytest.mark.parametrize(
    "name", ["run.zarr", "tiny.zarr", "unfinished.zarr.partial", "incoming", "arrays.bundle"]
)
def test_what_depends_on_the_input_alone_has_the_same_bytes(name, made):
    def of(folder):
        if (folder / name).is_file():
            return (folder / name).read_bytes()
        found = digests(folder / name)
        # What the Zarr library writes, and the digests of it.
        return {key: one for key, one in found.items() if key.rpartition("/")[2] not in ZARR}

    assert of(made) == of(FILES)


ZARR = ("zarr.json", "commit.json", "made-of.json")


def test_a_store_that_an_older_writer_left_is_finished(files):
    assert begin_writing(files / "unfinished.zarr", 3) == 2
    finished = digests(files / "unfinished.zarr")
    complete = digests(files / "tiny.zarr")
    assert sorted(finished) == sorted(complete)
    # Descriptions are today's; every chunk is the older writer's.
    for name, digest in complete.items():
        if name.rpartition("/")[2] not in ZARR:
            assert finished[name] == digest, name
    assert open_run(files / "unfinished.zarr").load().equals(open_run(files / "tiny.zarr").load())


def test_a_live_run_that_an_older_program_left_resumes(files, monkeypatch):
    """A snapshot belongs to the version that wrote it: the reader pretends to be of that one."""
    manifest = json.loads((files / "result" / "manifest.json").read_text())
    monkeypatch.setattr(package, "__version__", manifest["flgpr"], raising=False)
    output = files / "live-so-far"
    live(files, output)
    resumed = [one["event"] for one in events(output)]
    assert resumed.count("start") == 1
    assert resumed.count("resume") == 1
    check_table(pd.read_csv(output / "alarms.csv"), files / "live" / "alarms.csv")


def test_a_result_of_an_older_program_is_replayed_and_scored(files):
    agrees = json.loads(flgpr("replay", files / "result", "--run", files / "run.zarr", "--json"))[
        "agrees"
    ]
    assert agrees
    told = flgpr("score", files / "result", "--truth", files / "truth.csv", "--json")
    assert json.loads(told)["targets"] == 2
    model = json.loads(flgpr("info", files / "result", "--json"))
    assert model["format"] == "flgpr-model"
    told = flgpr("score", files / "sections", "--truth", files / "truth.csv", "--json")
    assert json.loads(told)["targets"] == 2


def test_a_truth_that_an_older_program_sealed_is_scored(files):
    told = flgpr(
        "score", files / "result" / "alarms.csv", "--sealed", files / "sealed",
        "-o", files / "blind", "--json", typed=f"{PHRASE}\n",
    )  # fmt: skip
    [score] = json.loads(told)["detections"].values()
    assert max(point["n_targets"] for point in score["points"]) == 2
