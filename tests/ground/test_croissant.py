"""The description in Croissant: what the specification requires, and that files are what it says.

The rules are those of the Croissant format specification 1.0 of MLCommons.
"""

import hashlib
import json
import shlex

import pandas as pd
import pytest
from typer.testing import CliRunner

from flgpr.commands.app import app
from flgpr.proving_ground import describe_ground, load_ground, write_croissant
from flgpr.store import lane_text, write_table
from flgpr_ground.croissant import missing_properties
from flgpr_ground.running import PRINTS, SEALED, begin_folder, seal_tested
from submitted import write_ground

TYPES = {"sc:Text", "sc:Float", "sc:Integer", "sc:Boolean", "sc:Date", "sc:URL", "cr:Split"}


@pytest.fixture(scope="module")
def full():
    """The packaged ground in its full form, described."""
    return describe_ground(load_ground())


def nodes(value):
    """Yield all objects of a description but its context."""
    if isinstance(value, dict):
        yield value
        for name, inner in value.items():
            if name not in ("@context", "data"):
                yield from nodes(inner)
    elif isinstance(value, list):
        for inner in value:
            yield from nodes(inner)


def by_id(described, name):
    [found] = [one for one in described["recordSet"] if one["@id"] == name]
    return found


def test_what_the_specification_requires_is_there(full):
    assert full["@type"] == "sc:Dataset"
    assert full["conformsTo"] == "http://mlcommons.org/croissant/1.0"
    assert full["@context"]["@vocab"] == "https://schema.org/"
    assert full["@context"]["cr"] == "http://mlcommons.org/croissant/"
    assert full["@context"]["conformsTo"] == "dct:conformsTo"
    assert full["name"] == "proving-ground-2"
    assert full["license"] == "https://creativecommons.org/licenses/by/4.0/"
    assert full["creator"]["name"] == "The flgpr developers"
    assert len(full["datePublished"]) == 10
    # Files that are hosted nowhere have no address, and none is invented.
    assert missing_properties(full) == ["url"]
    assert missing_properties(describe_ground(load_ground(True), url="https://a.org/b")) == []


def test_names_are_unique_and_references_lead_somewhere(full):
    defined = [node["@id"] for node in nodes(full) if "@id" in node and "@type" in node]
    assert len(set(defined)) == len(defined)
    referred = {node["@id"] for node in nodes(full) if set(node) == {"@id"}}
    assert referred <= set(defined)
    assert {"truth", "run-manifests", "lanes/lane", "parts/name"} <= referred


def test_files_and_fields_have_what_they_must(full):
    for file in full["distribution"]:
        assert file["@type"] == "cr:FileSet"  # no file is there that could be hashed
        assert file["includes"]
        assert file["encodingFormat"]
    for record_set in full["recordSet"]:
        names = {field["@id"] for field in record_set["field"]}
        for field in record_set["field"]:
            assert field["@id"].startswith(f"{record_set['@id']}/")
            types = field["dataType"]
            assert {types} <= TYPES if isinstance(types, str) else set(types) <= TYPES
            assert "data" in record_set or field["source"]["extract"]
        for record in record_set.get("data", []):
            assert set(record) == names


def test_lanes_and_splits_are_those_of_the_ground(full):
    ground = load_ground()
    lanes = {record["lanes/lane"]: record for record in by_id(full, "lanes")["data"]}
    assert set(lanes) == set(ground.lanes)
    lane = lanes["prepared-sand-test-1"]
    assert (lane["lanes/part"], lane["lanes/targets"], lane["lanes/y_max"]) == ("test", 54, 243.0)
    assert lane["lanes/seed"] == ground.lanes["prepared-sand-test-1"].seed
    assert len(lane["lanes/authors_sha256"]) == 64
    splits = pd.DataFrame(by_id(full, "splits")["data"])
    new_site = splits[splits["splits/split"] == "new-site"]
    for (_, fold), rows in new_site.groupby(["splits/split", "splits/fold"]):
        tested = rows[rows["splits/use"] == "test"]["splits/lane"]
        trained = rows[rows["splits/use"] == "train"]["splits/lane"]
        sites = {name.split("-")[-3] for name in tested}
        assert len(sites) == 1, fold
        assert not sites & {name.split("-")[-3] for name in trained}


def test_places_of_targets_of_test_lanes_are_nowhere(full):
    ground = load_ground()
    text = json.dumps(full)
    truth = ground.lanes["prepared-sand-test-1"].truth()
    assert not [y for y in truth["y"] if f"{y:.3f}" in text]
    targets = by_id(full, "targets")
    assert "data" not in targets
    assert "examples" not in targets


def test_the_command_of_the_description_makes_the_lanes(full, monkeypatch):
    command = full["measurementTechnique"].split("`")[1]
    assert command in full["description"]
    made = []

    def make_ground(output, quick, _, ground, tier):
        made.append((str(output), quick, ground, tier))
        return output

    monkeypatch.setattr("flgpr.proving_ground.make_ground", make_ground)
    done = CliRunner().invoke(app, shlex.split(command)[1:])
    assert done.exit_code == 0, done.output
    assert made == [("ground", False, "proving-ground-2", None)]


@pytest.fixture
def made(tmp_path):
    """A folder with the files of a small ground, but for the run stores themselves."""
    _, ground = write_ground(tmp_path)
    folder = tmp_path / "ground"
    begin_folder(ground, folder)
    lanes = folder / "lanes"
    seal_tested(ground, lanes)
    for name, lane in ground.lanes.items():
        (lanes / f"{name}.zarr").mkdir()
        (lanes / f"{name}.zarr" / "commit.json").write_text('{"scans": 7, "sha256": "abc"}')
        (lanes / f"{name}-lane.toml").write_text(lane_text(lane.lane))
        # The truth of a test lane that somebody laid there is not listed.
        write_table(lane.truth(), lanes / f"{name}-truth.csv")
    (lanes / PRINTS).write_text("lane,sha256\n")
    return folder


def test_files_that_are_there_are_listed_with_digest_and_size(made):
    path, missing = write_croissant(folder=made)
    assert path == made / "croissant.json"
    assert missing == ["license", "url", "creator", "datePublished"]  # not a packaged ground
    described = json.loads(path.read_text("utf-8"))
    files = [one for one in described["distribution"] if one["@type"] == "cr:FileObject"]
    for file in files:
        data = (made / file["contentUrl"]).read_bytes()
        assert file["sha256"] == hashlib.sha256(data).hexdigest()
        assert file["contentSize"] == f"{len(data)} B"
    names = {file["contentUrl"] for file in files}
    assert {"ground.toml", f"lanes/{SEALED}", f"lanes/{PRINTS}"} <= names
    assert "lanes/smooth-sand-test-1.zarr/commit.json" in names
    assert "lanes/smooth-sand-known-1-truth.csv" in names
    assert not [name for name in names if "test-1-truth" in name or "bare-1-truth" in name]


def test_a_link_among_the_files_is_refused(made):
    link = made / "lanes" / "smooth-sand-known-1-truth.csv"
    link.unlink()
    link.symlink_to("/etc/passwd")
    with pytest.raises(ValueError, match="symbolic link"):
        write_croissant(folder=made)


def test_a_stored_lane_is_under_the_licence_of_the_package():
    described = describe_ground(load_ground(source="full-wave-1"))
    assert [one.split("/")[-1] for one in described["license"]] == ["", "BSD-3-Clause.html"]


def test_stored_lanes_are_not_called_simulated():
    described = describe_ground(load_ground(source="full-wave-2"))
    assert "6 lanes are run stores that were there already" in described["description"]
    assert "6 stored lanes" in described["measurementTechnique"]
    simulated = describe_ground(load_ground())
    assert "stored" not in simulated["measurementTechnique"]
    assert "The lanes are simulated from a declared description" in simulated["description"]


def test_the_reference_library_reads_it(made):
    croissant = pytest.importorskip("mlcroissant")
    for name in made.glob("lanes/*-truth.csv"):
        if "known" not in name.name:
            name.unlink()
    path, _ = write_croissant(folder=made, licence="https://a.org/licence", url="https://a.org")
    data_set = croissant.Dataset(jsonld=str(path))
    assert not data_set.metadata.ctx.issues.errors
    ground = load_ground(False, made / "ground.toml")
    targets = list(data_set.records("targets"))
    assert len(targets) == sum(
        len(lane.truth()) for lane in ground.lanes.values() if lane.part != "test"
    )
    assert {record["targets/lane"].decode() for record in targets} == {
        "smooth-sand-known-1", "rough-sand-known-1",
    }  # fmt: skip
    assert [record["runs/scans"] for record in data_set.records("runs")] == [7] * 6
