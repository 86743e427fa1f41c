"""Folders that somebody else made: every kind of folder with every kind of damage, refused without waiting or filling.

What is in each kind of folder is named in `folder_kinds.py`; `tests/damage.py` has the damages. Archives have tests of
their own, `test_archive.py`.
"""

import contextlib
import json
import os
import shutil

import numpy as np
import pytest
from folder_kinds import KINDS, UNDIGESTED, decks_folder, read_manifest_only, view

from damage import (
    DAMAGES,
    SPARSE,
    answered,
    link_to_file,
    link_to_folder,
    memory_within,
    one_byte_more,
    pipe,
    sparse,
)
from flgpr import door
from flgpr.door import DoorError, Folder, Listed, read_named
from flgpr.jobs.checkpoint import Checkpoint, begin
from flgpr.json_text import parse_json
from flgpr.method.model import load_model
from flgpr.results.result import add_files, read_result
from flgpr.results.score import read_scored_truth
from flgpr.store import (
    json_with_digest,
    open_run,
    parse_with_digest,
    read_table,
    read_verdicts,
    sha256,
)
from flgpr.store.scan_file import RUN_FILE
from flgpr.store.tables import parse_columns
from flgpr.store.verdicts import verdict_bytes
from flgpr.viewer.session import LiveFile, ResultFiles
from flgpr_exchange.gprmax import deck_results as gprmax_decks
from scored import find_entrant

SMALL = 40 * 2**20
"""Memory that refusing a file may take, bytes; what is damaged is at least fifty times as large."""
CASES = [
    pytest.param(kind, name, damage, id=f"{kind}-{name}-{damage.__name__}")
    for kind, (_, _, names) in KINDS.items()
    for name in names
    for damage in DAMAGES
    if not (damage is link_to_folder and "/" not in name)  # the folder itself may be a link
    and not (damage is one_byte_more and kind in UNDIGESTED)
]


@pytest.fixture(scope="module")
def originals(tmp_path_factory):
    """Every kind of folder, whole."""
    home = tmp_path_factory.mktemp("kinds")
    folders = {}
    for number, (kind, (make, read, _)) in enumerate(KINDS.items()):
        (home / str(number)).mkdir()
        folders[kind] = make(home / str(number))
        read(folders[kind])
    return folders


@pytest.fixture
def copied(originals, tmp_path):
    """Give a folder of a kind to damage, and a place outside it."""
    (tmp_path / "outside").mkdir()

    def copy(kind):
        return shutil.copytree(originals[kind], tmp_path / "folder"), tmp_path / "outside"

    return copy


@pytest.mark.parametrize(("kind", "name", "damage"), CASES)
def test_no_kind_of_folder_is_read_past_damage(copied, kind, name, damage):
    folder, outside = copied(kind)
    damage(folder / name, outside)
    with memory_within(SMALL), pytest.raises((ValueError, OSError), match=f"{folder}|{name}"):
        answered(KINDS[kind][1], folder)


@pytest.mark.parametrize("kind", KINDS)
def test_the_folder_itself_may_be_a_link(copied, kind, tmp_path):
    folder, _ = copied(kind)
    (tmp_path / "link").symlink_to(folder)
    KINDS[kind][1](tmp_path / "link")


@pytest.mark.parametrize(
    "kind", ["store", "result", "viewer", "model", "sections", "score", "live", "incoming"]
)
def test_what_has_no_meaning_lies_undisturbed(copied, kind):
    folder, _ = copied(kind)
    (folder / "notes.txt").write_text("mine")
    (folder / ".DS_Store").mkdir()
    KINDS[kind][1](folder)


def forge(folder, change):
    """Change a result's manifest and give it the digests and sizes that it should have."""
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    del manifest["sha256"]
    change(manifest)
    for name in manifest["files"]:
        if (folder / name).is_file() and (folder / name).stat().st_size < SPARSE:
            data = (folder / name).read_bytes()
            manifest["files"][name] = sha256(data)
            manifest.get("sizes", {})[name] = len(data)
    (folder / "manifest.json").write_bytes(json_with_digest(manifest))


def without(entry, name):
    return lambda manifest: manifest[entry].pop(name)


@pytest.mark.parametrize("damage", [None, link_to_file], ids=["file", "link"])
def test_features_that_are_not_listed_are_not_believed(copied, damage):
    folder, outside = copied("result")
    forge(folder, without("files", "features.csv"))
    if damage is not None:
        damage(folder / "features.csv", outside)
    with pytest.raises(
        ValueError, match=r"features\.csv is not among the files that were written: take it away"
    ):
        read_result(folder)
    (folder / "features.csv").unlink()
    assert read_result(folder).detections[0].features is None


@pytest.mark.parametrize(
    "read", [view, lambda folder: read_scored_truth(read_manifest_only(folder))]
)
def test_a_score_that_is_not_listed_is_not_believed(copied, read):
    folder, _ = copied("viewer")
    forge(folder, without("added", "view/score.json"))
    with pytest.raises(
        ValueError, match=r"view/score\.json is not among the files that were written"
    ):
        read(folder)


def test_a_chunk_that_is_not_listed_is_not_believed(copied):
    folder, _ = copied("store")
    from test_untrusted import forge as forge_store

    forge_store(folder, lambda files: files.pop("signal/c/1/0/0/0"))
    with pytest.raises(ValueError, match="must be among the committed files"):
        open_run(folder)


@pytest.mark.parametrize(
    "name", ["alarms.csv", "view/index.json", "view/layers/main.0.0.0.f16", "view/score.json"]
)
def test_a_manifest_without_sizes_bounds_what_is_read(copied, name):
    """As older versions wrote it: the limits of the door hold still."""
    folder, _ = copied("result")
    forge(folder, lambda manifest: (manifest.pop("sizes"), manifest.pop("added_sizes")))
    read_result(folder)
    os.truncate(folder / name, 2**40)
    with memory_within(SMALL), pytest.raises(ValueError, match=f"{name} must hold at most"):
        read_result(folder)


def test_a_manifest_of_an_older_version_can_be_added_to_whenever_it_stops(copied, monkeypatch):
    """The size of the page that is replaced is not known then, and must not keep it out."""
    folder, _ = copied("result")
    forge(folder, lambda manifest: (manifest.pop("sizes"), manifest.pop("added_sizes")))
    for writes in range(1, 5):
        with monkeypatch.context() as patch:
            left = [writes]
            patch.setattr("flgpr.results.result.write_whole", stopping_after(left))
            with contextlib.suppress(KeyboardInterrupt):
                add_files(folder, {"report.html": "<p>another page</p>", "new.html": "<p>new</p>"})
        read_result(folder)
    assert (folder / "new.html").is_file()


def stopping_after(left):
    from flgpr.store import write_whole

    def write(path, data):
        if not left[0]:
            raise KeyboardInterrupt
        left[0] -= 1
        write_whole(path, data)

    return write


@pytest.mark.parametrize("files", [[], None, {"alarms.csv": 5}, {"alarms.csv": None}, "all"])
def test_a_list_of_files_that_is_none_is_an_error(copied, files):
    folder, _ = copied("list of a result")
    manifest = parse_with_digest((folder / "manifest.json").read_bytes())
    del manifest["sha256"]
    (folder / "manifest.json").write_bytes(json_with_digest(manifest | {"files": files}))
    for read in (
        read_result,
        ResultFiles,
        find_entrant,
        lambda folder: read_scored_truth(read_manifest_only(folder)),
    ):
        with pytest.raises(ValueError, match=str(folder)):
            read(folder)


def test_a_forged_list_of_sizes_bounds_nothing_further(copied):
    folder, _ = copied("viewer")
    os.truncate(folder / "view" / "score.json", SPARSE)
    forge(folder, lambda manifest: manifest["added_sizes"].update({"view/score.json": [SPARSE]}))
    with (
        memory_within(SMALL),
        pytest.raises(ValueError, match=r"score\.json must hold at most 64 MiB, got 2048"),
    ):
        view(folder)


@pytest.mark.parametrize("name", ["alarms.csv", "features.csv", "recipe.toml", "view/index.json"])
def test_text_that_is_not_utf8_is_an_error(copied, name):
    folder, _ = copied("result")
    (folder / name).write_bytes(b"\xff" + (folder / name).read_bytes())
    forge(folder, lambda manifest: None)
    with pytest.raises(ValueError, match=r"cannot be read|codec|not valid"):
        (ResultFiles if name == "view/index.json" else read_result)(folder)


DEEP = b"[" * 500 + b"]" * 500


@pytest.mark.parametrize(
    ("kind", "name"),
    [
        ("store", "commit.json"),
        ("sections", "sections.json"),
        ("score", "roc.json"),
        ("incoming", RUN_FILE),
    ]
    + [
        ("result", "manifest.json"),
        ("viewer", "manifest.json"),
        ("benchmark", "ground.json"),
        ("costs", "costs.json"),
    ]
    + [("gprMax decks", "manifest.json")],
)
@pytest.mark.parametrize("depth", [101, 500, 100_000])
def test_deep_nesting_is_refused_before_anything_recurses(copied, kind, name, depth):
    folder, _ = copied(kind)
    (folder / name).write_bytes(b'{"a": ' + b"[" * depth + b"]" * depth + b"}")
    with pytest.raises(ValueError, match=r"nested at most 100 deep|not valid JSON"):
        KINDS[kind][1](folder)


def test_json_is_bounded_in_depth_and_values(monkeypatch):
    assert parse_json(b"[" * 100 + b"]" * 100) is not None
    assert parse_json('{"a": [1, {"b": null}]}') == {"a": [1, {"b": None}]}
    assert parse_json(b"[NaN]", lambda _: None) == [None]
    for text in (b"[" * 102 + b"]" * 102, b'{"a":' * 102 + b"1" + b"}" * 102, DEEP):
        with pytest.raises(ValueError, match="nested at most 100"):
            parse_json(text)
    with memory_within(2 * SMALL), pytest.raises(ValueError, match="at most 8000000 values"):
        parse_json(b"[" + b"[],[]," * 4_000_000 + b"[]]")  # 24 MB that would take 600


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"x,y,confidence\n" + b"1,2,3\n" * 2_000_001, "at most 2000000 rows"),
        (b"x,y,confidence\r" + b"1,2,3\r" * 2_000_001, "at most 2000000 rows"),
        (b"x," * 5000 + b"y\n", "at most 4096 columns, got 5001"),
        (b"x,y,confidence\n" + (b"," * 4000 + b"\n") * 3000, "at most 10000000 cells"),
        (b"x;y;confidence\n" + (b";" * 4000 + b"\n") * 3000, "at most 10000000 cells"),
    ],
    ids=["rows", "rows of an old Mac", "columns", "cells", "cells between semicolons"],
)
def test_tables_are_counted_before_they_are_parsed(text, words, tmp_path):
    path = tmp_path / "alarms.csv"
    path.write_bytes(text)
    with memory_within(SMALL), pytest.raises(ValueError, match=words):
        read_table(path, "alarms")
    with pytest.raises(ValueError, match=words):
        parse_columns(text)


def overwritten_after(monkeypatch, path, data):
    """Let a file change as soon as its bytes were read."""
    read = door._read_all

    def and_overwrite(file, what):
        given = read(file, what)
        if what.endswith(path.name):
            path.write_bytes(data)
        return given

    monkeypatch.setattr(door, "_read_all", and_overwrite)


def test_the_bytes_that_are_checked_are_those_that_are_used(copied, monkeypatch):
    folder, _ = copied("result")
    alarms = read_result(folder).detections[0].alarms
    overwritten_after(monkeypatch, folder / "alarms.csv", b"alarm_id,x,y,confidence\nevil,0,0,9\n")
    assert read_result(folder).detections[0].alarms.equals(alarms)
    assert find_entrant_raises(folder)


def find_entrant_raises(folder):
    with pytest.raises(ValueError, match=r"alarms\.csv differs from what was written"):
        find_entrant(folder)
    return True


def test_a_list_is_scored_as_it_was_hashed(copied, monkeypatch):
    folder, _ = copied("list of a result")
    overwritten_after(monkeypatch, folder / "alarms.csv", b"alarm_id,x,y,confidence\nevil,0,0,9\n")
    entrant = find_entrant(folder)
    assert list(entrant.table()["alarm_id"]) == ["a", "b", "c"]
    assert (
        entrant.digests()["alarms_sha256"]
        == read_manifest_only(folder).manifest["files"]["alarms.csv"]
    )


def test_a_model_is_used_as_it_was_hashed(copied, monkeypatch):
    folder, _ = copied("model")
    before = load_model(folder).detector.arrays()
    digest = sha256((folder / "model.bundle").read_bytes())
    overwritten_after(monkeypatch, folder / "model.bundle", b"nothing")
    for name, array in load_model(folder, digest).detector.arrays().items():
        np.testing.assert_array_equal(array, before[name])
    with pytest.raises(ValueError, match=r"model\.bundle differs from what was written"):
        load_model(folder, digest)


def test_the_viewer_notices_a_change_that_keeps_size_and_times(copied):
    """A digest that is checked once per time stamp would not."""
    folder, _ = copied("viewer")
    source = ResultFiles(folder)
    tile = source.tile(0, 0, 0)
    for name, read in (
        ("view/layers/main.0.0.0.f16", lambda: source.tile(0, 0, 0)),
        ("view/index.json", source.index_bytes),
        ("view/score.json", source.score_bytes),
    ):
        read()
        path = folder / name
        whole = (folder / name).read_bytes()
        times = (folder / name).stat()
        path.write_bytes(bytes([whole[0] ^ 1]) + whole[1:])
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        assert path.stat().st_mtime_ns == times.st_mtime_ns
        with pytest.raises(ValueError, match="differs from what was written"):
            read()
        path.write_bytes(whole)
        read()
    assert source.tile(0, 0, 0) == tile


def test_parts_of_a_file_are_those_of_the_whole(tmp_path):
    data = np.random.default_rng(0).bytes(200_001)
    (tmp_path / "a").write_bytes(data)
    folder = Folder(tmp_path, {"a": Listed((sha256(data),), (len(data),))})
    for offset, length in (
        (0, 1),
        (32_767, 2),
        (32_768, 32_768),
        (5, 150_000),
        (200_000, 50),
        (200_001, 4),
        (10**6, 9),
    ):
        assert folder.read_part("a", offset, length) == data[offset : offset + length]
    for offset, length in ((-1, 4), (0, -1), (0, 2**40)):
        with pytest.raises(DoorError, match="within a file"):
            folder.read_part("a", offset, length)
    (tmp_path / "a").write_bytes(data[:100_000] + bytes([data[100_000] ^ 1]) + data[100_001:])
    assert folder.read_part("a", 0, 32_768) == data[:32_768]  # of blocks that are as they were
    with pytest.raises(DoorError, match="differs"):
        folder.read_part("a", 99_999, 2)
    with pytest.raises(DoorError, match="differs"):
        Folder(tmp_path, folder.listed).read_part("a", 0, 1)


NAMES = ["../a", "/etc/passwd", "b/../../a", "a\\..\\b", "", ".", "b//a", "b/./a", "a\0", "b/"]


@pytest.mark.parametrize("name", NAMES)
def test_names_cannot_lead_out(name, tmp_path):
    (tmp_path / "folder" / "b").mkdir(parents=True)
    (tmp_path / "a").write_text("secret")
    folder = Folder(tmp_path / "folder")
    for read in (folder.read, folder.has, folder.path, folder.check_size, folder.json):
        with pytest.raises(DoorError, match="must be relative and stay inside"):
            read(name)


def test_a_file_that_grows_while_it_is_read_is_refused(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"ab")
    folder = Folder(tmp_path)
    sizes = iter([1])
    state = os.fstat

    class Shorter:
        def __init__(self, real):
            self.st_mode = real.st_mode
            self.st_size = next(sizes, 1)

    monkeypatch.setattr(door.os, "fstat", lambda handle: Shorter(state(handle)))
    with pytest.raises(DoorError, match="stay as it is while it is read"):
        folder.read("a")


def test_files_that_users_name_may_be_links_but_are_never_waited_for(tmp_path):
    (tmp_path / "truth.csv").write_text("target_id,x,y,kind,depth\na,1,2,metal,0.1\n")
    (tmp_path / "link.csv").symlink_to(tmp_path / "truth.csv")
    assert len(read_table(tmp_path / "link.csv", "truth")) == 1
    pipe(tmp_path / "truth.csv", None)
    for name in ("truth.csv", "link.csv"):
        with pytest.raises(ValueError, match=r"must be a regular file, got a pipe"):
            answered(read_table, tmp_path / name, "truth")
        with pytest.raises(ValueError, match=r"must be a regular file, got a pipe"):
            answered(read_named, tmp_path / name)
    with pytest.raises(ValueError, match="got a device"):
        answered(read_named, "/dev/zero")
    with pytest.raises(IsADirectoryError):
        read_named(tmp_path)
    with pytest.raises(FileNotFoundError):
        read_named(tmp_path / "nothing")


def test_verdicts_are_bounded(tmp_path):
    path = tmp_path / "verdicts.json"
    path.write_bytes(verdict_bytes([]))
    assert read_verdicts(path) == []
    sparse(path, None)
    with memory_within(SMALL), pytest.raises(ValueError, match="must hold at most 16 MiB"):
        read_verdicts(path)
    path.write_bytes(DEEP)
    with pytest.raises(ValueError, match="nested"):
        read_verdicts(path)


@pytest.mark.parametrize(
    "damage", [one for one in DAMAGES if one is not link_to_folder], ids=lambda one: one.__name__
)
def test_live_events_are_never_waited_for(tmp_path, damage):
    (tmp_path / "outside").mkdir()
    path = tmp_path / "live.jsonl"
    path.write_bytes(b'{"event": "note", "value": NaN}\n' + DEEP + b"\n")
    good = LiveFile(tmp_path).after(0)
    assert good["events"] == [{"event": "note", "value": None}]
    assert good["bad"] == 1
    damage(path, tmp_path / "outside")
    with memory_within(SMALL):
        told = answered(LiveFile(tmp_path).after, 0)
    if damage in (sparse, one_byte_more):  # read in pieces, for it may grow
        assert told["events"] == good["events"]
    else:
        assert told["events"] == []


JOB = {"run": "r"}


@pytest.fixture
def work(tmp_path):
    """A work folder with two groups of arrays."""
    folder = tmp_path / "result.work"
    with begin(folder, JOB) as checkpoint:
        checkpoint["signature"] = {"a": np.arange(9.0)}
        checkpoint["view"] = {"b": np.arange(4.0)}
    (tmp_path / "outside").mkdir()
    return folder


def taken_up(folder, most=2**20):
    with begin(folder, JOB, most) as checkpoint:
        return {name: dict(checkpoint[name]) for name in checkpoint}


@pytest.mark.parametrize(
    "damage", [one for one in DAMAGES if one is not link_to_folder], ids=lambda one: one.__name__
)
@pytest.mark.parametrize("name", ["signature.arrays", "job.json", "lock", "folding"])
def test_a_work_folder_takes_nothing_else_up(work, name, damage, tmp_path):
    """What is not whole is made again; what a work folder cannot hold is refused, and nothing outside is touched."""
    (work / "folding").touch()
    whole = (work / name).read_bytes()
    damage(work / name, tmp_path / "outside")
    with memory_within(SMALL):
        if damage in (sparse, one_byte_more):
            left = answered(taken_up, work)
            expected = {"signature.arrays": {"view"}, "job.json": set()}.get(
                name, {"signature", "view"}
            )
            assert set(left) == expected
        else:
            # The error names the output, and the work folder as that beside it.
            with pytest.raises((ValueError, OSError), match=str(work.with_suffix(""))):
                answered(taken_up, work)
    if damage is link_to_file:
        assert (tmp_path / "outside" / name).read_bytes() == whole


def test_arrays_may_not_share_bytes(tmp_path):
    """Else a small file would hold a thousand large arrays."""
    from flgpr.json_text import canonical_json

    body = bytes(6400)
    entry = {"dtype": "<f8", "shape": [800], "sha256": sha256(body)}
    head = canonical_json(
        {"about": {}, "arrays": [entry | {"name": f"a{k}", "at": 0} for k in range(1000)]}
    )
    (tmp_path / "a.arrays").write_bytes(f"{len(head)} {sha256(head)}\n".encode() + head + body)
    checkpoint = Checkpoint(tmp_path)
    with pytest.raises(ValueError, match="must begin where the array before it ends"):
        checkpoint["a"]
    entry |= {"dtype": "<U0", "shape": [10**15], "sha256": sha256(b""), "name": "a", "at": 0}
    head = canonical_json({"about": {}, "arrays": [entry]})
    (tmp_path / "b.arrays").write_bytes(f"{len(head)} {sha256(head)}\n".encode() + head)
    with pytest.raises(ValueError, match=r"got the type .<U0"):
        checkpoint["b"]


@pytest.mark.parametrize("most", [2**20, 100])
def test_a_group_is_bounded(work, most):
    assert set(taken_up(work, most)) == ({"signature", "view"} if most > 1000 else set())


def test_nothing_is_added_through_a_link(copied):
    folder, outside = copied("viewer")
    link_to_folder(folder / "view" / "index.json", outside)
    with pytest.raises(
        ValueError, match="must lie in folders of its own, got a symbolic link at view"
    ):
        add_files(folder, {"view/score.json": b"{}"})
    assert sha256((outside / "moved" / "score.json").read_bytes()) != sha256(b"{}")


def test_live_events_are_not_written_through_a_link(tmp_path):
    from flgpr.live.events import EventFile

    (tmp_path / "secret").write_text("kept\n")
    (tmp_path / "live.jsonl").symlink_to(tmp_path / "secret")
    for fresh in (True, False):
        with pytest.raises(ValueError, match="must be a regular file, got a symbolic link"):
            EventFile(tmp_path / "live.jsonl", fresh)
    assert (tmp_path / "secret").read_text() == "kept\n"


def test_a_result_of_gprmax_cannot_lead_out(tmp_path):
    folder = decks_folder(tmp_path)
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest |= {
        "tones": {"start": 1e9, "step": 1e6, "count": 3},
        "runs": [{"file": "../secret", "free": "air"}],
    }
    (folder / "manifest.json").write_text(json.dumps(manifest))
    (tmp_path / "secret.h5").write_text("secret")
    with pytest.raises(ValueError, match="must be relative and stay inside"):
        gprmax_decks.GprmaxRun(folder)
