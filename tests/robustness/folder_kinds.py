"""Every kind of folder that somebody else may have made: how it is made and read, and its files."""

import json
import shutil

import numpy as np
import pytest
from test_flips import learnt_stage, make_result, small_classifier

from flgpr.live.state import FORMAT, SNAPSHOT_FILE, VERSION, read_snapshot
from flgpr.method.model import describe_model, load_model, save_model
from flgpr.model import Lane, make_run
from flgpr.results.manifest import read_result_manifest
from flgpr.results.result import Result, add_files, read_result
from flgpr.results.score import read_scored_truth
from flgpr.results.sections import read_sections, write_sections
from flgpr.store import (
    open_run,
    save_run,
    sha256,
    write_bundle,
)
from flgpr.store.scan_file import RUN_FILE, RunDescription, read_description, write_description
from flgpr.viewer.scores import ScoreFiles
from flgpr.viewer.session import ResultFiles, open_source
from flgpr_exchange.gprmax import deck_results as gprmax_decks
from flgpr_ground.lanes import read_ground
from flgpr_ground.running import read_costs
from scored import find_entrant
from small_results import small_result


def scored_result(home):
    folder = make_result(home / "result", None)
    result = read_result(folder)
    content = {"truth": {"x": [1.0]}, "objects": None, "result_sha256": result.manifest["identity"]}
    body = json.dumps(content, sort_keys=True, separators=(",", ":"))
    score = f'{{"sha256":"{sha256(body.encode())}","content":{body}}}'
    add_files(folder, {"view/score.json": score})
    return folder


def score_folder(home):
    point = {"group": "all", "far_allowed": 0.1, "n_targets": 3}
    point |= dict.fromkeys(("pd", "pd_low", "pd_high", "chance", "far", "far_low", "far_high"), 0.1)
    main = {"points": [point | {"n_detected": 1, "n_false": 2}], "area": 10.0}
    told = {
        "format": "flgpr-score",
        "version": 1,
        "rules": {},
        "notes": {},
        "detections": {"main": main},
    }
    folder = home / "score"
    folder.mkdir()
    (folder / "roc.json").write_text(json.dumps(told))
    return folder


def lane_in_sections(home):
    folder = home / "lane"
    folder.mkdir()
    for name in ("section-1", "section-2"):
        small_result(folder / name)
    shutil.copy(folder / "section-1" / "alarms.csv", folder / "alarms.csv")
    (folder / "lane.toml").write_text("x_min = -1.0\nx_max = 1.0\ny_min = 2.0\ny_max = 4.0\n")
    write_sections(folder, ["section-1", "section-2"], {"run": "r"})
    return folder


def live_folder(home):
    (home / "live").mkdir()
    write_bundle(
        home / "live" / SNAPSHOT_FILE, {"a": np.arange(3.0)}, {"format": FORMAT, "version": VERSION}
    )
    return home / "live"


def incoming_folder(home):
    (home / "incoming").mkdir()
    places = np.array([[0.0, 0.0, 2.0]])
    write_description(
        RunDescription(np.array([1e9, 2e9]), ["HH"], places, places), home / "incoming"
    )
    return home / "incoming"


def benchmark_folder(home):
    folder = home / "ground"
    folder.mkdir()
    (folder / "ground.json").write_text('{"quick": true}')
    (folder / "costs.json").write_text('{"lane": {"processor_seconds": 1.0, "peak_bytes": 2.0}}')
    return folder


def decks_folder(home):
    (home / "decks").mkdir()
    told = dict.fromkeys(gprmax_decks._NEEDED, "") | {"format": gprmax_decks.FORMAT}
    (home / "decks" / "manifest.json").write_text(json.dumps(told))
    return home / "decks"


def view(folder):
    source = ResultFiles(folder)
    return source.index_bytes(), source.score_bytes(), source.tile(0, 0, 0)


def both_scores(folder):
    ScoreFiles(folder / "roc.json")
    open_source(folder)


def open_run_of_four():
    rng = np.random.default_rng(3)
    signal = rng.normal(size=(4, 1, 2, 3)) + 1j * rng.normal(size=(4, 1, 2, 3))
    return make_run(
        signal, [1e9, 1.1e9, 1.2e9], ["HH"], np.zeros((2, 3)), np.ones((2, 3)), np.zeros((4, 6))
    )


def read_model_of(folder):
    """Read the model of a result as its manifest lists it, though reading the whole result would refuse it before."""
    files = read_manifest_only(folder)
    return files.model()


def read_manifest_only(folder):
    manifest = read_result_manifest(folder)
    return Result(folder, manifest, None, Lane(**manifest["lane"]), [])


def read_ground_mark(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("flgpr_ground.lanes.load_ground", lambda quick, source: quick)
        return read_ground(folder)


KINDS = {  # how a folder is made and read, and which of its files are damaged
    "store": (
        lambda home: save_run(open_run_of_four(), home / "run.zarr"),
        lambda folder: open_run(folder).load(),
        ["commit.json", "zarr.json", "pose/zarr.json", "pose/c/0/0", "signal/c/1/0/0/0"],
    ),
    "result": (
        scored_result,
        read_result,
        [
            "manifest.json",
            "alarms.csv",
            "features.csv",
            "run_view.npz",
            "recipe.toml",
            "alarms.json",
            "report.html",
            "roc.json",
            "view/index.json",
            "view/layers/main.0.0.0.f16",
            "view/score.json",
        ],
    ),
    "result's model": (
        lambda home: make_result(home / "result", None),
        lambda folder: read_model_of(folder),
        ["model/model.bundle"],
    ),
    "viewer": (
        scored_result,
        view,
        ["manifest.json", "view/index.json", "view/layers/main.0.0.0.f16", "view/score.json"],
    ),
    "scored truth": (
        scored_result,
        lambda folder: read_scored_truth(read_manifest_only(folder)),
        ["view/score.json"],
    ),
    "list of a result": (scored_result, find_entrant, ["manifest.json", "alarms.csv"]),
    "model": (
        lambda home: save_model(small_classifier(), home / "model"),
        load_model,
        ["model.bundle"],
    ),
    "learnt stage": (lambda home: learnt_stage(home / "stage"), load_model, ["model.bundle"]),
    "told model": (
        lambda home: save_model(small_classifier(), home / "model"),
        describe_model,
        ["model.bundle"],
    ),
    "sections": (
        lane_in_sections,
        read_sections,
        ["sections.json", "alarms.csv", "lane.toml", "section-1/manifest.json"],
    ),
    "score": (score_folder, both_scores, ["roc.json"]),
    "live": (live_folder, lambda folder: read_snapshot(folder / SNAPSHOT_FILE), [SNAPSHOT_FILE]),
    "incoming": (incoming_folder, read_description, [RUN_FILE]),
    "benchmark": (
        benchmark_folder,
        lambda folder: (read_ground_mark(folder), read_costs(folder)),
        ["ground.json"],
    ),
    "costs": (benchmark_folder, read_costs, ["costs.json"]),
    "gprMax decks": (decks_folder, gprmax_decks.read_manifest_of_decks, ["manifest.json"]),
}
UNDIGESTED = {"score", "incoming", "benchmark", "costs", "gprMax decks"}
"""Folders whose files have no digest: a byte more makes no difference in them."""
